"""ELAN (``.eaf``, EAF 3.0): tiers of annotations in milliseconds, below each other.

A tier of ecat becomes a tier of ELAN; parts of events are on tiers below those of their wholes, as ``Included_In`` or,
where they divide the whole without a gap and the coding scheme says so, ``Time_Subdivision``.  Events that overlap are
on ``tier``, ``tier #2`` and so on, because ELAN's tiers cannot hold them together.  An annotation's value is the
event's type, from a controlled vocabulary; on a tier without types it is the text.  Everything else that is said of an
event is on tiers of the stereotype ``Symbolic_Association`` below: ``text@tier``, ``Agent@tier``, ``unsure@tier``
(:mod:`ecat.formats.interchange.facts` has the names).

ELAN has no place for objects and their shapes, but names those that take part; nor for relations, and times are
rounded to the millisecond.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise
from pathlib import Path, PurePosixPath
from typing import Any

from lxml import etree

from ecat.formats.format import Format
from ecat.formats.interchange import elan_read
from ecat.formats.interchange.elan_read import RATE_PROPERTY, SCHEME_PROPERTY
from ecat.formats.interchange.facts import FIELDS, numbered, told
from ecat.formats.interchange.lanes import NO_TIER, Lane, Span, lanes_of
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.source import LayerOptions, Source, counted, source_of
from ecat.formats.interchange.times import to_ms
from ecat.model import Event
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "elan"
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
        *("reference", "predicate", "property"),
    }
)
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_SCHEMA = "http://www.mpi.nl/tools/elan/EAFv3.0.xsd"
_LANGUAGE = {
    "LANG_ID": "und",
    "LANG_DEF": "http://cdb.iso.org/lg/CDB-00130975-001",
    "LANG_LABEL": "undetermined (und)",
}
_STEREOTYPES = {
    "Time_Subdivision": (
        "Time subdivision of parent annotation's time interval, no time gaps allowed within this interval"
    ),
    "Symbolic_Subdivision": (
        "Symbolic subdivision of a parent annotation. Annotations refering to the same parent are ordered"
    ),
    "Symbolic_Association": "1-1 association with a parent annotation",
    "Included_In": "Time alignable annotations within the parent annotation's time interval, gaps are allowed",
}
"""In the words of ELAN's own files."""
_MIME = {".mp4": "video/mp4", ".m4v": "video/mp4", ".mov": "video/quicktime", ".avi": "video/x-msvideo"}


@dataclass(eq=False, slots=True)
class _Mark:
    """One annotation with a time; ``slots`` is the annotation whose time slots it shares."""

    id: str
    event: Event
    span: Span
    slots: str


@dataclass(slots=True)
class _Document:
    """What will be written, gathered lane by lane."""

    source: Source
    spans: Mapping[str, Sequence[Span]]
    marks: dict[str, list[_Mark]] = field(default_factory=dict[str, list[_Mark]])
    nested: set[str] = field(default_factory=set[str])
    names: set[str] = field(default_factory=set[str])
    numbers: Iterator[int] = field(default_factory=count)
    types: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])


