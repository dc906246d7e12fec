"""Objects, key frames, events and predicates of ``files.param``: element to model and back to the same text.

Where the usual text of a value differs from what the file said, the file's text is kept as a ``foreign`` fact.  The writer uses
it only while it still means the model's value, so an edit is never hidden by it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from lxml import etree

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import argb_from_color, color_from_argb, format_numbers, missing_corners
from ecat.formats.ecat2018.marks import KINECT_TO_CAMERA
from ecat.formats.ecat2018.xml_input import parse_floats
from ecat.model import (
    AnnotatedObject,
    Event,
    Foreign,
    KeyFrame,
    Link,
    Property,
    Relation,
    Segment,
    TextPredicate,
    TextReference,
)
from ecat.model.annotation import Argument, ObjectKind, Origin, foreign_value

Element: TypeAlias = etree._Element  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]

PREFIX = "ecat-2018:"
OBJECT_ATTRIBUTES = (
    *("id", "name", "filename", "objectType", "generate", "color", "borderSize", "semanticType", "shape"),
)
SHAPES: dict[ObjectKind, str] = {
    "rectangle": "Annotator.RectangleObject",
    "polygon": "Annotator.PolygonObject",
    "marker_box": "Annotator.GlyphBoxObject",
    "rig": "Annotator.RigObject",
    "other": "",
}
EVENT_CHILDREN = ("duration", "text", "refs", "events", "link")
_KINDS: dict[str, ObjectKind] = {shape: kind for kind, shape in SHAPES.items()} | {
    "Rectangle": "rectangle",
    "Polygon": "polygon",
}
_INTEGER = re.compile(r"-?[0-9]{1,10}")
_FORM = re.compile(r"(\w+)\((X|X,Y|Y,X)\)")


def fact(name: str, value: str) -> Foreign:
    """A foreign fact of this format."""
    return Foreign(PREFIX + name, value)


def kept(items: tuple[Foreign, ...], name: str) -> str | None:
    """The text kept under ``name``."""
    return foreign_value(items, PREFIX + name)


def frame_number(text: str | None, what: str, line: int) -> int:
    """A whole number that fits 32 bits.

    Raises
    ------
    FormatError : it is missing or anything else.
    """
    if text is not None and _INTEGER.fullmatch(text):
        number = int(text)
        if -(1 << 31) <= number < 1 << 31:
            return number
    found = "nothing" if text is None else repr(text[:40])
    raise FormatError(
        what,
        where=f"line {line}: expected a whole number, found {found}",
        consequence="the session was not imported; nothing was written",
        fix="correct the number",
    )


# ---------------------------------------------------------------------------------------------- key frames


def coordinates_of(text: str, dimensions: int, what: str, where: str) -> tuple[float, ...]:
    """The numbers of a drawn marker: pixels, or metres in ``camera/depth`` with NaN for missing points."""
    values = parse_floats(text.strip(), what=what, where=where)
    if dimensions == 3 and len(values) % 3 == 0:
        points = values.reshape(1, -1, 3)
        missing, _ = missing_corners(points)
        values = np.where(missing[..., None], np.nan, points * KINECT_TO_CAMERA).ravel()
    else:
        values = np.where(np.isfinite(values), values, np.nan)
    return tuple((values + 0.0).tolist())


def coordinates_text(coordinates: Sequence[float], dimensions: int) -> str:
    """How ECAT writes ``coordinates`` (:func:`coordinates_of`)."""
    if dimensions == 3 and len(coordinates) % 3 == 0:
        return format_numbers(value if i % 3 == 2 else -value for i, value in enumerate(coordinates))
    return format_numbers(coordinates)


def key_frame_of(element: Element, dimensions: int, what: str) -> KeyFrame:
    """A drawn marker (``<marker>`` with text)."""
    line = element.sourceline or 0
    number = frame_number(element.get("frame"), what, line)
    text = element.text or ""
    kind = element.get("type")
    if kind not in (None, "LOCATION", "DELETE") or len(element):
        raise FormatError(
            what,
            where=f"line {line}: a drawn marker of type {kind!r} with {len(element)} child elements",
            consequence="the session was not imported; nothing was written",
            fix="correct or remove the marker",
        )
    coordinates = coordinates_of(text, dimensions, what, f"line {line}, <marker> of frame {number}")
    foreign: list[Foreign] = []
    if coordinates_text(coordinates, dimensions) != text:
        foreign.append(fact("text", text))
    usual = ["type", "frame"] if dimensions == 2 else ["frame"]
    if element.keys() != usual:
        foreign.append(fact("attributes", ",".join(element.keys())))
        foreign += [fact(f"@{k}", v) for k, v in element.items() if k not in ("type", "frame")]
    return KeyFrame(
        frame=number - 1, present=kind != "DELETE", coordinates=coordinates, foreign=tuple(foreign)
    )


def key_frame_text(key: KeyFrame, dimensions: int) -> str:
    """The text of a drawn marker: as the file said while it still means the same, else in the usual form."""
    raw = kept(key.foreign, "text")
    if raw is not None and _same(coordinates_of(raw, dimensions, "", ""), key.coordinates):
        return raw
    return coordinates_text(key.coordinates, dimensions)


def _same(first: Sequence[float], second: Sequence[float]) -> bool:
    return np.array_equal(np.array(first), np.array(second), equal_nan=True)


# ---------------------------------------------------------------------------------------------- objects


def origin_of(text: str) -> Origin:
    """``generate`` in any case."""
    return {"TRACKED": "tracked", "PROVIDED": "provided"}.get(text.upper(), "manual")  # pyright: ignore[reportReturnType]


def _stream(filename: str) -> str:
    """Recorded and detected objects name a file by the recording machine's full path; its last part counts."""
    return re.split(r"[\\/]", filename)[-1]


