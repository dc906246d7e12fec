"""Trees as arrays say what scikit-learn's say, and damaged ones are refused before they are walked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError
from learn.recognize.forest import Forest, grow, library

GENERATOR = np.random.default_rng(0)
ROWS = GENERATOR.normal(size=(120, 6)).astype(np.float32)
CLASSES = (ROWS[:, 0] > 0).astype(np.int64) * 2 + (ROWS[:, 1] > 0)


@pytest.fixture(scope="module")
def forest() -> Forest:
    return grow(ROWS, CLASSES, 5, n_trees=30, share=0.5, seed=3)


def test_it_is_the_forest_of_scikit_learn(forest: Forest) -> None:
    model: Any = library("ensemble").ExtraTreesClassifier(n_estimators=30, max_features=0.5, random_state=3)
    others = GENERATOR.normal(size=(50, 6)).astype(np.float32)
    np.testing.assert_allclose(
        forest.predict(others)[:, :4], model.fit(ROWS, CLASSES).predict_proba(others), atol=1e-12
    )


def test_classes_that_never_occurred_have_no_probability(forest: Forest) -> None:
    assert forest.predict(ROWS).shape == (120, 5)
    assert (forest.predict(ROWS)[:, 4] == 0).all()


def test_arrays_come_back_as_the_same_forest(forest: Forest) -> None:
    again = Forest.of_arrays(forest.arrays("a"), "a")
    np.testing.assert_array_equal(again.predict(ROWS), forest.predict(ROWS))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("left", 10**6),
        ("right", 0),
        ("feature", 6),
        ("feature", -2),
        ("classes", 5),
        ("bounds", -1),
        ("roots", 3),
    ],
)
def test_trees_that_lead_outside_are_refused(name: str, value: int, forest: Forest) -> None:
    arrays = {key: values.copy() for key, values in forest.arrays("a").items()}
    arrays[f"a.{name}"][0] = value
    with pytest.raises(CorruptError):
        Forest.of_arrays(arrays, "a")


def test_a_missing_part_is_refused(forest: Forest) -> None:
    arrays = forest.arrays("a")
    del arrays["a.shares"]
    with pytest.raises(CorruptError):
        Forest.of_arrays(arrays, "a")
