"""Statistics of episodes and of everything, the same however the rows come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.lerobot import stats

seeds = st.integers(0, 2**32 - 1)


def rows(seed: int, n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.normal(3, 2, n), rng.exponential(1, n), np.full(n, 7.0)])


@given(seeds, st.lists(st.integers(1, 399), max_size=5, unique=True))
def test_moments_of_pieces_are_those_of_the_whole(seed: int, cuts: list[int]) -> None:
    values = rows(seed)
    moments = stats.Moments()
    for piece in np.split(values, sorted(cuts)):
        moments.add(stats.of_rows(piece))
    whole = stats.of_rows(values)
    assert moments.count == 400
    assert moments.mean == pytest.approx(whole["mean"], abs=1e-12)
    assert np.sqrt(moments.square / moments.count) == pytest.approx(whole["std"], abs=1e-9)
    assert (moments.least.tolist(), moments.greatest.tolist()) == (
        whole["min"].tolist(),
        whole["max"].tolist(),
    )


@given(seeds, st.lists(st.integers(1, 399), max_size=5, unique=True))
def test_quantiles_of_pieces_are_right_to_a_bin(seed: int, cuts: list[int]) -> None:
    values = rows(seed)
    histogram = stats.Histogram(values.min(axis=0), values.max(axis=0))
    for piece in np.split(values, sorted(cuts)):
        histogram.add(piece)
    width = np.ptp(values, axis=0) / stats.BINS
    ordered = np.sort(values, axis=0)
    for name, found in histogram.quantiles():
        # between the two rows that the quantile falls between, give or take a bin
        at = stats.QUANTILES[name] * 400
        low, high = ordered[max(int(at) - 1, 0)], ordered[min(int(np.ceil(at)), 399)]
        assert (found >= low - 2 * width).all()
        assert (found <= high + 2 * width).all()


def test_whole_numbers_stay_whole() -> None:
    found = stats.as_json(stats.of_rows(np.arange(5)[:, None]))
    assert (found["min"], found["max"], found["count"]) == ([0], [4], [5])
    assert isinstance(found["min"][0], int)
    assert found["mean"] == [2.0]
    assert list(found) == ["min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"]


@given(seeds)
def test_images_are_counted_exactly(seed: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, (3, 500))
    counts = np.array([np.bincount(channel, minlength=256) for channel in pixels])
    found = stats.of_histogram(counts, np.arange(256) / 255, 2)
    assert found["mean"].shape == (3, 1, 1)
    assert found["mean"].ravel() == pytest.approx(pixels.mean(axis=1) / 255)
    assert found["std"].ravel() == pytest.approx(pixels.std(axis=1) / 255)
    assert found["min"].ravel() == pytest.approx(pixels.min(axis=1) / 255)
    assert found["max"].ravel() == pytest.approx(pixels.max(axis=1) / 255)
    exact = np.quantile(pixels, 0.9, axis=1, method="inverted_cdf") / 255
    assert found["q90"].ravel() == pytest.approx(exact)
