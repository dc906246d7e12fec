"""What a person said about a recording: objects with key frames, events, relations, gathered in a layer.

Conventions
-----------
* ``frame`` counts the images of the annotated video from zero.  Frame -1 is legal in imported key frames and
  starts: the position before the first image (ECAT's track bar has a position 0 that shows the first image;
  image i is at i + 1).
* Intervals are half-open, ``[start_frame, end_frame)``.  ``*_ns`` are nanoseconds since the session's start, ``None``
  where the session has no clock.
* 2-D coordinates are pixels of the colour image as stored (origin top left, u right, v down).  3-D
  coordinates are metres in ``camera/depth`` (OpenCV axes).  A missing number is NaN.
* ``foreign`` keeps what a foreign format said and this model has no field for, so that exporting back loses nothing.
  Keys are ``<format>:<name>``.

A field whose metadata says ``tag`` holds child elements of that name in the XML; ``text`` makes it the
element's text; every other field is an attribute.  ``ecat.store.xml`` reads and writes by that rule and
``schemas/annotation.xsd`` follows it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, Literal

ObjectKind = Literal["rectangle", "polygon", "marker_box", "rig", "point", "other"]
Origin = Literal["manual", "tracked", "provided"]
MACHINE = "machine"
"""The layer of what is proposed, which no person edits."""
Status = Literal["proposed", "confirmed"]
Interpolation = Literal["linear", "hold"]
Verdict = Literal["accepted", "rejected"]


def _children(tag: str) -> Any:
    return field(default=(), metadata={"tag": tag})


def _text(default: Any) -> Any:
    return field(default=default, metadata={"text": True})


@dataclass(frozen=True, slots=True)
class Foreign:
    """One fact of a foreign format that the model has no field for: ``key`` is ``<format>:<name>``."""

    key: str
    value: str


@dataclass(frozen=True, slots=True)
class Property:
    """A free key and value that a person gave to an object or an event."""

    name: str
    value: str


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyFrame:
    """The shape of an object at one frame, or its absence from that frame on.

    ``coordinates`` by kind: rectangle ``u, v, width, height``; polygon ``u1, v1, u2, v2, ...``; point ``u, v``; in
    ``key_frames_3d`` ``x1, y1, z1, ...``.  Empty when ``present`` is false.
    """

    frame: int
    t_ns: int | None = None
    present: bool = True
    coordinates: tuple[float, ...] = _text(())
    foreign: tuple[Foreign, ...] = _children("foreign")


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnotatedObject:
    """Something that takes part in events.

    ``color`` is ``#rrggbbaa``; ``stream`` names the video whose pixels the key frames count; the marks of a
    ``marker_box`` and the joints of a ``rig`` are in tables, not here.  Between two key frames the shape moves
    in a straight line (``linear``), or stays as the first one says (``hold``).
    """

    id: str
    name: str = ""
    kind: ObjectKind = "other"
    origin: Origin = "manual"
    dimensions: Literal[2, 3] = 2
    semantic_type: str = ""
    stream: str = ""
    color: str = "#ff0000ff"
    line_width: int = 1
    interpolation: Interpolation = "linear"
    properties: tuple[Property, ...] = _children("property")
    key_frames: tuple[KeyFrame, ...] = _children("key_frame")
    key_frames_3d: tuple[KeyFrame, ...] = _children("key_frame_3d")
    foreign: tuple[Foreign, ...] = _children("foreign")


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """One stretch of an event, half-open."""

    start_frame: int
    end_frame: int
    start_ns: int | None = None
    end_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """What takes part in an event, and as what: an object, a joint (``o1/HandRight``) or another event."""

    name: str
    target: str
    kind: Literal["object", "joint", "event"] = "object"


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A typed link from one event to another (``SUBEVENT``, ``CAUSE``, ...)."""

    type: str
    target: str
    foreign: tuple[Foreign, ...] = _children("foreign")


