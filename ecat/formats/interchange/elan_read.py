"""Reading ELAN's files: their annotations as events, what hangs on those as what is said of them.

A tier whose linguistic type has a controlled vocabulary holds types, any other holds texts.  Tiers of the stereotype
``Symbolic_Association`` say something of the annotation above: what ecat wrote under its own types is understood,
everything else becomes a property.  Annotations without a time of their own (``Symbolic_Subdivision``, time slots
without a value) share the time around them evenly, as ELAN draws them.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.ecat2018.xml_input import Element, parse_safe, place, required_attribute
from ecat.formats.interchange.documents import head_of
from ecat.formats.interchange.facts import FIELDS, PROPERTY, ROLE
from ecat.formats.interchange.found import Found, FoundEvent, Times
from ecat.formats.interchange.lanes import tier_of
from ecat.formats.interchange.source import counted
from ecat.formats.interchange.times import HALF_MS_NS, MOST_SECONDS, from_ms
from ecat.model import CodingScheme, EventType, Tier

FACT_TYPE, ROLE_TYPE, PROPERTY_TYPE = "ecat:fact", "ecat:role", "ecat:property"
"""Linguistic types of the tiers on which ecat says more of an event."""
SCHEME_PROPERTY = "ecat:scheme"
RATE_PROPERTY = "ecat:images a second"
_RATE = re.compile(r"\d{1,5}(\.\d{1,20})?")
_PREFIXES = {FACT_TYPE: "ecat:", ROLE_TYPE: ROLE, PROPERTY_TYPE: PROPERTY}
_OWN_FACTS = {"event", *FIELDS}
_MOST_MS = int(MOST_SECONDS * 1000)
_CONSTRAINTS = {
    "Included_In": "included_in",
    "Time_Subdivision": "subdivision",
    "Symbolic_Subdivision": "subdivision",
}


def sniff(path: Path) -> bool:
    """Whether it is an EAF document."""
    return b"<ANNOTATION_DOCUMENT" in head_of(path, (".eaf", ".xml"))


def is_annotation_id(name: str) -> bool:
    """Whether an event's id is one that ELAN and its tools understand: a letter and a number."""
    return re.fullmatch(r"a[1-9]\d{0,8}", name) is not None


def fact_tier(name: str, taken: Container[str] = ()) -> str:
    """What the tier for a fact is called, before ``@``: ``Agent`` for ``role:Agent`` where nothing else is."""
    prefix = _PREFIXES[fact_type(name)]
    short = name.removeprefix(prefix)
    own = prefix == _PREFIXES[FACT_TYPE]
    clear = not short.startswith(tuple(_PREFIXES.values())) and (own or short not in _OWN_FACTS)
    return short if clear and short not in taken else f"{prefix}{short}"


def fact_type(name: str) -> str:
    """The linguistic type of the tier for a fact."""
    return next((kind for kind in (ROLE_TYPE, PROPERTY_TYPE) if name.startswith(_PREFIXES[kind])), FACT_TYPE)


def _fact_of(tier: str, kind: str) -> str:
    """The fact whose tier :func:`fact_tier` called so; a property if it was another program."""
    if kind == FACT_TYPE and (name := tier.removeprefix(_PREFIXES[kind])) in _OWN_FACTS:
        return name
    prefix = ROLE if kind == ROLE_TYPE else PROPERTY
    return f"{prefix}{tier.removeprefix(prefix) if kind in _PREFIXES else tier}"


@dataclass(eq=False, slots=True)
class _Tier:
    name: str
    kind: str
    above: str | None
    annotator: str
    participant: str
    constraint: str
    has_types: bool
    marks: list[_Mark] = field(default_factory=list["_Mark"])


@dataclass(eq=False, slots=True)
class _Mark:
    """One annotation: with ends (names of time slots), or about another."""

    id: str
    value: str
    ends: tuple[str, str] | None
    about: str
    before: str


def parse(source: Path) -> Sequence[Found]:
    """Read an EAF document.

    Raises
    ------
    FormatError : not EAF; the message names the line.
    LimitError : larger than a document of annotations can be.
    """
    what = f"cannot import {source.name}"
    root = parse_safe(source, what=what)
    if root.tag != "ANNOTATION_DOCUMENT":
        raise FormatError(what, where=f"{place(root)}: expected <ANNOTATION_DOCUMENT>")
    return (_Reader(root, what).found(source.stem),)


