"""What holds when, as lanes of a state timeline: events and sub-events, relations, how the boxes are known.

A lane shows one state at a time, so what overlaps is spread over several; sub-events lie below their events.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import pyarrow as pa

from ecat.view.scene import (
    FREE,
    PALETTE,
    UNOBSERVED,
    Scene,
    by_object,
    entity_part,
    finite,
    integers,
    numbers,
    pale,
    rgba,
    static,
    temporal,
    texts,
)
from ecat.view.space import pose_state

if TYPE_CHECKING:
    from rerun.chunk import Chunk

Span: TypeAlias = tuple[int, int]
"""Frames ``[start, end)``."""
T = TypeVar("T", bound=Hashable)
_HOLDS = (88, 170, 110)
_DENIED = (70, 76, 84)
PROPOSED = "/proposed"
_MOST_SHARED = 4
"""Lanes of proposals for one predicate; with many objects nearly all are left of one another."""


def assign_lanes(spans: Sequence[Span], depths: Sequence[int]) -> list[int]:
    """A lane for each span, from 0: no two in a lane overlap, and deeper spans lie in later lanes.

    Each takes the first lane of its depth that is free, in the order of their starts (interval partitioning:
    as few lanes as possible per depth).
    """
    lanes = [0] * len(spans)
    first = 0
    for depth in sorted(set(depths)):
        mine = sorted((spans[i], i) for i in range(len(spans)) if depths[i] == depth)
        busy: list[tuple[int, int]] = []
        free: list[int] = []
        used = 0
        for (start, end), i in mine:
            while busy and busy[0][0] <= start:
                heapq.heappush(free, heapq.heappop(busy)[1])
            if free:
                lane = heapq.heappop(free)
            else:
                lane, used = used, used + 1
            heapq.heappush(busy, (end, lane))
            lanes[i] = first + lane
        first += used
    return lanes


def nesting(parts: Iterable[tuple[T, T]]) -> dict[T, int]:
    """How deep each event lies below what it is part of, from pairs (whole, part); circles count as flat."""
    below: dict[T, list[T]] = defaultdict(list)
    waiting: dict[T, int] = defaultdict(int)
    for whole, part in set(parts):
        below[whole].append(part)
        waiting[part] += 1
    depth: dict[T, int] = dict.fromkeys([*below, *waiting], 0)
    ready = [event for event in below if not waiting[event]]
    while ready:
        event = ready.pop()
        for part in below[event]:
            depth[part] = max(depth[part], depth[event] + 1)
            waiting[part] -= 1
            if not waiting[part]:
                ready.append(part)
    return depth


def changes(spans: Iterable[tuple[int, int, str]]) -> list[tuple[int, str]]:
    """Frames at which a lane's state changes, and to what; '' where nothing is on.

    ``spans`` are (start, end, state).  Of two that overlap the later one wins from its start; equal states
    that touch or overlap become one.
    """
    found: list[tuple[int, str]] = []
    ordered = sorted(spans)
    reach = 0
    for (start, end, state), following in zip_longest(ordered, ordered[1:]):
        same = bool(found) and found[-1][1] == state and start <= reach
        reach = max(reach, end) if same else end
        if not same:
            found.append((start, state))
        if following is None or following[0] > reach:
            found.append((reach, ""))
    return [(frame, state) for frame, state in dict(found).items()]


def lane(
    path: str, changed: list[tuple[int, str]], styles: Mapping[str, tuple[str, int]], scene: Scene
) -> Iterator[Chunk]:
    """One lane: its changes of state, and the label and colour of each state."""
    import rerun as rr

    style = rr.StateConfiguration(
        values=list(styles),
        labels=[label for label, _ in styles.values()],
        colors=np.array([color for _, color in styles.values()], np.uint32),
    )
    yield static(path, style)
    frames = np.array([frame for frame, _ in changed], np.int64)
    yield temporal(
        path, scene.timebase, frames, rr.StateChange.columns(state=[state for _, state in changed])
    )


def spans(table: pa.Table, n_frames: int) -> list[Span]:
    """The rows' frames ``[start, end)``, at least one image each; an open end is the recording's."""
    starts: list[int] = integers(table, "start_frame").tolist()
    ends: list[int | None] = table.column("end_frame").to_pylist()
    return [(s, max(s + 1, n_frames if e is None else e)) for s, e in zip(starts, ends, strict=True)]


def event_label(row: Mapping[str, Any]) -> str:
    """:func:`event_name`, marked where it is proposed."""
    return ("proposed: " if is_proposed(row) else "") + event_name(row)


def event_name(row: Mapping[str, Any]) -> str:
    """What an event is called: its text, its type, or its id; marked where unsure."""
    label: str = row["text"].strip() or row["type"] or row["event_id"]
    return label + (" ?" if row["unsure"] else "")


def event_kind(row: Mapping[str, Any]) -> str:
    """What an event is an example of: its type, or what it is called where it has none."""
    return row["type"] or row["text"].strip() or row["event_id"]


def _lane_label(row: Mapping[str, Any]) -> str:
    """A person's words for what they confirmed; of proposals, whose sentences all begin alike, the type."""
    if not is_proposed(row):
        return event_name(row)
    return event_kind(row) + (" ?" if row["unsure"] else "")


