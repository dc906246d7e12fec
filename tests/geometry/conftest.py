"""A box on a table before a camera, with known truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import Noise, Sightings, corner_sharpness, place
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.planes import plane_frame
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z
from ecat.model.prototype import STELLA_ARTOIS

TABLE = plane_frame(np.array([0.0, -0.942, -0.336]), 0.73)


@pytest.fixture
def table() -> Rigid:
    """camera-from-table, as in the real recordings."""
    return TABLE


@pytest.fixture
def standing() -> Callable[[int], Rigid]:
    """Poses table-from-box of boxes that rest on the table where the camera sees three faces."""

    def make(n: int) -> Rigid:
        rng = np.random.default_rng(4)
        xy = rng.uniform([-0.3, -1.2], [0.3, -0.7], (n, 2))
        turn = matrix_about_z(rng.uniform(-1.1, -0.5, n))
        return Rigid(turn, np.column_stack([xy, np.full(n, 0.0762)]))

    return make


@pytest.fixture
def look() -> Callable[..., Sightings]:
    """What the camera sees of the box at given poses: corners with noise; faces turned away are not seen."""

    def see(pose: Rigid, noise_px: float = 0.0, *, depth: bool = False) -> Sightings:
        rng = np.random.default_rng(5)
        placed = TABLE.apply(place(pose, box_corners(STELLA_ARTOIS)))
        normal = np.cross(placed[..., 1, :] - placed[..., 0, :], placed[..., 3, :] - placed[..., 0, :])
        eye = KINECT_V2_COLOR.from_reference.inverse().translation
        away: Floats = (normal * (placed.mean(2) - eye)).sum(-1)
        seen = (away > 0)[
            ..., None, None
        ]  # TL, TR, BL of a print seen from the front turn against its normal
        pixels = KINECT_V2_COLOR.project(placed) + rng.normal(0, noise_px, (*placed.shape[:-1], 2))
        pixels = np.where(seen, pixels, np.nan)
        points = np.where(seen, placed, np.nan) if depth else np.full_like(placed, np.nan)
        return Sightings(pixels, points, np.nan_to_num(corner_sharpness(pixels, Noise())))

    return see