class _Reader:
    """One document."""

    def __init__(self, root: Element, what: str) -> None:
        self._root, self._what = root, what
        self._entries = _entries(root)
        self._tiers = self._read_tiers()
        self._offset_ms, self._media = self._read_media()
        self._times = _times(_slots(root, what), [tier.marks for tier in self._tiers.values()])
        self._found = Found(media=self._media)
        self._event_of: dict[str, FoundEvent] = {}
        self._events: dict[str, FoundEvent] = {}
        self._spans: dict[str, tuple[int, int]] = {}
        self._named: dict[str, FoundEvent] = {}
        self._wholes: list[tuple[FoundEvent, str]] = []
        self._untimed = self._even = self._lost = self._twice = 0

    def found(self, name: str) -> Found:
        """What the document says."""
        found = self._found
        for tier in self._in_order():
            if tier.constraint == "Symbolic_Association":
                self._say(tier)
            elif tier.constraint == "Symbolic_Subdivision":
                self._divide(tier)
            else:
                self._add(tier)
        for event, whole in self._wholes:
            event.said["parent"] = self._event_of[whole].key
        found.name = name
        found.events = sorted(self._events.values(), key=_start_ns)
        found.scheme_name = self._property(SCHEME_PROPERTY)
        rate = self._property(RATE_PROPERTY)
        found.rate_hz = float(rate) or None if _RATE.fullmatch(rate) else None
        found.scheme = self._scheme(name)
        told = (
            (self._untimed, f"{counted(self._untimed, 'annotation')} without a time left out"),
            (self._twice, f"{counted(self._twice, 'annotation')} with the id of another left out"),
            (
                self._even,
                f"{counted(self._even, 'annotation')} without a time placed evenly in the one above",
            ),
            (self._lost, f"{counted(self._lost, 'annotation')} about one that is not there left out"),
        )
        found.findings = [line for n, line in told if n]
        links = len(self._root.findall("HEADER/LINKED_FILE_DESCRIPTOR"))
        if links:
            found.findings.append(f"{counted(links, 'linked file')} not imported")
        return found

    # ---------------------------------------------------------------------------------------- the document

    def _property(self, name: str) -> str:
        said = (p.text or "" for p in self._root.iterfind("HEADER/PROPERTY") if p.get("NAME") == name)
        return next(said, "")

    def _read_media(self) -> tuple[int, tuple[str, ...]]:
        """Where the first medium is when time begins, milliseconds, and what the media are called."""
        media = self._root.findall("HEADER/MEDIA_DESCRIPTOR")
        names = [name for m in media for name in (m.get("RELATIVE_MEDIA_URL"), m.get("MEDIA_URL")) if name]
        origin = _number(media[0].get("TIME_ORIGIN", "0"), media[0], self._what) if media else 0
        return origin, tuple(dict.fromkeys(names))

    def _read_tiers(self) -> dict[str, _Tier]:
        types = {
            required_attribute(e, "LINGUISTIC_TYPE_ID", what=self._what): e
            for e in self._root.iterfind("LINGUISTIC_TYPE")
        }
        tiers: dict[str, _Tier] = {}
        for element in self._root.iterfind("TIER"):
            name = required_attribute(element, "TIER_ID", what=self._what)
            kind = element.get("LINGUISTIC_TYPE_REF", "")
            said = types.get(kind)
            vocabulary = None if said is None else said.get("CONTROLLED_VOCABULARY_REF")
            tiers[name] = _Tier(
                name=name,
                kind=kind,
                above=element.get("PARENT_REF") or None,
                annotator=element.get("ANNOTATOR", ""),
                participant=element.get("PARTICIPANT", ""),
                constraint="" if said is None else said.get("CONSTRAINTS", "").replace(" ", "_"),
                has_types=bool(vocabulary),
                marks=[
                    _mark(inner, self._what) for around in element.iterfind("ANNOTATION") for inner in around
                ],
            )
        return tiers

    def _in_order(self) -> Iterator[_Tier]:
        """Tiers after those above them; whose is not there, or leads back to itself, is at the top."""
        done: set[str] = set()
        for start in self._tiers.values():
            path: dict[str, _Tier] = {}
            here: _Tier | None = start
            while here is not None and here.name not in done and here.name not in path:
                path[here.name] = here
                here = self._tiers.get(here.above or "")
            if here is not None and here.name in path:
                here.above = None
            for tier in reversed(path.values()):
                tier.above = tier.above if tier.above in self._tiers else None
                done.add(tier.name)
                yield tier

    # ---------------------------------------------------------------------------------------- events

    def _new_event(self, tier: _Tier, mark: _Mark, whole: str) -> FoundEvent:
        event = FoundEvent(key=mark.id, tier=tier_of(tier.name, tier.above))
        if tier.has_types:
            event.type = mark.value
        elif mark.value:
            event.said["text"] = mark.value
        if tier.annotator:
            event.said["author"] = tier.annotator
        if tier.participant:
            event.said[f"{PROPERTY}participant"] = tier.participant
        if whole:
            self._wholes.append((event, whole))
        self._events[mark.id] = self._event_of[mark.id] = event
        return event

    def _add(self, tier: _Tier) -> None:
        """Annotations with a time."""
        above = self._tiers[tier.above].marks if tier.above else []
        wholes = sorted((self._spans[m.id], m.id) for m in above if m.id in self._spans)
        for mark in tier.marks:
            span = self._times.get(mark.id)
            if mark.id in self._events:
                self._twice += 1
            elif span is None:
                self._untimed += 1
            else:
                event = self._new_event(tier, mark, _around(wholes, span))
                self._place(event, mark.id, span)

    def _place(self, event: FoundEvent, name: str, span: tuple[int, int]) -> None:
        self._spans[name] = span
        start, end = (from_ms(t + self._offset_ms) for t in span)
        event.stretches.append(Times(start_ns=start, end_ns=end, within_ns=HALF_MS_NS))

    def _divide(self, tier: _Tier) -> None:
        """Annotations that share the time of the one above."""
        groups: dict[str, list[_Mark]] = {}
        for mark in tier.marks:
            groups.setdefault(mark.about, []).append(mark)
        for about, marks in groups.items():
            whole = self._spans.get(about)
            if whole is None or any(mark.id in self._events for mark in marks):
                self._lost += len(marks)
                continue
            for number, mark in enumerate(_chained(marks)):
                edges = tuple(
                    whole[0] + (whole[1] - whole[0]) * k // len(marks) for k in (number, number + 1)
                )
                event = self._new_event(tier, mark, about)
                self._place(event, mark.id, (edges[0], edges[1]))
                self._even += 1

    def _say(self, tier: _Tier) -> None:
        """What is said of the annotations above."""
        short = tier.name.removesuffix(f"@{tier.above}") if tier.above else tier.name
        fact = _fact_of(short, tier.kind)
        for mark in tier.marks:
            event = self._event_of.get(mark.about)
            if event is None:
                self._lost += 1
                continue
            self._event_of[mark.id] = event
            if fact == "event" and tier.kind == FACT_TYPE:
                self._join(event, mark)
            elif fact not in event.said or fact == "text":
                event.said[fact] = mark.value

    def _join(self, event: FoundEvent, mark: _Mark) -> None:
        """One more stretch of an event that has several, or the event's own id."""
        whole = self._named.setdefault(mark.value, event)
        if whole is event:
            event.key = mark.value
            return
        whole.stretches += event.stretches
        whole.said = event.said | whole.said
        self._events.pop(mark.about, None)
        self._event_of[mark.about] = whole

    # ---------------------------------------------------------------------------------------- vocabularies

    def _scheme(self, name: str) -> CodingScheme | None:
        """The tiers with their constraints, and the values of controlled vocabularies as types."""
        events = [tier for tier in self._tiers.values() if tier.constraint != "Symbolic_Association"]
        tiers: dict[str, Tier] = {}
        kinds: dict[str, EventType] = {}
        vocabularies = {
            e.get("LINGUISTIC_TYPE_ID"): e.get("CONTROLLED_VOCABULARY_REF")
            for e in self._root.iterfind("LINGUISTIC_TYPE")
        }
        for tier in events:
            mine = tier_of(tier.name, tier.above)
            above = self._tiers.get(tier.above or "")
            whole = None if above is None else tier_of(above.name, above.above)
            constraint = _CONSTRAINTS.get(tier.constraint, "none") if whole else "none"
            if mine:
                tiers.setdefault(mine, Tier(name=mine, parent=whole or None, constraint=constraint))  # type: ignore[arg-type]
            for value in self._entries.get(vocabularies.get(tier.kind) or "", ()):
                kinds.setdefault(value, EventType(name=value, tier=mine))
        if not kinds:
            return None
        return CodingScheme(name=name, tiers=tuple(tiers.values()), event_types=tuple(kinds.values()))