def _attribute_values(text: dict[str, str]) -> dict[str, object]:
    """The model's values of an object's standard attributes."""
    border = text["borderSize"]
    return {
        "name": text["name"],
        "stream": _stream(text["filename"]),
        "dimensions": 3 if text["objectType"] == "3D" else 2,
        "origin": origin_of(text["generate"]),
        "color": color_from_argb(text["color"]) or "#ff0000ff",
        "line_width": int(border) if _INTEGER.fullmatch(border) else 1,
        "semantic_type": text["semanticType"],
        "kind": _KINDS.get(text["shape"], "other"),
    }


def _usual_attributes(thing: AnnotatedObject) -> dict[str, str]:
    """The standard attributes of an object in their usual form."""
    return {
        "id": thing.id,
        "name": thing.name,
        "filename": thing.stream,
        "objectType": f"{thing.dimensions}D",
        "generate": thing.origin.upper(),
        "color": argb_from_color(thing.color),
        "borderSize": str(thing.line_width),
        "semanticType": thing.semantic_type,
        "shape": SHAPES.get(thing.kind, ""),
    }


def object_of(
    element: Element,
    object_id: str,
    key_frames: tuple[KeyFrame, ...],
    key_frames_3d: tuple[KeyFrame, ...],
    foreign: Iterable[Foreign],
    what: str,
) -> AnnotatedObject:
    """An ``<object>`` whose markers were read before."""
    said = {name: element.get(name) or "" for name in OBJECT_ATTRIBUTES}
    if not said["shape"]:
        raise FormatError(
            what,
            where=f"line {element.sourceline}: <object> {said['id']!r} has no shape",
            consequence="the session was not imported; nothing was written",
            fix="correct or remove the object",
        )
    extra = [Property(name, value) for name, value in element.items() if name not in OBJECT_ATTRIBUTES]
    thing = AnnotatedObject(
        id=object_id,
        properties=tuple(extra),
        key_frames=key_frames,
        key_frames_3d=key_frames_3d,
        **_attribute_values(said),  # pyright: ignore[reportArgumentType]
    )
    facts = list(foreign)
    usual = _usual_attributes(thing)
    facts += [fact(name, said[name]) for name in OBJECT_ATTRIBUTES if usual[name] != said[name]]
    if element.keys() != [*OBJECT_ATTRIBUTES, *(p.name for p in extra)]:
        facts.append(fact("attributes", ",".join(element.keys())))
    return AnnotatedObject(**{**_fields(thing), "foreign": tuple(facts)})


