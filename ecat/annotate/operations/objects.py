"""Operations on objects: what they are called and look like, what is said of them, and copies from elsewhere."""

from __future__ import annotations

import colorsys
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.uses import forget_object
from ecat.model import AnnotatedObject, Argument, KeyFrame, Property, Relation
from ecat.model.annotation import Interpolation, ObjectKind
from ecat.model.holding import ALWAYS, intervals
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.model.shapes import shape_problem

_COLOR = re.compile(r"#[0-9a-f]{6}([0-9a-f]{2})?")
_GOLDEN = 0.618033988749895


@dataclass(frozen=True, slots=True, kw_only=True)
class AddObject(Operation):
    """A new object; with ``coordinates``, its shape at ``frame``.

    ``color`` is ``#rrggbb`` or ``#rrggbbaa``; left out, it is one that few others have.  ``stream`` is the
    annotated video by default.  What a file says of it and nobody drew is ``provided``.
    """

    kind: ObjectKind
    name: str = ""
    id: str | None = None
    stream: str = ""
    color: str | None = None
    line_width: int = 1
    semantic_type: str = ""
    dimensions: Literal[2, 3] = 2
    interpolation: Interpolation = "linear"
    origin: Literal["manual", "provided"] = "manual"
    frame: int | None = None
    coordinates: tuple[float, ...] | None = None
    properties: Mapping[str, str] = field(default_factory=dict[str, str])

    def perform(self, edit: Edit) -> None:
        """Add it."""
        if self.coordinates is not None and self.frame is None:
            raise edit.refusal("coordinates without a frame", "name the frame that the shape was drawn at")
        if not all(name.strip() for name in self.properties):
            raise edit.refusal("a property without a name", "give it one")
        name = edit.new_id("object", self.id)
        number = edit.document.header.object_counter or len(edit.document.ids("object")) + 1
        thing = AnnotatedObject(
            id=name,
            name=self.name,
            kind=self.kind,
            dimensions=self.dimensions,
            semantic_type=self.semantic_type,
            stream=self.stream or edit.stream,
            color=distinct_color(number) if self.color is None else _color(edit, self.color),
            line_width=_line_width(edit, self.line_width),
            interpolation=self.interpolation,
            origin=self.origin,
            properties=tuple(Property(name=name, value=value) for name, value in self.properties.items()),
        )
        if self.frame is not None and self.coordinates is not None:
            key = new_key_frame(edit, thing, self.frame, self.coordinates, self.dimensions)
            thing = replace(thing, **{"key_frames" if self.dimensions == 2 else "key_frames_3d": (key,)})
        edit.put(thing)


@dataclass(frozen=True, slots=True, kw_only=True)
class EditObject(Operation):
    """Change what is given of an object."""

    id: str
    name: str | None = None
    color: str | None = None
    line_width: int | None = None
    semantic_type: str | None = None
    stream: str | None = None
    interpolation: Interpolation | None = None

    def perform(self, edit: Edit) -> None:
        """Change it."""
        thing = edit.object(self.id)
        said = {n: getattr(self, n) for n in ("name", "semantic_type", "stream", "interpolation")}
        said["color"] = None if self.color is None else _color(edit, self.color)
        said["line_width"] = None if self.line_width is None else _line_width(edit, self.line_width)
        edit.put(replace(thing, **{n: value for n, value in said.items() if value is not None}))


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveObject(Operation):
    """Remove an object, with the relations, roles and text references that name it."""

    id: str

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        edit.object(self.id)
        forget_object(edit, self.id)
        edit.drop("object", self.id)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetProperty(Operation):
    """Set a free key of an object or an event, or remove it (no ``value``)."""

    target: str
    name: str
    value: str | None = None

    def perform(self, edit: Edit) -> None:
        """Set it."""
        if not self.name.strip():
            raise edit.refusal("a property without a name", "give it one")
        owner = edit.owner(self.target)
        edit.put(replace(owner, properties=with_property(owner.properties, self.name, self.value)))


