"""Planes in depth images: right with noise, holes and things before them, and honest about their error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.geometry.cameras import KINECT_V2_DEPTH, Camera
from ecat.geometry.depth import DepthCamera, RangeNoise
from ecat.geometry.faceplanes import FaceFit, fit_faces
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec

NORMAL: Floats = np.array([0.3, -0.4, -0.866]) / np.linalg.norm([0.3, -0.4, -0.866])
MIDDLE: Floats = np.array([0.1, 0.05, 1.4])
NOISE = RangeNoise(floor_m=0.0005, square=0.0007)


def quad(camera: Camera, side_m: float = 0.09) -> Floats:
    """Pixels (1, 4, 2) of a square round MIDDLE in the plane."""
    x = np.cross(NORMAL, [0.0, 1.0, 0.0])
    x = x / np.linalg.norm(x)
    y = np.cross(NORMAL, x)
    arms = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side_m / 2
    return camera.project(MIDDLE + arms @ np.stack([x, y]))[None]


def depth_of(camera: Camera, seed: int = 0, noise: RangeNoise | None = None) -> NDArray[np.uint16]:
    """The plane all over the image, in tenths of a millimetre."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.unproject(np.stack([u, v], -1).astype(float))
    z = (MIDDLE @ NORMAL) / (rays @ NORMAL)
    z = np.where((z > 0) & (z < 6), z, 6.0)
    if noise is not None:
        z = z + noise.sigma(z) * np.random.default_rng(seed).normal(size=z.shape)
    return np.rint(z * 1e4).astype(np.uint16)


def fitted(image: NDArray[np.uint16], camera: Camera = KINECT_V2_DEPTH, steady_m: float = 1e-4) -> FaceFit:
    depth = DepthCamera(camera, 1e-4)
    return fit_faces([image], quad(camera), np.zeros(1, int), depth, noise=NOISE, steady_m=steady_m)


def off_degrees(fit: FaceFit) -> float:
    return float(np.degrees(np.arccos(np.clip(fit.normal[0] @ NORMAL, -1, 1))))


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_plane_without_noise_is_found(mirrored: bool) -> None:
    camera = replace(KINECT_V2_DEPTH, mirrored=mirrored)
    fit = fitted(depth_of(camera), camera)
    assert off_degrees(fit) < 0.05
    assert fit.normal[0] @ MIDDLE + fit.offset[0] == pytest.approx(0, abs=1e-4)
    assert fit.offset[0] > 0  # towards the camera
    assert fit.n_points[0] > 60


def test_the_stated_error_is_the_real_one() -> None:
    off: list[float] = []
    x = np.cross(NORMAL, [0.0, 1.0, 0.0])
    corner = MIDDLE + 0.045 * (x / np.linalg.norm(x) + np.cross(NORMAL, x / np.linalg.norm(x)))
    for seed in range(60):
        fit = fitted(depth_of(KINECT_V2_DEPTH, seed, NOISE), steady_m=0.0)
        off.append(float((fit.normal[0] @ corner + fit.offset[0]) / fit.sigma_m[0]))
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_what_is_before_the_face_and_holes_are_left_out() -> None:
    image = depth_of(KINECT_V2_DEPTH, 1, NOISE)
    (left, top), (right, bottom) = quad(KINECT_V2_DEPTH)[0].min(0), quad(KINECT_V2_DEPTH)[0].max(0)
    third = slice(round(left), round(left + (right - left) / 4))
    image[round(top) : round(bottom), third] = 9000
    image[round(top) : round(top) + 5] = 0
    fit = fitted(image)
    assert off_degrees(fit) < 1.5
    assert abs(fit.normal[0] @ MIDDLE + fit.offset[0]) < 0.001


def test_a_face_of_which_most_is_missing_has_no_plane() -> None:
    image = depth_of(KINECT_V2_DEPTH)
    image[:, : round(quad(KINECT_V2_DEPTH)[0, :, 0].mean()) + 3] = 0
    assert np.isnan(fitted(image).sigma_m[0])
    assert np.isnan(fitted(0 * image).sigma_m[0])


def test_planes_are_told_in_the_frame_of_reference() -> None:
    place = Rigid(matrix_from_rotvec(np.array([0.0, 0.2, 0.1])), np.array([0.05, 0.0, -0.02]))
    camera = replace(KINECT_V2_DEPTH, from_reference=place)
    fit = fitted(depth_of(KINECT_V2_DEPTH), camera)
    back = place.inverse()
    np.testing.assert_allclose(fit.normal[0], back.rotation @ NORMAL, atol=1e-3)
    assert fit.normal[0] @ back.apply(MIDDLE) + fit.offset[0] == pytest.approx(0, abs=1e-4)


def test_quadrilaterals_beyond_the_image_have_no_plane() -> None:
    away = quad(KINECT_V2_DEPTH) + np.array([2000.0, 0.0])
    depth = DepthCamera(KINECT_V2_DEPTH, 1e-4)
    fit = fit_faces([depth_of(KINECT_V2_DEPTH)], away, np.zeros(1, int), depth, noise=NOISE, steady_m=1e-4)
    assert np.isnan(fit.sigma_m[0])
    assert fit.n_points[0] == 0


def test_faces_of_several_images_are_those_of_each_image() -> None:
    depth = DepthCamera(KINECT_V2_DEPTH, 1e-4)
    images = [depth_of(KINECT_V2_DEPTH, seed, NOISE) for seed in (1, 2)]
    large, small = quad(KINECT_V2_DEPTH), quad(KINECT_V2_DEPTH, 0.03) + 5
    quads = np.concatenate([large, small, large + 3])
    together = fit_faces(iter(images), quads, np.array([0, 0, 1]), depth, noise=NOISE, steady_m=1e-3)
    for row, image in enumerate((0, 0, 1)):
        alone = fit_faces([images[image]], quads[[row]], np.zeros(1, int), depth, noise=NOISE, steady_m=1e-3)
        for name in ("normal", "offset", "sigma_m", "rms_m", "n_points"):
            np.testing.assert_allclose(getattr(together, name)[row], getattr(alone, name)[0], rtol=1e-9)
