"""Bundle adjustment of several recordings at once."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import OUTERMOST, Sightings, corner_sharpness, place
from ecat.geometry.bundle import Track, adjust
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.transforms import Rigid, matrix_about_z, matrix_from_rotvec
from ecat.model.prototype import STELLA_ARTOIS

TABLES = [
    Rigid(matrix_from_rotvec(np.array([tilt, 0.1, 0.0])), np.array([0.0, 0.2, away]))
    for tilt, away in ((-2.2, 1.4), (-2.1, 1.6), (-2.3, 1.5))
]


def track(table: int, n: int = 7) -> Track:
    """What a camera sees of a box that rests on a table at n places, three of its faces, with some noise."""
    rng = np.random.default_rng(table)
    x, y = rng.uniform(-0.2, 0.2, (2, n))
    pose = Rigid(
        matrix_about_z(rng.uniform(-0.5, 0.5, n)),
        np.stack([x, y, np.full(n, STELLA_ARTOIS.size_m[2] / 2)], -1),
    )
    points = TABLES[table].apply(place(pose, box_corners(STELLA_ARTOIS)))
    pixels = KINECT_V2_COLOR.project(points) + rng.normal(0, 0.2, (*points.shape[:-1], 2))
    pixels[:, 3:] = np.nan
    sharpness = np.nan_to_num(corner_sharpness(pixels, OUTERMOST))
    return Track(table, 0, Sightings(pixels, np.full_like(points, np.nan), sharpness))


def test_tracks_solved_together_say_what_they_say_one_by_one() -> None:
    apart = [track(table) for table in range(len(TABLES))]
    [joined] = Track.joined(apart)
    one, other = (
        adjust(tracks, TABLES, [STELLA_ARTOIS], KINECT_V2_COLOR, OUTERMOST) for tracks in (apart, [joined])
    )
    assert one.residual_px == pytest.approx(other.residual_px)
    assert one.prototypes[0].size_m == pytest.approx(other.prototypes[0].size_m, abs=1e-9)
    for a, b in zip(one.tables, other.tables, strict=True):
        np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-9)
        np.testing.assert_allclose(a.translation, b.translation, atol=1e-9)


def test_joined_tracks_keep_every_frame_with_its_table_and_never_many_at_once() -> None:
    apart = [track(0, 300), track(2, 300), track(1, 5)]
    pieces = Track.joined(apart)
    assert [len(piece) for piece in pieces] == [512, 93]
    tables = np.concatenate([np.broadcast_to(piece.table, len(piece)) for piece in pieces])
    assert tables.tolist() == [0] * 300 + [2] * 300 + [1] * 5
    pixels = np.concatenate([piece.seen.pixels for piece in pieces])
    np.testing.assert_array_equal(pixels, np.concatenate([t.seen.pixels for t in apart]))
