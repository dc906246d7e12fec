"""Label Studio's JSON: a task with rectangles over time (``VideoRectangle``) and ranges of images (``TimelineLabels``).

Images are counted from 1, ranges include their last; coordinates are per cent of the image.  A key frame that is not
``enabled`` still shows its shape, which is gone in the next image.  An event is a region of ranges, its tier the name
of the control, its parent the region's parent, its text the region's note; links between events, and roles of objects
that are drawn as rectangles, are relations between regions.  Proposed events are predictions.  What to paste into the
project's labeling interface is in the task's ``data.label_config``.

Label Studio has no place for polygons, points, joints in roles, properties, and for relations between objects.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.sax.saxutils import quoteattr

from ecat.formats.format import Format
from ecat.formats.interchange.documents import (
    Coordinate,
    Image,
    Seconds,
    Size,
    Text,
    head_of,
    read_json,
    write_json,
)
from ecat.formats.interchange.facts import ROLE, joined
from ecat.formats.interchange.found import Found, FoundEvent, FoundObject, FoundShape, Frames
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import TYPED, UNLABELLED, is_typed, label_of, straight, type_of
from ecat.formats.interchange.source import PixelOptions, Source, counted, source_of
from ecat.formats.interchange.times import from_counted, from_seconds, to_counted, to_seconds
from ecat.model import AnnotatedObject, Event
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "label-studio"
CARRIES = frozenset(
    {
        *("event", "type", "text", "tier", "stretches", "parent", "status", "link"),
        *("rectangle", "absence", "object type"),
    }
)
PARTLY = frozenset({"role"})
_VIDEO, _BOX, _NO_TIER = "video", "box", "timeline"


# ---------------------------------------------------------------------------------------------- writing


def part(
    session: Session, label: str, dest: Path, options: PixelOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the rectangles and events of one session as a task."""
    del progress
    source = source_of(session, label, options)
    size = source.size_px
    drawn = source.drawn("rectangle") if size is not None else []
    boxes = [_box(source, thing, size) for thing in drawn] if size is not None else []
    said = [event for event in source.events if event.status == "confirmed"]
    proposed = [event for event in source.events if event.status != "confirmed"]
    regions = {thing.id for thing in drawn} | {event.id for event in said}
    said_links, lost = _relations(said, regions)
    proposed_links, lost_too = _relations(proposed, {event.id for event in proposed})
    task: dict[str, object] = {
        "id": 1,
        "data": {_VIDEO: source.media[0] if source.media else "", "label_config": _config(source)},
        "annotations": [{"id": 1, "result": [*boxes, *map(_range, said), *said_links]}],
        "predictions": [],
    }
    if proposed:
        author = next((event.author for event in proposed if event.author), "ecat")
        task["predictions"] = [{"model_version": author, "result": [*map(_range, proposed), *proposed_links]}]
    write_new_file(dest, [write_json([task])])
    unsized = len(source.drawn("rectangle")) if size is None else 0
    untimed = len(source.layer.events) - len(source.events)
    return source.findings(
        CARRIES | PARTLY,
        "Label Studio",
        f"{counted(lost + lost_too, 'role or link', 'roles and links')} to what is no region there left out"
        if lost + lost_too
        else "",
        f"{counted(unsized, 'object')} left out, because the size of the images is not known: "
        "--option width=... --option height=..."
        if unsized
        else "",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
    )


def _config(source: Source) -> str:
    """The labeling interface for this task."""
    tiers: dict[str, dict[str, None]] = {}
    for event in source.events:
        tiers.setdefault(event.tier or _NO_TIER, {})[event.type or UNLABELLED] = None
    types = dict.fromkeys(map(label_of, source.drawn("rectangle")))

    def labels(names: Mapping[str, None]) -> str:
        return "".join(f"<Label value={quoteattr(name)}/>" for name in names)

    lines = [f'<Video name="{_VIDEO}" value="${_VIDEO}" frameRate="{source.times.rate_hz:.6g}"/>']
    if types:
        lines.append(f'<VideoRectangle name="{_BOX}" toName="{_VIDEO}"/>')
        lines.append(f'<Labels name="{_BOX}_labels" toName="{_VIDEO}">{labels(types)}</Labels>')
    for tier, names in tiers.items():
        control = f'<TimelineLabels name={quoteattr(tier)} toName="{_VIDEO}">'
        lines.append(f"{control}{labels(names)}</TimelineLabels>")
    return "<View>" + "".join(lines) + "</View>"


