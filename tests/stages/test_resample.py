"""Moments of a regular clock, and what is known at each."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ecat.stages.resample import NS, ROUNDED_NS, filled, held, interpolated, regular_times, same_side, unit

times = st.lists(st.integers(0, 10**12), min_size=1, max_size=30, unique=True).map(
    lambda chosen: np.array(sorted(chosen), np.int64)
)


@given(start=st.integers(0, 10**15), n_ns=st.integers(0, 10**11), fps=st.integers(1, 240))
def test_moments_are_regular_and_fill_the_stretch(start: int, n_ns: int, fps: int) -> None:
    moments = regular_times(start, start + n_ns, fps)
    assert (np.abs((moments - start) * fps - np.arange(len(moments)) * NS) * 2 <= fps).all()
    # one that is nearer to the end than times of frames are exact is the end
    assert len(moments) == max(-(-(n_ns - ROUNDED_NS) * fps // NS), 0)
    assert (moments < start + n_ns).all()


def test_there_is_no_moment_in_nothing() -> None:
    assert not len(regular_times(5, 5, 30))
    assert not len(regular_times(5, 4, 30))


@given(known=times, asked=times, within=st.integers(0, 10**11))
def test_held_values_are_the_nearest_known_ones(known: np.ndarray, asked: np.ndarray, within: int) -> None:
    values = known[:, None].astype(float)
    found = held(values, known, asked, within_ns=within)[:, 0]
    distance = np.abs(known[None] - asked[:, None]).min(axis=1)
    assert (np.isnan(found) == (distance > within)).all()
    near = ~np.isnan(found)
    assert (np.abs(found - asked)[near] == distance[near]).all()


def test_nothing_is_held_of_nothing() -> None:
    none = np.zeros((0, 3))
    assert np.isnan(held(none, np.zeros(0, np.int64), np.arange(2), within_ns=9)).all()
    assert np.isnan(interpolated(none, np.zeros(0, np.int64), np.arange(2), within_ns=9)).all()


@given(known=times, asked=times, slope=st.floats(-3, 3), within=st.integers(1, 10**12))
def test_values_on_a_line_are_found_on_it(
    known: np.ndarray, asked: np.ndarray, slope: float, within: int
) -> None:
    values = slope * (known / 1e9)[:, None]
    found = interpolated(values, known, asked, within_ns=within)[:, 0]
    there = ~np.isnan(found)
    assert found[there] == pytest.approx(slope * asked[there] / 1e9, abs=1e-6)
    outside = (asked < known[0]) | (asked > known[-1])
    assert np.isnan(found[outside]).all()
    assert not np.isnan(interpolated(values, known, known, within_ns=within)).any()


def test_a_gap_that_is_too_long_is_not_bridged_and_a_short_one_is() -> None:
    values = np.array([[0.0, 0.0], [np.nan, 1.0], [2.0, np.nan], [9.0, 9.0]])
    known = np.array([0, 10, 20, 90])
    found = interpolated(values, known, np.array([10, 15, 50]), within_ns=30)
    assert found[:, 0] == pytest.approx([1.0, 1.5, np.nan], nan_ok=True)
    assert found[:, 1] == pytest.approx([1.0, np.nan, np.nan], nan_ok=True)


@given(
    arrays(np.float64, (12, 4), elements=st.floats(-1, 1)), st.lists(st.booleans(), min_size=12, max_size=12)
)
def test_signs_of_quaternions_do_not_alternate(quaternions: np.ndarray, flips: list[bool]) -> None:
    rows = quaternions + np.array([0, 0, 0, 4.0])
    rows[3] = np.nan
    flipped = np.where(np.array(flips)[:, None], -rows, rows)
    assert same_side(flipped) == pytest.approx(rows, nan_ok=True)


def test_unit_quaternions_have_length_one_or_are_unknown() -> None:
    rows = unit(np.array([[0, 0, 3.0, 4.0], [0, 0, 0, 0]]))
    assert rows[0] == pytest.approx([0, 0, 0.6, 0.8])
    assert np.isnan(rows[1]).all()


def test_what_is_missing_repeats_the_last_known_value_or_the_first() -> None:
    nan = np.nan
    values = np.array([[nan, 1, nan], [2, nan, nan], [nan, 3, nan]])
    assert filled(values).tolist() == [[2, 1, 0], [2, 1, 0], [2, 3, 0]]
    assert filled(np.empty((0, 2))).shape == (0, 2)
