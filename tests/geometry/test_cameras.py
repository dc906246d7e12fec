"""Cameras project as OpenCV's do, mirrored ones left-right, and derivatives are those of the projection."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH, Camera
from ecat.geometry.transforms import Floats

LENS = (0.05, -0.07, 0.001, -0.002, 0.01, 0.002, 0.003, 0.001)
POINTS: Floats = np.random.default_rng(0).normal(size=(50, 3)) * 0.3 + [0, 0, 1.5]
CAMERAS = [
    KINECT_V2_COLOR,
    KINECT_V2_DEPTH,
    replace(KINECT_V2_COLOR, distortion=LENS),
    replace(KINECT_V2_COLOR, distortion=LENS, mirrored=False),
]


def test_the_colour_camera_is_the_fitted_model() -> None:
    """Source: ECAT 2018 file format §2.3, in Kinect camera space (x to the sensor's left, y up)."""
    x, y, z = 0.3, 0.1, 1.4
    u, v = KINECT_V2_COLOR.project(np.array([-x, -y, z]))
    assert u == pytest.approx(1065.5 * x / z + 54.66 / z + 967.1)
    assert v == pytest.approx(-1066.0 * y / z - 0.23 / z + 548.9)


def test_what_is_right_of_a_mirroring_camera_is_left_in_its_image() -> None:
    right, left = KINECT_V2_COLOR.project(np.array([[0.2, 0, 1], [-0.2, 0, 1.0]]))
    assert right[0] < left[0]


def test_lens_model_is_that_of_opencv() -> None:
    camera = replace(KINECT_V2_COLOR, distortion=LENS, mirrored=False)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    expected, _ = cv2.projectPoints(
        POINTS, np.zeros(3), camera.from_reference.translation, matrix, np.array(LENS)
    )
    np.testing.assert_allclose(camera.project(POINTS), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_derivatives_are_differences(camera: Camera) -> None:
    _, by_point = camera.project_jacobian(POINTS)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        slope = (camera.project(POINTS + step) - camera.project(POINTS - step)) / 2e-6
        np.testing.assert_allclose(by_point[..., axis], slope, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_go_through_what_is_seen(camera: Camera) -> None:
    inside = camera.from_reference.apply(POINTS)
    np.testing.assert_allclose(camera.unproject(camera.project(POINTS)) * inside[:, 2:], inside, atol=1e-9)


def test_what_is_behind_the_camera_is_not_seen() -> None:
    assert np.isnan(KINECT_V2_COLOR.project(np.array([0.0, 0.0, -1.0]))).all()
