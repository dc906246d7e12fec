"""What windows show on the table, also of sessions that have none."""

from __future__ import annotations

import numpy as np
import pytest

from learn.features.scene import filled, scene_of
from learn.features.windows import LENGTH, Table, windows_of


def test_a_value_that_is_not_known_is_the_nearest_earlier_or_else_the_next() -> None:
    values = np.array([[[np.nan], [1.0], [np.nan], [2.0], [np.nan]], [[np.nan]] * 5])
    assert filled(values)[..., 0].tolist() == [[1, 1, 1, 2, 2], [0] * 5]


def test_sessions_shorter_than_a_window_show_nothing() -> None:
    for n in (0, 1, LENGTH - 1):
        windows = windows_of(np.zeros((n, 21, 3)))
        assert scene_of(windows, Table(0.3, -0.6)).corners.shape == (0, LENGTH, 2, 4, 2)


@pytest.mark.parametrize("box", [0, 1])
def test_a_marker_with_three_corners_in_one_place_is_where_it_was_seen_last(box: int) -> None:
    """It is written so for dozens of frames, as if the box had jumped; two in one place may be seen edge on."""
    session = np.random.default_rng(0).normal([0.0, -0.3, 2.0], 0.05, (LENGTH, 21, 3))
    corners = slice(13 + 4 * box, 17 + 4 * box)
    flat, expected, two = session.copy(), session.copy(), session.copy()
    flat[8:14, corners] = [0.6, -0.2, 1.6]
    flat[8:14, corners.start] = np.nan
    expected[8:14, corners] = expected[7, corners]
    two[8:14, corners.start] = two[8:14, corners.start + 1]
    table = Table(0.3, -0.6)
    found, wanted, seen = (scene_of(one[None], table) for one in (flat, expected, two))
    np.testing.assert_allclose(found.corners, wanted.corners)
    np.testing.assert_allclose(found.height, wanted.height)
    assert np.abs(seen.corners - wanted.corners).max() > 1e-3
