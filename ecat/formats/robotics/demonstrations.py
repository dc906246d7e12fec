"""Demonstrations as VoxSim's teaching scene loads them: JSON of slides of one block against another, by kind of action.

``{action: [{"action_storage": [[x, y], ...], "start_config": [[x, y], [x, y]]}, ...]}``: where the block that moves and
the one that stands are at first, and the places that the first is moved to, one after the other; metres on the table.

Carried: of every event with two known blocks, both starts and the way of the mover, reduced to the corners of a line
that stays within ``tolerance_m`` of it.  Left behind: time, height, rotation, whatever the other block does, all else.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.episodes import chosen_layer
from ecat.formats.format import Format, Part
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import Things, table_fits, table_outlines, things_of
from ecat.geometry.transforms import Floats
from ecat.model.annotation import MACHINE, Event
from ecat.progress import Progress
from ecat.store import Session, files, write_new_file

Demonstration: TypeAlias = dict[str, list[list[float]]]
Demonstrations: TypeAlias = dict[str, list[Demonstration]]
ACTIONS = {
    "Away": ("away",),
    "Closer": ("toward", "towards", "closer"),
    "Past": ("past",),
    "Around": ("around",),
    "Next": ("next",),
}
"""The scene's names of actions, in the order of its file, and the words by which a type or a text says them."""


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Where the blocks ``ids`` are found: in a table of poses, as seen from ``origin`` (2,)."""

    session: Session
    table: str
    ids: tuple[str, ...]
    things: Things
    origin: Floats

    def places(self, start: int, end: int) -> Floats:
        """Of frames from ``start`` to before ``end``, (f, k, 2) metres on the table; NaN where unknown."""
        found = tracks.poses(self.session, self.table, self.ids, within=(start, end))
        none = np.zeros((0, len(self.ids), 2))
        return np.concatenate([none, *(stretch.centre[..., :2] - self.origin for stretch in found)])


@dataclass(frozen=True, slots=True, kw_only=True)
class DemonstrationOptions:
    """Which events, and how their ways are reduced."""

    layer: str = option("", "the layer of the events; nothing: gold, else main, else another")
    tolerance_m: float = option(
        0.03, "how far the line may be from the way of the block, metres", least=0.001
    )
    centre: Literal["table", "none"] = option(
        "table", "the origin: the middle of the table's outline, or that of the frame of reference table"
    )


def part(
    session: Session, label: str, dest: Path, options: DemonstrationOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the demonstrations of a session.

    Raises
    ------
    NotFoundError : there are no poses, or no event with two blocks whose places are known.
    """
    what = f"cannot write the demonstrations of {label}"
    table, layer = tracks.best_poses(session), chosen_layer(session, options.layer)
    if table is None:
        raise NotFoundError(
            what,
            where=f"{session.name}: there are no poses",
            consequence="this session was not written",
            fix=f"ecat process {session.path}",
        )
    origin = _centre(session) if options.centre == "table" else np.zeros(2)
    blocks = _Blocks(session, table, tracks.box_ids(session, table), things_of(session), origin)
    found: Demonstrations = {}
    findings: list[str] = []
    n = 0
    events = [e for e in layer.events if e.parent is None and _counts(e, layer.name)]
    for done, event in enumerate(events):
        progress(f"writing {label}", done, len(events))
        made = _demonstration(event, blocks, options.tolerance_m)
        if isinstance(made, str):
            findings.append(f"event {event.id} was left behind: {made}")
            continue
        action = action_of(event)
        found.setdefault(action, []).append(made)
        n += 1
        if action not in ACTIONS:
            findings.append(
                f"event {event.id}: the scene has no action {action!r}; it was written all the same"
            )
    if not n:
        raise NotFoundError(
            what,
            where=f"{session.name}, layer {layer.name}: none of {len(events)} events has two blocks of known places",
            consequence="this session was not written",
            fix="annotate events with a Theme and a Landmark, or name another layer (layer=machine)",
        )
    write_new_file(dest, [dump(found)])
    findings.append(
        f"{n} demonstrations of layer {layer.name}, origin at {origin[0]:.3f}, {origin[1]:.3f} m of the table; times, "
        "heights, rotations and sub-events have no place in the format"
    )
    return tuple(findings)


def dump(found: Demonstrations) -> bytes:
    """The file's text: actions in the scene's order, then others by name."""
    return json.dumps({action: found[action] for action in _ordered(found)}, indent=0).encode()


def _ordered(actions: Sequence[str] | Demonstrations) -> list[str]:
    known = list(ACTIONS)
    return sorted(
        actions, key=lambda action: (known.index(action) if action in known else len(known), action)
    )


