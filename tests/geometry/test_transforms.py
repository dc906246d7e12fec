"""Rotations and rigid transforms agree with SciPy's and with themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from ecat.geometry.transforms import (
    Floats,
    Rigid,
    known,
    matrix_about_z,
    matrix_from_quaternion,
    matrix_from_rotvec,
    quaternion_angle,
    quaternion_from_matrix,
    skew,
)

TURNS = Rotation.random(200, rng=np.random.default_rng(1))
vectors = arrays(float, 3, elements=st.floats(-3, 3))


def rigid(turn: Floats, shift: Floats) -> Rigid:
    return Rigid(matrix_from_rotvec(turn), shift)


def test_matrices_are_those_of_scipy() -> None:
    np.testing.assert_allclose(matrix_from_quaternion(TURNS.as_quat()), TURNS.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(matrix_from_rotvec(TURNS.as_rotvec()), TURNS.as_matrix(), atol=1e-12)


def test_quaternions_come_back_with_a_positive_scalar_part() -> None:
    found = quaternion_from_matrix(TURNS.as_matrix())
    np.testing.assert_allclose(found, TURNS.as_quat(canonical=True), atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_have_quaternions_too(axis: int) -> None:
    vector = np.pi * np.eye(3)[axis]
    found = quaternion_from_matrix(Rotation.from_rotvec(vector).as_matrix())
    np.testing.assert_allclose(np.abs(found), np.abs(Rotation.from_rotvec(vector).as_quat()), atol=1e-7)


def test_tiny_rotations_keep_their_digits() -> None:
    tiny = 1e-9 * np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(matrix_from_rotvec(tiny) - np.eye(3), skew(tiny), atol=1e-17)


@given(vectors, vectors, vectors)
def test_inverse_undoes(turn: Floats, shift: Floats, point: Floats) -> None:
    there = rigid(turn, shift)
    np.testing.assert_allclose(there.inverse().apply(there.apply(point)), point, atol=1e-9)


@given(vectors, vectors, vectors, vectors, vectors)
def test_composition_is_one_after_the_other(
    a: Floats, b: Floats, c: Floats, d: Floats, point: Floats
) -> None:
    first, second = rigid(a, b), rigid(c, d)
    np.testing.assert_allclose((second @ first).apply(point), second.apply(first.apply(point)), atol=1e-9)


def test_arrays_of_transforms_move_arrays_of_points() -> None:
    many = Rigid(TURNS.as_matrix(), np.arange(600.0).reshape(200, 3))
    points = np.ones((200, 3))
    expected = np.array(
        [Rigid(r, t).apply(p) for r, t, p in zip(many.rotation, many.translation, points, strict=True)]
    )
    np.testing.assert_allclose(many.apply(points), expected)


def test_unknown_orientation_stays_unknown() -> None:
    assert np.isnan(quaternion_from_matrix(np.full((3, 3), np.nan))).all()
    assert np.isnan(matrix_from_quaternion(np.full(4, np.nan))).any()
    np.testing.assert_array_equal(known(np.array([[1.0, 2.0], [np.nan, 1.0]])), [True, False])


def test_angle_between_orientations() -> None:
    a, b = np.array([0.0, 0.0, 0.0, 1.0]), -quaternion_from_matrix(matrix_about_z(np.array(0.3)))
    assert quaternion_angle(a, b) == pytest.approx(0.3)
