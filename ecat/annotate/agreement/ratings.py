"""How far several raters who put the same items into categories agree beyond chance.

Ratings come as **patterns**: how many items the raters gave which labels, ``{("push", "push"): 812, ("push", None):
3}``, one label per rater in a fixed order and None where a rater gave none.  Millions of frames are a handful of
patterns, and patterns of several sessions add up.

A coefficient of items that all got one label is not defined (chance alone explains everything): it is NaN.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Label: TypeAlias = Hashable
Patterns: TypeAlias = Mapping[tuple[Any, ...], int]
Level = Literal["nominal", "ordinal", "interval"]


def patterns_of(items: Iterable[Iterable[Label]]) -> Counter[tuple[Any, ...]]:
    """Patterns of items that are given one by one, each the labels by all raters."""
    return Counter(map(tuple, items))


def categories_of(patterns: Patterns) -> list[Any]:
    """The labels that occur, in order."""
    found = {label for pattern in patterns for label in pattern if label is not None}
    return sorted(found, key=lambda label: (str(type(label)), label))


def observed_agreement(patterns: Patterns) -> float:
    """The share of pairs of ratings of one item that are equal (for two raters: of items)."""
    counts, weights = _counts(patterns)
    n = counts.sum(1)
    rated = n > 1
    pairs = (counts * (counts - 1)).sum(1)[rated] / (n * (n - 1))[rated]
    total = weights[rated].sum()
    return float((pairs * weights[rated]).sum() / total) if total else float("nan")


def cohen_kappa(patterns: Patterns, *, weights: Literal["none", "linear", "quadratic"] = "none") -> float:
    """Cohen's kappa of two raters (Cohen 1960; weighted: Cohen 1968, over the order of the categories).

    Items that one of them did not rate are left out.
    """
    table = confusion(patterns)
    n = table.sum()
    if not n:
        return float("nan")
    k = len(table)
    steps = np.abs(np.subtract.outer(np.arange(k), np.arange(k))).astype(float)
    disagreement = {"none": (steps > 0).astype(float), "linear": steps, "quadratic": steps**2}[weights]
    expected = np.outer(table.sum(1), table.sum(0)) / n
    by_chance = float((disagreement * expected).sum())
    return 1.0 - float((disagreement * table).sum()) / by_chance if by_chance else float("nan")


def fleiss_kappa(patterns: Patterns) -> float:
    """Fleiss' kappa of any number of raters (Fleiss 1971); items that somebody did not rate are left out."""
    complete = {pattern: n for pattern, n in patterns.items() if None not in pattern}
    counts, weights = _counts(complete)
    if not counts.size or counts.sum(1).max() < 2:
        return float("nan")
    n = counts[0].sum()
    per_item = ((counts**2).sum(1) - n) / (n * (n - 1))
    shares = (counts * weights[:, None]).sum(0) / (n * weights.sum())
    by_chance = float((shares**2).sum())
    observed = float((per_item * weights).sum() / weights.sum())
    return (observed - by_chance) / (1 - by_chance) if by_chance < 1 else float("nan")


def krippendorff_alpha(patterns: Patterns, *, level: Level = "nominal") -> float:
    """Krippendorff's alpha of any number of raters, missing ratings allowed (Krippendorff 2011).

    Parameters
    ----------
    level : ``nominal`` labels are equal or not; ``ordinal`` ones are ordered; ``interval`` ones are numbers.
    """
    counts, weights = _counts(patterns)
    m = counts.sum(1)
    rated = m > 1
    counts, weights, m = counts[rated], weights[rated], m[rated]
    if not len(counts):
        return float("nan")
    each = counts[:, :, None] * counts[:, None, :]
    each -= counts[:, :, None] * np.eye(counts.shape[1])
    coincidences = (each * (weights / (m - 1))[:, None, None]).sum(0)
    totals = coincidences.sum(0)
    distance = _distances(level, totals, categories_of(patterns))
    expected = float((np.outer(totals, totals) * distance).sum())
    observed = float((coincidences * distance).sum())
    return 1.0 - (float(totals.sum()) - 1.0) * observed / expected if expected else float("nan")


def confusion(patterns: Patterns, *, normalize: bool = False) -> Floats:
    """How often the first of two raters (or the truth) said one thing while the second said another.

    Returns
    -------
    (k, k) over :func:`categories_of`: rows the first, columns the second; ``normalize`` makes each row that has
    items add up to one.
    """
    if any(len(pattern) != 2 for pattern in patterns):
        raise ValueError("a confusion matrix is of two raters")
    place = {label: i for i, label in enumerate(categories_of(patterns))}
    table = np.zeros((len(place), len(place)))
    for (first, second), n in patterns.items():
        if first is not None and second is not None:
            table[place[first], place[second]] += n
    return table / np.maximum(table.sum(1, keepdims=True), 1) if normalize else table


def _counts(patterns: Patterns) -> tuple[Floats, Floats]:
    """Ratings by pattern and category, and how many items have the pattern."""
    place = {label: i for i, label in enumerate(categories_of(patterns))}
    counts = np.zeros((len(patterns), len(place)))
    for row, pattern in zip(counts, patterns, strict=True):
        for label in pattern:
            if label is not None:
                row[place[label]] += 1
    return counts, np.array(list(patterns.values()), float)


def _distances(level: Level, totals: Floats, categories: list[Any]) -> Floats:
    """Squared distances (k, k) of the categories."""

    def ordinal() -> Floats:
        # ratings from the one category to the other, half of those at the ends
        rank = np.cumsum(totals) - totals / 2
        return np.subtract.outer(rank, rank) ** 2

    def interval() -> Floats:
        values = np.array(categories, float)
        return np.subtract.outer(values, values) ** 2

    by_level: dict[Level, Callable[[], Floats]] = {
        "nominal": lambda: 1.0 - np.eye(len(totals)),
        "ordinal": ordinal,
        "interval": interval,
    }
    return by_level[level]()