def _start_ns(event: FoundEvent) -> int:
    return min(stretch.start_ns for stretch in event.stretches if isinstance(stretch, Times))


# ---------------------------------------------------------------------------------------------- elements


def _mark(element: Element, what: str) -> _Mark:
    if element.tag not in {"ALIGNABLE_ANNOTATION", "REF_ANNOTATION"}:
        raise FormatError(what, where=f"{place(element)}: expected an annotation")
    ends = None
    if element.tag == "ALIGNABLE_ANNOTATION":
        first, last = (required_attribute(element, f"TIME_SLOT_REF{n}", what=what) for n in (1, 2))
        ends = first, last
    return _Mark(
        id=required_attribute(element, "ANNOTATION_ID", what=what),
        value=element.findtext("ANNOTATION_VALUE") or "",
        ends=ends,
        about=element.get("ANNOTATION_REF", ""),
        before=element.get("PREVIOUS_ANNOTATION", ""),
    )


def _number(text: str, element: Element, what: str) -> int:
    if not re.fullmatch(r"-?\d{1,12}", text) or abs(int(text)) > _MOST_MS:
        raise FormatError(what, where=f"{place(element)}: expected milliseconds, found {text[:40]!r}")
    return int(text)


def _entries(root: Element) -> dict[str, list[str]]:
    """The values of every controlled vocabulary, in the old form and in that for several languages."""
    return {
        vocabulary.get("CV_ID", ""): [
            entry.findtext("CVE_VALUE") or "" if entry.tag == "CV_ENTRY_ML" else entry.text or ""
            for entry in vocabulary
            if entry.tag in {"CV_ENTRY", "CV_ENTRY_ML"}
        ]
        for vocabulary in root.iterfind("CONTROLLED_VOCABULARY")
    }


