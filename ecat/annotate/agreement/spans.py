"""Spans that two annotators marked: which of them mean the same, and how well their edges agree."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Stretches: TypeAlias = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Span:
    """Half-open stretches of frames, in order and apart from each other, of one kind of thing."""

    id: str
    label: Hashable
    stretches: Stretches

    @property
    def start(self) -> int:
        """Its first frame."""
        return self.stretches[0][0]

    @property
    def end(self) -> int:
        """The frame after its last."""
        return self.stretches[-1][1]

    @property
    def frames(self) -> int:
        """How many frames it covers."""
        return sum(end - start for start, end in self.stretches)


@dataclass(frozen=True, slots=True)
class Match:
    """Two spans that mean the same, and their intersection over union."""

    first: int
    second: int
    iou: float


@dataclass(frozen=True, slots=True)
class Score:
    """How many spans found their partner; adds up over sessions."""

    matched: int = 0
    first: int = 0
    second: int = 0

    def __add__(self, other: Score) -> Score:
        return Score(self.matched + other.matched, self.first + other.first, self.second + other.second)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall, the same whichever of the two is called the truth."""
        total = self.first + self.second
        return 2 * self.matched / total if total else float("nan")


def iou(first: Stretches, second: Stretches) -> float:
    """Frames that both cover, over frames that either covers."""
    common = sum(max(0, min(b, d) - max(a, c)) for a, b in first for c, d in second)
    either = sum(b - a for a, b in first) + sum(d - c for c, d in second) - common
    return common / either if either else 0.0


def match_spans(
    first: Sequence[Span], second: Sequence[Span], *, least_iou: float = 0.5, same_label: bool = True
) -> list[Match]:
    """One-to-one pairs of spans whose intersection over union is at least ``least_iou`` (> 0).

    Of all such pairings it is one with the most pairs, and of those the one with the greatest sum of overlaps (Kuhn
    1955).  Spans of different labels are not paired unless ``same_label`` is false.
    """
    candidates = [
        Match(i, j, overlap)
        for i, j in _overlapping(first, second)
        if (not same_label or first[i].label == second[j].label)
        and (overlap := iou(first[i].stretches, second[j].stretches)) >= least_iou
    ]
    found = [match for group in _groups(candidates, len(first), len(second)) for match in _assigned(group)]
    return sorted(found, key=lambda match: match.first)


def edge_errors(first: Sequence[Span], second: Sequence[Span], matches: Iterable[Match]) -> NDArray[np.int64]:
    """Frames by which the second's start and end are later than the first's (n, 2)."""
    rows = [
        (second[m.second].start - first[m.first].start, second[m.second].end - first[m.first].end)
        for m in matches
    ]
    return np.array(rows, np.int64).reshape(-1, 2)


def _overlapping(first: Sequence[Span], second: Sequence[Span]) -> Iterable[tuple[int, int]]:
    """Pairs that have a frame in common between their outer ends."""
    order = sorted(range(len(second)), key=lambda j: second[j].start)
    starts = np.array([second[j].start for j in order], np.int64)
    # the latest end so far tells from where on earlier starts may still reach
    reach = np.maximum.accumulate([second[j].end for j in order]) if order else starts
    for i, span in enumerate(first):
        low, high = np.searchsorted(reach, span.start, "right"), np.searchsorted(starts, span.end, "left")
        yield from ((i, order[k]) for k in range(int(low), int(high)) if second[order[k]].end > span.start)


def _groups(candidates: Sequence[Match], n: int, m: int) -> Iterable[list[Match]]:
    """Candidates that compete with each other, together."""
    if not candidates:
        return []
    rows, columns = [c.first for c in candidates], [n + c.second for c in candidates]
    graph = coo_array((np.ones(len(candidates)), (rows, columns)), shape=(n + m, n + m))
    part = connected_components(graph, directed=False)[1]
    groups: dict[int, list[Match]] = {}
    for candidate in candidates:
        groups.setdefault(int(part[candidate.first]), []).append(candidate)
    return groups.values()


def _assigned(group: list[Match]) -> Iterable[Match]:
    if len(group) == 1:
        return group
    rows = {i: k for k, i in enumerate(sorted({c.first for c in group}))}
    columns = {j: k for k, j in enumerate(sorted({c.second for c in group}))}
    gain = np.zeros((len(rows), len(columns)))
    for c in group:
        # one more pair is worth more than any overlap
        gain[rows[c.first], columns[c.second]] = len(group) + c.iou
    picked = set(zip(*(side.tolist() for side in linear_sum_assignment(gain, maximize=True)), strict=True))
    return [c for c in group if (rows[c.first], columns[c.second]) in picked]
