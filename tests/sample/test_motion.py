"""Paths, gaps and what makes a path an instance of an action."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.geometry.transforms import Floats, Rigid, matrix_about_z
from ecat.sample.motion import (
    Path,
    State,
    bezier,
    box_gap,
    box_quaternion,
    is_instance,
    minimum_jerk,
    propose,
)
from ecat.sample.scene import EDGE_M, HALF_M

CORNERS: Floats = HALF_M * np.array(list(product((-1.0, 1.0), repeat=3)))
angles = st.floats(-math.pi, math.pi)


def cube(x: float, y: float, yaw: float = 0.0, z: float = HALF_M) -> Rigid:
    return Rigid(matrix_about_z(np.array(yaw)), np.array([x, y, z]))


def outline(box: Rigid) -> Floats:
    """Points along the foot of a standing cube, a millimetre apart."""
    s = np.linspace(-HALF_M, HALF_M, 153)
    side = np.column_stack([s, np.full_like(s, HALF_M), np.zeros_like(s)])
    turns = matrix_about_z(np.arange(4) * math.pi / 2)
    return box.apply((side @ turns).reshape(-1, 3))


def test_a_minimum_jerk_movement_begins_and_ends_at_rest() -> None:
    tau = np.array([0.0, 1e-4, 0.5, 1 - 1e-4, 1.0])
    way = minimum_jerk(tau)
    assert way[[0, 2, 4]].tolist() == [0.0, 0.5, 1.0]
    assert way[1] < 1e-10
    assert 1 - way[3] < 1e-10


@given(angles, st.floats(0.0, 0.3))
def test_the_gap_of_aligned_cubes_is_the_distance_of_their_faces(yaw: float, gap: float) -> None:
    way = (EDGE_M + gap) * np.array([math.cos(yaw), math.sin(yaw)])
    assert box_gap(cube(0.1, -0.2, yaw), cube(0.1 + way[0], -0.2 + way[1], yaw)) == pytest.approx(
        gap, abs=1e-9
    )


@settings(max_examples=40, deadline=None)
@given(angles, angles, angles, st.floats(0.22, 0.5))
def test_the_gap_of_standing_cubes_is_the_least_distance_of_their_outlines(
    yaw_a: float, yaw_b: float, bearing: float, distance: float
) -> None:
    a, b = cube(0, 0, yaw_a), cube(distance * math.cos(bearing), distance * math.sin(bearing), yaw_b)
    least = np.sqrt(((outline(a)[:, None] - outline(b)) ** 2).sum(-1)).min()
    gap = box_gap(a, b)
    assert gap <= least + 1e-12
    assert gap == pytest.approx(least, abs=6e-4)


@given(angles, angles, angles, st.floats(0.0, 0.15))
def test_overlapping_cubes_have_no_gap(yaw_a: float, yaw_b: float, bearing: float, distance: float) -> None:
    b = cube(distance * math.cos(bearing), distance * math.sin(bearing), yaw_b)
    assert box_gap(cube(0, 0, yaw_a), b) == pytest.approx(0, abs=1e-12)


def test_a_cube_held_over_the_other_is_as_far_as_its_lowest_face() -> None:
    assert box_gap(cube(0, 0), cube(0.02, 0.01, 0.3, z=HALF_M + EDGE_M + 0.05)) == pytest.approx(0.05)


@given(st.floats(0, 0.1), st.floats(-0.5, 0.5), angles, st.floats(0, 1))
def test_the_lowest_corner_is_at_the_height_of_the_lift(
    lift: float, tilt: float, yaw: float, s: float
) -> None:
    path = Path(bezier(np.zeros(2), np.ones(2), np.zeros(2)), (yaw, 0.0), lift, tilt)
    place, turned, tilted, lifted = path.at(np.array([s]))
    corners = Rigid.from_quaternion(box_quaternion(turned, tilted), place).apply(CORNERS[:, None])
    assert corners[..., 2].min() == pytest.approx(lifted[0], abs=1e-12)


def test_a_path_is_upright_on_the_table_at_both_ends_and_highest_in_the_middle() -> None:
    path = Path(bezier(np.zeros(2), np.ones(2), np.array([0.2, 0.0])), (0.1, 0.7), 0.05, 0.3)
    place, yaw, tilt, lift = path.at(np.array([0.0, 0.5, 1.0]))
    assert lift.tolist() == [0.0, 0.05, 0.0]
    assert tilt.tolist() == [0.0, 0.3, 0.0]
    assert yaw.tolist() == pytest.approx([0.1, 0.4, 0.7])
    assert place[[0, 2]].tolist() == [[0.0, 0.0, HALF_M], [0.2, 0.0, HALF_M]]


def line(start: tuple[float, float], end: tuple[float, float]) -> Floats:
    return np.array(start) + np.linspace(0, 1, 21)[:, None] * (np.array(end) - np.array(start))


def arc(degrees: float, radius: float = 0.3) -> Floats:
    angle = np.radians(np.linspace(0, degrees, 41))
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize(
    ("offsets", "kinds"),
    [
        (line((0.4, 0.0), (0.155, 0.01)), {"next", "toward"}),
        (line((0.4, 0.0), (0.25, 0.0)), {"toward"}),
        (line((0.2, 0.0), (0.4, 0.0)), {"away"}),
        (line((0.3, 0.0), (0.4, 0.0)), set()),
        (line((-0.3, 0.2), (0.3, 0.2)), {"past"}),
        (arc(250), {"around"}),
        (arc(-250), {"around"}),
        (arc(50), set()),
    ],
)
def test_the_evaluators_conditions_tell_the_actions_apart(offsets: Floats, kinds: set[str]) -> None:
    assert {
        kind for kind in ("next", "past", "around", "toward", "away") if is_instance(kind, offsets)
    } == kinds


@pytest.mark.parametrize("kind", ["next", "past", "around", "toward", "away", "set"])
def test_a_proposed_path_begins_where_the_cube_stands(kind: str) -> None:
    state = State(np.array([[0.1, 0.05], [-0.2, -0.1]]), np.array([-0.7, -0.9]))
    rng = np.random.default_rng(3)
    for box in (0, 1):
        curve, _ = propose(kind, rng, state, box)
        assert curve(np.zeros(1))[0] == pytest.approx(state.xy[box])