def is_proposed(row: Mapping[str, Any]) -> bool:
    """Whether nobody has confirmed the event or relation yet."""
    return row["status"] == "proposed"


def _tops(rows: Iterable[Mapping[str, Any]], root: str) -> Callable[[Mapping[str, Any]], str]:
    """Below which entity a row's lanes lie: proposals apart and by author, and layers where there are several."""
    layers = {(row["layer"], is_proposed(row)) for row in rows}
    several = {state: sum(other == state for _, other in layers) > 1 for state in (True, False)}

    def top(row: Mapping[str, Any]) -> str:
        proposed = is_proposed(row)
        parts = [row["layer"]] if several[proposed] else []
        # relations have no author in their table
        if proposed and row.get("author"):
            parts.append(row["author"])
        return "/".join([f"{PROPOSED if proposed else ''}{root}", *map(entity_part, parts)])

    return top


@dataclass(frozen=True)
class _Event:
    id: str
    label: str
    kind: str
    whole: Span
    stretches: tuple[Span, ...]
    depth: int
    proposed: bool


def _tiers(tables: Mapping[str, pa.Table], n_frames: int) -> Iterator[tuple[str, list[_Event]]]:
    """The events of each layer and tier, with the entity path of the tier."""
    rows = tables["events"].to_pylist()
    stretches: dict[tuple[str, str], list[Span]] = defaultdict(list)
    segments = tables["event_segments"]
    for row, span in zip(segments.to_pylist(), spans(segments, n_frames), strict=True):
        stretches[row["layer"], row["event_id"]].append(span)
    depth = nesting(
        ((row["layer"], row["event_id"]), (row["layer"], row["target"]))
        for row in tables["event_links"].to_pylist()
        if row["type"].upper() == "SUBEVENT"
    )
    top = _tops(rows, "/events")
    tiers: dict[str, list[_Event]] = defaultdict(list)
    for row, whole in zip(rows, spans(tables["events"], n_frames), strict=True):
        key = (row["layer"], row["event_id"])
        parts = tuple(stretches[key] or [whole])
        nested = depth.get(key, 0)
        event = _Event(key[1], _lane_label(row), event_kind(row), whole, parts, nested, is_proposed(row))
        tiers[f"{top(row)}/{entity_part(row['tier'] or 'event')}"].append(event)
    yield from tiers.items()


def events(tables: Mapping[str, pa.Table], scene: Scene) -> Iterator[Chunk]:
    """Tables ``events``, ``event_segments`` and ``event_links`` as lanes ``/events/<tier>/<lane>``.

    With several layers, each has its own lanes below ``/events/<layer>``; proposals lie below
    ``/proposed/events/<author>``.  Equal types have equal colours, proposals the paler ones.
    """
    kinds = dict.fromkeys(event_kind(row) for row in tables["events"].to_pylist())
    colors = {kind: PALETTE[i % len(PALETTE)] for i, kind in enumerate(kinds)}
    for path, mine in _tiers(tables, scene.timebase.n_frames):
        lanes = assign_lanes([event.whole for event in mine], [event.depth for event in mine])
        for number in sorted(set(lanes)):
            shown = [event for event, at in zip(mine, lanes, strict=True) if at == number]
            changed = changes((start, end, event.id) for event in shown for start, end in event.stretches)
            styles = {
                event.id: (
                    event.label,
                    rgba(pale(colors[event.kind]) if event.proposed else colors[event.kind]),
                )
                for event in shown
            }
            yield from lane(f"{path}/{number}", changed, styles, scene)


