"""The part of a depth image inside a shape, and its convex hull."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.cameras import Camera
from ecat.geometry.depth import DepthCamera, color_pixels
from ecat.geometry.hulls import convex_hull, object_points
from ecat.geometry.transforms import Floats

CAMERA = Camera("depth", 120, 90, fx=100.0, fy=100.0, cx=59.5, cy=44.5)
SQUARE = np.array([[38.0, 28.0], [82.0, 28.0], [82.0, 62.0], [38.0, 62.0]])


def seen(depth: Floats) -> tuple[Floats, Floats]:
    cloud = DepthCamera(CAMERA).cloud(np.rint(depth * 1000).astype(np.uint16))
    return cloud, color_pixels(cloud, CAMERA)


def thing() -> Floats:
    """A thing at 1 m before a wall at 2 m."""
    depth = np.full((90, 120), 2.0)
    depth[30:60, 40:80] = 1.0
    return depth


def test_only_the_thing_is_taken_from_a_shape_drawn_too_large() -> None:
    points = object_points(*seen(thing()), SQUARE)
    assert set(points[:, 2]) == {1.0}
    assert 1000 < len(points) <= 1200


def test_the_table_is_no_part_of_it() -> None:
    depth = np.full((90, 120), 1.5)
    depth[30:60, 40:80] = 1.48
    plane = (np.array([0.0, 0.0, -1.0]), 1.5)
    points = object_points(*seen(depth), SQUARE, plane)
    assert set(points[:, 2]) == {1.48}
    depth[30:60, 40:80] = 1.497
    assert not len(object_points(*seen(depth), SQUARE, plane))


def test_what_hides_the_thing_is_not_the_thing() -> None:
    depth = thing()
    depth[30:60, 40:65] = 0.7
    cloud, pixels = seen(depth)
    assert object_points(cloud, pixels, SQUARE)[:, 2] == pytest.approx(0.7)
    assert set(object_points(cloud, pixels, SQUARE, distance_m=(0.95, 1.1))[:, 2]) == {1.0}
    assert not len(object_points(cloud, pixels, SQUARE, distance_m=(3, 4)))


def test_a_shape_beyond_the_image_has_no_points() -> None:
    cloud, pixels = seen(thing())
    assert not len(object_points(cloud, pixels, SQUARE + 500))
    assert not len(object_points(np.full_like(cloud, np.nan), np.full_like(pixels, np.nan), SQUARE))


def test_the_hull_of_a_cube_has_its_corners() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (2, 3)], float)
    hull = convex_hull(np.concatenate([corners, rng.uniform([0.1, 0.1, 2.1], [0.9, 0.9, 2.9], (200, 3))]))
    assert hull is not None
    assert sorted(map(tuple, hull)) == sorted(map(tuple, corners))


def test_a_round_hull_is_thinned_but_keeps_its_size() -> None:
    ball = np.random.default_rng(0).standard_normal((3000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    hull = convex_hull(ball)
    assert hull is not None
    assert 30 <= len(hull) <= 48
    assert np.ptp(hull, axis=0) == pytest.approx([2, 2, 2], abs=0.1)


@pytest.mark.parametrize("points", [np.zeros((3, 3)), np.zeros((50, 3)), np.eye(3)[[0, 1, 0, 1, 0]]])
def test_what_spans_no_volume_has_no_hull(points: Floats) -> None:
    assert convex_hull(points) is None