def _fields(thing: AnnotatedObject) -> dict[str, object]:
    return {name: getattr(thing, name) for name in AnnotatedObject.__dataclass_fields__}


def object_attributes(thing: AnnotatedObject) -> list[tuple[str, str]]:
    """An object's attributes as the file had them, in its order, with what was edited since."""
    values = _usual_attributes(thing)
    raw = {name: text for name in OBJECT_ATTRIBUTES if (text := kept(thing.foreign, name)) is not None}
    if raw:
        means, now = _attribute_values(values | raw), _attribute_values(values)
        edited = {name for name in means if means[name] != now[name]}
        of = {
            "filename": "stream",
            "objectType": "dimensions",
            "generate": "origin",
            "borderSize": "line_width",
            "semanticType": "semantic_type",
            "shape": "kind",
        }
        values |= {name: text for name, text in raw.items() if of.get(name, name) not in edited}
    named = list(values.items()) + [(p.name, p.value) for p in thing.properties]
    order = kept(thing.foreign, "attributes")
    if order is None:
        return named
    said = {name: i for i, name in enumerate(order.split(","))}
    standard = set(OBJECT_ATTRIBUTES)
    named = [(n, v) for n, v in named if n in said or n not in standard]
    return sorted(named, key=lambda pair: said.get(pair[0], len(said)))


# ---------------------------------------------------------------------------------------------- relations


def predicate_of(text: str) -> tuple[str, bool]:
    """Name, and whether the second slot is read first (``NAME(Y,X)``)."""
    form = _FORM.fullmatch(text)
    return (form.group(1), form.group(2) == "Y,X") if form else (text, False)


def relation_of(element: Element, what: str) -> Relation:
    """A ``<predicate>``: it holds from its frame until contradicted."""
    line = element.sourceline or 0
    number = frame_number(element.get("frame"), what, line)
    said = {name: element.get(name) or "" for name in ("arguments", "ids", "q", "type")}
    predicate, turned = predicate_of(said["type"])
    ids = said["ids"].split(",") if said["ids"] else []
    relation = Relation(
        predicate=predicate,
        start_frame=number - 1,
        polarity=said["q"].lower() != "false",
        arguments=tuple(Argument(target=i) for i in (reversed(ids) if turned else ids)),
    )
    usual = predicate_attributes(relation)
    foreign = [fact(name, text) for name, text in said.items() if dict(usual)[name] != text]
    if element.keys() != [name for name, _ in usual]:
        foreign.append(fact("attributes", ",".join(element.keys())))
        foreign += [fact(f"@{n}", v) for n, v in element.items() if n not in said and n != "frame"]
    return Relation(**{**_relation_fields(relation), "foreign": tuple(foreign)})  # pyright: ignore[reportArgumentType]


def _relation_fields(relation: Relation) -> dict[str, object]:
    return {name: getattr(relation, name) for name in Relation.__dataclass_fields__}


def predicate_attributes(relation: Relation) -> list[tuple[str, str]]:
    """The attributes of a ``<predicate>``."""
    raw_type = kept(relation.foreign, "type")
    name, turned = predicate_of(raw_type) if raw_type is not None else (relation.predicate, False)
    same_type = raw_type is not None and name == relation.predicate
    ids = list(relation.targets)
    if same_type and turned:
        ids.reverse()
    usual_type = f"{relation.predicate}({'X,Y' if len(ids) == 2 else 'X'})"  # noqa: PLR2004
    values = {
        "frame": str(relation.start_frame + 1),
        "arguments": kept(relation.foreign, "arguments") or str(len(ids)),
        "ids": ",".join(ids),
        "q": "True" if relation.polarity else "False",
        "type": raw_type if same_type and raw_type is not None else usual_type,
    }
    raw_q = kept(relation.foreign, "q")
    if raw_q is not None and (raw_q.lower() != "false") == relation.polarity:
        values["q"] = raw_q
    order = kept(relation.foreign, "attributes")
    if order is None:
        return list(values.items())
    return [(n, values[n] if n in values else kept(relation.foreign, f"@{n}") or "") for n in order.split(",")]


