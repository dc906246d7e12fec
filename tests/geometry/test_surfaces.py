"""Planes in depth images: which is the table, how well it is placed, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.cameras import Camera
from ecat.geometry.depth import DepthCamera, RangeNoise
from ecat.geometry.surfaces import (
    Surface,
    outline,
    resting_depth,
    surface_near,
    surfaces,
    tabletop,
)
from ecat.geometry.transforms import Floats

CAMERA = DepthCamera(Camera("depth", 160, 120, fx=130.0, fy=130.0, cx=79.5, cy=59.5))
NOISE = RangeNoise()
UP: Floats = np.array([0.0, -0.94, -0.34]) / np.hypot(0.94, 0.34)


def range_of(normal: Floats, offset: float) -> Floats:
    """Depth (h, w) of a plane, infinite where it is not before the camera."""
    inverse = -(CAMERA.rays @ normal) / offset
    return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1), np.inf)


def desk(rng: np.random.Generator, *, boxes: bool = True, noise: float = 1.0) -> Floats:
    """A table 0.73 m below a camera in a room, with a box on it; it ends at 2 m and on the right."""
    table, floor = range_of(UP, 0.73), range_of(UP, 1.47)
    wall = np.full(table.shape, 4.0)
    here = (table < 2) & (np.arange(160) < 120)
    z = np.minimum(np.where(here, table, np.inf), np.minimum(floor, wall))
    if boxes:
        z[60:85, 60:90] = np.minimum(z[60:85, 60:90], 1.2)
    return z + noise * NOISE.sigma(z) * rng.standard_normal(z.shape)


def off(surface: Surface) -> tuple[float, float]:
    """Degrees, and millimetres where the camera looks at the table."""
    at = CAMERA.rays[70, 80] * range_of(UP, 0.73)[70, 80]
    angle = np.degrees(np.arccos(np.clip(surface.normal @ UP, -1, 1)))
    return float(angle), float(1000 * abs(surface.normal @ at + surface.offset))


def test_of_table_floor_and_wall_the_table_is_the_table() -> None:
    z = desk(np.random.default_rng(0))
    found = surfaces(z, CAMERA.rays, NOISE)
    offsets = {round(surface.offset, 1) for surface in found}
    assert {0.7, 1.5, 4.0} <= offsets
    best = tabletop(found)
    assert best is not None
    angle, height_mm = off(best)
    assert angle < 0.3
    assert height_mm < 2


@pytest.mark.parametrize("seed", range(4))
def test_what_stands_on_the_table_does_not_lift_it(seed: int) -> None:
    """Many things that stand on one side of the plane, in noise twice as strong as believed."""
    rng = np.random.default_rng(seed)
    z = desk(rng, noise=2.0)
    cover = rng.random(z.shape) < 0.25
    z[cover] -= rng.uniform(0, 0.1, cover.sum())
    best = tabletop(surfaces(z, CAMERA.rays, NOISE))
    assert best is not None
    angle, height_mm = off(best)
    assert angle < 0.3
    assert height_mm < 3


def test_a_surface_is_found_where_it_is_believed_to_be() -> None:
    z = desk(np.random.default_rng(0))
    floor = surface_near(UP, 1.45, z, CAMERA.rays, NOISE)
    assert floor is not None
    assert floor.offset == pytest.approx(1.47, abs=0.005)
    assert surface_near(UP, 1.1, z, CAMERA.rays, NOISE) is None
    assert surface_near(np.array([1.0, 0.0, 0.0]), 0.5, z, CAMERA.rays, NOISE) is None


def test_seen_from_straight_above_size_decides() -> None:
    z = np.full((120, 160), 1.2)
    z[:8] = 2.0
    best = tabletop(surfaces(z, CAMERA.rays, NOISE))
    assert best is not None
    assert best.normal == pytest.approx([0, 0, -1], abs=1e-6)
    assert best.offset == pytest.approx(1.2)


def test_the_outline_is_the_tables_and_runs_round_its_normal() -> None:
    z = np.full((120, 160), 2.0)
    z[30:90, 40:120] = 1.0
    best = tabletop(surfaces(z, CAMERA.rays, NOISE))
    assert best is not None
    near = surface_near(np.array([0, 0, -1.0]), 1.0, z, CAMERA.rays, NOISE)
    assert near is not None
    ring = outline(near, CAMERA.rays)
    assert ring[:, 2] == pytest.approx(1)
    u, v = (ring[:, :2] * 130 + [79.5, 59.5]).T
    assert sorted(np.rint(u)) == [40, 40, 119, 119]
    assert sorted(np.rint(v)) == [30, 30, 89, 89]
    turn = np.cross(ring[1] - ring[0], ring[2] - ring[1])
    assert turn @ near.normal > 0


def test_an_image_of_nothing_has_no_surface() -> None:
    assert surfaces(np.full((120, 160), np.nan), CAMERA.rays, NOISE) == []
    assert tabletop([]) is None
    assert surfaces(np.random.default_rng(0).uniform(0.5, 4, (120, 160)), CAMERA.rays, NOISE) == []


def test_resting_depth_forgets_hands_and_holes() -> None:
    stack = np.full((11, 4, 100), 1000, np.uint16)
    stack[:4, 1] = 600  # a hand
    stack[4:8, 1] = 0  # its shadow
    stack[8:, 1] = 1001
    stack[:, 2] = 0
    stack[0, 2] = 800  # measured once
    stack[:, 3] = np.arange(1000, 1011)[:, None]
    resting = resting_depth(stack)
    assert set(resting[0]) == {1000}
    assert set(resting[1]) == {600}
    assert np.isnan(resting[2]).all()
    assert set(resting[3]) == {1005}
