"""The covariance of a pose says how far it is off: by noise of corners, and by markers that are not quite in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import OUTERMOST, SUBPIXEL, Noise, Sightings, place
from ecat.geometry.boxpose import box_poses
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.poseerror import SteadyErrors
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec, quaternion_from_matrix
from ecat.model.prototype import STELLA_ARTOIS, BoxPrototype

Stand = Callable[[int], Rigid]


def measured(sigma_m: float | None) -> BoxPrototype:
    return replace(STELLA_ARTOIS, faces=tuple(replace(face, sigma_m=sigma_m) for face in STELLA_ARTOIS.faces))


def seen_with(pose: Rigid, table: Rigid, noise_px: float, shift_m: Floats) -> Sightings:
    """Corners of all faces, each marker ``shift_m`` (n, faces, 3) off in box axes."""
    rng = np.random.default_rng(3)
    moved = (
        place(pose, box_corners(STELLA_ARTOIS))
        + np.einsum("nij,nfj->nfi", pose.rotation, shift_m)[:, :, None]
    )
    pixels = KINECT_V2_COLOR.project(table.apply(moved))
    pixels = pixels + rng.normal(0, noise_px, pixels.shape)
    sharp = np.broadcast_to(np.eye(2), (*pixels.shape, 2))
    return Sightings(pixels, np.full((*pixels.shape[:-1], 3), np.nan), sharp)


def nees(pose: Rigid, true: Rigid, covariance: Floats) -> Floats:
    """Squared error over what was stated, per degree of freedom (n,)."""
    turn = 2 * quaternion_from_matrix(true.rotation @ np.swapaxes(pose.rotation, 1, 2))[:, :3]
    off = np.concatenate([true.translation - pose.translation, turn], 1)
    return np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[..., None])[..., 0]) / 6


@pytest.mark.parametrize("lifted", [False, True])
def test_noise_of_corners_is_told_rightly(table: Rigid, standing: Stand, lifted: bool) -> None:
    true = standing(300)
    if lifted:
        tilt = matrix_from_rotvec(np.array([0.2, 0.1, 0.0]))
        true = Rigid(tilt @ true.rotation, true.translation + np.array([0, 0, 0.1]))
    seen = seen_with(true, table, SUBPIXEL.sigma_px, np.zeros((300, 3, 3)))
    # as if the table were known to a hair, as it is here
    steady = SteadyErrors(table_m=1e-5, table_rad=1e-5)
    found = box_poses(seen, measured(1e-6), KINECT_V2_COLOR, table, noise=SUBPIXEL, steady=steady)
    assert (found.free == lifted).all()
    assert 0.4 < nees(found.pose, true, found.covariance).mean() < (1.3 if lifted else 1.1)


def test_markers_that_are_off_are_told_rightly(table: Rigid, standing: Stand) -> None:
    true = standing(300)
    shift = np.random.default_rng(8).normal(0, 0.001, (300, 3, 3))
    seen = seen_with(true, table, 0.02, shift)
    found = box_poses(seen, measured(0.001 * 2 * np.sqrt(3)), KINECT_V2_COLOR, table, noise=SUBPIXEL)
    assert 0.3 < nees(found.pose, true, found.covariance).mean() < 1.3


@pytest.mark.parametrize("noise", [OUTERMOST, SUBPIXEL])
def test_covariances_are_covariances(table: Rigid, standing: Stand, noise: Noise) -> None:
    true = standing(30)
    found = box_poses(
        seen_with(true, table, 0.1, np.zeros((30, 3, 3))), STELLA_ARTOIS, KINECT_V2_COLOR, table, noise=noise
    )
    np.testing.assert_allclose(found.covariance, np.swapaxes(found.covariance, 1, 2), atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


def test_a_box_a_little_above_the_plane_is_where_its_corners_say(table: Rigid, standing: Stand) -> None:
    """The plane is less well known than sub-pixel corners are."""
    rest = standing(50)
    true = Rigid(rest.rotation, rest.translation + np.array([0, 0, 0.001]))
    seen = seen_with(true, table, 0.02, np.zeros((50, 3, 3)))
    box = measured(1e-5)
    soft, hard = (
        box_poses(seen, box, KINECT_V2_COLOR, table, noise=noise)
        for noise in (SUBPIXEL, replace(SUBPIXEL, held=True))
    )
    off = [np.linalg.norm(found.pose.translation - true.translation, axis=1) for found in (soft, hard)]
    assert np.median(off[0]) < 0.3 * np.median(off[1])
    assert not soft.free.any()
