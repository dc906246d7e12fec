"""Sessions with any layer in them, and what of a layer a format can carry, for comparison."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pytest
from hypothesis import strategies as st

from ecat.formats.interchange.shapes import first_images, shapes, straight
from ecat.formats.interchange.source import shape_kind
from ecat.formats.interchange.times import times_of
from ecat.model import (
    AnnotatedObject,
    Clock,
    Event,
    KeyFrame,
    Layer,
    Link,
    Manifest,
    Property,
    Role,
    Segment,
    Stream,
    TextPredicate,
    TextReference,
)
from ecat.model.annotation import ObjectKind
from ecat.progress import silent
from ecat.store import Draft, Session, TableData, create_session
from ecat.tables import FRAMES

N_FRAMES = 90
STREAM = "color"
Timing = Literal["uniform", "recorded", "unknown"]
RECORDED_NS = [0, *(33_000_000 * n + (n * 7919) % 9_000_000 for n in range(1, N_FRAMES))]
"""Images that come irregularly."""


def base_session(folder: Path, timing: Timing, layer: Layer | None = None, **stream: Any) -> Session:
    """A session of ninety images that are not there."""
    clock = {
        "uniform": Clock(rule="uniform", duration_ns=2_983_333_333),
        "recorded": Clock(rule="recorded", duration_ns=RECORDED_NS[-1]),
        "unknown": Clock(rule="unknown"),
    }[timing]
    said: Any = {"width_px": 640, "height_px": 480, **stream}
    manifest = Manifest(
        name="s",
        created="2026-01-01T00:00:00+00:00",
        n_frames=N_FRAMES,
        clock=clock,
        streams=(Stream(name=STREAM, kind="color", n_frames=N_FRAMES, **said),),
    )
    rows = pa.table(
        {"t_ns": RECORDED_NS, "frame": list(range(N_FRAMES)), "stream": [STREAM] * N_FRAMES}
    ).cast(FRAMES.arrow)
    tables = {"frames": TableData(data=rows)} if timing == "recorded" else {}
    draft = Draft(manifest=manifest, layers=(layer or Layer(),), tables=tables)
    return create_session(folder / timing / "s", draft)


class Holding(Session):
    """A session whose layer ``main`` is another than on the disk."""

    def __init__(self, base: Session, layer: Layer) -> None:
        super().__init__(base.snapshot)
        self._held = layer

    def layer(self, name: str = "main") -> Layer:
        """The layer, whatever it is called."""
        return self._held


def there_and_back(
    form: Any, session: Session, folder: Path, **options: Any
) -> tuple[Layer, tuple[str, ...]]:
    """The layer of a session written in a format and read again, and what was left behind."""
    dest = folder / f"file{form.suffix}"
    findings = form.part(session, "s", dest, form.options(**options), silent)
    return form.read_layer(dest, session)[0], findings


# ---------------------------------------------------------------------------------------------- any layer

_LETTERS = st.characters(categories=("L", "N", "P", "S"), exclude_characters="\ufffe\uffff")
NAMES = st.text(_LETTERS | st.just(" "), min_size=1, max_size=8).map(str.strip).filter(bool)
"""Names without line feeds, as of roles and tiers."""
TEXTS = st.text(_LETTERS | st.sampled_from(" \n\t\r;\\|,'\"&<>"), max_size=12)
_RESERVED = {"unlabelled", "(no tier)", "timeline", "None", "No focal subject", "object", "event"}
TYPES = NAMES.filter(lambda name: name not in _RESERVED)


@st.composite
def objects(
    draw: st.DrawFn, kinds: tuple[ObjectKind, ...], *, absences: bool = True
) -> tuple[AnnotatedObject, ...]:
    made: list[AnnotatedObject] = []
    for number in range(1, draw(st.integers(1, 4)) + 1):
        kind = draw(st.sampled_from(kinds))
        frames = sorted(draw(st.sets(st.integers(0, N_FRAMES - 1), max_size=5)))
        keys = [
            KeyFrame(frame=frame, coordinates=draw(_coordinates(kind)))
            if index == 0 or not absences or draw(st.integers(0, 3))
            else KeyFrame(frame=frame, present=False)
            for index, frame in enumerate(frames)
        ]
        thing = AnnotatedObject(
            id=f"o{number}",
            name=draw(TEXTS.filter(lambda t: t == t.strip()) | NAMES),
            kind=kind,
            stream=STREAM,
            semantic_type=draw(st.just("") | TYPES),
            interpolation=draw(st.sampled_from(["linear", "hold"])),
            properties=tuple(
                Property(name=f"{name}!", value=draw(TEXTS)) for name in draw(st.sets(NAMES, max_size=2))
            ),
            key_frames=tuple(keys),
        )
        made.append(thing)
    return tuple(made)


@st.composite
def _coordinates(draw: st.DrawFn, kind: ObjectKind) -> tuple[float, ...]:
    place = st.integers(0, 5000).map(lambda n: n / 8)
    if kind == "rectangle":
        return tuple(draw(st.tuples(place, place, place.map(lambda x: x + 1), place.map(lambda x: x + 1))))
    if kind == "point":
        return tuple(draw(st.tuples(place, place)))
    n = draw(st.integers(3, 5))
    return tuple(draw(st.lists(place, min_size=2 * n, max_size=2 * n)))


@st.composite
def layers(
    draw: st.DrawFn,
    session: Session,
    kinds: tuple[ObjectKind, ...] = ("rectangle", "polygon", "point"),
    *,
    absences: bool = True,
    apart: bool = False,
) -> Layer:
    """Any layer; with events that lie ``apart``, those of a type are on one tier."""
    things = draw(objects(kinds, absences=absences))
    ids = [f"a{number}" for number in range(1, draw(st.integers(1, 6)) + 1)]
    times = times_of(session)
    tiers, types = draw(st.lists(TYPES, max_size=3)), draw(st.lists(TYPES, max_size=3))
    tier_of = {kind: draw(st.sampled_from(["", *tiers])) for kind in ["", *types]}
    free = list(range(N_FRAMES + 1))
    events: list[Event] = []
    for number, name in enumerate(ids):
        edges = sorted(draw(st.sets(st.sampled_from(free), min_size=2, max_size=6)))
        pairs = list(zip(edges[::2], edges[1::2], strict=False))
        if apart:
            if len(free) < 4:
                break
            pairs = [(edges[0], edges[1])]
            free = [frame for frame in free if frame > edges[1]] if len(free) > 12 else []
            free = free if len(free) > 6 else []
        kind = draw(st.sampled_from(["", *types]))
        text = draw(TEXTS)
        events.append(
            Event(
                id=name,
                type=kind,
                tier=tier_of[kind] if apart else draw(st.sampled_from(["", *tiers])),
                parent=draw(st.sampled_from([None, *ids[:number]])),
                status=draw(st.sampled_from(["confirmed", "proposed"])),
                unsure=draw(st.booleans()),
                author=draw(st.sampled_from(["", "ann", "Bo b"])),
                text=text,
                segments=tuple(_segment(times, *pair) for pair in pairs),
                roles=tuple(draw(st.lists(roles(things, ids), max_size=3, unique=True))),
                links=tuple(
                    Link(type=draw(NAMES), target=draw(st.sampled_from(ids)))
                    for _ in range(draw(st.integers(0, 2)))
                ),
                references=tuple(_references(draw, text, things)),
                predicates=tuple(
                    TextPredicate(start=r.start, end=r.end, type=draw(TEXTS))
                    for r in _references(draw, text, things)
                ),
                properties=tuple(
                    Property(name=draw(NAMES), value=draw(TEXTS)) for _ in range(draw(st.integers(0, 2)))
                ),
            )
        )
        if apart and not free:
            break
    known = {event.id for event in events}
    events = [_without_unknown(event, known) for event in events]
    return Layer(events=tuple(events), objects=things)


def _without_unknown(event: Event, known: set[str]) -> Event:
    return replace(
        event,
        links=tuple(link for link in event.links if link.target in known),
        roles=tuple(role for role in event.roles if role.kind != "event" or role.target in known),
    )


def _segment(times: Any, start: int, end: int) -> Segment:
    return times.of_frames(start, end)


@st.composite
def roles(draw: st.DrawFn, things: tuple[AnnotatedObject, ...], ids: list[str]) -> Role:
    name = draw(st.sampled_from(["Agent", "Theme", "text"]) | NAMES)
    kind = draw(st.sampled_from(["object", "joint", "event"]))
    if kind == "event":
        return Role(name=name, target=draw(st.sampled_from(ids)), kind="event")
    target = draw(st.sampled_from([thing.id for thing in things]))
    if kind == "joint":
        return Role(name=name, target=f"{target}/{draw(st.sampled_from(['HandLeft', 'Head']))}", kind="joint")
    return Role(name=name, target=target)


def _references(draw: st.DrawFn, text: str, things: tuple[AnnotatedObject, ...]) -> Iterator[TextReference]:
    if text and draw(st.booleans()):
        start = draw(st.integers(0, len(text) - 1))
        end = draw(st.integers(start + 1, len(text)))
        yield TextReference(start=start, end=end, target=draw(st.sampled_from([t.id for t in things])))


# ---------------------------------------------------------------------------------------------- comparing


def said_of(event: Event, carries: frozenset[str]) -> dict[str, Any]:
    """What a format that ``carries`` this says of an event, besides its stretches."""
    by_role: dict[str, list[tuple[str, str]]] = {}
    for role in event.roles:
        by_role.setdefault(role.name, []).append((role.kind, role.target))
    everything = {
        "type": event.type,
        "text": event.text,
        "tier": event.tier,
        "parent": event.parent,
        "status": event.status,
        "unsure": event.unsure,
        "author": event.author,
        "role": by_role,
        "link": event.links,
        "reference": event.references,
        "predicate": event.predicates,
        "property": event.properties,
    }
    return {name: value for name, value in everything.items() if name in carries}


def events_of(layer: Layer, carries: frozenset[str]) -> dict[str, Any]:
    """The events by id."""
    return {
        event.id: (sorted(event.segments, key=lambda s: s.start_frame), said_of(event, carries))
        for event in layer.events
        if event.segments
    }


def stretches_of(layer: Layer, carries: frozenset[str]) -> list[Any]:
    """The stretches of events, in the order of time, where a format does not know which belong together."""
    found = [(s, said_of(event, carries)) for event in layer.events for s in event.segments]
    return sorted(found, key=lambda pair: (pair[0].start_frame, pair[0].end_frame, repr(pair[1])))


def shapes_of(layer: Layer, kinds: frozenset[str], end: int = N_FRAMES) -> dict[str, Any]:
    """The shapes of the objects of these kinds, image by image."""
    return {
        thing.id: dict(shapes(thing, end))
        for thing in layer.objects
        if shape_kind(thing) in kinds and any(key.present for key in first_images(thing.key_frames))
    }


def drawn_of(layer: Layer, kinds: frozenset[str], end: int = N_FRAMES) -> dict[str, Any]:
    """:func:`shapes_of`, for comparison to the thousandth of a pixel."""
    found = shapes_of(layer, kinds, end).items()
    return {
        name: {frame: pytest.approx(shape, abs=1e-3) for frame, shape in there.items()}
        for name, there in found
    }


def key_shapes(layer: Layer) -> dict[str, dict[int, tuple[float, ...]]]:
    """The shapes of objects at the images where somebody drew them, or they begin to move."""
    return {
        thing.id: {key.frame: key.coordinates for key in straight(thing) if key.present}
        for thing in layer.objects
        if any(key.present for key in first_images(thing.key_frames))
    }
