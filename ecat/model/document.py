"""A working copy of a layer: elements by id, who names whom, and what lies where on a tier."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

from ecat.model.annotation import (
    AnnotatedObject,
    Decision,
    Event,
    KeyFrame,
    Layer,
    Relation,
    with_relation_ids,
)
from ecat.model.changes import (
    ELEMENTS,
    KEY_FRAMES,
    LISTS,
    SHAPES,
    Change,
    Json,
    Kind,
    by_id,
    from_json,
    header,
    readers,
    to_json,
)


class Document:
    """A layer that can be changed, with its elements at hand by id; an edit costs what it touches.

    Parameters
    ----------
    layer : what to begin with; relations without an id get one.

    Raises
    ------
    SchemaError : an id, or a frame of an object, occurs twice.
    """

    def __init__(self, layer: Layer) -> None:
        layer = with_relation_ids(layer)
        self.name = layer.name
        self._header = replace(layer, objects=(), events=(), relations=(), decisions=())
        self._elements: dict[Kind, dict[str, Any]] = {LISTS[name]: by_id(layer, name) for name in LISTS}
        self._order: dict[Kind, list[str]] = {kind: list(ids) for kind, ids in self._elements.items()}
        self._users: dict[tuple[str, str], dict[tuple[Kind, str], None]] = {}
        self._lanes: dict[str, Lane] = {}
        for kind, elements in self._elements.items():
            for name, element in elements.items():
                self._index(kind, name, element)

    def layer(self) -> Layer:
        """The layer as it is now."""
        lists = {
            name: tuple(map(self._elements[kind].__getitem__, self._order[kind]))
            for name, kind in LISTS.items()
        }
        return replace(self._header, **lists)

    @property
    def header(self) -> Layer:
        """The layer without its elements: name, counters, scheme, foreign facts."""
        return self._header

    # ------------------------------------------------------------------------------------------ looking up

    def object(self, name: str) -> AnnotatedObject | None:
        """The object with this id."""
        return self._elements["object"].get(name)

    def event(self, name: str) -> Event | None:
        """The event with this id."""
        return self._elements["event"].get(name)

    def relation(self, name: str) -> Relation | None:
        """The relation with this id."""
        return self._elements["relation"].get(name)

    def decision(self, proposal: str) -> Decision | None:
        """What was decided about a proposal."""
        return self._elements["decision"].get(proposal)

    def element(self, kind: Kind, name: str) -> Any:
        """The element that a change of this kind and id is about, or ``None``."""
        if kind == "layer":
            return self._header
        if kind in SHAPES:
            owner, _, frame = name.rpartition("@")
            thing = self.object(owner)
            keys: tuple[KeyFrame, ...] = () if thing is None else getattr(thing, SHAPES[kind])
            return next((key for key in keys if str(key.frame) == frame), None)
        return self._elements[kind].get(name)

    def said(self, kind: Kind, name: str, *, whole: bool = False) -> Json | None:
        """:meth:`element` as a change tells it; an object with its key frames if ``whole``."""
        if kind == "layer":
            return header(self._header)
        element = self.element(kind, name)
        inner = KEY_FRAMES if kind == "object" and not whole else ()
        return None if element is None else to_json(element, without=inner)

    def position(self, kind: Kind, name: str) -> int:
        """Where an element stands among those of its kind."""
        if kind in SHAPES:
            owner, _, frame = name.rpartition("@")
            keys: tuple[KeyFrame, ...] = getattr(self._elements["object"][owner], SHAPES[kind])
            return [str(key.frame) for key in keys].index(frame)
        return self._order[kind].index(name)

    def ids(self, kind: Kind) -> Sequence[str]:
        """The ids of the elements of a kind, in the order of the layer."""
        return self._order[kind]

    def children(self, name: str) -> tuple[Event, ...]:
        """The sub-events of an event, by their start."""
        users = self._users.get(("event", name), {})
        found = (self._elements["event"][user] for kind, user in users if kind == "event")
        return tuple(sorted((e for e in found if e.parent == name), key=lambda e: (span(e) or (0, 0), e.id)))

    def tree(self, name: str) -> tuple[Event, ...]:
        """An event and all its sub-events, each after the one that it is a part of."""
        found: dict[str, Event] = {name: self._elements["event"][name]}
        waiting = [name]
        for parent in waiting:
            for child in self.children(parent):
                # an event that was imported as a part of itself is met once
                if child.id not in found:
                    found[child.id] = child
                    waiting.append(child.id)
        return tuple(found.values())

    def users(self, kind: Literal["object", "event"], name: str) -> tuple[tuple[Kind, str], ...]:
        """Kind and id of what names an object or an event; a decision names its result as an event."""
        return tuple(self._users.get((kind, name), ()))

    def overlapping(self, tier: str, start: int, end: int) -> Iterator[Event]:
        """The events on a tier that have a segment in ``[start, end)``."""
        if tier not in self._lanes:
            self._lanes[tier] = lane = Lane()
            for event in self._elements["event"].values():
                if event.tier == tier:
                    lane.add(event)
        names = dict.fromkeys(self._lanes[tier].overlapping(start, end))
        return (self._elements["event"][name] for name in names)

    # ------------------------------------------------------------------------------------------ changing

    def apply(self, changes: Iterable[Change]) -> None:
        """Make every change, in order."""
        for change in changes:
            if change.kind == "layer":
                kept = Layer(name=self.name, version=self._header.version)
                said = {n: readers(Layer)[n](v) for n, v in (change.after or {}).items()}
                self._header = replace(kept, **said)
            elif change.kind in SHAPES:
                self._apply_key_frame(change)
            else:
                self._apply_element(change)

    def _apply_element(self, change: Change) -> None:
        elements, order = self._elements[change.kind], self._order[change.kind]
        old = elements.get(change.id)
        new = None if change.after is None else from_json(ELEMENTS[change.kind], change.after)
        if old is not None:
            self._unindex(change.kind, change.id, old)
        if new is None:
            del elements[change.id]
            at = change.index
            del order[at if 0 <= at < len(order) and order[at] == change.id else order.index(change.id)]
            return
        if old is None:
            order.insert(change.index if change.index >= 0 else len(order), change.id)
        elif isinstance(new, AnnotatedObject):
            new = replace(new, key_frames=old.key_frames, key_frames_3d=old.key_frames_3d)
        elements[change.id] = new
        self._index(change.kind, change.id, new)

    def _apply_key_frame(self, change: Change) -> None:
        owner, _, frame = change.id.rpartition("@")
        field = SHAPES[change.kind]
        thing: AnnotatedObject = self._elements["object"][owner]
        keys: list[KeyFrame] = list(getattr(thing, field))
        at = next((i for i, key in enumerate(keys) if str(key.frame) == frame), None)
        new = None if change.after is None else from_json(KeyFrame, change.after)
        if at is not None:
            keys[at : at + 1] = [] if new is None else [new]
        elif new is not None:
            keys.insert(change.index if change.index >= 0 else len(keys), new)
        self._elements["object"][owner] = replace(thing, **{field: tuple(keys)})

    def _index(self, kind: Kind, name: str, element: Any) -> None:
        for used in _uses(element):
            self._users.setdefault(used, {})[kind, name] = None
        if kind == "event" and (lane := self._lanes.get(element.tier)) is not None:
            lane.add(element)

    def _unindex(self, kind: Kind, name: str, element: Any) -> None:
        for used in _uses(element):
            self._users.get(used, {}).pop((kind, name), None)
        if kind == "event" and (lane := self._lanes.get(element.tier)) is not None:
            lane.remove(element)


class Lane:
    """The segments of one tier's events, in order."""

    def __init__(self) -> None:
        self._spans: list[tuple[int, int, str]] = []
        self._longest = 0

    def add(self, event: Event) -> None:
        """Put the segments of an event in."""
        for segment in event.segments:
            insort(self._spans, (segment.start_frame, segment.end_frame, event.id))
            self._longest = max(self._longest, segment.end_frame - segment.start_frame)

    def remove(self, event: Event) -> None:
        """Take the segments of an event out."""
        for segment in event.segments:
            del self._spans[bisect_left(self._spans, (segment.start_frame, segment.end_frame, event.id))]

    def overlapping(self, start: int, end: int) -> Iterator[str]:
        """Ids of the events with a segment in ``[start, end)``."""
        for i in range(bisect_left(self._spans, (start - self._longest,)), len(self._spans)):
            first, last, name = self._spans[i]
            if first >= end:
                return
            if last > start:
                yield name


def span(event: Event) -> tuple[int, int] | None:
    """First frame of an event, and the first after it; ``None`` without segments."""
    if not event.segments:
        return None
    return min(s.start_frame for s in event.segments), max(s.end_frame for s in event.segments)


def _uses(element: Any) -> Iterator[tuple[str, str]]:
    """What an element names: ``object`` or ``event``, and the id."""
    if isinstance(element, Event):
        if element.parent is not None:
            yield "event", element.parent
        for role in element.roles:
            yield ("event" if role.kind == "event" else "object"), owner_of(role.target, role.kind)
        for link in element.links:
            yield "event", link.target
        for reference in element.references:
            yield "object", reference.target
    elif isinstance(element, Relation):
        for target in element.targets:
            if "/" not in target:
                yield "object", target
    elif isinstance(element, Decision) and element.result:
        yield "event", element.result


def owner_of(target: str, kind: str) -> str:
    """The id of the object or event that a role names: a joint is ``<object>/<joint>``."""
    return target.partition("/")[0] if kind == "joint" else target
