"""Measures of spatial relations on boxes whose places are known, and the intervals in which a relation holds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry import relations
from ecat.geometry.relations import Threshold, held, way
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z

CUBE = np.full(3, 0.1)
RULE = Threshold(on=0.01, off=0.02, sigmas=1.0, min_s=0.1, max_gap_s=0.5)


def at(*places: tuple[float, float, float], yaw: float = 0.0) -> Rigid:
    points = np.array(places)
    return Rigid(matrix_about_z(np.full(len(points), yaw)), points)


def spans(measure: Floats, sigma: float = 0.0, rule: Threshold = RULE) -> list[tuple[int, int]]:
    found = held(np.arange(len(measure)) / 10.0, measure, np.full(len(measure), sigma), rule)
    return [(span.start, span.end) for span in found]


def test_between_the_thresholds_the_last_word_counts() -> None:
    measure = np.array([0.03, 0.015, 0.005, 0.015, 0.019, 0.015, 0.005, 0.03, 0.015, 0.03])
    assert spans(measure) == [(2, 7)]


def test_where_there_is_no_last_word_the_middle_of_both_thresholds_decides() -> None:
    nearly, hardly = np.full(10, 0.0149), np.full(10, 0.0151)
    assert spans(nearly) == [(0, 10)]
    assert spans(hardly) == []
    assert spans(np.r_[nearly, hardly]) == [(0, 20)]
    # a long time later it is another question
    assert spans(np.r_[nearly, np.full(6, np.nan), hardly]) == [(0, 10)]
    assert spans(np.r_[hardly, np.full(6, np.nan), nearly]) == [(16, 26)]


def test_an_interval_begins_and_ends_at_the_very_frame() -> None:
    assert spans(np.r_[np.ones(7), np.zeros(5), np.ones(8)]) == [(7, 12)]


def test_a_doubtful_measure_ends_no_relation() -> None:
    measure = np.r_[np.zeros(5), np.full(3, 0.025), np.zeros(5)]
    assert spans(measure, sigma=0.001) == [(0, 5), (8, 13)]
    assert spans(measure, sigma=0.01) == [(0, 13)]


def test_a_short_gap_is_bridged_and_a_long_one_ends_the_interval() -> None:
    short, long = np.zeros(20), np.zeros(20)
    short[5:8] = np.nan
    long[5:15] = np.nan
    assert spans(short) == [(0, 20)]
    assert spans(long) == [(0, 5), (15, 20)]


def test_what_lasts_too_briefly_is_not_reported() -> None:
    measure = np.r_[np.ones(5), np.zeros(2), np.ones(5)]
    assert spans(measure, rule=Threshold(0.01, 0.02, min_s=0.3)) == []


def test_what_makes_no_sense_ends_a_relation_at_once() -> None:
    assert spans(np.r_[np.zeros(5), np.full(5, np.inf)], sigma=10.0) == [(0, 5)]


def test_confidence_is_the_probability_that_the_relation_holds() -> None:
    sure, half, unseen = np.zeros(10), np.full(10, 0.009), np.zeros(10)
    unseen[2:6] = np.nan
    t_s, sigma = np.arange(10) / 10.0, np.full(10, 0.001)
    assert held(t_s, sure, sigma, RULE)[0].confidence == pytest.approx(1.0)
    assert held(t_s, half, np.full(10, 0.1), RULE)[0].confidence == pytest.approx(0.52, abs=0.01)
    (bridged,) = held(t_s, unseen, sigma, RULE)
    assert (bridged.start, bridged.end) == (0, 10)
    assert bridged.confidence == pytest.approx(0.8)


numbers = st.one_of(st.floats(0, 0.04), st.just(float("nan")), st.just(float("inf")))


@given(st.lists(numbers, max_size=60), st.floats(0, 0.02))
def test_intervals_are_ordered_apart_and_not_empty(values: list[float], sigma: float) -> None:
    found = spans(np.array(values, float), sigma)
    assert all(0 <= start < end <= len(values) for start, end in found)
    assert all(first[1] <= second[0] for first, second in pairwise(found))


def test_nothing_known_is_nothing_said() -> None:
    assert spans(np.full(10, np.nan)) == []


def test_gap_between_boxes_that_face_each_other_is_what_lies_between() -> None:
    a, b = at((0, 0, 0.05), (0, 0, 0.05)), at((0.13, 0.02, 0.05), (0, 0, 0.2))
    np.testing.assert_allclose(relations.box_gap(a, b, CUBE, CUBE), [0.03, 0.05])


def test_gap_between_an_edge_and_a_face_counts_the_diagonal() -> None:
    a, b = at((0, 0, 0.05)), at((0.2, 0, 0.05), yaw=np.pi / 4)
    np.testing.assert_allclose(relations.box_gap(a, b, CUBE, CUBE), 0.2 - 0.05 - 0.05 * np.sqrt(2))


def test_boxes_that_overlap_have_no_gap() -> None:
    assert relations.box_gap(at((0, 0, 0.05)), at((0.06, 0.01, 0.05)), CUBE, CUBE) == 0


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-1, 1), st.floats(0, 6))
def test_gaps_do_not_depend_on_where_the_table_is_nor_on_the_order(
    x: float, y: float, z: float, turn: float
) -> None:
    a, b = at((0, 0, 0.05), yaw=0.3), at((0.2, 0.11, 0.07), yaw=1.0)
    there = Rigid(matrix_about_z(np.array([turn])), np.array([[x, y, z]]))
    plain = relations.box_gap(a, b, CUBE, CUBE)
    np.testing.assert_allclose(relations.box_gap(there @ a, there @ b, CUBE, CUBE), plain, atol=1e-9)
    np.testing.assert_allclose(relations.box_gap(b, a, CUBE, CUBE), plain, atol=1e-12)


def test_a_point_is_as_far_from_a_box_as_from_its_surface() -> None:
    points = np.array([[0.0, 0.0, 0.13], [0.08, 0.09, 0.05], [0.01, 0.0, 0.05]])
    box = at(*[(0, 0, 0.05)] * 3)
    np.testing.assert_allclose(relations.point_gap(points, box, CUBE), [0.03, 0.05, 0.0], atol=1e-12)


def test_what_stands_on_another_box_is_at_height_zero_without_overhang() -> None:
    below = at((0, 0, 0.05), (0, 0, 0.05), (0, 0, 0.05))
    above = at((0.02, 0, 0.15), (0.09, 0, 0.15), (0, 0, 0.25))
    np.testing.assert_allclose(relations.height_over(above, below, CUBE, CUBE), [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(relations.overhang(above, below, CUBE), [0, 0.04, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("place", "axis"),
    [((-0.2, 0), (-1, 0)), ((0.2, 0), (1, 0)), ((0, -0.2), (0, -1)), ((0, 0.2), (0, 1))],
)
def test_bearing_is_zero_along_its_axis(place: tuple[float, float], axis: tuple[float, float]) -> None:
    off = relations.bearing_off(np.array([[*place, 0.0]]), np.zeros((1, 3)), axis)
    np.testing.assert_allclose(off, 0, atol=1e-12)


LANDMARK = np.zeros(2)


def line(start: tuple[float, float], end: tuple[float, float]) -> Floats:
    return np.linspace(start, end, 30)


def ring(turn: float) -> Floats:
    angle = np.linspace(0, turn, 60)
    return 0.3 * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize(
    ("path", "gap_m", "expected"),
    [
        (line((0.5, 0.0), (0.16, 0.0)), 0.005, "next"),
        (line((0.5, 0.0), (0.3, 0.0)), 0.15, "toward"),
        (line((0.2, 0.0), (0.5, 0.1)), 0.35, "away"),
        (line((-0.4, 0.25), (0.4, 0.25)), 0.3, "past"),
        (ring(1.3 * np.pi), 0.15, "around"),
        (ring(0.9 * np.pi), 0.15, "past"),
        (line((0.3, 0.07), (0.3, -0.07)), 0.15, ""),
    ],
)
def test_ways_are_named_as_people_name_them(path: Floats, gap_m: float, expected: str) -> None:
    assert way(path, LANDMARK, gap_m, beside_m=0.04, change_m=0.05) == expected
    assert way(path + 2.0, LANDMARK + 2.0, gap_m, beside_m=0.04, change_m=0.05) == expected
