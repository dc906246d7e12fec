"""VIA 3 projects (VGG Image Annotator): temporal segments in seconds, regions at single times, free attributes.

Each tier is an attribute of temporal segments whose options are the types of its events (its value the text, on a tier
without types); everything else that is said of an event is an attribute under the names of
:mod:`ecat.formats.interchange.facts`.  A key frame is a region, its attribute ``object`` the object's label.  Regions
are at one time: VIA has no place for disappearances and for the way between key frames, nor for relations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ecat.formats.format import Format
from ecat.formats.interchange.documents import Coordinate, Rate, Seconds, Text, read_json, tells, write_json
from ecat.formats.interchange.facts import PROPERTY, told
from ecat.formats.interchange.found import Found, FoundEvent, FoundObject, FoundShape, Times
from ecat.formats.interchange.lanes import NO_TIER
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import Numbers, straight
from ecat.formats.interchange.source import LayerOptions, Source, counted, shape_kind, source_of
from ecat.formats.interchange.times import HALF_MS_NS, from_seconds, to_seconds
from ecat.model import AnnotatedObject, CodingScheme, EventType, Tier
from ecat.model.annotation import ObjectKind
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "via"
CARRIES = frozenset(
    {
        *(
            "event",
            "type",
            "text",
            "tier",
            "stretches",
            "parent",
            "status",
            "unsure",
            "author",
            "role",
            "link",
        ),
        *("reference", "predicate", "property", "rectangle", "polygon", "point", "object type"),
    }
)
_SEGMENT, _REGION = "FILE1_Z2_XY0", "FILE1_Z1_XY1"
_TEXT, _SELECT = 1, 4
_TIER, _FACT, _OBJECT, _OBJECT_TYPE = "ecat:tier", "ecat:fact", "ecat:object", "ecat:object type"
"""What ecat's own attributes are described as."""
_EVENT = "event"
_SHAPES: dict[str, int] = {"point": 1, "rectangle": 2, "polygon": 7}
_VIEW = "1"


# ---------------------------------------------------------------------------------------------- writing


@dataclass(slots=True)
class _Attributes:
    """The attributes of a project, each made when it is first asked for."""

    said: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    numbers: dict[tuple[str, str], str] = field(default_factory=dict[tuple[str, str], str])

    def number(self, name: str, desc: str, anchor: str, options: Sequence[str] = ()) -> str:
        """The number of an attribute."""
        key = (name, desc)
        if key not in self.numbers:
            self.numbers[key] = number = str(len(self.said) + 1)
            self.said[number] = {
                "aname": name,
                "anchor_id": anchor,
                "type": _SELECT if options else _TEXT,
                "desc": desc,
                "options": {str(n): option for n, option in enumerate(options, 1)},
                "default_option_id": "",
            }
        return self.numbers[key]


