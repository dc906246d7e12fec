"""Depth images as points, and where they are in a colour image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH, Camera
from ecat.geometry.depth import DepthCamera, color_pixels, depth_at, inside, steady
from ecat.geometry.transforms import Rigid, matrix_from_rotvec

SMALL = Camera("depth", 64, 48, fx=60.0, fy=61.0, cx=30.5, cy=24.0)
BENT = replace(KINECT_V2_COLOR, distortion=(0.08, -0.05, 0.001, -0.002, 0.01, 0.0, 0.0, 0.0))


def test_a_cloud_projects_back_onto_its_pixels() -> None:
    depth = np.full((48, 64), 1500, np.uint16)
    depth[3, 5] = 0
    cloud = DepthCamera(SMALL).cloud(depth)
    assert np.isnan(cloud[3, 5]).all()
    assert cloud[10, 20] == pytest.approx([(20 - 30.5) / 60 * 1.5, (10 - 24) / 61 * 1.5, 1.5])
    np.testing.assert_allclose(color_pixels(cloud, SMALL)[10, 20], [20, 10], atol=1e-9)


def test_the_unit_of_the_images_counts() -> None:
    depth = np.full((48, 64), 5000, np.uint16)
    assert DepthCamera(SMALL, unit_m=1 / 5000).cloud(depth)[0, 0, 2] == pytest.approx(1.0)


def test_a_cloud_is_in_the_frame_in_which_points_are_given() -> None:
    place = Rigid(matrix_from_rotvec(np.array([0.1, 0.2, 0.3])), np.array([0.5, 0.0, -0.1]))
    moved = replace(SMALL, from_reference=place)
    depth = np.full((48, 64), 900, np.uint16)
    own, given = DepthCamera(SMALL).cloud(depth), DepthCamera(moved).cloud(depth)
    np.testing.assert_allclose(place.apply(given), own, atol=1e-12)


@pytest.mark.parametrize("camera", [KINECT_V2_COLOR, BENT, replace(BENT, mirrored=False), KINECT_V2_DEPTH])
def test_fast_projection_is_the_cameras_own(camera: Camera) -> None:
    points = np.random.default_rng(0).uniform([-0.6, -0.4, 0.8], [0.6, 0.4, 3], (500, 3))
    points[7] = [0, 0, -1]
    points[8] = np.nan
    np.testing.assert_allclose(color_pixels(points, camera), camera.project(points), atol=2e-3)


def test_inside_agrees_with_the_polygon() -> None:
    triangle = np.array([[10.0, 10.0], [110.0, 10.0], [10.0, 90.0]])
    pixels = np.random.default_rng(1).uniform(0, 120, (4000, 2))
    beyond = (pixels - [10, 10]) @ np.array([0.8, 1.0]) - 80
    true = (pixels > 10).all(1) & (beyond < 0)
    sure = (np.abs(pixels - 10) > 0.5).all(1) & (np.abs(beyond) > 1)
    np.testing.assert_array_equal(inside(pixels, triangle)[sure], true[sure])
    assert not inside(np.array([[np.nan, 20.0], [1e9, 20.0], [-5.0, -5.0]]), triangle).any()


def test_depth_at_a_pixel_is_that_of_what_is_in_front() -> None:
    pixels = np.array([[100.0, 100.0], [101.0, 100.0], [200.0, 50.0]])
    points = np.array([[0, 0, 2.0], [0, 0, 1.0], [0, 0, 3.0]])
    found = depth_at(np.array([[100.2, 100.0], [203.0, 50.0], [150.0, 75.0]]), pixels, points, reach_px=4)
    np.testing.assert_array_equal(found[:, 2], [1, 3, np.nan])


def test_outlines_and_lonely_pixels_are_not_steady() -> None:
    z = np.full((20, 20), 1.0)
    z[:, 10:] = 2.0
    z[5, 10] = 1.5  # between both sides
    z[15, 3] = 1.2  # a spike
    z[0:4, 0:4] = np.nan
    z[1, 1] = 1.0
    good = steady(z)
    assert not good[5, 10]
    assert not good[15, 3]
    assert not good[1, 1]
    assert good[10, 5]
    assert good[10, 15]
    assert good[z == 2].mean() > 0.9