def event_log(events_table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Every event as a line of text at its start; of proposals, who proposed them too."""
    import rerun as rr

    ordered = events_table.sort_by("start_frame")
    lines = [
        f"{event_label(row)}  [{start}, {end})" + (f"  {row['author']}" if is_proposed(row) else "")
        for row, (start, end) in zip(
            ordered.to_pylist(), spans(ordered, scene.timebase.n_frames), strict=True
        )
    ]
    if lines:
        frames = integers(ordered, "start_frame")
        yield temporal("/log/events", scene.timebase, frames, rr.TextLog.columns(text=lines))


def relations(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Table ``relations`` as a lane for each fact, ``/relations/<predicate>/<argument>/...``.

    Proposals are many: they share lanes, ``/proposed/relations/<predicate>/<lane>``, with their arguments in words.
    """
    rows = table.to_pylist()
    whole = spans(table, scene.timebase.n_frames)
    top = _tops(rows, "/relations")
    facts: dict[str, list[tuple[int, int, str]]] = defaultdict(list)
    proposals: dict[str, list[tuple[Span, str]]] = defaultdict(list)
    for row, span in zip(rows, whole, strict=True):
        path = f"{top(row)}/{entity_part(row['predicate'])}"
        things = [scene.thing(target) for target in row["arguments"]]
        if is_proposed(row):
            words = ", ".join(thing.name for thing in things) or row["predicate"]
            proposals[path].append((span, words if row["polarity"] else f"not: {words}"))
        else:
            state = "holds" if row["polarity"] else "denied"
            facts["/".join([path, *(thing.part for thing in things)])].append((*span, state))
    styles = {"holds": ("holds", rgba(_HOLDS)), "denied": ("denied", rgba(_DENIED))}
    for path, marked in sorted(facts.items()):
        yield from lane(path, changes(marked), styles, scene)
    for path, offered in sorted(proposals.items()):
        yield from _shared(path, offered, scene)


def _shared(path: str, offered: Sequence[tuple[Span, str]], scene: Scene) -> Iterator[Chunk]:
    """Proposals of one predicate in as few lanes as they need, at most ``_MOST_SHARED``; equal words, equal shades."""
    lanes = assign_lanes([span for span, _ in offered], [0] * len(offered))
    words = dict.fromkeys(text for _, text in offered)
    shades = {text: (text, rgba(pale(PALETTE[i % len(PALETTE)]))) for i, text in enumerate(words)}
    for number in range(min(max(lanes) + 1, _MOST_SHARED)):
        mine = [(*span, text) for (span, text), at in zip(offered, lanes, strict=True) if at == number]
        styles = {text: shades[text] for *_, text in mine}
        yield from lane(f"{path}/{number}", changes(mine), styles, scene)


def supports(poses: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """How each box of table ``poses`` is known, as ``/support/<name>``; nothing where it is not."""
    for object_id, rows in by_object(poses):
        thing = scene.thing(object_id)
        known = finite(numbers(rows, "x y z qx qy qz qw"))
        states = pose_state(texts(rows, "source"), texts(rows, "support"), known)
        frames = integers(rows, "frame")
        # a missing row is not known either
        ends = np.append(frames[1:], scene.timebase.n_frames)
        marked = [
            (int(start), int(min(start + 1, end)), str(state))
            for start, end, state in zip(frames, ends, states, strict=True)
            if state
        ]
        styles = {
            "table": ("on the table", rgba(thing.color)),
            "free": ("free", rgba(FREE)),
            "interpolated": ("interpolated", rgba(UNOBSERVED)),
        }
        yield from lane(f"/support/{thing.part}", changes(marked), styles, scene)
