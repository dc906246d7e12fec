"""Events side by side: lanes in which none overlaps another, the parts of an event below it.

ELAN allows no overlap on a tier, and a tier below another holds what lies within single annotations of that one.  So a
tier of ecat becomes as many lanes as it takes, below each lane that its wholes are in.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from ecat.errors import LimitError
from ecat.formats.interchange.facts import plain_name
from ecat.model import Event

Span: TypeAlias = tuple[int, int]
NO_TIER = "(no tier)"
"""The lane of events that are on no tier."""
MOST_DEPTH = 16
"""Lanes below each other; ecat's own editor allows no more levels of sub-events."""
MOST_LANES = 500
"""Of one tier; more events do not happen at one time."""


@dataclass(eq=False, slots=True)
class Lane:
    """Events that do not overlap; ``spans`` of all of them, in order, in milliseconds."""

    tier: str
    above: Lane | None
    number: int
    events: list[Event] = field(default_factory=list[Event])
    spans: list[Span] = field(default_factory=list[Span])

    @property
    def depth(self) -> int:
        """How many lanes there are down to this one."""
        return 1 if self.above is None else 1 + self.above.depth

    @property
    def name(self) -> str:
        """Unlike that of any other lane; :func:`tier_of` tells the tier again."""
        name = self.tier or NO_TIER
        if self.number > 1 or plain_name(name) != name:
            name = f"{name} #{self.number}"
        return name if self.above is None else f"{name}@{self.above.name}"

    def is_free(self, spans: Sequence[Span]) -> bool:
        """Whether none of these overlaps what is there."""
        return all(self._is_free(*span) for span in spans)

    def _is_free(self, start: int, end: int) -> bool:
        at = bisect_right(self.spans, (start, end))
        before_ends = at == 0 or self.spans[at - 1][1] <= start
        return before_ends and (at == len(self.spans) or self.spans[at][0] >= end)

    def add(self, event: Event, spans: Sequence[Span]) -> None:
        """Put an event in."""
        self.events.append(event)
        for span in spans:
            insort(self.spans, span)


def tier_of(name: str, above: str | None) -> str:
    """The tier of the lane called ``name``, below the one called ``above``."""
    plain = plain_name(name.removesuffix(f"@{above}") if above else name)
    return "" if plain == NO_TIER else plain


def lanes_of(events: Sequence[Event], spans: Mapping[str, Sequence[Span]]) -> tuple[list[Lane], set[str]]:
    """All lanes, each after the one above it, and the ids of events that are below the event they are a part of.

    An event is below its whole where each of its stretches lies within one of the whole's, down to ``MOST_DEPTH``.

    Parameters
    ----------
    events : by their start. spans : the stretches of each, by its id, in order.

    Raises
    ------
    LimitError : more than ``MOST_LANES`` events of a tier happen at one time.
    """
    found: dict[tuple[str, int], list[Lane]] = {}
    lane_of: dict[str, Lane] = {}
    nested: set[str] = set()
    for event in _wholes_first(events):
        mine = spans[event.id]
        above = lane_of.get(event.parent or "")
        if above is None or above.depth >= MOST_DEPTH or not _within(mine, spans[event.parent or ""]):
            above = None
        else:
            nested.add(event.id)
        lanes = found.setdefault((event.tier, id(above)), [])
        lane = next((lane for lane in lanes if lane.is_free(mine)), None)
        if lane is None:
            if len(lanes) == MOST_LANES:
                raise LimitError(
                    "cannot write the events in lanes",
                    where=f"event {event.id}: more than {MOST_LANES} others of tier {event.tier or NO_TIER} overlap it",
                    consequence="nothing was written",
                    fix="write them as csv",
                )
            lane = Lane(event.tier, above, len(lanes) + 1)
            lanes.append(lane)
        lane.add(event, mine)
        lane_of[event.id] = lane
    return [lane for lanes in found.values() for lane in lanes], nested


def _within(parts: Sequence[Span], whole: Sequence[Span]) -> bool:
    return all(any(first <= start and end <= last for first, last in whole) for start, end in parts)


def _wholes_first(events: Sequence[Event]) -> Iterator[Event]:
    """Level by level, each in the order given; then those that are a part of themselves."""
    known = {event.id for event in events}
    parts: dict[str, list[Event]] = {}
    level = [event for event in events if event.parent not in known]
    for event in events:
        if event.parent in known:
            parts.setdefault(event.parent or "", []).append(event)
    left = dict.fromkeys(event.id for event in events)
    while level:
        for event in level:
            del left[event.id]
            yield event
        level = [part for event in level for part in parts.get(event.id, ())]
    yield from (event for event in events if event.id in left)
