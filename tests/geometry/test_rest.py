"""A rest is found where a thing stays, to the frame, whatever noise, outliers and gaps there are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry.rest import Stillness, box_places, find_rests
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec

STILL = Stillness()


def times(n: int) -> Floats:
    return np.arange(n) / 30.0


def step(n: int, first: int, last: int, way_m: float = 0.3) -> Floats:
    """Rests at 0 up to row ``first``, goes evenly, rests ``way_m`` farther from row ``last`` on."""
    share = np.clip((np.arange(n) - first) / (last - first), 0.0, 1.0)
    return np.stack([way_m * share, np.zeros(n), np.full(n, 0.08)], -1)


def test_rests_end_and_begin_at_the_very_frame_without_lag() -> None:
    found = find_rests(times(90), step(90, 30, 60), np.zeros(90), STILL)
    assert [(rest.first, rest.last) for rest in found] == [(0, 30), (60, 89)]


def test_noise_moves_the_ends_by_a_frame_or_two_only() -> None:
    rng = np.random.default_rng(1)
    places = step(90, 30, 60) + rng.normal(0, 0.002, (90, 3))
    found = find_rests(times(90), places, np.full(90, 0.002), STILL)
    assert abs(found[0].last - 30) <= 2
    assert abs(found[-1].first - 60) <= 2


def test_outliers_do_not_interrupt_a_rest() -> None:
    places = step(60, 100, 110)
    places[[20, 21, 40]] += 0.05
    assert [(rest.first, rest.last) for rest in find_rests(times(60), places, np.zeros(60), STILL)] == [
        (0, 59)
    ]


def test_a_box_that_is_where_it_was_before_a_gap_has_rested() -> None:
    seen = np.r_[0:20, 60:80]
    found = find_rests(times(80)[seen], step(80, 100, 110)[seen], np.zeros(40), STILL)
    assert [(rest.first, rest.last) for rest in found] == [(0, 39)]


def test_a_box_that_is_elsewhere_after_a_gap_has_not() -> None:
    seen = np.r_[0:20, 60:80]
    found = find_rests(times(80)[seen], step(80, 25, 55)[seen], np.zeros(40), STILL)
    assert [(rest.first, rest.last) for rest in found] == [(0, 19), (20, 39)]


def test_slow_steady_sliding_is_no_rest() -> None:
    places = step(300, 0, 299, way_m=3.0)  # 0.3 m/s
    assert find_rests(times(300), places, np.zeros(300), STILL) == []


def test_a_doubtful_position_must_be_farther_away_to_have_left() -> None:
    places = np.zeros((60, 3))
    places[30:] += [0.02, 0.0, 0.0]
    sure, unsure = np.full(60, 0.001), np.full(60, 0.01)
    assert len(find_rests(times(60), places, sure, STILL)) == 2
    assert len(find_rests(times(60), places, unsure, STILL)) == 1


@given(
    st.floats(0.05, 0.3),
    st.floats(0.05, 0.3),
    st.floats(0.05, 0.3),
    st.lists(st.floats(-2, 2), min_size=6, max_size=6),
)
def test_distance_of_box_places_is_the_root_mean_square_way_of_the_corners(
    a: float, b: float, c: float, numbers: list[float]
) -> None:
    size = np.array([a, b, c])
    pose = Rigid(
        matrix_from_rotvec(np.array([[0.0, 0, 0], numbers[:3]])), np.array([[0.0, 0, 0], numbers[3:]])
    )
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = np.einsum("nij,kj->nki", pose.rotation, signs * size / 2) + pose.translation[:, None]
    expected = np.sqrt(((corners[1] - corners[0]) ** 2).sum(-1).mean())
    places = box_places(pose, size)
    np.testing.assert_allclose(np.linalg.norm(places[1] - places[0]), expected, atol=1e-12)


@given(st.integers(0, 10_000), st.floats(-1, 1), st.floats(-1, 1))
def test_rests_are_ordered_apart_and_the_same_wherever_the_table_is(seed: int, x: float, y: float) -> None:
    rng = np.random.default_rng(seed)
    places = np.cumsum(rng.normal(0, 0.02, (80, 3)) * (rng.random((80, 1)) < 0.3), axis=0)
    sigma = np.full(80, 0.001)
    found = find_rests(times(80), places, sigma, STILL)
    assert all(rest.first <= rest.last for rest in found)
    assert all(a.last < b.first for a, b in pairwise(found))
    moved = find_rests(times(80), places + np.array([x, y, 0.0]), sigma, STILL)
    assert [(r.first, r.last) for r in moved] == [(r.first, r.last) for r in found]
