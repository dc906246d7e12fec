"""Features of windows: of the right windows, unmoved by glitches of depth, whole where points are missing."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.errors import InputError
from learn.features.points import SWAP_POINTS
from learn.features.windows import (
    Table,
    chunks_of,
    either_way,
    fit_table,
    mirror,
    session_features,
    window_features,
    windows_of,
)
from tests.learn.recognize import made

POINTS = made.scene(1)
DEPTH_AND_HEIGHT = 399
"""The first of these features."""
TABLE = Table(made.SLOPE, made.HEIGHT)


def test_windows_begin_every_five_frames_and_the_rest_is_unused() -> None:
    frames = np.arange(47.0)[:, None, None] + np.zeros((47, 21, 3))
    assert windows_of(frames)[:, [0, -1], 0, 0].tolist() == [[5.0 * i, 5.0 * i + 19] for i in range(6)]
    assert len(windows_of(frames[:19])) == 0


def test_the_table_is_found_among_glitches() -> None:
    points = POINTS.copy()
    points[::7, 13] *= 1.4
    table = fit_table(points)
    assert (table.slope, table.height) == (
        pytest.approx(made.SLOPE, abs=1e-3),
        pytest.approx(made.HEIGHT, abs=1e-3),
    )


def test_a_table_needs_corners() -> None:
    with pytest.raises(InputError):
        fit_table(np.full((4, 21, 3), np.nan))


def test_where_boxes_are_does_not_depend_on_their_depth() -> None:
    glitch = POINTS.copy()
    glitch[3:9, 14] *= 1.5  # farther along the same ray
    before, after = (window_features(windows_of(points), TABLE) for points in (POINTS, glitch))
    changed = np.flatnonzero((np.abs(before - after) > 1e-5).any(axis=0))
    depth_and_height = np.arange(DEPTH_AND_HEIGHT, DEPTH_AND_HEIGHT + 16)
    assert set(changed.tolist()) <= set(depth_and_height.tolist())


def test_unknown_points_take_the_nearest_known() -> None:
    features = window_features(
        windows_of(np.where(np.arange(45)[:, None, None] % 9 == 4, np.nan, POINTS)), TABLE
    )
    assert np.isfinite(features).all()
    assert np.isfinite(window_features(np.full((2, 20, 21, 3), np.nan), TABLE)).all()


def test_a_mirror_twice_and_an_exchange_twice_change_nothing() -> None:
    np.testing.assert_array_equal(mirror(mirror(POINTS)), POINTS)
    np.testing.assert_array_equal(POINTS[:, SWAP_POINTS][:, SWAP_POINTS], POINTS)


def test_features_of_both_ways_are_those_of_the_windows_and_of_exchanged_ones() -> None:
    windows = windows_of(POINTS)
    windows[1, 4:9, 13:17] = -1.0  # the first marker is lost
    first, second = either_way(windows, TABLE)
    np.testing.assert_array_equal(first, window_features(windows, TABLE))
    np.testing.assert_array_equal(second, window_features(windows[:, :, SWAP_POINTS], TABLE))


@pytest.mark.parametrize("n", [0, 1, 512, 513, 1025])
def test_parts_of_windows_are_all_of_them_in_order(n: int) -> None:
    parts = chunks_of(np.arange(n, dtype=np.float64))
    assert len(parts) == max(1, -(-n // 512))
    assert np.concatenate(parts).tolist() == list(range(n))


def test_windows_are_independent_of_each_other() -> None:
    windows = windows_of(POINTS)
    np.testing.assert_array_equal(window_features(windows, TABLE)[2:3], window_features(windows[2:3], TABLE))


def test_of_a_session_means_and_deviations_of_its_windows_are_told() -> None:
    features = np.random.default_rng(2).normal(100, 1, (7, 3)).astype(np.float32)
    found = session_features(features, [4, 1, 2])
    for row, part in zip(found, np.split(features, [4, 5]), strict=True):
        np.testing.assert_allclose(row, np.r_[part.mean(axis=0), part.std(axis=0)], atol=1e-4)
    assert session_features(features[:0], []).shape == (0, 6)