@dataclass(frozen=True, slots=True, kw_only=True)
class TextReference:
    """Characters ``[start, end)`` of an event's text refer to an object."""

    start: int
    end: int
    target: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TextPredicate:
    """Characters ``[start, end)`` of an event's text name an action of type ``type``."""

    start: int
    end: int
    type: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that happens: one or more segments, roles, a place in the tree of sub-events."""

    id: str
    type: str = ""
    tier: str = ""
    parent: str | None = None
    status: Status = "confirmed"
    unsure: bool = False
    author: str = ""
    text: str = field(default="", metadata={"element": True})
    segments: tuple[Segment, ...] = _children("segment")
    roles: tuple[Role, ...] = _children("role")
    links: tuple[Link, ...] = _children("link")
    references: tuple[TextReference, ...] = _children("reference")
    predicates: tuple[TextPredicate, ...] = _children("predicate")
    properties: tuple[Property, ...] = _children("property")
    foreign: tuple[Foreign, ...] = _children("foreign")


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """One argument of a relation: an object id, or ``<session>/<object id>`` for an object of another session."""

    target: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation:
    """A predicate over objects that holds (``polarity``) or is denied from ``start_frame`` on.

    ``end_frame`` ``None`` means: until contradicted (:mod:`ecat.model.holding` says when that is).  A relation
    that was written without an ``id`` gets one when it is read (:func:`with_relation_ids`).
    """

    id: str = ""
    predicate: str
    start_frame: int
    end_frame: int | None = None
    start_ns: int | None = None
    end_ns: int | None = None
    polarity: bool = True
    source: Literal["marked", "computed"] = "marked"
    status: Status = "confirmed"
    author: str = ""
    arguments: tuple[Argument, ...] = _children("argument")
    foreign: tuple[Foreign, ...] = _children("foreign")

    @property
    def targets(self) -> tuple[str, ...]:
        """The arguments' object ids, in reading order."""
        return tuple(argument.target for argument in self.arguments)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What a person made of a proposal: ``result`` is the id of what was accepted into the person's own layer.

    ``proposal`` is ``<layer>/<id>`` of the event or relation; the layer of proposals itself is not changed.
    """

    proposal: str
    verdict: Verdict
    result: str = ""
    author: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """Everything one annotator (or one machine) said about a session.

    The counters are the last numbers used for ids: ids of deleted things are not given again.
    """

    name: str = field(default="main", metadata={"always": True})
    version: Literal["1"] = field(default="1", metadata={"always": True})
    object_counter: int = 0
    event_counter: int = 0
    relation_counter: int = 0
    scheme: str = ""
    foreign: tuple[Foreign, ...] = _children("foreign")
    objects: tuple[AnnotatedObject, ...] = _children("object")
    events: tuple[Event, ...] = _children("event")
    relations: tuple[Relation, ...] = _children("relation")
    decisions: tuple[Decision, ...] = _children("decision")


def with_relation_ids(layer: Layer) -> Layer:
    """The layer, where every relation has an id: one that had none is ``r<n>`` by its position, or the next free."""
    if all(relation.id for relation in layer.relations):
        return layer
    taken = {relation.id for relation in layer.relations}
    relations: list[Relation] = []
    for number, relation in enumerate(layer.relations, 1):
        name = relation.id or next(name for n in count(number) if (name := f"r{n}") not in taken)
        taken.add(name)
        relations.append(relation if relation.id else replace(relation, id=name))
    return replace(layer, relations=tuple(relations))


def without_usual_ids(layer: Layer) -> Layer:
    """The layer, where no relation has the id that :func:`with_relation_ids` would give it."""
    ids = Counter(relation.id for relation in layer.relations)
    relations = tuple(
        replace(relation, id="") if relation.id == f"r{n}" and ids[relation.id] == 1 else relation
        for n, relation in enumerate(layer.relations, 1)
    )
    return replace(layer, relations=relations)


def foreign_value(items: tuple[Foreign, ...], key: str) -> str | None:
    """The value kept under ``key``, or ``None``."""
    for item in items:
        if item.key == key:
            return item.value
    return None
