"""How far a box has come, of what it will have come at the end of its session."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from learn.features.journey import journey_features
from learn.features.points import SWAP_POINTS
from learn.features.windows import Table, n_windows
from tests.learn.recognize import made

TABLE = Table(made.SLOPE, made.HEIGHT)
SHARE_OF_PATH = slice(13, 16)  # at the beginning, in the middle and at the end of a window


def test_there_is_a_row_for_each_window_and_either_box() -> None:
    first, second = journey_features(made.scene(1, n_frames=63), TABLE)
    assert first.shape == second.shape
    assert len(first) == n_windows(63)


def test_what_moves_comes_farther_from_window_to_window_until_it_is_there() -> None:
    share = journey_features(made.scene(1), TABLE)[0][:, SHARE_OF_PATH]
    assert (np.diff(share, axis=0) > 0).all()
    assert (np.diff(share, axis=1) > 0).all()
    np.testing.assert_allclose(share[[0, -1], [0, 2]], [0, 1], atol=0.03)


def test_exchanged_boxes_have_exchanged_journeys() -> None:
    points = made.scene(2)
    np.testing.assert_array_equal(
        np.stack(journey_features(points, TABLE)),
        np.stack(journey_features(points[:, SWAP_POINTS], TABLE)[::-1]),
    )


@settings(max_examples=25, deadline=None)
@given(
    st.integers(20, 40).flatmap(
        lambda n: arrays(np.float64, (n, 21, 3), elements=st.sampled_from([-1.0, 0.0, 0.5, 3.0, np.nan]))
    )
)
def test_whatever_is_seen_features_are_finite(
    points: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> None:
    assert all(np.isfinite(part).all() for part in journey_features(points, TABLE))
