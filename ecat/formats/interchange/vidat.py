"""Vidat's JSON: boxes and regions on listed images, and a flat list of actions in seconds.

Images are counted as the session counts them.  Every image with a key frame or a disappearance is listed with all
shapes that are to be seen in it, so that what is missing there has gone.  A label is an object; a type of event is an
action, its text the description.  Vidat has no place for tiers, sub-events, roles, points and relations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecat.formats.format import Format
from ecat.formats.interchange.documents import (
    Coordinate,
    Image,
    Rate,
    Seconds,
    Size,
    Text,
    read_json,
    tells,
    write_json,
)
from ecat.formats.interchange.facts import ROLE
from ecat.formats.interchange.found import Found, FoundEvent, FoundObject, FoundShape, Times
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import UNLABELLED, Numbers, absences, first_images, shape_in, straight
from ecat.formats.interchange.source import PixelOptions, Source, counted, shape_kind, source_of
from ecat.formats.interchange.times import HALF_MS_NS, from_seconds, to_seconds
from ecat.model import AnnotatedObject, CodingScheme, EventType
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "vidat"
CARRIES = frozenset({"event", "type", "text", "rectangle", "polygon", "absence"})
VERSION = "2.0.7"
_COLOR = "#00ff00"


# ---------------------------------------------------------------------------------------------- writing


def part(
    session: Session, label: str, dest: Path, options: PixelOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the shapes and events of one session."""
    del progress
    source = source_of(session, label, options)
    drawn = source.drawn("rectangle", "polygon")
    frames = sorted({key.frame for thing in drawn for key in straight(thing)})
    maps: dict[str, dict[str, list[object]]] = {"rectangle": {}, "polygon": {}}
    for number, thing in enumerate(drawn, 1):
        keys = first_images(thing.key_frames)
        for frame in frames:
            shapes = maps[shape_kind(thing)].setdefault(str(frame), [])
            if (shape := shape_in(thing, keys, frame)) is not None:
                shapes.append(_shape(thing, number, shape))
    write_new_file(dest, [write_json(_document(source, drawn, frames, maps))])
    pieces = sum(len(event.segments) - 1 for event in source.events)
    untimed = len(source.layer.events) - len(source.events)
    return source.findings(
        CARRIES,
        "Vidat",
        f"{counted(pieces, 'further stretch', 'further stretches')} became actions of their own"
        if pieces
        else "",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        source.made_up(),
    )


def _shape(thing: AnnotatedObject, label: int, shape: Numbers) -> object:
    made: dict[str, object] = {"instance": None, "score": None, "labelId": label, "color": thing.color[:7]}
    if shape_kind(thing) == "rectangle":
        return made | dict(zip(("x", "y", "width", "height"), shape, strict=True))
    points = zip(shape[::2], shape[1::2], strict=True)
    return made | {"pointList": [{"x": u, "y": v} for u, v in points]}


def _document(
    source: Source,
    drawn: Sequence[AnnotatedObject],
    frames: Sequence[int],
    maps: Mapping[str, Mapping[str, object]],
) -> object:
    types = list(dict.fromkeys(event.type for event in source.events if event.type))
    number = {"": 0} | {name: n for n, name in enumerate(types, 1)}
    width, height = source.size_px or (0, 0)
    colors = (
        {kind.name: kind.color for kind in source.scheme.event_types} if source.scheme is not None else {}
    )
    actions = [
        {
            **{name: to_seconds(t) for name, t in zip(("start", "end"), edges, strict=True)},
            "action": number[event.type],
            "object": 0,
            "color": colors.get(event.type) or _COLOR,
            "description": event.text,
        }
        for event in source.events
        for edges in map(source.times.edges_ns, event.segments)
    ]
    objects = [{"id": n, "name": source.labels[t.id], "color": t.color[:7]} for n, t in enumerate(drawn, 1)]
    kinds = [
        {"id": n, "name": name, "color": colors.get(name) or _COLOR, "objects": [0]}
        for n, name in enumerate(types, 1)
    ]
    return {
        "version": VERSION,
        "annotation": {
            "video": {
                "src": source.media[0] if source.media else "",
                "fps": source.times.rate_hz,
                "frames": source.end,
                "duration": to_seconds(source.times.ns(source.end)),
                "height": height,
                "width": width,
            },
            "keyframeList": list(frames),
            "objectAnnotationListMap": maps["rectangle"],
            "regionAnnotationListMap": maps["polygon"],
            "skeletonAnnotationListMap": {},
            "actionAnnotationList": actions,
        },
        "config": {
            "objectLabelData": [{"id": 0, "name": UNLABELLED, "color": _COLOR}, *objects],
            "actionLabelData": [{"id": 0, "name": UNLABELLED, "color": _COLOR, "objects": [0]}, *kinds],
            "skeletonTypeData": [],
        },
    }


# ---------------------------------------------------------------------------------------------- reading


@dataclass
class _Point:
    x: Coordinate
    y: Coordinate


@dataclass
class _Box:
    labelId: int  # noqa: N815  (Vidat's name)
    x: Coordinate
    y: Coordinate
    width: Coordinate
    height: Coordinate
    instance: Text = ""


@dataclass
class _Region:
    labelId: int  # noqa: N815  (Vidat's name)
    pointList: list[_Point]  # noqa: N815  (Vidat's name)
    instance: Text = ""


