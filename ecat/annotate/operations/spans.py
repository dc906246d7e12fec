"""Operations on when an event happens: its segments and their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.events import Span, remove_tree
from ecat.model import Event, Segment
from ecat.model.document import span


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSegments(Operation):
    """Replace the segments of an event."""

    id: str
    segments: tuple[Span, ...]

    def perform(self, edit: Edit) -> None:
        """Replace them."""
        set_segments(edit, edit.event(self.id), self.segments)


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveEdge(Operation):
    """Let a segment start or end at another frame.

    Where the event becomes shorter than its sub-events, these are cut (``clip``; one of which nothing is left is
    removed), or the move is refused.  On a tier whose events divide others, the neighbour that it meets follows.
    """

    id: str
    edge: Literal["start", "end"]
    frame: int
    segment: int = 0
    children: Literal["refuse", "clip"] = "refuse"

    def perform(self, edit: Edit) -> None:
        """Move it."""
        event = edit.event(self.id)
        spans = spans_of(event)
        start, end = spans[_position(edit, event, self.segment)]
        spans[self.segment] = (self.frame, end) if self.edge == "start" else (start, self.frame)
        for neighbour in self._neighbours(edit, event, start if self.edge == "start" else end):
            first, last = spans_of(neighbour)[0]
            moved = (first, self.frame) if self.edge == "start" else (self.frame, last)
            set_segments(edit, neighbour, [moved])
        set_segments(edit, event, spans)
        if self.children == "clip":
            clip_children(edit, self.id)

    def _neighbours(self, edit: Edit, event: Event, edge: int) -> list[Event]:
        """The events that share the edge, where events divide their parent."""
        tiers = edit.scheme.tiers if edit.scheme is not None else ()
        divides = any(tier.name == event.tier and tier.constraint == "subdivision" for tier in tiers)
        if not divides or event.parent is None or len(event.segments) > 1:
            return []
        siblings = (other for other in edit.document.children(event.parent) if other.tier == event.tier)
        at = 1 if self.edge == "start" else 0
        return [
            s for s in siblings if s.id != event.id and len(s.segments) == 1 and spans_of(s)[0][at] == edge
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveEvent(Operation):
    """Let an event, with its sub-events, happen ``frames`` later (earlier, if negative)."""

    id: str
    frames: int

    def perform(self, edit: Edit) -> None:
        """Move it."""
        event = edit.event(self.id)
        if not event.segments:
            raise edit.refusal(f"event {self.id} has no segments", "set its segments instead")
        for part in edit.document.tree(self.id):
            if part.segments:
                set_segments(edit, part, [(s + self.frames, e + self.frames) for s, e in spans_of(part)])


@dataclass(frozen=True, slots=True, kw_only=True)
class AddSegment(Operation):
    """One more stretch of an event."""

    id: str
    start_frame: int
    end_frame: int

    def perform(self, edit: Edit) -> None:
        """Add it."""
        event = edit.event(self.id)
        set_segments(edit, event, [*spans_of(event), (self.start_frame, self.end_frame)])


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveSegment(Operation):
    """Remove the stretch number ``segment`` (from 0) of an event that has several."""

    id: str
    segment: int

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        event = edit.event(self.id)
        at = _position(edit, event, self.segment)
        if len(event.segments) == 1:
            raise edit.refusal(f"event {self.id} has no other segment", "remove the event instead")
        spans = spans_of(event)
        set_segments(edit, event, [*spans[:at], *spans[at + 1 :]])


def spans_of(event: Event) -> list[Span]:
    """The segments of an event as pairs of frames."""
    return [(s.start_frame, s.end_frame) for s in event.segments]


def set_segments(edit: Edit, event: Event, spans: Sequence[Span]) -> None:
    """Give an event other segments; those that it had keep their times, even if they are not in the recording."""
    known = {(s.start_frame, s.end_frame): s for s in event.segments}
    kept = [known[pair] for pair in spans if pair in known]
    edges = {edge for pair in known for edge in pair}
    new = [edit.segment(*pair, kept=edges) for pair in spans if pair not in known]
    segments = sorted([*kept, *new], key=lambda s: (s.start_frame, s.end_frame))
    if not segments:
        edit.segments(())
    for first, second in pairwise(segments):
        if second.start_frame < first.end_frame:
            raise edit.refusal(
                f"event {event.id}: frames {_shown(first)} and {_shown(second)} overlap",
                "let the segments of an event lie apart, or make it one",
            )
    edit.put(replace(event, segments=tuple(segments)))


def clip_children(edit: Edit, name: str) -> None:
    """Cut the sub-events of an event, and theirs, to its span."""
    for part in edit.document.tree(name)[1:]:
        parent = edit.document.event(part.parent or "")
        extent = None if parent is None else span(parent)
        if extent is None or edit.document.event(part.id) is None:
            continue
        spans = [(max(s, extent[0]), min(e, extent[1])) for s, e in spans_of(part)]
        kept = [(s, e) for s, e in spans if s < e]
        if part.segments and not kept:
            remove_tree(edit, part.id)
        elif kept != spans_of(part):
            set_segments(edit, part, kept)


def _position(edit: Edit, event: Event, segment: int) -> int:
    if not 0 <= segment < len(event.segments):
        n = len(event.segments)
        raise edit.refusal(
            f"event {event.id} has {n} segments, none is number {segment}",
            f"name one from 0 to {n - 1}" if n else "give it segments first",
        )
    return segment


def _shown(segment: Segment) -> str:
    return f"{segment.start_frame} to {segment.end_frame}"