@dataclass(frozen=True, slots=True, kw_only=True)
class CopyObjects(Operation):
    """Objects of another session of the project, as they were last seen there, at ``frame`` here (§2.15).

    Each copy is the same thing as its original (IDENTITY), and what held between the copied at the other
    session's end holds here.  ``mode`` says what an object is that was gone at that end: left out (``last_frame``),
    or taken from where it was last (``last_appearance``).  Without ``objects`` all of them are copied.
    """

    session: str
    frame: int
    objects: tuple[str, ...] | None = None
    mode: Literal["last_frame", "last_appearance"] = "last_frame"

    def perform(self, edit: Edit) -> None:
        """Copy them."""
        other = edit.session_of(self.session)
        known = {thing.id: thing for thing in other.objects}
        for name in self.objects or ():
            if name not in known:
                there = ", ".join(f"{thing.id} ({thing.name})" for thing in other.objects[:5]) or "none"
                raise edit.refusal(
                    f"session {self.session} has no object {name}",
                    f"name one that it has; the first are: {there}",
                )
        wanted = known if self.objects is None else {name: known[name] for name in self.objects}
        copies: dict[str, str] = {}
        for name, thing in wanted.items():
            if thing.kind in {"rig", "marker_box"}:
                continue  # what they look like is in tables, and of that recording
            shape = _last_shape(thing, gone=self.mode == "last_appearance")
            if shape is None:
                continue
            copies[name] = edit.new_id("object")
            key = new_key_frame(edit, thing, self.frame, shape, 2)
            edit.put(
                AnnotatedObject(
                    id=copies[name], name=thing.name, kind=thing.kind, color=thing.color,
                    line_width=thing.line_width, interpolation=thing.interpolation, stream=edit.stream,
                    key_frames=(key,),
                )
            )  # fmt: skip
            self._say(edit, "IDENTITY", (copies[name], f"{self.session}/{name}"))
        held = intervals(other.relations, edit.scheme or ECAT_2018_SCHEME, lambda _: ALWAYS)
        for i, relation in enumerate(other.relations):
            lasts = any(end is None for _, end in held.get(i, ()))
            if lasts and relation.predicate != "IDENTITY" and all(t in copies for t in relation.targets):
                self._say(edit, relation.predicate, tuple(copies[t] for t in relation.targets))

    def _say(self, edit: Edit, predicate: str, targets: tuple[str, ...]) -> None:
        edit.put(
            Relation(
                id=edit.new_id("relation"),
                predicate=predicate,
                start_frame=edit.frame(self.frame),
                start_ns=edit.t_ns(self.frame),
                author=edit.author,
                arguments=tuple(Argument(target=target) for target in targets),
            )
        )


def _last_shape(thing: AnnotatedObject, *, gone: bool) -> tuple[float, ...] | None:
    """The shape at the end, or (``gone``) at the last appearance before it."""
    for key in reversed(thing.key_frames):
        if key.present and key.coordinates:
            return key.coordinates
        if not key.present and not gone:
            return None
    return None


def new_key_frame(
    edit: Edit, thing: AnnotatedObject, frame: int, coordinates: tuple[float, ...], dimensions: int
) -> KeyFrame:
    """A shape of an object, or an error if it is none."""
    if problem := shape_problem(thing.kind, coordinates, dimensions):
        raise edit.refusal(f"{thing.kind} {thing.name or thing.id}: {problem}", "draw it again")
    frame = edit.frame(frame)
    return KeyFrame(
        frame=frame, t_ns=edit.t_ns(frame), coordinates=tuple(number + 0.0 for number in coordinates)
    )


def with_property(properties: tuple[Property, ...], name: str, value: str | None) -> tuple[Property, ...]:
    """``properties`` with the one called ``name`` set in its place, or without it."""
    new = () if value is None else (Property(name=name, value=value),)
    at = next((i for i, p in enumerate(properties) if p.name == name), len(properties))
    return (*properties[:at], *new, *(p for p in properties[at:] if p.name != name))


def distinct_color(number: int) -> str:
    """The color of object ``number``: hues far apart, each as light as the last one was not."""
    hue = number * _GOLDEN % 1.0
    light, strong = ((0.45, 0.85), (0.62, 0.75), (0.33, 0.9))[number // 7 % 3]
    return "#" + "".join(f"{round(255 * c):02x}" for c in colorsys.hls_to_rgb(hue, light, strong)) + "ff"


def _color(edit: Edit, color: str) -> str:
    color = color.lower()
    if not _COLOR.fullmatch(color):
        raise edit.refusal(f"{color!r:.40} is no color", "write it as #rrggbb or #rrggbbaa")
    return color if len(color) == 9 else f"{color}ff"


def _line_width(edit: Edit, width: int) -> int:
    if not 1 <= width <= 10:
        raise edit.refusal(f"a line {width} pixels wide", "take 1 to 10")
    return width
