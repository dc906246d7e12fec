"""Boxes are solid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry.contact import overlap, parted
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z

SIZE = np.array([0.15, 0.15, 0.15])


def at(x: float, y: float, yaw: float) -> Rigid:
    return Rigid(matrix_about_z(np.array([yaw])), np.array([[x, y, 0.075]]))


def test_boxes_side_by_side_neither_overlap_nor_stand_apart() -> None:
    depth, axis = overlap(at(0, 0, 0), at(0.15, 0, 0), SIZE, SIZE)
    assert depth[0] == pytest.approx(0)
    assert axis[0] == pytest.approx([1, 0])


def test_a_gap_is_a_negative_depth() -> None:
    depth, _ = overlap(at(0, 0, 0), at(0, 0.25, 0), SIZE, SIZE)
    assert depth[0] == pytest.approx(-0.1)


def test_a_corner_reaches_further_than_a_side() -> None:
    depth, _ = overlap(at(0, 0, 0), at(0.17, 0, np.pi / 4), SIZE, SIZE)
    assert depth[0] == pytest.approx(0.075 * (1 + np.sqrt(2)) - 0.17)


def spread(along: float, across: float, turn: float) -> Floats:
    """Covariance (1, 3, 3) with standard deviations in x, y and turn."""
    return np.diag([along**2, across**2, turn**2])[None]


def test_the_one_that_is_known_better_moves_less() -> None:
    spreads = spread(0.001, 0.001, 0.0), spread(0.002, 0.002, 0.0)
    first, second = parted(at(0, 0, 0), at(0.14, 0, 0), (SIZE, SIZE), spreads, 0.0)
    assert first.translation[0] == pytest.approx([-0.002, 0, 0.075])
    assert second.translation[0] == pytest.approx([0.148, 0, 0.075])


def test_a_box_whose_turn_is_in_doubt_turns_rather_than_slides() -> None:
    known, doubtful = spread(0.0001, 0.0001, 0.0001), spread(0.0001, 0.0001, 0.05)
    before = at(0.152, 0, 0.1)
    first, second = parted(at(0, 0, 0), before, (SIZE, SIZE), (known, doubtful), 0.0)
    assert first.translation[0] == pytest.approx([0, 0, 0.075], abs=1e-4)
    assert second.translation == pytest.approx(before.translation, abs=1e-4)
    assert 0 < np.arctan2(second.rotation[0, 1, 0], second.rotation[0, 0, 0]) < 0.05


def test_what_may_be_error_is_left_alone() -> None:
    spreads = spread(0.001, 0.001, 0.01), spread(0.001, 0.001, 0.01)
    first, second = parted(at(0, 0, 0), at(0.147, 0, 0), (SIZE, SIZE), spreads, 0.004)
    assert first.translation[0] == pytest.approx([0, 0, 0.075])
    assert second.translation[0] == pytest.approx([0.147, 0, 0.075])


NUMBER = st.floats(-0.2, 0.2)
TURN = st.floats(-np.pi, np.pi)
SIGMA = st.floats(0.0002, 0.005)


@given(NUMBER, NUMBER, TURN, TURN, SIGMA, SIGMA, st.floats(0, 0.05), st.floats(0, 0.01))
def test_afterwards_none_overlap_by_more_than_the_tolerance(
    x: float, y: float, turn: float, other: float, along: float, across: float, doubt: float, tolerance: float
) -> None:
    spreads = spread(0.001, 0.001, 0.01), spread(along, across, doubt)
    poses = parted(at(0, 0, turn), at(x, y, other), (SIZE, SIZE), spreads, tolerance)
    depth, _ = overlap(*poses, SIZE, SIZE)
    assert depth[0] <= tolerance + 1e-9
    for pose in poses:
        assert pose.rotation[0] @ pose.rotation[0].T == pytest.approx(np.eye(3), abs=1e-9)
        assert pose.translation[0, 2] == pytest.approx(0.075)
