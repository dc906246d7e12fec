"""Boosted trees as arrays say what LightGBM says, and damaged ones are refused before they are walked."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import MissingExtraError
from learn.recognize import boosting
from learn.recognize.boosting import Boosted, boost
from learn.recognize.trees import library

GENERATOR = np.random.default_rng(0)
ROWS = GENERATOR.normal(size=(200, 6)).astype(np.float32)
CLASSES = (ROWS[:, 0] > 0).astype(np.int64) * 2 + (ROWS[:, 1] > 0)


@pytest.fixture(scope="module")
def boosted() -> Boosted:
    return boost(ROWS, CLASSES, 4, n_trees=30, n_models=2, seed=3)


def test_it_says_what_lightgbm_says() -> None:
    lightgbm = library("lightgbm")
    drawn = vars(boosting)["_SETTINGS"] | {"num_class": 4, "min_data_in_leaf": 4, "seed": 7}
    booster = lightgbm.train(drawn, lightgbm.Dataset(ROWS, CLASSES.astype(np.float32)), 10)
    others = GENERATOR.normal(size=(50, 6)).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = booster.predict(others)
    found = boost(ROWS, CLASSES, 4, n_trees=10, seed=7).predict(others)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_models_are_averaged_as_logarithms() -> None:
    one, two = (boost(ROWS, CLASSES, 4, n_trees=5, seed=seed).predict(ROWS) for seed in (2, 3))
    both = boost(ROWS, CLASSES, 4, n_trees=5, n_models=2, seed=1).predict(ROWS)
    mean = np.sqrt(one * two)
    np.testing.assert_allclose(both, mean / mean.sum(axis=1, keepdims=True), atol=1e-9)


def test_what_is_learned_is_told(boosted: Boosted) -> None:
    assert (boosted.predict(ROWS).argmax(axis=1) == CLASSES).mean() > 0.7  # a tree sees one feature of six
    assert boosted.shape.tolist() == [6, 4]


def test_one_class_is_always_it() -> None:
    assert (boost(ROWS, 0 * CLASSES, 1, n_trees=5, seed=0).predict(ROWS) == 1).all()


def test_arrays_come_back_as_the_same_trees(boosted: Boosted) -> None:
    again = Boosted.of_arrays(boosted.arrays("a"), "a")
    np.testing.assert_array_equal(again.predict(ROWS), boosted.predict(ROWS))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("left", 10**6),
        ("right", 0),
        ("feature", 6),
        ("feature", -2),
        ("value", np.nan),
        ("roots", 3),
        ("shape", 0),
    ],
)
def test_trees_that_lead_outside_are_refused(name: str, value: float, boosted: Boosted) -> None:
    arrays = {key: values.copy() for key, values in boosted.arrays("a").items()}
    arrays[f"a.{name}"][0] = value
    with pytest.raises(ValueError, match="trees"):
        Boosted.of_arrays(arrays, "a")


@settings(max_examples=30, deadline=None)
@given(
    name=st.sampled_from(["roots", "left", "right", "feature", "threshold", "value", "shape"]),
    place=st.integers(0, 400),
    value=st.integers(-(2**40), 2**40),
)
def test_whatever_is_written_into_them_is_walked_to_an_end_or_refused(
    name: str, place: int, value: int, boosted: Boosted
) -> None:
    arrays = {key: values.copy() for key, values in boosted.arrays("a").items()}
    part = arrays[f"a.{name}"]
    part[place % len(part)] = value
    try:
        found = Boosted.of_arrays(arrays, "a").predict(ROWS[:3])
    except ValueError:
        return
    assert np.isfinite(found).all()


@pytest.mark.parametrize("value", [np.zeros(0), np.zeros((2, 2)), np.array(["x"])])
def test_arrays_of_another_kind_are_refused(value: np.ndarray, boosted: Boosted) -> None:
    for name in boosted.arrays("a"):
        with pytest.raises(ValueError, match="trees"):
            Boosted.of_arrays(boosted.arrays("a") | {name: value}, "a")


def test_rows_of_another_width_are_refused(boosted: Boosted) -> None:
    with pytest.raises(ValueError, match="trees"):
        boosted.predict(ROWS[:, :5])


def test_a_missing_part_is_refused(boosted: Boosted) -> None:
    arrays = boosted.arrays("a")
    del arrays["a.value"]
    with pytest.raises(ValueError, match="trees"):
        Boosted.of_arrays(arrays, "a")


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr("importlib.import_module", missing)
    with pytest.raises(MissingExtraError, match="LightGBM"):
        library("lightgbm")
