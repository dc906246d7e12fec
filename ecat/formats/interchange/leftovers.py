"""What a format cannot carry: the kinds of things that a layer says, and how many of them were left behind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ecat.model import AnnotatedObject, Event, Layer


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of thing that a layer says: its name in the tables of the documentation, and how many there are."""

    name: str
    one: str
    several: str
    count: Callable[[Layer], int]


def _events(count: Callable[[Event], int]) -> Callable[[Layer], int]:
    return lambda layer: sum(map(count, layer.events))


def _objects(count: Callable[[AnnotatedObject], int]) -> Callable[[Layer], int]:
    return lambda layer: sum(map(count, layer.objects))


def _drawn(kind: str) -> Callable[[Layer], int]:
    """How many objects of a kind (nothing: neither rectangle nor point) have a shape somewhere."""

    def count(thing: AnnotatedObject) -> int:
        mine = thing.kind == kind or (not kind and thing.kind not in {"rectangle", "point"})
        return int(mine and any(key.present for key in thing.key_frames))

    return _objects(count)


_KINDS = (
    Kind("event", "event", "events", lambda layer: len(layer.events)),
    Kind("type", "type of an event", "types of events", _events(lambda e: bool(e.type))),
    Kind("text", "text of an event", "texts of events", _events(lambda e: bool(e.text))),
    Kind("tier", "tier of an event", "tiers of events", _events(lambda e: bool(e.tier))),
    Kind(
        "stretches",
        "event of several stretches",
        "events of several stretches",
        _events(lambda e: len(e.segments) > 1),
    ),
    Kind(
        "parent",
        "place in the tree of events",
        "places in the tree of events",
        _events(lambda e: e.parent is not None),
    ),
    Kind("status", "event as proposed", "events as proposed", _events(lambda e: e.status != "confirmed")),
    Kind("unsure", "event as unsure", "events as unsure", _events(lambda e: e.unsure)),
    Kind("author", "author of an event", "authors of events", _events(lambda e: bool(e.author))),
    Kind("role", "role", "roles", _events(lambda e: len(e.roles))),
    Kind("link", "link between events", "links between events", _events(lambda e: len(e.links))),
    Kind(
        "reference",
        "reference of a text to an object",
        "references of texts to objects",
        _events(lambda e: len(e.references)),
    ),
    Kind(
        "predicate", "action named by a text", "actions named by texts", _events(lambda e: len(e.predicates))
    ),
    Kind("property", "property of an event", "properties of events", _events(lambda e: len(e.properties))),
    Kind("rectangle", "object drawn as a rectangle", "objects drawn as rectangles", _drawn("rectangle")),
    Kind("polygon", "object drawn as a polygon", "objects drawn as polygons", _drawn("")),
    Kind("point", "object drawn as a point", "objects drawn as points", _drawn("point")),
    Kind(
        "absence",
        "disappearance of an object",
        "disappearances of objects",
        _objects(lambda o: sum(not key.present for key in o.key_frames)),
    ),
    Kind("shape in space", "shape in space", "shapes in space", _objects(lambda o: len(o.key_frames_3d))),
    Kind("object type", "type of an object", "types of objects", _objects(lambda o: bool(o.semantic_type))),
    Kind(
        "object property",
        "property of an object",
        "properties of objects",
        _objects(lambda o: len(o.properties)),
    ),
    Kind("relation", "relation", "relations", lambda layer: len(layer.relations)),
    Kind(
        "decision",
        "decision about a proposal",
        "decisions about proposals",
        lambda layer: len(layer.decisions),
    ),
)
KINDS = {kind.name: kind for kind in _KINDS}
"""Everything that a person says in a layer, in the order of the documentation."""


def left_behind(layer: Layer, carries: frozenset[str], program: str, own: str = "") -> Iterator[str]:
    """One line about what is in ``layer`` and not among what the program ``carries``, and one about facts of other
    formats than its ``own``.
    """
    found = [(kind, kind.count(layer)) for kind in KINDS.values() if kind.name not in carries]
    if not layer.events or "event" not in carries:
        about_events = {
            "type",
            "text",
            "tier",
            "stretches",
            "parent",
            "status",
            "unsure",
            "author",
            "property",
        }
        found = [(kind, n) for kind, n in found if kind.name not in about_events]
    told = [f"{n:,} {kind.one if n == 1 else kind.several}" for kind, n in found if n]
    if told:
        yield f"{program} has no place for {', '.join(told)}"
    facts = Counter(
        item.key.partition(":")[0]
        for element in (layer, *layer.objects, *layer.events, *layer.relations)
        for item in element.foreign
    )
    del facts[own]
    for format_name, n in sorted(facts.items()):
        yield f"{n:,} {'fact' if n == 1 else 'facts'} that {format_name} alone knows stayed behind"
