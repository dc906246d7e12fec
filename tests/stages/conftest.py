"""Sessions for the stages: generated ones with known truth, and the real ones beside the checkout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecat.geometry.transforms import Floats, Rigid, matrix_about_z
from ecat.model.prototype import STELLA_ARTOIS
from tests.stages.recorded import SESSIONS, TABLE, Recorded, clock_of, marker_tables, read_session


@pytest.fixture(scope="session")
def generated() -> Callable[..., Recorded]:
    """Sessions of one box that slides and turns on the table, with markers not quite where they should be."""
    faces = STELLA_ARTOIS.faces
    true = replace(
        STELLA_ARTOIS,
        faces=(
            replace(faces[0], centre=(-0.003, 0.001, 0.0762), side_m=0.085),
            replace(faces[1], centre=(0.002, -0.0762, -0.001)),
            replace(faces[2], centre=(0.0762, 0.004, 0.002), side_m=0.091),
        ),
    )

    def make(n: int = 300, noise_px: float = 0.2, lift: Floats | None = None) -> Recorded:
        s = np.linspace(0, 1, n)
        yaw = -0.8 + 0.6 * np.sin(5 * s)
        xyz = np.column_stack([0.35 * np.cos(7 * s), -0.95 + 0.25 * np.sin(11 * s), np.full(n, 0.0762)])
        pose = Rigid(matrix_about_z(yaw), xyz + (0 if lift is None else lift))
        flat, solid = marker_tables(true, pose, noise_px)
        corners = np.array([[-0.6, -1.4, 0], [0.6, -1.4, 0], [0.6, -0.2, 0], [-0.6, -0.2, 0]])
        polygon = TABLE.apply(corners)
        clock = clock_of(n, n * 1e9 / 30)
        return Recorded(clock, flat, solid, polygon, {"o2": true.name}, pose, true, TABLE)

    return make


@pytest.fixture(scope="session")
def real(shared: Path) -> dict[tuple[str, str], Recorded]:
    """The three given Kinect sessions, read directly, so that these tests stand without the importer."""
    return {
        name: read_session(shared / "ecat_kinect" / name[0] / name[1] / "files.param") for name in SESSIONS
    }