def part(
    session: Session, label: str, dest: Path, options: LayerOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the events and shapes of one session."""
    del progress
    source = source_of(session, label, options)
    attributes = _Attributes()
    metadata = {**dict(_segments(source, attributes)), **dict(_regions(source, attributes))}
    media = source.media[0] if source.media else ""
    project = {
        "project": {
            "pid": "__VIA_PROJECT_ID__",
            "rev": "__VIA_PROJECT_REV_ID__",
            "rev_timestamp": "__VIA_PROJECT_REV_TIMESTAMP__",
            "pname": source.name,
            "creator": "ecat",
            "created": 0,
            "vid_list": [_VIEW],
        },
        "config": {
            "file": {"loc_prefix": {"1": "", "2": "", "3": "", "4": ""}},
            "ui": {
                "file_content_align": "center",
                "file_metadata_editor_visible": True,
                "spatial_metadata_editor_visible": True,
                "temporal_segment_metadata_editor_visible": True,
                "spatial_region_label_attribute_id": attributes.numbers.get(("object", _OBJECT), ""),
                "gtimeline_visible_row_count": "4",
            },
            "images_a_second": source.times.rate_hz,
        },
        "attribute": attributes.said,
        "file": {
            "1": {"fid": "1", "fname": PurePosixPath(media).name, "type": 4, "loc": 3, "src": media},
        },
        "view": {_VIEW: {"fid_list": ["1"]}},
        "metadata": metadata,
    }
    write_new_file(dest, [write_json(project)])
    untimed = len(source.layer.events) - len(source.events)
    return source.findings(
        CARRIES,
        "VIA",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        source.made_up(),
    )


def _segments(source: Source, attributes: _Attributes) -> Iterator[tuple[str, object]]:
    """An entry for each stretch; what is said of an event is said of its first."""
    types: dict[str, list[str]] = {}
    for event in source.events:
        types.setdefault(event.tier, [])
        if event.type and event.type not in types[event.tier]:
            types[event.tier].append(event.type)
    scheme = source.scheme.event_types if source.scheme is not None else ()
    for tier, used in types.items():
        more = [kind.name for kind in scheme if kind.tier == tier and kind.name not in used] if used else []
        attributes.number(tier or NO_TIER, _TIER, _SEGMENT, [*used, *more])
    for event in source.events:
        tier = attributes.number(event.tier or NO_TIER, _TIER, _SEGMENT)
        options = types[event.tier]
        value = str(options.index(event.type) + 1) if event.type else ("" if options else event.text)
        facts = {_EVENT: event.id, **told(event, source.labels)}
        if not options:
            facts.pop("text", None)
        for number, segment in enumerate(event.segments, 1):
            said = facts if number == 1 else {_EVENT: event.id}
            values = {attributes.number(name, _FACT, _SEGMENT): text for name, text in said.items()}
            name = f"{_VIEW}_{event.id}" + (f"_{number}" if number > 1 else "")
            yield name, _entry(map(to_seconds, source.times.edges_ns(segment)), (), {tier: value, **values})


def _regions(source: Source, attributes: _Attributes) -> Iterator[tuple[str, object]]:
    for thing in source.drawn(*_SHAPES):
        named = {attributes.number("object", _OBJECT, _REGION): source.labels[thing.id]}
        if thing.semantic_type:
            named[attributes.number("object type", _OBJECT_TYPE, _REGION)] = thing.semantic_type
        for key in straight(thing):
            if key.present:
                shape = (_SHAPES[shape_kind(thing)], *key.coordinates)
                time = [to_seconds(source.times.ns(key.frame))]
                yield f"{_VIEW}_{thing.id}_frame_{key.frame}", _entry(time, shape, named)


def _entry(z: Iterator[float] | list[float], xy: Numbers, av: Mapping[str, str]) -> object:
    return {"vid": _VIEW, "flg": 0, "z": list(z), "xy": list(xy), "av": dict(av)}


# ---------------------------------------------------------------------------------------------- reading


@dataclass
class _Attribute:
    aname: Text = ""
    anchor_id: Text = ""
    type: int = 1
    desc: Text = ""
    options: dict[str, Text] = field(default_factory=dict[str, str])


@dataclass
class _Entry:
    vid: Text = ""
    z: list[Seconds] = field(default_factory=list[float])
    xy: list[Coordinate] = field(default_factory=list[float])
    av: dict[str, Text] = field(default_factory=dict[str, str])


@dataclass
class _MediaFile:
    fname: Text = ""
    src: Text = ""


@dataclass
class _View:
    fid_list: list[Text] = field(default_factory=list[str])


@dataclass
class _Config:
    images_a_second: Rate | None = None


@dataclass
class _Project:
    metadata: dict[str, _Entry]
    view: dict[str, _View] = field(default_factory=dict[str, _View])
    file: dict[str, _MediaFile] = field(default_factory=dict[str, _MediaFile])
    attribute: dict[str, _Attribute] = field(default_factory=dict[str, _Attribute])
    config: _Config = field(default_factory=_Config)


def sniff(path: Path) -> bool:
    """Whether it is a project of VIA 3."""
    return tells(path, (".json",), "vid_list") or tells(path, (".json",), "metadata", "fid_list")


def parse(source: Path) -> Sequence[Found]:
    """Read a project: what it says about each view.

    Raises
    ------
    FormatError, LimitError : it is no project of VIA 3.
    """
    project = read_json(source, _Project, f"cannot import {source.name}")
    scheme = _scheme(source.stem, project.attribute.values())
    views: dict[str, list[tuple[str, _Entry]]] = {name: [] for name in project.view}
    for name, entry in project.metadata.items():
        views.setdefault(entry.vid, []).append((name, entry))
    found: list[Found] = []
    for view, entries in views.items():
        files = [project.file[n] for n in project.view.get(view, _View()).fid_list if n in project.file]
        media = tuple(dict.fromkeys(name for file in files for name in (file.src, file.fname) if name))
        name = PurePosixPath(media[-1]).stem if media and len(views) > 1 else source.stem
        made = Found(name=name, media=media, rate_hz=project.config.images_a_second, scheme=scheme)
        _fill(made, view, entries, project.attribute)
        found.append(made)
    return found or [Found(name=source.stem)]


def _fill(
    found: Found, view: str, entries: Sequence[tuple[str, _Entry]], attributes: Mapping[str, _Attribute]
) -> None:
    events: dict[str, FoundEvent] = {}
    objects: dict[tuple[str, str, int], FoundObject] = {}
    counts: dict[tuple[str, int], int] = {}
    others = 0
    for name, entry in entries:
        if len(entry.z) == 2 and not entry.xy:
            event = _event(name.removeprefix(f"{view}_"), entry, attributes)
            known = events.setdefault(event.key, event)
            if known is not event:
                known.stretches += event.stretches
                known.said = event.said | known.said
        elif len(entry.z) == 1 and (shape := _shape(entry.xy)) is not None:
            _add_region(objects, counts, entry, shape, attributes)
        else:
            others += 1
    found.events, found.objects = list(events.values()), list(objects.values())
    if others:
        found.findings.append(
            f"{counted(others, 'entry', 'entries')} neither of a time nor of a known shape left out"
        )


def _event(name: str, entry: _Entry, attributes: Mapping[str, _Attribute]) -> FoundEvent:
    start, end = map(from_seconds, entry.z)
    event = FoundEvent(key=name, stretches=[Times(start_ns=start, end_ns=end, within_ns=HALF_MS_NS)])
    for number, value in entry.av.items():
        said = attributes.get(number, _Attribute(aname=f"attribute {number}"))
        text = said.options.get(value, value)
        is_free = not event.type and not event.tier and said.desc != _FACT
        if said.desc == _FACT and said.aname == _EVENT:
            event.key = text
        elif said.desc == _FACT:
            event.said[said.aname] = text
        elif is_free and (said.options or said.desc == _TIER):
            event.tier = "" if said.aname == NO_TIER else said.aname
            event.type = text if said.options else ""
            if not said.options and text:
                event.said["text"] = text
        elif text:
            name = "text" if said.aname.lower() in {"text", "description"} else f"{PROPERTY}{said.aname}"
            event.said.setdefault(name, text)
    return event


def _shape(xy: Sequence[float]) -> tuple[ObjectKind, Numbers] | None:
    """The kind of a region, and its coordinates; ``None`` if objects have no such shape.  Circles and ellipses are
    boxed.
    """
    if not xy:
        return None
    kind, numbers = int(xy[0]), tuple(xy[1:])
    if kind == 1 and len(numbers) == 2:
        return "point", numbers
    if kind == 2 and len(numbers) == 4:
        return "rectangle", numbers
    if kind in {3, 4} and len(numbers) == kind:
        u, v, across, down = *numbers, *numbers[2 : 6 - kind]
        return "rectangle", (u - across, v - down, 2 * across, 2 * down)
    if kind == 7 and len(numbers) >= 6 and len(numbers) % 2 == 0:
        return "polygon", numbers
    return None


def _add_region(
    objects: dict[tuple[str, str, int], FoundObject],
    counts: dict[tuple[str, int], int],
    entry: _Entry,
    region: tuple[ObjectKind, Numbers],
    attributes: Mapping[str, _Attribute],
) -> None:
    """A shape of the object whose label the region has; two with one label at one time are two objects."""
    said = [(attributes.get(n, _Attribute(aname=n)), value) for n, value in entry.av.items()]
    named = [(a.options.get(value, value), a) for a, value in said if value and a.desc != _OBJECT_TYPE]
    label = named[0][0] if named else "region"
    types = [value for a, value in said if a.desc == _OBJECT_TYPE]
    t_ns = from_seconds(entry.z[0])
    kind, coordinates = region
    shape = FoundShape(t_ns=t_ns, coordinates=coordinates)
    copy = counts[label, t_ns] = counts.get((label, t_ns), 0) + 1
    known = objects.get((label, kind, copy))
    if known is not None:
        known.shapes.append(shape)
        return
    name = label if copy == 1 else f"{label} {copy}"
    record = AnnotatedObject(id=name, name=name, kind=kind, semantic_type=types[0] if types else "")
    objects[label, kind, copy] = FoundObject(record=record, shapes=[shape])


def _scheme(name: str, attributes: Iterable[_Attribute]) -> CodingScheme | None:
    """The options of temporal segments as types, their attributes as tiers."""
    kinds: dict[str, EventType] = {}
    tiers: dict[str, Tier] = {}
    for said in attributes:
        if said.anchor_id == _SEGMENT and said.options:
            tier = "" if said.aname == NO_TIER else said.aname
            if tier:
                tiers.setdefault(tier, Tier(name=tier))
            for option in filter(None, said.options.values()):
                kinds.setdefault(option, EventType(name=option, tier=tier))
    if not kinds:
        return None
    return CodingScheme(name=name, tiers=tuple(tiers.values()), event_types=tuple(kinds.values()))


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="VIA 3 projects: temporal segments, regions, attributes",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".json",
    options=LayerOptions,
)
