"""What several readers make of numbers."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.recordings.rows import wall_clock


def test_a_time_since_1970_is_a_wall_clock() -> None:
    assert wall_clock(1_305_031_102_175_304_000) == "2011-05-10T12:38:22.175304+00:00"


@pytest.mark.parametrize("t_ns", [-1, 0, 10**18 - 1, 4 * 10**18, 1 << 62])
def test_what_counts_from_the_recorder_s_own_start_is_none(t_ns: int) -> None:
    assert wall_clock(t_ns) is None


@given(st.integers(10**18, 4 * 10**18 - 1))
def test_it_is_exact_to_a_microsecond(t_ns: int) -> None:
    said = wall_clock(t_ns)
    assert said is not None
    away = datetime.fromisoformat(said) - datetime(1970, 1, 1, tzinfo=UTC)
    assert abs(away.total_seconds() - t_ns / 1e9) < 2e-6
