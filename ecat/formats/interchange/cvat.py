"""CVAT for video 1.1 (XML): a track for each object, its key frames as boxes, polygons or points.

An object's type is the label, its id, name and properties are attributes of the track.  A shape that is ``outside``
has gone from that image on.  CVAT has no stretches of time: an event is a tag on each of its images
(``--option events=none`` leaves them out), with what is said of it as attributes of the first.  Between two polygons
CVAT finds a way of its own.  There is no place for relations and shapes in space.

Boxes, polygons, polylines and points are read, of tracks and of single images, and tags; sessions have nothing like
cuboids, ellipses, masks and skeletons.  ``occluded``, ``z_order``, ``rotation`` and attributes that change are kept as
facts of the key frame, for CVAT alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import chain
from pathlib import Path
from typing import Literal
from xml.sax import saxutils
from xml.sax.saxutils import quoteattr

from ecat.errors import LimitError
from ecat.formats.format import Format
from ecat.formats.interchange import cvat_read
from ecat.formats.interchange.cvat_read import ID, NAME_ATTRIBUTE, TIER
from ecat.formats.interchange.facts import told
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import TYPED, UNLABELLED, Numbers, is_typed, label_of, straight
from ecat.formats.interchange.source import PixelOptions, Source, counted, shape_kind, source_of
from ecat.formats.options import option
from ecat.model import AnnotatedObject, Event, KeyFrame
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "cvat-video"
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
        *("reference", "predicate", "property", "rectangle", "polygon", "point", "absence", "object type"),
        "object property",
    }
)
MOST_TAGS = 1_000_000
_ELEMENTS = {"rectangle": "box", "polygon": "polygon", "point": "points"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CvatOptions(PixelOptions):
    """What the writer can be told, too."""

    events: Literal["tags", "none"] = option("tags", "events as a tag on each of their images, or not at all")


def part(
    session: Session, label: str, dest: Path, options: CvatOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the shapes and events of one session.

    Raises
    ------
    LimitError : events on more images than CVAT should be given tags.
    """
    del progress
    source = source_of(session, label, options)
    drawn = source.drawn("rectangle", "polygon", "point")
    events = source.events if options.events == "tags" else []
    n_tags = sum(s.end_frame - s.start_frame for event in events for s in event.segments)
    if n_tags > MOST_TAGS:
        raise LimitError(
            f"cannot write {label} for CVAT",
            where=f"its events are on {n_tags:,} images, and each would be a tag; at most {MOST_TAGS:,} are written",
            consequence="nothing was written",
            fix="--option events=none",
        )
    said = {event.id: _said(source, event) for event in events}
    lines = chain(_head(source, drawn, said), _tracks(drawn), _images(events, said), ["</annotations>"])
    write_new_file(dest, (f"{line}\n".encode() for line in lines))
    carries = (
        CARRIES if options.events == "tags" else CARRIES - {"event", "role", "link", "reference", "predicate"}
    )
    untimed = len(source.layer.events) - len(source.events)
    return source.findings(
        carries,
        "CVAT",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        own="cvat",
    )


def _said(source: Source, event: Event) -> dict[str, str]:
    return {ID: event.id, **({TIER: event.tier} if event.tier else {}), **told(event, source.labels)}


def _escaped(text: str) -> str:
    """A text as the content of an element; a carriage return would be read as a line feed."""
    return saxutils.escape(text, {"\r": "&#13;"})


def _head(
    source: Source, drawn: Sequence[AnnotatedObject], said: Mapping[str, Mapping[str, str]]
) -> Iterator[str]:
    size = source.size_px
    yield '<?xml version="1.0" encoding="utf-8"?>'
    yield "<annotations>"
    yield "  <version>1.1</version>"
    yield "  <meta>"
    yield "    <task>"
    yield f"      <name>{_escaped(source.name)}</name>"
    yield f"      <size>{source.end}</size>"
    yield "      <mode>interpolation</mode>"
    yield f"      <start_frame>0</start_frame>\n      <stop_frame>{source.end - 1}</stop_frame>"
    yield "      <labels>"
    labels: dict[tuple[str, bool], dict[str, None]] = {}
    for thing in drawn:
        names = dict.fromkeys(name for name, _ in _about(thing))
        labels.setdefault((label_of(thing), False), {}).update(names)
    for event in source.events if said else ():
        labels.setdefault((_label(event.type), True), {}).update(dict.fromkeys(said[event.id]))
    for (label, is_tag), names in labels.items():
        kind = "tag" if is_tag else "any"
        yield f"        <label><name>{_escaped(label)}</name><type>{kind}</type><attributes>"
        for name in names:
            yield (
                f"          <attribute><name>{_escaped(name)}</name><mutable>False</mutable>"
                "<input_type>text</input_type><default_value></default_value><values></values></attribute>"
            )
        yield "        </attributes></label>"
    yield "      </labels>"
    if size is not None:
        yield "      <original_size>"
        yield f"        <width>{size[0]}</width>\n        <height>{size[1]}</height>"
        yield "      </original_size>"
    if source.media:
        yield f"      <source>{_escaped(source.media[0])}</source>"
    yield "    </task>"
    yield "  </meta>"