@dataclass
class _Action:
    start: Seconds
    end: Seconds
    action: int = 0
    object: int = 0
    description: Text = ""


@dataclass
class _Video:
    src: Text = ""
    fps: Rate | None = None
    frames: Image | None = None
    duration: Seconds | None = None
    height: Size = 0
    width: Size = 0


@dataclass
class _Annotation:
    video: _Video
    keyframeList: list[Image] = field(default_factory=list[int])  # noqa: N815
    objectAnnotationListMap: dict[Image, list[_Box]] = field(default_factory=dict[int, list[_Box]])  # noqa: N815
    regionAnnotationListMap: dict[Image, list[_Region]] = field(default_factory=dict[int, list[_Region]])  # noqa: N815
    skeletonAnnotationListMap: dict[str, list[object]] = field(default_factory=dict[str, list[object]])  # noqa: N815
    actionAnnotationList: list[_Action] = field(default_factory=list[_Action])  # noqa: N815


@dataclass
class _Label:
    id: int
    name: Text = ""
    color: Text = ""


@dataclass
class _Config:
    objectLabelData: list[_Label] = field(default_factory=list[_Label])  # noqa: N815
    actionLabelData: list[_Label] = field(default_factory=list[_Label])  # noqa: N815


@dataclass
class _File:
    annotation: _Annotation
    config: _Config = field(default_factory=_Config)


def sniff(path: Path) -> bool:
    """Whether it is an annotation of Vidat."""
    return tells(path, (".json",), "annotation", "keyframeList")


def parse(source: Path) -> Sequence[Found]:
    """Read an annotation of Vidat.

    Raises
    ------
    FormatError, LimitError : it is none.
    """
    file = read_json(source, _File, f"cannot import {source.name}")
    said, video = file.annotation, file.annotation.video
    found = Found(name=source.stem, media=(video.src,) if video.src else ())
    found.rate_hz, found.n_frames = video.fps, video.frames or None
    found.duration_ns = from_seconds(video.duration) if video.duration and video.duration > 0 else None
    found.size_px = (video.width, video.height) if video.width and video.height else None
    names = {label.id: label for label in file.config.objectLabelData}
    found.objects = list(_objects(said, names))
    actions = {label.id: label.name for label in file.config.actionLabelData}
    for number, action in enumerate(said.actionAnnotationList, 1):
        found.events.append(_event(action, number, actions, names))
    types = [name for name in dict.fromkeys(actions.values()) if name and name != UNLABELLED]
    if types:
        found.scheme = CodingScheme(name=source.stem, event_types=tuple(EventType(name=n) for n in types))
    skeletons = sum(map(len, said.skeletonAnnotationListMap.values()))
    if skeletons:
        found.findings.append(f"{counted(skeletons, 'skeleton')} left out")
    return (found,)


def _event(
    action: _Action, number: int, types: Mapping[int, str], objects: Mapping[int, _Label]
) -> FoundEvent:
    kind = types.get(action.action, "")
    times = Times(start_ns=from_seconds(action.start), end_ns=from_seconds(action.end), within_ns=HALF_MS_NS)
    event = FoundEvent(key=f"action {number}", type="" if kind == UNLABELLED else kind, stretches=[times])
    event.said = {"text": action.description} if action.description else {}
    if action.object and action.object in objects:
        event.said[f"{ROLE}object"] = objects[action.object].name
    return event


def _objects(said: _Annotation, names: Mapping[int, _Label]) -> Iterator[FoundObject]:
    """Objects by label and instance; of several on one image without an instance, the first is the same as before."""
    runs: dict[tuple[str, int, str, int], dict[int, Numbers]] = {}
    for kind, frames in (
        ("rectangle", said.objectAnnotationListMap),
        ("polygon", said.regionAnnotationListMap),
    ):
        for frame, shapes in sorted(frames.items()):
            seen: dict[tuple[str, int, str], int] = {}
            for shape in shapes:
                key = (kind, shape.labelId, shape.instance)
                seen[key] = seen.get(key, 0) + 1
                runs.setdefault((*key, seen[key]), {})[frame] = _coordinates(shape)
    listed = sorted({*said.keyframeList, *(frame for run in runs.values() for frame in run)})
    names_taken: set[str] = set()
    for (kind, label, instance, copy), run in runs.items():
        known = names.get(label, _Label(label, name=f"label {label}"))
        name = " ".join(filter(None, (known.name, instance, str(copy) if copy > 1 else "")))
        record = AnnotatedObject(
            id=name if name not in names_taken else f"{name} ({kind})",
            name=name,
            kind="rectangle" if kind == "rectangle" else "polygon",
            semantic_type=known.name if name != known.name else "",
            color=f"{known.color}ff" if len(known.color) == 7 else "#ff0000ff",
        )
        names_taken.add(record.id)
        shapes = [
            FoundShape(frame=key.frame, coordinates=key.coordinates, present=key.present)
            for key in absences(run, listed)
        ]
        yield FoundObject(record=record, shapes=shapes, dense=True)


def _coordinates(shape: _Box | _Region) -> Numbers:
    if isinstance(shape, _Box):
        return shape.x, shape.y, shape.width, shape.height
    return tuple(number for point in shape.pointList for number in (point.x, point.y))


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="Vidat annotations: boxes, regions, actions",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".json",
    options=PixelOptions,
)
