"""``<annotation>`` of ``files.param``: to an event and back (ECAT 2018 file format §1.2.6).

ECAT has no types of events, but actions: characters of the text that name what is done.  An event is of the type of its
only action, or of the last if that is all of the text.
"""

from __future__ import annotations

import re
from dataclasses import replace

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
TIER = "event"
"""Of the events that are read, unless they are parts of others (:mod:`ecat.formats.ecat2018.nesting`)."""


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
    event = Event(
        id=event_id,
        tier=TIER,
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
    return _typed(event)


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


# ---------------------------------------------------------------------------------------------- types as actions


def with_action(event: Event) -> Event:
    """The event with an action that says its type, if none does and one can.

    That is the first word of the text that is the type; else, and where there are other actions, all of the text, which
    is the type where there is none.
    """
    if event.type == _type_said(event) or not event.type or (event.predicates and not event.text):
        return event
    text, pattern = event.text or event.type, rf"(?<!\w){re.escape(event.type)}(?!\w)"
    word = None if event.predicates else re.search(pattern, text, re.IGNORECASE)
    start, end = word.span() if word else (0, len(text))
    action = TextPredicate(start=start, end=end, type=event.type)
    return replace(event, text=text, predicates=(*event.predicates, action))


def is_type_read(event: Event) -> bool:
    """Whether an event is of the same type when it is read again."""
    return event.type == _type_said(with_action(event))


def _type_said(event: Event) -> str:
    """The type that actions say."""
    actions = event.predicates
    return actions[-1].type if len(actions) == 1 or (actions and _is_whole(actions[-1], event.text)) else ""


def _is_whole(action: TextPredicate, text: str) -> bool:
    return (action.start, action.end) == (0, len(text))


def _typed(event: Event) -> Event:
    """The event with the type that its actions say, and without what is there to say it."""
    typed = replace(event, type=_type_said(event))
    if not typed.type or not _is_whole(event.predicates[-1], event.text):
        return typed
    for text in ("", event.text) if event.text == typed.type else (event.text,):
        bare = replace(typed, text=text, predicates=event.predicates[:-1])
        if with_action(bare) == typed:
            return bare
    return typed
