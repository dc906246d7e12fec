"""Reading CVAT's XML: tracks and single shapes as objects, tags as events."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.ecat2018.xml_input import Element, iterparse_safe, place, required_attribute
from ecat.formats.interchange.documents import head_of
from ecat.formats.interchange.found import Found, FoundEvent, FoundObject, FoundShape, Frames
from ecat.formats.interchange.shapes import TYPED, UNLABELLED, Numbers, type_of
from ecat.formats.interchange.source import counted
from ecat.formats.interchange.times import MOST_FRAMES
from ecat.model import AnnotatedObject, Foreign, Property
from ecat.model.annotation import ObjectKind

ID, NAME_ATTRIBUTE, TIER = "id", "name", "tier"
"""Attributes by which ecat tells an object or an event."""
ATTRIBUTE = "cvat:attribute:"
_KINDS: dict[str, ObjectKind] = {
    "box": "rectangle",
    "polygon": "polygon",
    "polyline": "polygon",
    "points": "point",
}
_NUMBER = re.compile(r"[+-]?\d{1,12}(\.\d{0,20})?([eE][+-]?\d{1,2})?")
_MOST = 1e9


def sniff(path: Path) -> bool:
    """Whether it is an annotation of CVAT."""
    head = head_of(path, (".xml",))
    return b"<annotations>" in head and (b"<track " in head or b"<image " in head or b"<mode>" in head)


@dataclass(eq=False, slots=True)
class _Tags:
    """The images with one tag; ``said`` on any of them."""

    label: str
    said: dict[str, str]
    frames: list[int] = field(default_factory=list[int])


def parse(source: Path) -> Sequence[Found]:
    """Read an annotation of CVAT, image by image and track by track.

    Raises
    ------
    FormatError : not such a document, or a coordinate that is none; the message names the line.
    LimitError : larger than a document of annotations can be.
    """
    what = f"cannot import {source.name}"
    found = Found(name=source.stem)
    tags: dict[tuple[str, str], _Tags] = {}
    unknown: dict[str, int] = {}
    elements = iterparse_safe(source, tags=("meta", "track", "image"), what=what)
    for number, element in enumerate(elements):
        if number == 0 and element.tag != "annotations":
            raise FormatError(what, where=f"{place(element)}: expected <annotations>")
        if element.tag == "meta":
            _read_meta(found, element)
        elif element.tag == "track":
            _read_track(found, element, unknown, what)
        elif element.tag == "image":
            _read_image(found, element, tags, unknown, what)
    found.events = [_event(number, said) for number, said in enumerate(tags.values(), 1)]
    for tag, n in unknown.items():
        found.findings.append(f"{counted(n, tag)} left out: sessions have no such shape")
    return (found,)


def _read_meta(found: Found, meta: Element) -> None:
    def number(path: str) -> int:
        text = (meta.findtext(path) or "").strip()
        return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0

    for around in ("task", "job", "project/tasks/task"):
        found.n_frames = found.n_frames or number(f"{around}/size") or None
        size = number(f"{around}/original_size/width"), number(f"{around}/original_size/height")
        found.size_px = found.size_px or (size if all(size) else None)
        name = (meta.findtext(f"{around}/source") or "").strip()
        found.media = found.media or ((name,) if name else ())


def _read_track(found: Found, track: Element, unknown: dict[str, int], what: str) -> None:
    shapes: list[FoundShape] = []
    kind: ObjectKind = "rectangle"
    fixed: dict[str, str] = {}
    changing = _changing(track)
    for element in track:
        if element.tag not in _KINDS:
            unknown[str(element.tag)] = unknown.get(str(element.tag), 0) + 1
            continue
        kind = _KINDS[str(element.tag)]
        said = _attributes(element)
        fixed |= {name: value for name, value in said.items() if name not in changing}
        if element.get("keyframe", "1") == "0":
            continue
        frame = _whole(element, "frame", what)
        present = element.get("outside", "0") != "1"
        kept = _kept(element, {name: said[name] for name in said if name in changing}) if present else ()
        coordinates = _coordinates(element, what) if present else ()
        if element.tag == "points" and len(coordinates) > 2:
            kind = "polygon"
        shapes.append(FoundShape(frame=frame, coordinates=coordinates, present=present, foreign=kept))
    if shapes:
        label = required_attribute(track, "label", what=what)
        key = f"track {track.get('id') or len(found.objects)}"
        _add(found, label, kind, {ID: key, **fixed}, shapes)


def _add(
    found: Found, label: str, kind: ObjectKind, said: Mapping[str, str], shapes: list[FoundShape]
) -> None:
    """An object; attributes other than its id and name are properties."""
    own = {ID, NAME_ATTRIBUTE, TYPED}
    name = said.get(NAME_ATTRIBUTE, "")
    record = AnnotatedObject(
        id=said.get(ID) or f"shape {len(found.objects)}",
        name=name,
        kind=kind,
        semantic_type=type_of(label, name, typed=TYPED in said),
        properties=tuple(Property(name=n, value=value) for n, value in said.items() if n not in own),
    )
    found.objects.append(FoundObject(record=record, shapes=shapes))


def _changing(track: Element) -> set[str]:
    """Attributes that are not the same in all key frames."""
    values: dict[str, str] = {}
    found: set[str] = set()
    for element in track:
        for name, value in _attributes(element).items():
            if values.setdefault(name, value) != value:
                found.add(name)
    return found - {ID, NAME_ATTRIBUTE, TYPED}


def _attributes(element: Element) -> dict[str, str]:
    return {a.get("name", ""): a.text or "" for a in element.iterfind("attribute")}


def _kept(element: Element, changing: Mapping[str, str]) -> tuple[Foreign, ...]:
    """What CVAT says of a shape and a session has no field for."""
    said = {
        "occluded": element.get("occluded", "0"),
        "z_order": element.get("z_order", "0"),
        "rotation": element.get("rotation", ""),
    }
    usual = {"0", "", "0.00", "0.0"}
    kept = [Foreign(key=f"cvat:{n}", value=value) for n, value in said.items() if value not in usual]
    return (*kept, *(Foreign(key=f"{ATTRIBUTE}{n}", value=value) for n, value in changing.items()))


def _read_image(
    found: Found,
    image: Element,
    tags: dict[tuple[str, str], _Tags],
    unknown: dict[str, int],
    what: str,
) -> None:
    """Tags, and shapes that are to be seen in this image alone."""
    frame = _whole(image, "id", what)
    for element in image:
        if element.tag == "tag":
            label, said = required_attribute(element, "label", what=what), _attributes(element)
            key = (label, said.get(ID) or repr(sorted(said.items())))
            known = tags.setdefault(key, _Tags(label, said))
            known.said = said | known.said
            known.frames.append(frame)
        elif element.tag in _KINDS:
            coordinates = _coordinates(element, what)
            kind = _KINDS[str(element.tag)]
            kind = "polygon" if kind == "point" and len(coordinates) > 2 else kind
            shapes = [
                FoundShape(frame=frame, coordinates=coordinates, foreign=_kept(element, {})),
                FoundShape(frame=frame + 1, present=False),
            ]
            label = required_attribute(element, "label", what=what)
            _add(found, label, kind, _attributes(element), shapes)
        else:
            unknown[str(element.tag)] = unknown.get(str(element.tag), 0) + 1


def _event(number: int, tags: _Tags) -> FoundEvent:
    """An event of the images that follow one another."""
    said = dict(tags.said)
    event = FoundEvent(
        key=said.pop(ID, "") or f"tag {number}",
        type="" if tags.label == UNLABELLED else tags.label,
        tier=said.pop(TIER, ""),
        said=said,
    )
    event.stretches += [Frames(start=start, end=end) for start, end in _runs(sorted(set(tags.frames)))]
    return event


def _runs(frames: Sequence[int]) -> Iterator[tuple[int, int]]:
    start = frames[0]
    for frame, following in zip(frames, [*frames[1:], -1], strict=True):
        if following != frame + 1:
            yield start, frame + 1
            start = following


def _whole(element: Element, name: str, what: str) -> int:
    text = required_attribute(element, name, what=what)
    if not text.isascii() or not text.isdigit() or int(text[:12]) > MOST_FRAMES:
        raise FormatError(what, where=f"{place(element)}, {name}: expected an image, found {text[:40]!r}")
    return int(text)


def _coordinates(element: Element, what: str) -> Numbers:
    if element.tag == "box":
        names = ("xtl", "ytl", "xbr", "ybr")
        left, top, right, bottom = _numbers(
            [required_attribute(element, n, what=what) for n in names], element, what
        )
        return left, top, round(right - left, 6), round(bottom - top, 6)
    points = required_attribute(element, "points", what=what)
    pairs = [pair.split(",") for pair in points.split(";") if pair.strip()]
    if not pairs or any(len(pair) != 2 for pair in pairs):
        raise FormatError(what, where=f"{place(element)}: expected points as u,v;u,v")
    return _numbers([text for pair in pairs for text in pair], element, what)


def _numbers(texts: Sequence[str], element: Element, what: str) -> Numbers:
    found: list[float] = []
    for text in texts:
        if not _NUMBER.fullmatch(text.strip()) or abs(number := float(text)) > _MOST:
            raise FormatError(what, where=f"{place(element)}: expected a coordinate, found {text[:40]!r}")
        found.append(number)
    return tuple(found)