def object_links(element: Element, object_id: str, what: str) -> tuple[list[Relation], list[Foreign]]:
    """The older links inside an object (``<links>`` of 2016-07, ``<spatialLink>`` of 2016-03), and how they lie.

    A link holds from its frame on, between the object that contains it and the one it names.
    """
    relations: list[Relation] = []
    frames: list[str] = []
    layout: list[Foreign] = []
    wrapper = element.find("links")
    links = element.findall("spatialLink") if wrapper is None else wrapper.findall("link")
    for link in links:
        line = link.sourceline or 0
        frames.append(link.get("frame") or "")
        number = frame_number(link.get("frame"), what, line)
        for to in link.findall("linkTo"):
            other = to.get("id")
            session = to.get("otherSession")
            target = f"{session}/{other}" if session is not None else other
            kind = to.get("type") or ""
            predicate, _ = predicate_of(kind)
            foreign = [fact("link", link.tag)]
            if kind != predicate:
                foreign.append(fact("type", kind))
            if to.get("q") not in ("True", "False"):
                foreign.append(fact("q", to.get("q") or "absent"))
            relations.append(
                Relation(
                    predicate=predicate,
                    start_frame=number - 1,
                    polarity=(to.get("q") or "").lower() != "false",
                    arguments=tuple(Argument(target=i) for i in (object_id, target) if i is not None),
                    foreign=tuple(foreign),
                )
            )
    if wrapper is not None or links:
        layout.append(fact("links" if wrapper is not None else "spatialLinks", ",".join(frames)))
    return relations, layout


# ---------------------------------------------------------------------------------------------- events


def event_of(element: Element, event_id: str, what: str) -> Event:
    """An ``<annotation>``: its span is inclusive and in track bar numbers."""
    line = element.sourceline or 0
    foreign: list[Foreign] = []
    if element.keys() != ["id"]:
        foreign.append(fact("attributes", ",".join(element.keys())))
        foreign += [fact(f"@{n}", v) for n, v in element.items() if n != "id"]
    if event_id != element.get("id"):
        foreign.append(fact("id", element.get("id") or ""))
    tags = [child.tag for child in element]
    if tags != list(EVENT_CHILDREN):
        foreign.append(fact("children", ",".join(tags)))
    duration = element.find("duration")
    segments: tuple[Segment, ...] = ()
    if duration is not None:
        start, end = (frame_number(duration.get(name), what, line) for name in ("startFrame", "endFrame"))
        segments = (Segment(start_frame=start - 1, end_frame=end),)
    return Event(
        id=event_id,
        tier="event",
        text=element.findtext("text") or "",
        segments=segments,
        references=tuple(
            TextReference(**_span(ref, what), target=ref.get("refTo") or "")
            for ref in element.iterfind("refs/ref")
        ),
        predicates=tuple(
            TextPredicate(**_span(e, what), type=e.get("semanticType") or "")
            for e in element.iterfind("events/event")
        ),
        links=tuple(_link(to) for to in element.iterfind("link/linkTo")),
        foreign=tuple(foreign),
    )


def _span(element: Element, what: str) -> dict[str, int]:
    line = element.sourceline or 0
    return {name: frame_number(element.get(name), what, line) for name in ("start", "end")}


def _link(element: Element) -> Link:
    said = element.get("type") or ""
    name, _ = predicate_of(said)
    foreign = (fact("type", said),) if link_type(Link(type=name, target="")) != said else ()
    return Link(type=name, target=element.get("id") or "", foreign=foreign)


def link_type(link: Link) -> str:
    """The type of a link between events as a predicate form."""
    raw = kept(link.foreign, "type")
    return raw if raw is not None and predicate_of(raw)[0] == link.type else f"{link.type}(X,Y)"
