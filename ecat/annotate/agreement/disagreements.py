"""Where two annotators disagree, one thing at a time, for the person who decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ecat.annotate.agreement.compare import PAIRING_IOU
from ecat.annotate.agreement.facts import event_spans, last_frame, relation_spans
from ecat.annotate.agreement.objects import match_objects
from ecat.annotate.agreement.spans import Match, Span, match_spans
from ecat.model import AnnotatedObject, Event, Layer
from ecat.model.scheme import ECAT_2018_SCHEME, CodingScheme

SAME_EDGE_FRAMES = 2
"""Edges that differ by no more count as the same: nobody sees the difference."""
SAME_SHAPE_IOU = 0.9
"""Shapes that overlap by as much on average count as the same."""
_ANY_IOU = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """One thing that two annotators see differently.

    ``first`` and ``second`` are the ids in their layers, None where one of them says nothing (of a relation: of all
    that state the fact, apart by spaces); ``differs`` names what is different (``only``; of events and relations
    ``type``, ``start``, ``end``, ``tier``, ``parent``, ``roles``, ``text``; of objects ``name``, ``kind``,
    ``semantic type``, ``shape``).
    """

    kind: Literal["object", "event", "relation"]
    first: str | None
    second: str | None
    differs: tuple[str, ...]
    label: str
    start_frame: int
    end_frame: int


def disagreements(
    first: Layer, second: Layer, n_frames: int = 0, scheme: CodingScheme = ECAT_2018_SCHEME
) -> list[Disagreement]:
    """All of them, in the order of time; events first, and each before its parts.

    Events are paired by type and overlap; those left over are paired by overlap alone, and then differ in type.
    """
    n_frames = n_frames or last_frame((first, second))
    matched = match_objects(first.objects, second.objects)
    same = {a: b for a, (b, _) in matched.items()}
    found = [
        *_events(first, second, n_frames, same),
        *_relations(first, second, n_frames, same, scheme),
        *_objects(first, second, matched, n_frames),
    ]
    return sorted(found, key=lambda d: (d.kind != "event", d.start_frame, -d.end_frame, d.label))


def _pairs(first: Sequence[Span], second: Sequence[Span]) -> list[tuple[int | None, int | None]]:
    matches = match_spans(first, second, least_iou=PAIRING_IOU)
    matches += _remaining(first, second, matches, same_label=True, least=_ANY_IOU)
    matches += _remaining(first, second, matches, same_label=False, least=PAIRING_IOU)
    taken = {m.first for m in matches}, {m.second for m in matches}
    alone: list[tuple[int | None, int | None]] = [(i, None) for i in range(len(first)) if i not in taken[0]]
    alone += [(None, j) for j in range(len(second)) if j not in taken[1]]
    return [*((m.first, m.second) for m in matches), *alone]


def _remaining(
    first: Sequence[Span], second: Sequence[Span], matches: Sequence[Match], *, same_label: bool, least: float
) -> list[Match]:
    taken = {m.first for m in matches}, {m.second for m in matches}
    rest = [[k for k in range(len(side)) if k not in taken[n]] for n, side in enumerate((first, second))]
    found = match_spans(
        [first[i] for i in rest[0]], [second[j] for j in rest[1]], least_iou=least, same_label=same_label
    )
    return [Match(rest[0][m.first], rest[1][m.second], m.iou) for m in found]


def _events(first: Layer, second: Layer, n_frames: int, same: Mapping[str, str]) -> list[Disagreement]:
    events = {e.id: e for e in first.events}, {e.id: e for e in second.events}
    spans = event_spans(first, n_frames), event_spans(second, n_frames)
    pairs = _pairs(*spans)
    partner = {spans[0][i].id: spans[1][j].id for i, j in pairs if i is not None and j is not None}
    found: list[Disagreement] = []
    for i, j in pairs:
        a, b = (None if i is None else spans[0][i]), (None if j is None else spans[1][j])
        differs = _differences(a, b, events, partner, same)
        if differs:
            found.append(_disagreement("event", a, b, differs))
    return found


def _differences(
    a: Span | None,
    b: Span | None,
    events: tuple[Mapping[str, Event], Mapping[str, Event]],
    partner: Mapping[str, str],
    same: Mapping[str, str],
) -> tuple[str, ...]:
    if a is None or b is None:
        return ("only",)
    first, second = events[0][a.id], events[1][b.id]
    parent = None if first.parent is None else partner.get(first.parent, "?")
    differences = {
        "type": first.type != second.type,
        "start": abs(a.start - b.start) > SAME_EDGE_FRAMES,
        "end": abs(a.end - b.end) > SAME_EDGE_FRAMES,
        "tier": first.tier != second.tier,
        "parent": parent != second.parent,
        "roles": {(r.name, same.get(r.target, r.target)) for r in first.roles}
        != {(r.name, r.target) for r in second.roles},
        "text": first.text != second.text,
    }
    return tuple(name for name, differ in differences.items() if differ)


def _relations(
    first: Layer, second: Layer, n_frames: int, same: Mapping[str, str], scheme: CodingScheme
) -> list[Disagreement]:
    spans = (
        relation_spans(first, scheme, n_frames, same),
        relation_spans(second, scheme, n_frames, {}),
    )
    found: list[Disagreement] = []
    for i, j in _pairs(*spans):
        a, b = (None if i is None else spans[0][i]), (None if j is None else spans[1][j])
        if a is None or b is None:
            found.append(_disagreement("relation", a, b, ("only",)))
        elif a.label != b.label:
            # another fact that happens to hold at the same time is not what this one should have been
            found.append(_disagreement("relation", a, None, ("only",)))
            found.append(_disagreement("relation", None, b, ("only",)))
        elif edges := _edges(a, b):
            found.append(_disagreement("relation", a, b, edges))
    return found


def _edges(a: Span, b: Span) -> tuple[str, ...]:
    differences = {"start": a.start - b.start, "end": a.end - b.end}
    return tuple(name for name, frames in differences.items() if abs(frames) > SAME_EDGE_FRAMES)


def _objects(
    first: Layer, second: Layer, matched: Mapping[str, tuple[str, float]], n_frames: int
) -> list[Disagreement]:
    theirs, paired = {thing.id: thing for thing in second.objects}, {b for b, _ in matched.values()}
    found: list[Disagreement] = []
    for thing in first.objects:
        a = _life(thing, n_frames)
        if thing.id not in matched:
            found.append(_disagreement("object", a, None, ("only",)))
            continue
        other, alike = matched[thing.id]
        if differs := _object_differences(thing, theirs[other], alike):
            found.append(_disagreement("object", a, _life(theirs[other], n_frames), differs))
    alone = (thing for thing in second.objects if thing.id not in paired)
    return found + [_disagreement("object", None, _life(thing, n_frames), ("only",)) for thing in alone]


def _life(thing: AnnotatedObject, n_frames: int) -> Span:
    start = min((max(key.frame, 0) for key in thing.key_frames), default=0)
    return Span(thing.id, thing.name or thing.id, ((start, max(n_frames, start + 1)),))


def _object_differences(a: AnnotatedObject, b: AnnotatedObject, alike: float) -> tuple[str, ...]:
    differences = {
        "name": a.name != b.name,
        "kind": a.kind != b.kind,
        "semantic type": a.semantic_type != b.semantic_type,
        "shape": alike < SAME_SHAPE_IOU,
    }
    return tuple(name for name, differ in differences.items() if differ)


def _disagreement(
    kind: Literal["object", "event", "relation"], a: Span | None, b: Span | None, differs: tuple[str, ...]
) -> Disagreement:
    there = [span for span in (a, b) if span is not None]
    label = there[0].label
    return Disagreement(
        kind=kind,
        first=a.id if a else None,
        second=b.id if b else None,
        differs=differs,
        label=" ".join(map(str, label)) if isinstance(label, tuple) else str(label),  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
        start_frame=min(span.start for span in there),
        end_frame=max(span.end for span in there),
    )
