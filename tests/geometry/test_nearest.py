"""The nearest in time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry.nearest import nearest_in_time

moments = st.lists(st.integers(-50, 50), max_size=12)


@given(moments.map(sorted), moments, st.none() | st.integers(0, 20), st.booleans())
def test_no_other_is_nearer_and_what_is_too_far_away_is_none(
    times: list[int], asked: list[int], within: int | None, later_on_tie: bool
) -> None:
    found = nearest_in_time(
        np.array(times, np.int64), np.array(asked, np.int64), within=within, later_on_tie=later_on_tie
    )
    assert len(found) == len(asked)
    for when, index in zip(asked, found.tolist(), strict=True):
        least = min((abs(t - when) for t in times), default=None)
        if least is None or (within is not None and least > within):
            assert index == -1
            continue
        assert abs(times[index] - when) == least
        equal = {t for t in times if abs(t - when) == least}
        assert times[index] == (max(equal) if later_on_tie else min(equal))


@pytest.mark.parametrize(("later_on_tie", "expected"), [(False, 0), (True, 1)])
def test_of_two_equally_near_the_earlier_counts_unless_the_later_is_wanted(
    later_on_tie: bool, expected: int
) -> None:
    found = nearest_in_time(np.array([0, 10]), np.array([5]), later_on_tie=later_on_tie)
    assert found.tolist() == [expected]


def test_what_is_as_far_away_as_allowed_counts() -> None:
    assert nearest_in_time(np.array([0]), np.array([7, 8]), within=7).tolist() == [0, -1]
