"""``<object>`` of ``files.param``: to the model and back to the same attributes (ECAT 2018 file format §1.2.3)."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from ecat.formats.ecat2018.elements import attributes_of, fact, kept, small_number
from ecat.formats.ecat2018.lexical import argb_from_color, color_from_argb
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import AnnotatedObject, Foreign, KeyFrame, Property
from ecat.model.annotation import ObjectKind, Origin

SHAPES: dict[ObjectKind, str] = {
    "rectangle": "Annotator.RectangleObject",
    "polygon": "Annotator.PolygonObject",
    "marker_box": "Annotator.GlyphBoxObject",
    "rig": "Annotator.RigObject",
}
# attribute -> field of the model
_FIELDS = {
    "id": "id",
    "name": "name",
    "filename": "stream",
    "objectType": "dimensions",
    "generate": "origin",
    "color": "color",
    "borderSize": "line_width",
    "semanticType": "semantic_type",
    "shape": "kind",
}
_NAME = re.compile(r"(?!(?i:xml))[A-Za-z_][A-Za-z0-9_.-]*")
"""Of an attribute: ECAT gives up on a whole file over another one (§4.1)."""
_KINDS: dict[str, ObjectKind] = {"Rectangle": "rectangle", "Polygon": "polygon"}
_KINDS.update((shape, kind) for kind, shape in SHAPES.items())
_ORIGINS: dict[str, Origin] = {"MANUAL": "manual", "TRACKED": "tracked", "PROVIDED": "provided"}


def is_attribute(name: str) -> bool:
    """Whether a property of this name can be written beside an object's own attributes."""
    return _NAME.fullmatch(name) is not None and name not in _FIELDS


def kind_of(shape: str) -> ObjectKind:
    """The kind of an object by the name of its .NET class, with or without namespace."""
    return _KINDS.get(shape, "other")


def object_of(
    element: Element,
    object_id: str,
    key_frames: tuple[KeyFrame, ...],
    key_frames_3d: tuple[KeyFrame, ...],
    foreign: Iterable[Foreign],
    *,
    what: str,
) -> AnnotatedObject:
    """An ``<object>`` whose markers were read before.  Where the file has no shape, its first marker may have one."""
    said = attributes_of(element, what)
    texts = {name: said.get(name, "") for name in _FIELDS}
    if "shape" not in said and key_frames:
        texts["shape"] = kept(key_frames[0].foreign, "@shape") or ""
    extra = tuple(Property(name, value) for name, value in said.items() if name not in _FIELDS)
    values: dict[str, Any] = {**_meant(texts), "id": object_id}
    thing = AnnotatedObject(properties=extra, key_frames=key_frames, key_frames_3d=key_frames_3d, **values)
    facts = list(foreign)
    usual = _usual(thing)
    facts += [fact(name, text) for name, text in texts.items() if usual[name] != text]
    if list(said) != [*_FIELDS, *(p.name for p in extra)]:
        facts.append(fact("attributes", ",".join(said)))
    return replace(thing, foreign=tuple(facts))


def object_attributes(thing: AnnotatedObject) -> list[tuple[str, str]]:
    """An object's attributes as the file had them, in its order, with what was edited since."""
    values = _usual(thing)
    raw = {name: text for name in _FIELDS if (text := kept(thing.foreign, name)) is not None}
    if raw:
        now, then = _meant(values), _meant(values | raw)
        values |= {
            name: text
            for name, text in raw.items()
            if name == "id" or then[_FIELDS[name]] == now[_FIELDS[name]]
        }
    named = list(values.items()) + [(p.name, p.value) for p in thing.properties]
    order = kept(thing.foreign, "attributes")
    if order is None:
        return named
    said = {name: i for i, name in enumerate(order.split(","))}
    # a standard attribute that the file did not have is written once it says something
    named = [(name, value) for name, value in named if name in said or (value and name != "shape")]
    return sorted(named, key=lambda pair: said.get(pair[0], len(said)))


def _meant(texts: dict[str, str]) -> dict[str, Any]:
    """The model's values of an object's standard attributes."""
    return {
        "id": texts["id"],
        "name": texts["name"],
        # recorded and detected objects name a file by the recording machine's full path; its last part counts
        "stream": re.split(r"[\\/]", texts["filename"])[-1],
        "dimensions": 3 if texts["objectType"] == "3D" else 2,
        "origin": _ORIGINS.get(texts["generate"].upper(), "manual"),
        "color": color_from_argb(texts["color"]) or "#ff0000ff",
        "line_width": small_number(texts["borderSize"]) or 1,
        "semantic_type": texts["semanticType"],
        "kind": kind_of(texts["shape"]),
    }


def _usual(thing: AnnotatedObject) -> dict[str, str]:
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
