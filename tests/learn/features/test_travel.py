"""Features in the frame of a box that moves stay when the table is turned or moved; faces are found by rays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from learn.features.scene import Table, knots, scene_of
from learn.features.travel import travel_features
from learn.features.windows import windows_of
from tests.learn.recognize import made

TABLE = Table(made.SLOPE, made.HEIGHT)
LEVEL = Table(0.0, -1.0)
Floats = NDArray[np.float64]


def around(places: Floats, hands: Floats, body: Floats) -> list[Floats]:
    """The features that are made of places alone, but the heading itself."""
    scene = scene_of(windows_of(made.scene(1)), TABLE)
    n = len(scene.corners)
    parts = (np.broadcast_to(part, (n, *part.shape)) for part in (places, hands, body))
    return travel_features(scene, *parts)[:7]


def turned(points: Floats, angle: float) -> Floats:
    cos, sin = np.cos(angle), np.sin(angle)
    found = points.copy()
    found[..., :2] = points[..., :2] @ np.array([[cos, sin], [-sin, cos]]) + [0.3, -2.0]
    return found


@pytest.mark.parametrize("angle", [0.4, 2.0, -3.0])
def test_a_table_that_is_turned_and_moved_changes_nothing(angle: float) -> None:
    generator = np.random.default_rng(0)
    parts = [generator.normal(size=shape) for shape in ((5, 2, 2), (5, 2, 3), (5, 3))]
    before, after = around(*parts), around(*(turned(part, angle) for part in parts))
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def marker(normal: Floats, middle: Floats) -> Floats:
    """Corners (4, 3) of a square that faces ``normal``."""
    first = np.cross(normal, [0.2, 1.0, 0.3])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.05
    return middle + signs @ np.stack([first, second])


@pytest.mark.parametrize("normal", [[0.0, 0.9, -0.4], [0.6, 0.4, -0.7], [-0.8, 0.1, -0.6]])
def test_where_a_face_looks_follows_from_rays_alone(normal: list[float]) -> None:
    """The depth of a corner is of no use, and its features tell up from the table."""
    facing = np.array(normal) / np.linalg.norm(normal)
    corners = marker(facing, np.array([0.1, -0.7, 1.8]))
    corners *= np.linspace(0.8, 1.5, 4)[:, None]  # farther along the same rays
    frames = np.zeros((20, 21, 3))
    frames[:, 13:17] = frames[:, 17:] = corners
    scene = scene_of(frames[None], LEVEL)
    parts = travel_features(scene, knots(scene.boxes), knots(scene.hands), knots(scene.body))
    upright = [part for part in parts if part.shape == (1, 5, 2) and np.allclose(part, facing[1])]
    assert len(upright) == 1


def test_all_is_finite_where_nothing_was_seen() -> None:
    scene = scene_of(np.full((2, 20, 21, 3), np.nan), TABLE)
    parts = travel_features(scene, knots(scene.boxes), knots(scene.hands), knots(scene.body))
    assert all(np.isfinite(part).all() for part in parts)
