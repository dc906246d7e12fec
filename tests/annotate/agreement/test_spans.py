"""Pairs of spans: the best there are, one to one."""

from __future__ import annotations

from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.annotate.agreement.spans import Score, Span, edge_errors, iou, match_spans


def span(start: int, end: int, label: str = "push", name: str = "e") -> Span:
    return Span(name, label, ((start, end),))


def test_overlap_counts_frames() -> None:
    assert iou(((0, 10),), ((5, 15),)) == pytest.approx(5 / 15)
    assert iou(((0, 10), (20, 30)), ((5, 25),)) == pytest.approx(10 / 30)
    assert iou(((0, 10),), ((10, 20),)) == 0.0


def test_a_span_is_paired_once_and_with_the_best() -> None:
    first, second = [span(0, 10), span(10, 20)], [span(1, 11), span(8, 20)]
    assert [(m.first, m.second) for m in match_spans(first, second)] == [(0, 0), (1, 1)]


def test_greed_for_the_best_pair_does_not_spoil_the_whole() -> None:
    # the very best pair, the second with the first, would leave the two others alone
    first, second = [span(0, 9), span(4, 14)], [span(4, 13), span(7, 20)]
    assert len(match_spans(first, second, least_iou=0.3)) == 2


def test_other_labels_are_other_things() -> None:
    first, second = [span(0, 10, "push")], [span(0, 10, "pull")]
    assert match_spans(first, second) == []
    assert len(match_spans(first, second, same_label=False)) == 1


def test_nothing_pairs_with_nothing() -> None:
    assert match_spans([], []) == []
    assert match_spans([span(0, 1)], []) == []


def test_edges_tell_who_is_late() -> None:
    first, second = [span(10, 20)], [span(12, 19)]
    assert edge_errors(first, second, match_spans(first, second)).tolist() == [[2, -1]]


def test_scores_add_up() -> None:
    total = Score(1, 2, 2) + Score(2, 2, 3)
    assert total.f1 == pytest.approx(2 * 3 / 9)


_spans = st.lists(
    st.tuples(st.integers(0, 30), st.integers(1, 12), st.sampled_from("ab")).map(
        lambda t: span(t[0], t[0] + t[1], t[2])
    ),
    max_size=5,
)


def _best(first: list[Span], second: list[Span], least: float) -> tuple[int, float]:
    """The most pairs, and the greatest sum of their overlaps, by trying all."""
    rows = [*range(len(second)), *[-1] * len(first)]
    found = (0, 0.0)
    for order in set(permutations(rows, len(first))):
        pairs = [(a, second[j]) for a, j in zip(first, order, strict=True) if j >= 0]
        overlaps = [iou(a.stretches, b.stretches) for a, b in pairs if a.label == b.label]
        good = [overlap for overlap in overlaps if overlap >= least]
        found = max(found, (len(good), sum(good)))
    return found


@given(_spans.filter(lambda s: len(s) < 4), _spans.filter(lambda s: len(s) < 4), st.sampled_from([0.2, 0.5]))
def test_no_other_pairing_is_better(first: list[Span], second: list[Span], least: float) -> None:
    matches = match_spans(first, second, least_iou=least)
    pairs, overlap = _best(first, second, least)
    assert len(matches) == pairs
    assert sum(m.iou for m in matches) == pytest.approx(overlap)


@given(_spans, _spans)
def test_it_does_not_matter_who_is_first(first: list[Span], second: list[Span]) -> None:
    ahead, back = match_spans(first, second), match_spans(second, first)
    assert len(ahead) == len(back)
    assert sum(m.iou for m in ahead) == pytest.approx(sum(m.iou for m in back))
    assert len({m.first for m in ahead}) == len({m.second for m in ahead}) == len(ahead)
