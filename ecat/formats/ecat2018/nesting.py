"""Sub-events in ``files.param``: ECAT has no tree of events, but a link ``SUBEVENT(X,Y)`` from the whole to a part
(ECAT 2018 file format §1.2.6).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ecat.formats.ecat2018.elements import fact, kept, predicate_of
from ecat.formats.ecat2018.events import TIER as OUTER_TIER
from ecat.formats.ecat2018.events import link_type
from ecat.model import Event, Link
from ecat.model.document import span

MOST_DEPTH = 16
"""Events from the outermost to the innermost, as many as may be edited."""
TIER = "sub-event"
"""Of the parts of events that are no parts themselves; the tier of parts of parts has no name."""
_PART = "SUBEVENT"
_ORDER = "links"


def nested(events: Sequence[Event]) -> tuple[Event, ...]:
    """Events with the parts that they link to below them.

    A link becomes a place in the tree where it can mean nothing else: there is one event of that id, no other event
    links to it as a part, it happens while the whole does, and no event is a part of itself.  Every other stays a
    link.
    """
    wholes = _wholes(events)
    parts: dict[str, list[str]] = {}
    for event in events:
        if event.id in wholes:
            parts.setdefault(wholes[event.id], []).append(event.id)
    return tuple(_placed(event, wholes, parts.get(event.id, ())) for event in events)


def linked(event: Event, parts: Iterable[str]) -> list[tuple[str, str]]:
    """Target and type of the links of an event, and of one to each of its ``parts``, in the order of the file."""
    links = [(link.target, link_type(link)) for link in event.links]
    known = {(target, predicate_of(kind)[0]) for target, kind in links}
    links += [(part, f"{_PART}(X,Y)") for part in parts if (part, _PART) not in known]
    place = {line: i for i, line in enumerate((kept(event.foreign, _ORDER) or "").split("\n"))}
    return sorted(links, key=lambda link: place.get(_line(link), len(place)))


def _line(link: tuple[str, str]) -> str:
    return f"{link[1]} {link[0]}"


def _wholes(events: Sequence[Event]) -> dict[str, str]:
    """The event that each part is a part of."""
    known = {event.id: event for event in events}
    doubled = {kept(event.foreign, "id") for event in events}
    said = [(event, link.target) for event in events for link in event.links if _is_part(link)]
    times = Counter(target for _, target in said)
    found = {
        target: whole.id
        for whole, target in said
        if times[target] == 1
        and target in known
        and target not in doubled
        and _is_within(known[target], whole)
        and len(set(whole.links)) == len(whole.links)
    }
    return {part: whole for part, whole in found.items() if _has_a_top(part, found)}


def _is_part(link: Link) -> bool:
    return link.type == _PART and not link.foreign


def _is_within(part: Event, whole: Event) -> bool:
    inner, outer = span(part), span(whole)
    return inner is not None and outer is not None and outer[0] <= inner[0] < inner[1] <= outer[1]


def _has_a_top(part: str, wholes: dict[str, str]) -> bool:
    here: str | None = part
    for _ in range(MOST_DEPTH):
        here = wholes.get(here)
        if here is None:
            return True
    return False


def _placed(event: Event, wholes: dict[str, str], parts: Sequence[str]) -> Event:
    """An event at its place in the tree; the order of its links is kept where the writer has another one."""
    whole, below = wholes.get(event.id), set(parts)
    if whole is None and not below:
        return event
    links = tuple(link for link in event.links if not (_is_part(link) and link.target in below))
    tier = event.tier if whole is None else "" if whole in wholes else TIER
    placed = replace(event, parent=whole, tier=tier, links=links)
    said = [(link.target, link_type(link)) for link in event.links]
    if linked(placed, parts) == said:
        return placed
    return replace(placed, foreign=(*event.foreign, fact(_ORDER, "\n".join(map(_line, said)))))


def unread_tiers(events: Sequence[Event]) -> list[str]:
    """The events that are on another tier than they would be read on."""
    outer = {event.id for event in events if event.parent is None}
    return [
        event.id
        for event in events
        if event.tier
        and event.tier != (OUTER_TIER if event.parent is None else TIER if event.parent in outer else "")
    ]