def part(
    session: Session, label: str, dest: Path, options: LayerOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the events of one session."""
    del progress
    source = source_of(session, label, options)
    spans = {event.id: _spans(source, event) for event in source.events}
    lanes, nested = lanes_of(source.events, spans)
    known = [int(e.id[1:]) for e in source.layer.events if elan_read.is_annotation_id(e.id)]
    document = _Document(source, spans, nested=nested, numbers=count(max(known, default=0) + 1))
    document.names = {lane.name for lane in lanes}
    root = _root(document, lanes)
    etree.indent(root, space="    ")
    head = b'<?xml version="1.0" encoding="UTF-8"?>\n'
    write_new_file(dest, [head, etree.tostring(root, encoding="utf-8"), b"\n"])
    untimed = len(source.layer.events) - len(source.events)
    return source.findings(
        CARRIES,
        "ELAN",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        source.made_up(),
        own=NAME,
    )


def _spans(source: Source, event: Event) -> list[Span]:
    """The stretches in milliseconds, none empty, none over another."""
    found: list[Span] = []
    for segment in event.segments:
        start, end = map(to_ms, source.times.edges_ns(segment))
        start = max(start, found[-1][1]) if found else start
        found.append((start, max(end, start + 1)))
    return found


def _root(document: _Document, lanes: Sequence[Lane]) -> Any:
    source = document.source
    author = next((e.author for e in source.events if e.author), "")
    root = etree.Element(
        "ANNOTATION_DOCUMENT",
        {"AUTHOR": author, "DATE": source.manifest.created, "FORMAT": "3.0", "VERSION": "3.0"},
        nsmap={"xsi": _XSI},
    )
    root.set(f"{{{_XSI}}}noNamespaceSchemaLocation", _SCHEMA)
    header = etree.SubElement(root, "HEADER", MEDIA_FILE="", TIME_UNITS="milliseconds")
    for name in source.media:
        mime = _MIME.get(PurePosixPath(name).suffix.lower(), "video/*")
        etree.SubElement(header, "MEDIA_DESCRIPTOR", MEDIA_URL=name, MIME_TYPE=mime, RELATIVE_MEDIA_URL=name)
    time_order = etree.SubElement(root, "TIME_ORDER")
    slots: dict[tuple[str, int], str] = {}
    for lane in lanes:
        _add_lane(root, document, lane, slots)
    by_time = sorted(slots, key=lambda slot: slot[1])
    numbers = {slots[slot]: f"ts{number}" for number, slot in enumerate(by_time, 1)}
    for slot in by_time:
        name = numbers[slots[slot]]
        etree.SubElement(time_order, "TIME_SLOT", TIME_SLOT_ID=name, TIME_VALUE=str(slot[1]))
    for mark in root.iter("ALIGNABLE_ANNOTATION"):
        for end in ("TIME_SLOT_REF1", "TIME_SLOT_REF2"):
            mark.set(end, numbers[mark.attrib[end]])
    last = next(document.numbers) - 1
    etree.SubElement(header, "PROPERTY", NAME="lastUsedAnnotationId").text = str(last)
    etree.SubElement(header, "PROPERTY", NAME=RATE_PROPERTY).text = repr(source.times.rate_hz)
    if source.layer.scheme:
        etree.SubElement(header, "PROPERTY", NAME=SCHEME_PROPERTY).text = source.layer.scheme
    _add_types(root, document, lanes)
    return root


# ---------------------------------------------------------------------------------------------- tiers


def _add_lane(root: Any, document: _Document, lane: Lane, slots: dict[tuple[str, int], str]) -> None:
    """The tier of a lane, and those of what is said of its events."""
    marks = _marks(document, lane)
    constraint = _constraint(document, lane)
    vocabulary = _vocabulary(document.source, lane.tier)
    kind = _kind(document, lane.tier or NO_TIER, constraint, has_types=bool(vocabulary))
    tier = _tier(root, lane.name, kind, None if lane.above is None else lane.above.name)
    authors = {event.author for event in lane.events}
    if len(authors) == 1 and (author := authors.pop()):
        tier.set("ANNOTATOR", author)
    if constraint == "Time_Subdivision":
        _share_slots(document, marks)
    entries = {value: f"cve{n}" for n, value in enumerate(vocabulary)}
    for mark in sorted(marks, key=lambda mark: mark.span):
        value = mark.event.type if vocabulary else mark.event.text
        first, last = (slots.setdefault((mark.slots, t), f"{mark.slots} {t}") for t in mark.span)
        said = {"TIME_SLOT_REF1": first, "TIME_SLOT_REF2": last}
        if value in entries:
            said["CVE_REF"] = entries[value]
        _annotate(tier, "ALIGNABLE_ANNOTATION", mark.id, value, said)
    _add_facts(root, document, lane, marks, by_type=bool(vocabulary), author="ANNOTATOR" in tier.attrib)


def _kind(document: _Document, tier: str, constraint: str, *, has_types: bool) -> str:
    """The linguistic type of a lane."""
    said = {
        "TIME_ALIGNABLE": "true",
        "GRAPHIC_REFERENCES": "false",
        **({"CONSTRAINTS": constraint} if constraint else {}),
        **({"CONTROLLED_VOCABULARY_REF": tier} if has_types else {}),
    }
    name = f"{tier} ({constraint})" if constraint else tier
    if document.types.get(name, said) != said:
        name = numbered(name, document.types)
    document.types[name] = said
    return name


def _marks(document: _Document, lane: Lane) -> list[_Mark]:
    found: list[_Mark] = []
    for event in lane.events:
        mine: list[_Mark] = []
        for span in document.spans[event.id]:
            keeps = not mine and elan_read.is_annotation_id(event.id)
            name = event.id if keeps else f"a{next(document.numbers)}"
            mine.append(_Mark(name, event, span, name))
        document.marks[event.id] = mine
        found += mine
    return found


def _constraint(document: _Document, lane: Lane) -> str:
    """The stereotype of a lane's type; nothing at the top."""
    if lane.above is None:
        return ""
    scheme = document.source.scheme
    said = next((t.constraint for t in scheme.tiers if t.name == lane.tier), "") if scheme else ""
    return "Time_Subdivision" if said == "subdivision" and _divides(document, lane) else "Included_In"


def _divides(document: _Document, lane: Lane) -> bool:
    """Whether the lane's events fill those above without a gap, wherever there are any."""
    by_whole: dict[Span, list[Span]] = {}
    for event in lane.events:
        wholes = document.spans[event.parent or ""]
        for span in document.spans[event.id]:
            whole = next(w for w in wholes if w[0] <= span[0] and span[1] <= w[1])
            by_whole.setdefault(whole, []).append(span)
    return all(_fills(whole, sorted(spans)) for whole, spans in by_whole.items())


def _fills(whole: Span, spans: Sequence[Span]) -> bool:
    meet = all(first[1] == second[0] for first, second in pairwise(spans))
    return meet and (spans[0][0], spans[-1][1]) == whole


def _share_slots(document: _Document, marks: Sequence[_Mark]) -> None:
    """Let the parts of an annotation begin and end in its time slots, and in each other's."""
    for mark in marks:
        wholes = document.marks[mark.event.parent or ""]
        mark.slots = next(w.slots for w in wholes if w.span[0] <= mark.span[0] and mark.span[1] <= w.span[1])


def _add_facts(
    root: Any, document: _Document, lane: Lane, marks: Sequence[_Mark], *, by_type: bool, author: bool
) -> None:
    """A tier below for each name under which something is said of the lane's events."""
    tiers: dict[str, list[tuple[str, str]]] = {}
    seen: set[str] = set()
    left_out = {*([] if by_type else ["text"]), *(["author"] if author else [])}
    for mark in marks:
        said: dict[str, str] = {}
        several = len(document.marks[mark.event.id]) > 1
        if several or not elan_read.is_annotation_id(mark.event.id):
            said["event"] = mark.event.id
        if mark.event.id not in seen:
            said |= told(mark.event, document.source.labels)
            if mark.event.id in document.nested:
                said.pop("parent")
        seen.add(mark.event.id)
        for name, text in said.items():
            if name not in left_out:
                tiers.setdefault(name, []).append((mark.id, text))
    for name in sorted(tiers, key=_fact_order):
        kind = elan_read.fact_type(name)
        document.types[kind] = {
            "TIME_ALIGNABLE": "false",
            "CONSTRAINTS": "Symbolic_Association",
            "GRAPHIC_REFERENCES": "false",
        }
        below = elan_read.fact_tier(name, {n.removesuffix(f"@{lane.name}") for n in document.names})
        tier = _tier(root, f"{below}@{lane.name}", kind, lane.name)
        document.names.add(f"{below}@{lane.name}")
        for about, text in tiers[name]:
            number = f"a{next(document.numbers)}"
            _annotate(tier, "REF_ANNOTATION", number, text, {"ANNOTATION_REF": about})


def _fact_order(name: str) -> int:
    return FIELDS.index(name) if name in FIELDS else -1 if name == "event" else len(FIELDS)


def _tier(root: Any, name: str, kind: str, above: str | None) -> Any:
    tier = etree.SubElement(root, "TIER", LINGUISTIC_TYPE_REF=kind)
    if above is not None:
        tier.set("PARENT_REF", above)
    tier.set("TIER_ID", name)
    return tier


def _annotate(tier: Any, tag: str, name: str, value: str, said: Mapping[str, str]) -> None:
    around = etree.SubElement(tier, "ANNOTATION")
    made = etree.SubElement(around, tag, {"ANNOTATION_ID": name, **said})
    etree.SubElement(made, "ANNOTATION_VALUE").text = value


# ---------------------------------------------------------------------------------------------- types


def _vocabulary(source: Source, tier: str) -> list[str]:
    """The types of a tier's events: those of the coding scheme, then others that occur; none if no event has one."""
    used = {event.type for event in source.layer.events if event.tier == tier and event.type}
    scheme = source.scheme
    listed = [kind.name for kind in scheme.event_types if kind.tier == tier] if scheme is not None else []
    return [*listed, *sorted(used - set(listed))]


def _add_types(root: Any, document: _Document, lanes: Sequence[Lane]) -> None:
    for name, said in document.types.items():
        etree.SubElement(root, "LINGUISTIC_TYPE", {"LINGUISTIC_TYPE_ID": name, **said})
    etree.SubElement(root, "LANGUAGE", _LANGUAGE)
    for stereotype, description in _STEREOTYPES.items():
        etree.SubElement(root, "CONSTRAINT", STEREOTYPE=stereotype, DESCRIPTION=description)
    for tier in dict.fromkeys(lane.tier for lane in lanes):
        vocabulary = _vocabulary(document.source, tier)
        if not vocabulary:
            continue
        made = etree.SubElement(root, "CONTROLLED_VOCABULARY", CV_ID=tier or NO_TIER)
        etree.SubElement(made, "DESCRIPTION", LANG_REF="und")
        for number, value in enumerate(vocabulary):
            entry = etree.SubElement(made, "CV_ENTRY_ML", CVE_ID=f"cve{number}")
            etree.SubElement(entry, "CVE_VALUE", DESCRIPTION="", LANG_REF="und").text = value


_READING = Reading(NAME, elan_read.parse)
FORMAT = Format(
    name=NAME,
    description="ELAN annotations (.eaf): tiers, controlled vocabularies, linked videos",
    sniff=elan_read.sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".eaf",
    options=LayerOptions,
)