def _box(source: Source, thing: AnnotatedObject, size: tuple[int, int]) -> object:
    """An object: key frames in per cent, the last before a disappearance not enabled."""
    width, height = size
    sequence: list[dict[str, object]] = []
    keys = straight(thing)
    for at, key in enumerate(keys):
        following = keys[at + 1] if at + 1 < len(keys) else None
        gone = following is not None and not following.present
        if not key.present:
            continue
        last = following.frame - 1 if gone and following is not None else key.frame
        for frame in dict.fromkeys((key.frame, last)):
            u, v, across, down = key.coordinates
            sequence.append(
                {
                    "frame": frame + 1,
                    "enabled": not (gone and frame == last),
                    "rotation": 0,
                    "x": u / width * 100,
                    "y": v / height * 100,
                    "width": across / width * 100,
                    "height": down / height * 100,
                    "time": to_seconds(source.times.ns(frame)),
                }
            )
    meta: dict[str, object] = {"text": [thing.name]} if thing.name else {}
    if is_typed(thing):
        meta[TYPED] = True
    return {
        "id": thing.id,
        "type": "videorectangle",
        "from_name": _BOX,
        "to_name": _VIDEO,
        "origin": "manual",
        "original_width": width,
        "original_height": height,
        "value": {
            "framesCount": source.end,
            "duration": to_seconds(source.times.ns(source.end)),
            "sequence": sequence,
            "labels": [label_of(thing)],
        },
        **({"meta": meta} if meta else {}),
    }


def _range(event: Event) -> object:
    edges = [to_counted(s.start_frame, s.end_frame) for s in event.segments]
    return {
        "id": event.id,
        "type": "timelinelabels",
        "from_name": event.tier or _NO_TIER,
        "to_name": _VIDEO,
        "origin": "manual",
        "value": {
            "ranges": [{"start": first, "end": last} for first, last in edges],
            "timelinelabels": [event.type or UNLABELLED],
        },
        **({"parentID": event.parent} if event.parent is not None else {}),
        **({"meta": {"text": [event.text]}} if event.text else {}),
    }


def _relations(events: Sequence[Event], regions: set[str]) -> tuple[list[object], int]:
    """Links and roles as relations between regions, and how many lead to what is none."""
    found: list[object] = []
    lost = 0
    for event in events:
        ends = [(link.target, [link.type]) for link in event.links]
        ends += [
            (role.target if role.kind != "joint" else "", [f"{ROLE}{role.name}"]) for role in event.roles
        ]
        for target, labels in ends:
            if target not in regions:
                lost += 1
                continue
            found.append(
                {
                    "type": "relation",
                    "from_id": event.id,
                    "to_id": target,
                    "direction": "right",
                    "labels": labels,
                }
            )
    return found, lost


# ---------------------------------------------------------------------------------------------- reading


@dataclass
class _Key:
    frame: Image
    x: Coordinate
    y: Coordinate
    width: Coordinate
    height: Coordinate
    enabled: bool = True


@dataclass
class _Range:
    start: Image
    end: Image


@dataclass
class _Value:
    framesCount: Image | None = None  # noqa: N815  (Label Studio's name)
    duration: Seconds | None = None
    sequence: list[_Key] = field(default_factory=list[_Key])
    labels: list[Text] = field(default_factory=list[str])
    ranges: list[_Range] = field(default_factory=list[_Range])
    timelinelabels: list[Text] = field(default_factory=list[str])


@dataclass
class _Meta:
    text: list[Text] | Text = ""
    typed: bool = False


@dataclass
class _Region:
    type: Text = ""
    id: Text = ""
    from_name: Text = ""
    value: _Value = field(default_factory=_Value)
    meta: _Meta = field(default_factory=_Meta)
    parentID: Text = ""  # noqa: N815  (Label Studio's name)
    original_width: Size = 0
    original_height: Size = 0
    from_id: Text = ""
    to_id: Text = ""
    labels: list[Text] = field(default_factory=list[str])


@dataclass
class _Annotation:
    result: list[_Region] = field(default_factory=list[_Region])
    was_cancelled: bool = False


@dataclass
class _Task:
    data: dict[str, object]
    annotations: list[_Annotation] = field(default_factory=list[_Annotation])
    predictions: list[_Annotation] = field(default_factory=list[_Annotation])


def sniff(path: Path) -> bool:
    """Whether it is an export of tasks with regions over time."""
    head = head_of(path, (".json",))
    return b'"videorectangle"' in head or b'"timelinelabels"' in head


def parse(source: Path) -> Sequence[Found]:
    """Read an export: what it says about each task's video.

    Raises
    ------
    FormatError, LimitError : it is no export of Label Studio.
    """
    tasks = read_json(source, list[_Task], f"cannot import {source.name}")
    found = [_found(task) for task in tasks]
    if len(found) == 1:
        found[0].name = source.stem
    return found or [Found(name=source.stem)]