# ---------------------------------------------------------------------------------------------- times


def _slots(root: Element, what: str) -> dict[str, int | None]:
    """The time of every slot, milliseconds; ``None`` where it has none of its own."""
    return {
        required_attribute(slot, "TIME_SLOT_ID", what=what): None
        if (said := slot.get("TIME_VALUE")) is None
        else _number(said, slot, what)
        for slot in root.iterfind("TIME_ORDER/TIME_SLOT")
    }


def _times(slots: dict[str, int | None], tiers: Sequence[Sequence[_Mark]]) -> dict[str, tuple[int, int]]:
    """When each annotation starts and ends; slots without a time share that between their neighbours evenly."""
    for marks in tiers:
        following = {mark.ends[0]: mark.ends[1] for mark in marks if mark.ends is not None}
        for first in [slot for slot in following if slots.get(slot) is not None]:
            chain = [first]
            while chain[-1] in following and (len(chain) == 1 or slots.get(chain[-1]) is None):
                chain.append(following.pop(chain[-1]))
            start, end = slots.get(chain[0]), slots.get(chain[-1])
            if start is None or end is None:
                continue
            for number, slot in enumerate(chain[1:-1], 1):
                slots[slot] = start + (end - start) * number // (len(chain) - 1)
    found: dict[str, tuple[int, int]] = {}
    for mark in (mark for marks in tiers for mark in marks if mark.ends is not None):
        start, end = (slots.get(slot) for slot in mark.ends or ())
        if start is not None and end is not None and end >= start:
            found[mark.id] = start, end
    return found


def _around(wholes: Sequence[tuple[tuple[int, int], str]], span: tuple[int, int]) -> str:
    """The annotation above that a stretch lies in most: its neighbours by their start; nothing if it is in none."""
    at = bisect_right(wholes, (span, "\U0010ffff"))
    near = wholes[max(at - 2, 0) : at + 2]
    shared = [(min(end, span[1]) - max(start, span[0]), name) for (start, end), name in near]
    most = max(shared, default=(0, ""))
    return most[1] if most[0] > 0 else ""


def _chained(marks: Sequence[_Mark]) -> list[_Mark]:
    """Annotations of one annotation in their order: each names the one before it."""
    following = {mark.before: mark for mark in marks}
    ordered: list[_Mark] = []
    here = following.pop("", None)
    while here is not None:
        ordered.append(here)
        here = following.pop(here.id, None)
    return ordered if len(ordered) == len(marks) else list(marks)
