"""Boxes are solid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry.contact import overlap, parted
from ecat.geometry.transforms import Rigid, matrix_about_z

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


def test_the_one_that_is_known_better_moves_less() -> None:
    sigmas = np.array([0.001]), np.array([0.002])
    first, second = parted(at(0, 0, 0), at(0.14, 0, 0), (SIZE, SIZE), sigmas, 0.0)
    assert first.translation[0] == pytest.approx([-0.002, 0, 0.075])
    assert second.translation[0] == pytest.approx([0.148, 0, 0.075])


def test_what_may_be_error_is_left_alone() -> None:
    sigmas = np.array([0.001]), np.array([0.001])
    first, second = parted(at(0, 0, 0), at(0.147, 0, 0), (SIZE, SIZE), sigmas, 0.004)
    assert first.translation[0] == pytest.approx([0, 0, 0.075])
    assert second.translation[0] == pytest.approx([0.147, 0, 0.075])


NUMBER = st.floats(-0.2, 0.2)
TURN = st.floats(-np.pi, np.pi)


@given(NUMBER, NUMBER, TURN, TURN, st.floats(0.0005, 0.005), st.floats(0, 0.01))
def test_afterwards_none_overlap_by_more_than_the_tolerance(
    x: float, y: float, turn: float, other: float, sigma: float, tolerance: float
) -> None:
    sigmas = np.array([0.001]), np.array([sigma])
    poses = parted(at(0, 0, turn), at(x, y, other), (SIZE, SIZE), sigmas, tolerance)
    depth, _ = overlap(*poses, SIZE, SIZE)
    assert depth[0] <= tolerance + 1e-9
    for pose, before in zip(poses, (turn, other), strict=True):
        assert pose.rotation[0] == pytest.approx(matrix_about_z(np.array(before)))
