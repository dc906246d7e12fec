"""Extremely randomised trees say shares, and are read as they were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from learn.recognize.forest import Forest, grow

ROWS = np.random.default_rng(0).normal(size=(80, 6)).astype(np.float32)
CLASSES = (ROWS[:, 2] > 0).astype(np.int64) + (ROWS[:, 4] > 0.5)


@pytest.fixture(scope="module")
def forest() -> Forest:
    return grow(ROWS, np.eye(3)[CLASSES], seed=0, n_estimators=20)


def test_what_was_learned_is_said(forest: Forest) -> None:
    said = forest.predict(ROWS)
    np.testing.assert_allclose(said.sum(axis=1), 1)
    assert said.argmax(axis=1).tolist() == CLASSES.tolist()


def test_rows_that_were_not_seen_are_told_better_than_by_chance(forest: Forest) -> None:
    others = np.random.default_rng(1).normal(size=(400, 6)).astype(np.float32)
    truth = (others[:, 2] > 0).astype(np.int64) + (others[:, 4] > 0.5)
    assert (forest.predict(others).argmax(axis=1) == truth).mean() > 0.7


def test_a_share_may_be_of_one_class() -> None:
    share = np.linspace(0, 1, len(ROWS))[:, None]
    found = grow(ROWS, share, seed=0, n_estimators=5, min_samples_leaf=1)
    np.testing.assert_allclose(found.predict(ROWS), share, atol=1e-9)


def test_without_rows_all_classes_are_as_likely() -> None:
    found = grow(ROWS[:0], np.zeros((0, 4)), seed=0, n_estimators=3)
    np.testing.assert_allclose(found.predict(ROWS[:2]), 1 / 4)


def test_nothing_is_said_of_no_rows(forest: Forest) -> None:
    assert forest.predict(ROWS[:0]).shape == (0, 3)


def test_the_seed_is_all_that_is_drawn() -> None:
    grown = [
        grow(ROWS, np.eye(3)[CLASSES], seed=seed, n_estimators=4).threshold.tolist() for seed in (1, 1, 2)
    ]
    assert grown[0] == grown[1] != grown[2]


def test_they_are_read_as_they_were_written(forest: Forest, tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", allow_pickle=False, **forest.arrays("t"))
    with np.load(tmp_path / "t.npz") as arrays:
        again = Forest.of_arrays(arrays, "t")
    np.testing.assert_array_equal(again.predict(ROWS), forest.predict(ROWS))


@pytest.mark.parametrize("wrong", [-0.1, 1.1, np.nan])
def test_what_is_no_probability_is_refused(wrong: float, forest: Forest) -> None:
    arrays = forest.arrays("t")
    arrays["t.value"] = np.where(np.arange(len(forest.value))[:, None] == 5, wrong, forest.value)
    with pytest.raises(ValueError, match="trees"):
        Forest.of_arrays(arrays, "t")


def test_values_of_fewer_classes_are_refused(forest: Forest) -> None:
    with pytest.raises(ValueError, match="trees"):
        Forest.of_arrays(forest.arrays("t") | {"t.value": forest.value[:, :2]}, "t")
