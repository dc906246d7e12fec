"""What networks are fed is fitted to training sessions, and stands in for what a session lacks."""

from __future__ import annotations

import numpy as np
import pytest

from learn.features.raw import VERSION as RAW
from learn.features.windows import Table
from learn.recognize.inputs import SHAPES, Fitted
from tests.learn.recognize import made

N_JOINTS = 13


@pytest.fixture(scope="module")
def sessions() -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    return [made.scene(1 + seed % 2, seed=seed) for seed in range(3)]


@pytest.mark.parametrize("name", SHAPES)
def test_windows_have_the_shape_of_their_set(
    name: str, sessions: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]
) -> None:
    inputs = Fitted.of(name, sessions).windows(sessions[0])
    assert inputs.shape == (6, *SHAPES[name])
    assert inputs.dtype == np.float32


def test_where_nobody_was_seen_joints_are_where_they_usually_are(
    sessions: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> None:
    fitted = Fitted.of(RAW, sessions)
    alone, usual = sessions[0].copy(), sessions[0].copy()
    alone[:, :N_JOINTS] = np.nan
    usual[:, :N_JOINTS] = np.median(np.concatenate(sessions)[:, :N_JOINTS], axis=0)
    np.testing.assert_array_equal(fitted.windows(alone), fitted.windows(usual))
    partly = sessions[0].copy()
    partly[5:, :N_JOINTS] = np.nan  # they stay where they were
    assert (fitted.windows(partly) != fitted.windows(usual)).any()


def test_without_any_joints_to_learn_from_they_are_nowhere(
    sessions: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> None:
    alone = [points.copy() for points in sessions]
    for points in alone:
        points[:, :N_JOINTS] = np.nan
    assert np.isfinite(Fitted.of(RAW, alone).windows(alone[0])).all()


def test_a_known_table_takes_the_place_of_the_fitted_one(
    sessions: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> None:
    fitted = Fitted.of(RAW, sessions)
    moved = fitted.on_table(Table(0.1, -0.8))
    assert moved.fit[:2].tolist() == [0.1, -0.8]
    np.testing.assert_array_equal(moved.fit[2:], fitted.fit[2:])
    planes = Fitted.of("ch4-pcas18", sessions)
    assert planes.on_table(Table(0.1, -0.8)) is planes


@pytest.mark.parametrize("name", [RAW, "ch4-qsr25"])
@pytest.mark.parametrize("wrong", [[], [0.0] * 5, [np.nan] * 41, [np.nan] * 18])
def test_what_was_fitted_to_another_set_is_refused(name: str, wrong: list[float]) -> None:
    with pytest.raises(ValueError, match="fitted"):
        Fitted(name, np.array(wrong))
