"""Coefficients against the worked examples of the papers that define them, and against what must always hold."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ecat.annotate.agreement.ratings import (
    categories_of,
    cohen_kappa,
    confusion,
    fleiss_kappa,
    krippendorff_alpha,
    observed_agreement,
    patterns_of,
)

# ratings of ten patients by 14 psychiatrists in five categories (Fleiss 1971, table 1, as usually reprinted)
_FLEISS = (
    (0, 0, 0, 0, 14), (0, 2, 6, 4, 2), (0, 0, 3, 5, 6), (0, 3, 9, 2, 0), (2, 2, 8, 1, 1),
    (7, 7, 0, 0, 0), (3, 2, 6, 3, 0), (2, 5, 3, 2, 2), (6, 5, 2, 1, 0), (0, 2, 2, 3, 7),
)  # fmt: skip
# four observers, twelve units, with missing values (Krippendorff 2011, section D)
_KRIPPENDORFF = (
    (1, 2, 3, 3, 2, 1, 4, 1, 2, None, None, None),
    (1, 2, 3, 3, 2, 2, 4, 1, 2, 5, None, 3),
    (None, 3, 3, 3, 2, 3, 4, 2, 2, 5, 1, None),
    (1, 2, 3, 3, 2, 4, 4, 1, 2, 5, 1, None),
)

labels = st.sampled_from(["push", "pull", "slide", None])
items = st.lists(st.tuples(labels, labels, labels), min_size=1, max_size=30)


def test_fleiss_kappa_of_the_psychiatrists() -> None:
    rated = [[k for k, n in enumerate(row) for _ in range(n)] for row in _FLEISS]
    assert fleiss_kappa(patterns_of(rated)) == pytest.approx(0.2099, abs=1e-4)


@pytest.mark.parametrize(("level", "alpha"), [("nominal", 0.743), ("ordinal", 0.815), ("interval", 0.849)])
def test_krippendorffs_alpha_of_the_four_observers(level: str, alpha: float) -> None:
    patterns = patterns_of(zip(*_KRIPPENDORFF, strict=True))
    assert krippendorff_alpha(patterns, level=level) == pytest.approx(alpha, abs=5e-4)  # type: ignore[arg-type]


def test_cohens_kappa_of_a_two_by_two_table() -> None:
    patterns = {("yes", "yes"): 20, ("yes", "no"): 5, ("no", "yes"): 10, ("no", "no"): 15}
    assert cohen_kappa(patterns) == pytest.approx(0.4)


def test_weighted_kappa_forgives_near_misses() -> None:
    near = {(1, 1): 10, (2, 2): 10, (3, 3): 10, (1, 2): 5}
    far = {(1, 1): 10, (2, 2): 10, (3, 3): 10, (1, 3): 5}
    assert cohen_kappa(near, weights="quadratic") > cohen_kappa(far, weights="quadratic")
    assert cohen_kappa(near, weights="linear") > cohen_kappa(near)


def test_agreement_on_one_label_alone_says_nothing() -> None:
    patterns = {("push", "push"): 100}
    assert observed_agreement(patterns) == 1.0
    assert all(math.isnan(f(patterns)) for f in (cohen_kappa, fleiss_kappa, krippendorff_alpha))


def test_no_items_give_no_figure() -> None:
    assert all(math.isnan(f({})) for f in (observed_agreement, fleiss_kappa, krippendorff_alpha, cohen_kappa))


def test_confusion_has_the_truth_in_its_rows() -> None:
    patterns = {("Next", "Closer"): 3, ("Next", "Next"): 1, ("Closer", "Closer"): 2, ("Next", None): 9}
    assert categories_of(patterns) == ["Closer", "Next"]
    assert confusion(patterns).tolist() == [[2, 0], [3, 1]]
    assert confusion(patterns, normalize=True).tolist() == [[1, 0], [0.75, 0.25]]


def test_confusion_is_of_two() -> None:
    with pytest.raises(ValueError, match="two raters"):
        confusion({("a", "b", "c"): 1})


@given(items)
def test_perfect_agreement_is_one_or_undefined(rated: list[tuple[str | None, ...]]) -> None:
    same = patterns_of((row[0], row[0], row[0]) for row in rated)
    for figure in (fleiss_kappa(same), krippendorff_alpha(same)):
        assert math.isnan(figure) or figure == pytest.approx(1.0)


@given(items, st.permutations(range(3)))
def test_the_order_of_the_raters_does_not_matter(
    rated: list[tuple[str | None, ...]], order: list[int]
) -> None:
    turned = patterns_of(tuple(row[k] for k in order) for row in rated)
    for figure in (fleiss_kappa, krippendorff_alpha, observed_agreement):
        np.testing.assert_allclose(figure(patterns_of(rated)), figure(turned))


@given(items)
def test_patterns_add_up_as_the_items_do(rated: list[tuple[str | None, ...]]) -> None:
    twice = Counter(patterns_of(rated))
    twice.update(patterns_of(rated))
    assert twice == patterns_of([*rated, *rated])
    # kappa does not know how many items there are
    np.testing.assert_allclose(fleiss_kappa(twice), fleiss_kappa(patterns_of(rated)))


@given(items)
def test_alpha_and_fleiss_meet_where_nothing_is_missing(rated: list[tuple[str | None, ...]]) -> None:
    full = patterns_of(row for row in rated for _ in range(400) if None not in row)
    assume(len(categories_of(full)) > 1)
    # alpha corrects for the sample's size, which vanishes as it grows
    assert krippendorff_alpha(full) == pytest.approx(fleiss_kappa(full), abs=2e-3)
