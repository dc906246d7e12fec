"""What a layer says, as spans that can be compared: events, their parts, relations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ecat.annotate.agreement.spans import Span, Stretches
from ecat.model import Event, Layer, Relation, Segment
from ecat.model.holding import ALWAYS, intervals, presence
from ecat.model.scheme import CodingScheme


def last_frame(layers: Sequence[Layer]) -> int:
    """The frame after the last one that the layers mention, for recordings of unknown length."""
    ends = [segment.end_frame for layer in layers for event in layer.events for segment in event.segments]
    ends += [(r.end_frame or r.start_frame + 1) for layer in layers for r in layer.relations]
    ends += [key.frame + 1 for layer in layers for thing in layer.objects for key in thing.key_frames]
    return max(ends, default=0)


def event_spans(layer: Layer, n_frames: int) -> list[Span]:
    """The events that have a place in time, in the layer's order; the label is the type."""
    return [
        Span(event.id, event.type, stretches)
        for event in layer.events
        if (stretches := _stretches(event.segments, n_frames))
    ]


def _stretches(segments: Sequence[Segment], n_frames: int) -> Stretches:
    found: list[tuple[int, int]] = []
    for segment in sorted(segments, key=lambda s: s.start_frame):
        start = max(segment.start_frame, 0)
        end = min(segment.end_frame, n_frames) if n_frames else segment.end_frame
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        elif end > start:
            found.append((start, end))
    return tuple(found)


def depths(events: Mapping[str, Event]) -> dict[str, int]:
    """How many events each event is a part of, one within the other."""
    found: dict[str, int] = {}
    for name in events:
        path: list[str] = []
        at: str | None = name
        while at is not None and at in events and at not in found and at not in path:
            path.append(at)
            at = events[at].parent
        depth = found.get(at, -1) if at is not None else -1
        for step in reversed(path):
            depth += 1
            found[step] = depth
    return found


def relation_spans(layer: Layer, scheme: CodingScheme, n_frames: int, same: Mapping[str, str]) -> list[Span]:
    """When the layer's positive relations hold; the label is the predicate with its arguments.

    ``same`` renames the objects of another layer to this one's; facts about the same arguments are one span, whose id
    lists those of the relations.
    """
    there = {thing.id: presence(thing) for thing in layer.objects}
    held = intervals(layer.relations, scheme, lambda name: there.get(name, ALWAYS if "/" in name else ()))
    by_fact: dict[tuple[str, ...], list[Segment]] = {}
    ids: dict[tuple[str, ...], list[str]] = {}
    for index, stretches in held.items():
        fact = _fact(layer.relations[index], same)
        ids.setdefault(fact, []).append(layer.relations[index].id)
        by_fact.setdefault(fact, []).extend(
            Segment(start_frame=start, end_frame=n_frames if end is None else end) for start, end in stretches
        )
    return [
        Span(" ".join(ids[fact]), fact, stretches)
        for fact, segments in sorted(by_fact.items())
        if (stretches := _stretches(segments, n_frames))
    ]


def _fact(relation: Relation, same: Mapping[str, str]) -> tuple[str, ...]:
    return (relation.predicate, *(same.get(target, target) for target in relation.targets))
