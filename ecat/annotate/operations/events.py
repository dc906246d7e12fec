"""Operations on events as wholes: adding, describing, removing, splitting, merging, and their place in the tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.near import advice
from ecat.annotate.operations.text import moved_spans
from ecat.annotate.operations.uses import forget_event, rename_event
from ecat.model import Event, Role, Segment
from ecat.model.annotation import Status
from ecat.model.document import span

Span = tuple[int, int]
"""First frame, and the first after it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AddEvent(Operation):
    """A new event; ``segments`` are half-open stretches of frames, ``roles`` what takes part as what.

    On a tier whose events are parts of others, an event without ``parent`` becomes a part of the shortest one
    around it.
    """

    type: str = ""
    segments: tuple[Span, ...] = ()
    tier: str = ""
    parent: str | None = None
    text: str = ""
    roles: Mapping[str, str] = field(default_factory=dict[str, str])
    status: Status = "confirmed"
    unsure: bool = False
    id: str | None = None

    def perform(self, edit: Edit) -> None:
        """Add it."""
        segments = edit.segments(self.segments)
        tier = self.tier or type_tier(edit, self.type)
        parent = self.parent if self.parent is not None else _around(edit, tier, segments)
        edit.put(
            Event(
                id=edit.new_id("event", self.id),
                type=self.type,
                tier=tier,
                parent=parent,
                status=self.status,
                unsure=self.unsure,
                author=edit.author,
                text=self.text,
                segments=segments,
                roles=tuple(role_of(edit, name, target) for name, target in self.roles.items()),
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EditEvent(Operation):
    """Change what is given of an event; references in a text that is edited move with the words they mark."""

    id: str
    type: str | None = None
    text: str | None = None
    tier: str | None = None
    unsure: bool | None = None
    status: Status | None = None

    def perform(self, edit: Edit) -> None:
        """Change it."""
        event = edit.event(self.id)
        said = {name: getattr(self, name) for name in ("type", "text", "tier", "unsure", "status")}
        new = replace(event, **{name: value for name, value in said.items() if value is not None})
        if new.text != event.text:
            new = replace(
                new,
                references=moved_spans(event.references, event.text, new.text),
                predicates=moved_spans(event.predicates, event.text, new.text),
            )
        edit.put(new)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveEvent(Operation):
    """Remove an event, the links and roles that name it, and its sub-events, unless they are to stay.

    Sub-events that stay (``keep``) take its place: below its parent, or on its tier.
    """

    id: str
    children: Literal["remove", "keep"] = "remove"

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        event = edit.event(self.id)
        if self.children == "keep":
            for child in edit.document.children(self.id):
                tier = child.tier if event.parent is not None else event.tier
                edit.put(replace(child, parent=event.parent, tier=tier))
        remove_tree(edit, self.id)


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitEvent(Operation):
    """Make two events of one: what lies from ``frame`` on is a new one, with the same type, text and roles.

    Sub-events go with the side that they lie on; one that lies on both is split as well.
    """

    id: str
    frame: int

    def perform(self, edit: Edit) -> None:
        """Split it."""
        extent = span(edit.event(self.id))
        if extent is None or not extent[0] < self.frame < extent[1]:
            where = "nowhere" if extent is None else f"at frames {extent[0]} to {extent[1]}"
            raise edit.refusal(
                f"event {self.id} is {where}, frame {self.frame} is not inside of it",
                "name a frame after its first and before its end",
            )
        seconds: dict[str, str] = {}
        for event in edit.document.tree(self.id):
            start, end = span(event) or (0, 0)
            if event.id == self.id or start < self.frame < end:
                seconds[event.id] = self._split(edit, event, seconds.get(event.parent or ""))
            elif start >= self.frame and event.parent in seconds:
                edit.put(replace(event, parent=seconds[event.parent]))

    def _split(self, edit: Edit, event: Event, parent: str | None) -> str:
        """Split ``event``; the id of the second half, a part of ``parent`` (of what it was a part of, by default)."""
        first, second = _divided(edit, event.segments, self.frame)
        name = edit.new_id("event")
        edit.put(replace(event, segments=first))
        new = replace(
            event, id=name, segments=second, parent=parent or event.parent, author=edit.author, foreign=()
        )
        edit.put(new, edit.document.position("event", event.id) + 1)
        return name


@dataclass(frozen=True, slots=True, kw_only=True)
class MergeEvents(Operation):
    """Make one event of several: the first named keeps its id, type and text, and gets everybody's segments.

    Segments that meet or overlap become one.  Sub-events, links, roles that the first lacks, properties, and
    whatever names the others come along.
    """

    ids: tuple[str, ...]

    def perform(self, edit: Edit) -> None:
        """Merge them."""
        if len(set(self.ids)) != len(self.ids) or len(self.ids) < 2:
            raise edit.refusal("two events or more make one", "name each once")
        events = [edit.event(name) for name in self.ids]
        kept = events[0]
        roles = {role.name: role for event in reversed(events) for role in event.roles}
        properties = {p.name: p for event in reversed(events) for p in event.properties}
        ours = {kept.id, *self.ids}
        merged = replace(
            kept,
            segments=joined(edit, [segment for event in events for segment in event.segments]),
            roles=tuple(dict.fromkeys([*(roles[r.name] for r in kept.roles), *roles.values()])),
            properties=tuple(properties[n] for n in dict.fromkeys([*(p.name for p in kept.properties), *properties])),
            links=tuple(
                dict.fromkeys(link for event in events for link in event.links if link.target not in ours)
            ),
            unsure=any(event.unsure for event in events),
        )  # fmt: skip
        for event in events[1:]:
            rename_event(edit, event.id, kept.id)
        # an event that was a part of another of them is not a part of itself
        parent = None if kept.parent in ours else kept.parent
        edit.put(replace(merged, parent=parent))
        for event in events[1:]:
            forget_event(edit, event.id)
            edit.drop("event", event.id)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetParent(Operation):
    """Make an event a part of another, or of none."""

    id: str
    parent: str | None = None

    def perform(self, edit: Edit) -> None:
        """Set it."""
        event = edit.event(self.id)
        if self.parent is not None:
            edit.event(self.parent)
        edit.put(replace(event, parent=self.parent))


def role_of(edit: Edit, name: str, target: str) -> Role:
    """A role; what fills it is an object, a joint of one (``<object>/<joint>``), or another event.

    Raises
    ------
    OperationError : it is none of these.
    """
    if edit.document.object(target) is not None:
        return Role(name=name, target=target)
    if "/" in target and edit.document.object(target.partition("/")[0]) is not None:
        return Role(name=name, target=target, kind="joint")
    if edit.document.event(target) is not None:
        return Role(name=name, target=target, kind="event")
    owner = target.partition("/")[0]
    raise edit.refusal(
        f"role {name}: there is no object or event {target}",
        f"name an object, a joint of one (o1/HandRight), or an event; "
        f"{advice(edit.document, ('object', 'event'), owner)}",
    )


def type_tier(edit: Edit, kind: str) -> str:
    """The tier that events of a type are on, by the coding scheme."""
    types = edit.scheme.event_types if edit.scheme is not None else ()
    return next((t.tier for t in types if t.name == kind), "")


def remove_tree(edit: Edit, name: str) -> None:
    """Remove an event with its sub-events, and whatever names them."""
    for event in reversed(edit.document.tree(name)):
        forget_event(edit, event.id)
        edit.drop("event", event.id)


def joined(edit: Edit, segments: list[Segment]) -> tuple[Segment, ...]:
    """Segments in order, those that meet or overlap as one."""
    found: list[tuple[int, int]] = []
    for segment in sorted(segments, key=lambda s: (s.start_frame, s.end_frame)):
        if found and segment.start_frame <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], segment.end_frame))
        else:
            found.append((segment.start_frame, segment.end_frame))
    known = {(s.start_frame, s.end_frame): s for s in segments}
    return tuple(known.get(pair) or edit.segment(*pair) for pair in found)


def _divided(
    edit: Edit, segments: tuple[Segment, ...], frame: int
) -> tuple[tuple[Segment, ...], tuple[Segment, ...]]:
    time = edit.t_ns(frame)
    first = tuple(
        s if s.end_frame <= frame else replace(s, end_frame=frame, end_ns=time)
        for s in segments
        if s.start_frame < frame
    )
    second = tuple(
        s if s.start_frame >= frame else replace(s, start_frame=frame, start_ns=time)
        for s in segments
        if s.end_frame > frame
    )
    return first, second


def _around(edit: Edit, tier: str, segments: tuple[Segment, ...]) -> str | None:
    """The shortest event around ``segments`` on the tier that ``tier`` hangs below."""
    tiers = edit.scheme.tiers if edit.scheme is not None else ()
    above = next((t.parent for t in tiers if t.name == tier and t.constraint != "none"), None)
    if above is None:
        return None
    start, end = segments[0].start_frame, segments[-1].end_frame
    found: list[tuple[int, str]] = []
    for event in edit.document.overlapping(above, start, end):
        extent = span(event) or (0, 0)
        if extent[0] <= start and end <= extent[1]:
            found.append((extent[1] - extent[0], event.id))
    return min(found)[1] if found else None
