"""Do annotations fit the recording, each other and their coding scheme."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import chain, pairwise
from math import isnan

from ecat.check.finding import Finding, Patient, error, some, warning
from ecat.model import CodingScheme, Event, Layer, Relation
from ecat.model.shapes import shape_problem

FIRST_FRAME = -1
"""Position before the first image, legal in imported annotations (see :mod:`ecat.model.annotation`)."""
OPEN_SCHEMES = frozenset({"ecat-2018"})
"""Coding schemes that may lack predicates: ECAT users kept theirs in a file outside of the recording
(ECAT 2018 file format §1.10)."""


def _spans(layer: Layer) -> Iterator[tuple[str, int, int | None, int | None, int | None]]:
    """Every interval of a layer: place, start and end frame, start and end time."""
    for event in layer.events:
        for i, s in enumerate(event.segments):
            which = f", segment {i}" if len(event.segments) > 1 else ""
            place = f"layer {layer.name}, event {event.id}{which}"
            yield place, s.start_frame, s.end_frame, s.start_ns, s.end_ns
    for i, r in enumerate(layer.relations):
        place = f"layer {layer.name}, relation {i} ({r.predicate})"
        yield place, r.start_frame, r.end_frame, r.start_ns, r.end_ns


def intervals(patient: Patient) -> Iterator[Finding]:
    """Intervals are neither empty nor reversed."""
    for layer in patient.layers.values():
        for place, start, end, start_ns, end_ns in _spans(layer):
            reversed_in_time = start_ns is not None and end_ns is not None and end_ns < start_ns
            if (end is not None and end < start) or reversed_in_time:
                message = f"it ends before it starts: frames {start} to {end}"
                if reversed_in_time:
                    message += f", {start_ns} to {end_ns} ns"
                yield error("interval-reversed", place, message)
            elif end == start:
                message = f"it is empty: it starts at frame {start} and ends before that frame"
                yield warning("interval-empty", place, message)


def outside_recording(patient: Patient) -> Iterator[Finding]:
    """Intervals and key frames lie within the recording, where its length is known."""
    n = patient.manifest.n_frames
    if not n:
        return
    for layer in patient.layers.values():
        for place, start, end, _, _ in _spans(layer):
            if start < FIRST_FRAME or start >= n or (end is not None and end > n):
                last = "the end" if end is None else end
                message = f"frames {start} to {last}, but the recording has {n:,} frames"
                yield warning("outside-recording", place, message)
        for thing in layer.objects:
            frames = [k.frame for k in (*thing.key_frames, *thing.key_frames_3d)]
            outside = [str(frame) for frame in sorted(set(frames)) if not FIRST_FRAME <= frame < n]
            if outside:
                place = f"layer {layer.name}, object {thing.id}"
                message = f"key frames at frame {some(outside)}, but the recording has {n:,} frames"
                yield warning("outside-recording", place, message)


def key_frame_order(patient: Patient) -> Iterator[Finding]:
    """Key frames are in order, one per frame: an object's state is that of its last key frame."""
    for layer in patient.layers.values():
        for thing in layer.objects:
            for keys in (thing.key_frames, thing.key_frames_3d):
                wrong = [str(b.frame) for a, b in pairwise(keys) if b.frame <= a.frame]
                if wrong:
                    place = f"layer {layer.name}, object {thing.id}"
                    message = f"key frames repeated or out of order at frame {some(wrong)}"
                    yield error("key-frame-order", place, message)


def key_frame_values(patient: Patient) -> Iterator[Finding]:
    """A drawn shape has as many numbers as its kind takes, and they are places; in space a vertex may be unknown."""
    for layer in patient.layers.values():
        for thing in layer.objects:
            if thing.kind not in {"rectangle", "polygon", "point"}:
                continue
            frames: dict[str, list[str]] = defaultdict(list)
            for dimensions, keys in ((2, thing.key_frames), (3, thing.key_frames_3d)):
                for key in (key for key in keys if key.present):
                    known = [0.0 if dimensions == 3 and isnan(x) else x for x in key.coordinates]
                    frames[shape_problem(thing.kind, known, dimensions)].append(str(key.frame))
            for problem in filter(None, frames):
                message = f"the {thing.kind} at frame {some(frames[problem])}: {problem}"
                yield warning("key-frame-value", f"layer {layer.name}, object {thing.id}", message)


def sub_events(patient: Patient) -> Iterator[Finding]:
    """A sub-event lies within its parent (the constraint ``included_in``)."""
    for layer in patient.layers.values():
        by_id = {event.id: event for event in layer.events}
        for event in layer.events:
            parent = by_id.get(event.parent) if event.parent is not None else None
            if parent is None or not parent.segments or not event.segments:
                continue
            outer, inner = _extent(parent), _extent(event)
            if inner[0] < outer[0] or inner[1] > outer[1]:
                yield warning(
                    "sub-event-outside",
                    f"layer {layer.name}, event {event.id}",
                    f"frames {inner[0]} to {inner[1]}, but its parent {parent.id} "
                    f"has frames {outer[0]} to {outer[1]}",
                )


def _extent(event: Event) -> tuple[int, int]:
    return min(s.start_frame for s in event.segments), max(s.end_frame for s in event.segments)


def coding_scheme(patient: Patient) -> Iterator[Finding]:
    """Tiers, event types, roles and predicates are those of the layer's coding scheme."""
    for layer in patient.layers.values():
        scheme = patient.scheme(layer.scheme)
        if scheme is None:
            continue
        events = ((f"event {e.id}", _event_problems(e, scheme)) for e in layer.events)
        relations = (
            (f"relation {i} ({r.predicate})", _relation_problems(r, scheme))
            for i, r in enumerate(layer.relations)
        )
        for place, problems in chain(events, relations):
            for message in problems:
                place_ = f"layer {layer.name}, {place}"
                yield warning("off-scheme", place_, message)


def _event_problems(event: Event, scheme: CodingScheme) -> Iterator[str]:
    """A scheme without tiers, types or event predicates leaves these free."""
    tiers = {tier.name for tier in scheme.tiers}
    if tiers and event.tier and event.tier not in tiers:
        yield f"tier {event.tier} is not in the coding scheme {scheme.name}"
    types = {kind.name: kind for kind in scheme.event_types}
    if types and event.type and event.type not in types:
        yield f"type {event.type} is not in the coding scheme {scheme.name}"
    links = {p.name for p in scheme.predicates if p.target == "event"}
    for link in event.links:
        if links and link.type not in links:
            yield f"link {link.type} is not in the coding scheme {scheme.name}"
    if event.type in types:
        allowed = {role.name: role for role in types[event.type].roles}
        filled = {role.name for role in event.roles}
        for name in sorted(filled - allowed.keys()) if allowed else ():
            yield f"role {name} is not one of {event.type}"
        for role in allowed.values():
            if role.required and role.name not in filled:
                yield f"role {role.name} is required for {event.type}, and empty"


def _relation_problems(relation: Relation, scheme: CodingScheme) -> Iterator[str]:
    arities = {p.arity for p in scheme.predicates if p.name == relation.predicate}
    if scheme.predicates and not arities and scheme.name not in OPEN_SCHEMES:
        yield f"predicate {relation.predicate} is not in the coding scheme {scheme.name}"
    elif arities and len(relation.targets) not in arities:
        expected = " or ".join(map(str, sorted(arities)))
        yield f"it has {len(relation.targets)} arguments, {relation.predicate} takes {expected}"


ANNOTATION = (intervals, outside_recording, key_frame_order, key_frame_values, sub_events, coding_scheme)