def action_of(event: Event) -> str:
    """What the scene calls it: by the last word of its type, else by its text, else its type as it is."""
    words = event.type.lower().replace("-", "_").split("_")[-1:] or [""]
    for said in (words, event.text.lower().split()):
        for action, names in ACTIONS.items():
            if set(said) & set(names):
                return action
    return event.type or "other"


def _counts(event: Event, layer: str) -> bool:
    return bool(event.segments) and (event.status == "confirmed" or layer == MACHINE)


def _centre(session: Session) -> Floats:
    """The middle (2,) of the table's first outline; where there is none, the origin of ``table``."""
    fits = table_fits(session)
    rings = table_outlines(session, fits) if fits is not None else []
    if not rings:
        return np.zeros(2)
    ring = rings[0][1][:, :2]
    return (ring.min(0) + ring.max(0)) / 2


def _demonstration(event: Event, blocks: _Blocks, tolerance_m: float) -> Demonstration | str:
    """The event as a demonstration, or why it is none."""
    start, end = max(event.segments[0].start_frame, 0), event.segments[-1].end_frame
    places = blocks.places(start, max(end, start + 1))
    pair = blocks_of(event, blocks.ids, blocks.things, places)
    if pair is None:
        return "it does not say which of the blocks moves, and past which"
    mover, other = (places[:, blocks.ids.index(key)] for key in pair)
    mover, other = mover[np.isfinite(mover[:, 0])], other[np.isfinite(other[:, 0])]
    if len(mover) < 2 or not len(other):
        return "a block was not seen in it"
    way = corners(mover, tolerance_m)
    return {"action_storage": way[1:].tolist(), "start_config": [way[0].tolist(), other[0].tolist()]}


def blocks_of(event: Event, ids: Sequence[str], things: Things, places: Floats) -> tuple[str, str] | None:
    """The block that moves and the one that stands: by roles, else by the text, else by which of two moved more.

    ``places`` (f, k, 2) are those of the blocks ``ids`` in the event.
    """
    roles = {role.name.lower(): role.target for role in event.roles}
    said = [roles.get("theme"), roles.get("landmark")]
    text = event.text.lower()
    at = {key: text.find(things[key].name.lower()) for key in ids}
    named = sorted((key for key in ids if at[key] >= 0), key=lambda key: at[key])
    for pair in (said, named):
        if len(pair) == 2 and set(pair) <= set(ids) and pair[0] != pair[1]:
            return str(pair[0]), str(pair[1])
    if len(ids) != 2:
        return None
    moved = [_length(places[:, k]) for k in range(2)]
    return (ids[0], ids[1]) if moved[0] >= moved[1] else (ids[1], ids[0])


def _length(way: Floats) -> float:
    there = way[np.isfinite(way[:, 0])]
    return float(np.linalg.norm(there[-1] - there[0])) if len(there) else 0.0


def corners(way: Floats, tolerance: float) -> Floats:
    """The fewest of the points (n, 2) whose line stays within ``tolerance`` of all (Douglas and Peucker, 1973).

    First and last are always among them.
    """
    kept: NDArray[np.bool_] = np.zeros(len(way), np.bool_)
    kept[[0, -1]] = True
    waiting = [(0, len(way) - 1)]
    while waiting:
        a, b = waiting.pop()
        if b - a < 2:
            continue
        along = way[b] - way[a]
        t = np.clip((way[a + 1 : b] - way[a]) @ along / max(along @ along, 1e-18), 0.0, 1.0)
        off = np.linalg.norm(way[a + 1 : b] - (way[a] + t[:, None] * along), axis=1)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            kept[a + 1 + worst] = True
            waiting += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return way[kept]


def merge(parts: Sequence[Part], dest: Path, options: Any, progress: Progress) -> tuple[str, ...]:
    """One file of all sessions: actions in the scene's order, demonstrations in the order of the parts."""
    del options
    actions = _ordered(list({action for part in parts for action in _read(part)}))

    def pieces() -> Iterator[bytes]:
        for k, action in enumerate(actions):
            progress("joining demonstrations", k, len(actions))
            yield (b"," if k else b"{") + f"\n{json.dumps(action)}: [".encode()
            separator = b"\n"
            for part in parts:
                for demonstration in _read(part).get(action, []):
                    yield separator + json.dumps(demonstration, indent=0).encode()
                    separator = b",\n"
            yield b"\n]"
        yield b"\n}"

    write_new_file(dest, pieces())
    return ()


def _read(part: Part) -> Demonstrations:
    return json.loads(files.read_bytes(part.path, 1 << 30))


FORMAT = Format(
    name="voxsim-demonstrations",
    description="the JSON of demonstrations that VoxSim's teaching scene loads, one file for all sessions",
    part=part,
    merge=merge,
    suffix=".json",
    options=DemonstrationOptions,
)