def _found(task: _Task) -> Found:
    media = tuple(
        v for v in task.data.values() if isinstance(v, str) and re.search(r"\.\w{2,4}($|\?)", v[-200:])
    )
    media = tuple(name.rpartition("?d=")[2] for name in media if not name.startswith("<"))
    found = Found(name=PurePosixPath(media[0]).stem if media else "", media=media)
    done = [annotation for annotation in task.annotations if not annotation.was_cancelled]
    others = len(done) - 1
    if others > 0:
        found.findings.append(f"{counted(others, 'further annotation')} of the task left out")
    events: dict[str, FoundEvent] = {}
    objects: dict[str, FoundObject] = {}
    unknown = 0
    for annotation, proposed in [*[(a, False) for a in done[:1]], *[(p, True) for p in task.predictions[:1]]]:
        for region in annotation.result:
            if region.type == "timelinelabels":
                event = _event(region, proposed=proposed)
                events[event.key or f"region {len(events)}"] = event
            elif region.type == "videorectangle":
                _add_object(found, objects, region)
            elif region.type != "relation":
                unknown += 1
        _relate(annotation.result, events, objects)
    found.events, found.objects = list(events.values()), list(objects.values())
    if unknown:
        found.findings.append(f"{counted(unknown, 'result')} of other kinds left out")
    return found


def _event(region: _Region, *, proposed: bool) -> FoundEvent:
    kind = "; ".join(region.value.timelinelabels)
    frames = [from_counted(r.start, r.end) for r in region.value.ranges]
    said = {
        "text": _note(region),
        "parent": region.parentID,
        "status": "proposed" if proposed else "",
    }
    return FoundEvent(
        key=region.id,
        type="" if kind == UNLABELLED else kind,
        tier="" if region.from_name == _NO_TIER else region.from_name,
        stretches=[Frames(start=start, end=end) for start, end in frames],
        said={name: text for name, text in said.items() if text},
    )


def _note(region: _Region) -> str:
    text = region.meta.text
    return text if isinstance(text, str) else "\n".join(text)


def _add_object(found: Found, objects: dict[str, FoundObject], region: _Region) -> None:
    value = region.value
    found.n_frames = value.framesCount or found.n_frames
    if value.duration and value.duration > 0:
        found.duration_ns = from_seconds(value.duration)
    if region.original_width and region.original_height:
        found.size_px = region.original_width, region.original_height
    name = _note(region)
    record = AnnotatedObject(
        id=region.id or f"region {len(objects)}",
        name=name,
        kind="rectangle",
        semantic_type=type_of("; ".join(value.labels[:1]), name, typed=region.meta.typed),
    )
    objects[record.id] = FoundObject(record=record, shapes=list(_shapes(value.sequence)), per_cent=True)


def _shapes(sequence: Sequence[_Key]) -> Iterator[FoundShape]:
    """Key frames; after one that is not enabled the shape is gone."""
    keys: dict[int, FoundShape] = {}
    before: FoundShape | None = None
    for key in sorted(sequence, key=lambda key: key.frame):
        frame = max(key.frame, 1) - 1
        shape = FoundShape(frame=frame, coordinates=(key.x, key.y, key.width, key.height))
        if key.enabled or before is None or before.coordinates != shape.coordinates:
            keys[frame] = before = shape
        if not key.enabled:
            keys[frame + 1] = before = FoundShape(frame=frame + 1, present=False)
    yield from keys.values()


def _relate(
    result: Sequence[_Region], events: Mapping[str, FoundEvent], objects: Mapping[str, FoundObject]
) -> None:
    """Relations between regions: to an object a role, to an event a link, or a role if it says so."""
    links: dict[str, list[str]] = {}
    roles: dict[tuple[str, str], list[str]] = {}
    for region in result:
        if region.type != "relation" or region.from_id not in events:
            continue
        for label in region.labels or ["related"]:
            name = label.removeprefix(ROLE)
            if region.to_id in objects:
                roles.setdefault((region.from_id, name), []).append(objects[region.to_id].record.id)
            elif region.to_id in events and name != label:
                roles.setdefault((region.from_id, name), []).append(f"event:{region.to_id}")
            elif region.to_id in events:
                links.setdefault(region.from_id, []).append(f"{label} {region.to_id}")
    for (key, name), targets in roles.items():
        events[key].said[f"{ROLE}{name}"] = joined(targets)
    for key, told in links.items():
        events[key].said["links"] = joined(told)


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="Label Studio tasks: video rectangles, timeline labels",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".json",
    options=PixelOptions,
)