def _label(kind: str) -> str:
    return kind or UNLABELLED


def _about(thing: AnnotatedObject) -> list[tuple[str, str]]:
    """What is said of an object as attributes of its track."""
    properties = [(p.name, p.value) for p in thing.properties]
    name = [(NAME_ATTRIBUTE, thing.name)] if thing.name else []
    return [(ID, thing.id), *name, *([(TYPED, "true")] if is_typed(thing) else []), *properties]


def _tracks(drawn: Sequence[AnnotatedObject]) -> Iterator[str]:
    for number, thing in enumerate(drawn):
        yield f'  <track id="{number}" label={quoteattr(label_of(thing))} source="manual">'
        shape: Numbers = ()
        for key in straight(thing):
            if not shape and not key.present:
                continue
            shape = key.coordinates if key.present else shape
            yield from _shape(thing, key, shape)
        yield "  </track>"


def _shape(thing: AnnotatedObject, key: KeyFrame, shape: Numbers) -> Iterator[str]:
    """A key frame; a disappearance has the shape that was there before."""
    kept = {item.key: item.value for item in key.foreign}
    tag = _ELEMENTS[shape_kind(thing)]
    outside, occluded = int(not key.present), kept.pop("cvat:occluded", "0")
    said = f'frame="{key.frame}" keyframe="1" outside="{outside}" occluded={quoteattr(occluded)}'
    if tag == "box":
        u, v, width, height = shape
        edges = zip(("xtl", "ytl", "xbr", "ybr"), (u, v, u + width, v + height), strict=True)
        said += "".join(f' {name}="{_number(value)}"' for name, value in edges)
    else:
        pairs = zip(shape[::2], shape[1::2], strict=True)
        said += ' points="' + ";".join(f"{_number(u)},{_number(v)}" for u, v in pairs) + '"'
    for name in ("rotation", "z_order"):
        value = kept.pop(f"cvat:{name}", "0" if name == "z_order" else "")
        said += f" {name}={quoteattr(value)}" if value else ""
    attributes = _about(thing) + [
        (name.removeprefix(cvat_read.ATTRIBUTE), value)
        for name, value in kept.items()
        if name.startswith(cvat_read.ATTRIBUTE)
    ]
    yield f"    <{tag} {said}>"
    for name, value in attributes:
        yield f"      <attribute name={quoteattr(name)}>{_escaped(value)}</attribute>"
    yield f"    </{tag}>"


def _number(value: float) -> str:
    """A coordinate; CVAT itself writes two decimals."""
    return (
        f"{round(value, 6):g}"
        if math.isfinite(value) and abs(value) < 1e5 and value == int(value)
        else repr(round(value, 6))
    )


def _images(events: Sequence[Event], said: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Images with the events that happen in them; memory for those that happen at the same time."""
    stretches = sorted(
        ((s.start_frame, s.end_frame, n) for n, e in enumerate(events) for s in e.segments),
        reverse=True,
    )
    told_once: set[int] = set()
    now: list[tuple[int, int]] = []
    frame = 0
    while stretches or now:
        if not now:
            frame = max(frame, stretches[-1][0])
        while stretches and stretches[-1][0] <= frame:
            _, end, number = stretches.pop()
            heappush(now, (end, number))
        while now and now[0][0] <= frame:
            heappop(now)
        if not now:
            continue
        yield f'  <image id="{frame}" name="frame_{frame:06}">'
        for number in sorted({number for _, number in now}):
            event = events[number]
            attributes = dict(said[event.id]) if number not in told_once else {ID: event.id}
            told_once.add(number)
            inner = "".join(
                f"<attribute name={quoteattr(name)}>{_escaped(value)}</attribute>"
                for name, value in attributes.items()
            )
            yield f'    <tag label={quoteattr(_label(event.type))} source="manual">{inner}</tag>'
        yield "  </image>"
        frame += 1


_READING = Reading(NAME, cvat_read.parse)
FORMAT = Format(
    name=NAME,
    description="CVAT for video 1.1 (XML): tracks, attributes, tags",
    sniff=cvat_read.sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".xml",
    options=CvatOptions,
)
