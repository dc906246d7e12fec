"""``<annotation>`` of ``files.param``: to an event and back (ECAT 2018 file format §1.2.6)."""

from __future__ import annotations

from ecat.formats.ecat2018.elements import (
    attribute_facts,
    attributes_of,
    fact,
    frame_number,
    kept,
    predicate_of,
    tag_of,
)
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import Event, Foreign, Link, Segment, TextPredicate, TextReference

EVENT_CHILDREN = ("duration", "text", "refs", "events", "link")


def event_of(element: Element, event_id: str, what: str) -> Event:
    """An ``<annotation>``: its span is inclusive and in track bar numbers.

    Raises
    ------
    FormatError : a number is missing or is none.
    """
    said = attributes_of(element, what)
    foreign: list[Foreign] = attribute_facts(said, ("id",), ("id",))
    if event_id != said.get("id"):
        foreign.append(fact("id", said.get("id", "")))
    tags = [tag for child in element if (tag := tag_of(child)) in EVENT_CHILDREN]
    if tags != list(EVENT_CHILDREN):
        foreign.append(fact("children", ",".join(tags)))
    return Event(
        id=event_id,
        tier="event",
        text=element.findtext("text") or "",
        segments=_segments(element.find("duration"), what),
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


def _segments(duration: Element | None, what: str) -> tuple[Segment, ...]:
    if duration is None:
        return ()
    line = duration.sourceline or 0
    start, end = (frame_number(duration.get(name), what, line) for name in ("startFrame", "endFrame"))
    return (Segment(start_frame=start - 1, end_frame=end),)


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
