"""Event proposals: what was moved from rest to rest, by which hand, past what; docs/relations.md tells the rules."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.grasp import Grasp, Grip, find_grasp
from ecat.geometry.moves import Move, Segmentation, find_moves, goes_on, grouped
from ecat.geometry.relations import box_gap
from ecat.geometry.relations import way as path_way
from ecat.geometry.rest import box_places
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import ImagesByKind
from ecat.stages.series import Series, sets_back
from ecat.stages.stage import Stage, Tables
from ecat.stages.tie import pieces
from ecat.stages.tracks import (
    EVIDENCE,
    HandTrack,
    Timeline,
    Track,
    evidence,
    object_boxes,
    poses_of,
    read_hands,
    read_tracks,
    timeline,
)
from ecat.tables import EVENT_PROPOSALS

PREPOSITIONS = {
    "next": "next to",
    "past": "past",
    "around": "around",
    "toward": "toward",
    "away": "away from",
}


@dataclass(frozen=True)
class ProposeParameters:
    """``regrasp_s``, ``regrasp_turn_rad``: a box that is let go and taken again within that time, moved on in about
    that direction by the same (known) hand while nothing else moves, is one action.  ``lifted``: above this share of
    frames off the table an action is a ``move``, otherwise a ``slide``.  ``beside_m`` and ``change_m`` as in
    :func:`ecat.geometry.relations.way`.  ``hands``: joints that may hold a box.  ``series``: when what is between
    demonstrations of one kind is called ``set``.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    moves: Segmentation = field(default_factory=Segmentation)
    grip: Grip = field(default_factory=Grip)
    hands: tuple[str, ...] = ("HandLeft", "HandRight")
    regrasp_s: float = 3.5
    regrasp_turn_rad: float = math.radians(30)
    lifted: float = 0.3
    beside_m: float = 0.04
    change_m: float = 0.05
    series: Series = field(default_factory=Series)


@dataclass(frozen=True)
class _Carry:
    """One movement of a box, rows ``start`` to ``end`` (excluded) of the session, and how it was held, if known."""

    track: Track
    move: Move
    start: int
    end: int
    hand: str | None
    grasp: Grasp | None

    @property
    def whole(self) -> tuple[int, int]:
        """From the first touch to the last."""
        return (self.grasp.grasp, self.grasp.end) if self.grasp else (self.start, self.end)

    @property
    def seen(self) -> float:
        """Share of the frames on the way in which the box was seen."""
        return float(self.track.observed[self.start : self.end].mean())


_Action: TypeAlias = tuple[_Carry, ...]


@dataclass(frozen=True)
class _Way:
    """How an action went (a key of ``PREPOSITIONS`` or ``""``) with regard to a landmark, if there is one."""

    kind: str
    landmark: Track | None


@dataclass(frozen=True)
class _Scene:
    """What the rules look at: all boxes, all that was carried, the time."""

    tracks: Sequence[Track]
    carries: Sequence[_Carry]
    line: Timeline
    parameters: ProposeParameters

    def busy(self, start: int, end: int) -> set[str]:
        """The objects that move somewhere between two rows."""
        return {c.track.object_id for c in self.carries if c.start < end and c.end > start}


def propose_events(
    clock: pa.Table,
    poses: pa.Table,
    table_plane: pa.Table,
    *,
    joints: pa.Table | None = None,
    markers_2d: pa.Table | None = None,
    markers_3d: pa.Table | None = None,
    parameters: ProposeParameters | None = None,
) -> pa.Table:
    """The table ``event_proposals``: actions and their parts.

    ``poses`` should not be smoothed: rests are found in spite of noise, and sharper without.  ``markers_*`` tell which
    prototype an object is; hands are looked at where ``joints`` has them.  No action goes on across a move of the
    camera after which nothing ties the table's frames.
    """
    parameters = parameters or ProposeParameters()
    boxes = object_boxes((markers_2d, markers_3d), parameters.prototypes, mirrored=parameters.camera.mirrored)
    found: list[tuple[_Action, _Way, Timeline]] = []
    for part, placed in zip(pieces(clock, table_plane), pieces(poses, table_plane), strict=True):
        if not part.num_rows:
            continue
        line = timeline(part)
        tracks = read_tracks(placed, boxes, line)
        hands = read_hands(joints, table_plane, line, parameters.hands)
        carries = [carry for track in tracks for carry in _carries(track, hands, line, parameters)]
        scene = _Scene(tracks, carries, line, parameters)
        actions = sorted(
            grouped(carries, _regrasped(scene)),
            key=lambda action: (action[0].whole[0], action[0].track.object_id),
        )
        found += [(action, _way(action, scene), line) for action in actions]
    back = sets_back([way.kind for _, way, _ in found], parameters.series)
    ids = (f"a{number}" for number in count(1))
    rows = [
        row
        for (action, way, line), only_set in zip(found, back, strict=True)
        for row in _rows(action, "set" if only_set else _verb(action, parameters), way, line, ids)
    ]
    rows.sort(key=lambda row: (row["start_frame"], row["event_id"]))
    return pa.Table.from_pylist(rows, schema=EVENT_PROPOSALS.arrow)


def _carries(
    track: Track, hands: Sequence[HandTrack], line: Timeline, parameters: ProposeParameters
) -> Iterator[_Carry]:
    seen = np.flatnonzero(track.observed)
    places = box_places(_at(track, seen), track.size_m)
    moves = find_moves(line.t_s[seen], places, track.sigma_m[seen], track.free[seen], parameters.moves)
    spans = [line.rows(move) for move in moves]
    for number, (move, (start, end)) in enumerate(zip(moves, spans, strict=True)):
        bounds = (
            spans[number - 1][1] if number else 0,
            spans[number + 1][0] if number + 1 < len(spans) else len(line.frame),
        )
        hand, grasp = _held(track, hands, (start, end), bounds, parameters.grip)
        yield _Carry(track, move, start, end, hand, grasp)


def _held(
    track: Track, hands: Sequence[HandTrack], move: tuple[int, int], bounds: tuple[int, int], grip: Grip
) -> tuple[str | None, Grasp | None]:
    """The hand that stays the most fixed to the box, and its grasp."""
    best, name = None, None
    for hand in hands:
        found = find_grasp(
            track.pose, track.size_m, hand.place, hand.sigma_m, move=move, bounds=bounds, grip=grip
        )
        if found and (best is None or found.spread_m < best.spread_m):
            best, name = found, hand.target
    return name, best


def _regrasped(scene: _Scene) -> Callable[[_Carry, _Carry], bool]:
    """The rule by which one carry goes on with the one before it."""
    line, parameters = scene.line, scene.parameters

    def together(first: _Carry, second: _Carry) -> bool:
        return (
            first.track is second.track
            and line.t_s[second.start] - line.t_s[first.end] <= parameters.regrasp_s
            and first.hand is not None
            and first.hand == second.hand
            and goes_on(first.move, second.move, parameters.moves, parameters.regrasp_turn_rad)
            and not scene.busy(first.end, second.start) - {first.track.object_id}
        )

    return together


def _verb(action: _Action, parameters: ProposeParameters) -> str:
    frames = [carry.end - carry.start for carry in action]
    lifted = np.average([carry.move.lifted for carry in action], weights=frames)
    return "move" if lifted > parameters.lifted else "slide"


def _rows(
    action: _Action, verb: str, way: _Way, line: Timeline, ids: Iterator[str]
) -> Iterator[dict[str, Any]]:
    """The action's row and those of its parts."""
    track, hand, landmark = action[0].track, action[0].hand, way.landmark
    seen = np.average([carry.seen for carry in action], weights=[carry.end - carry.start for carry in action])
    common = {
        "object_id": track.object_id,
        "hand": hand,
        "landmark": landmark.object_id if landmark else None,
        "confidence": float(1 + seen) / 2,
    }
    text = f"{verb.capitalize()} {track.box.name}"
    if landmark and way.kind:
        text += f" {PREPOSITIONS[way.kind]} {landmark.box.name}"
    name, span = next(ids), line.interval(action[0].whole[0], action[-1].whole[1])
    event_type = f"{verb}_{way.kind}" if way.kind else verb
    yield common | span | {"event_id": name, "parent": None, "type": event_type, "text": text}
    for carry in action:
        for part, start, end in _parts(carry):
            row = common | {"event_id": next(ids), "parent": name, "type": part, "text": ""}
            yield row | line.interval(start, end)


def _parts(carry: _Carry) -> Iterator[tuple[str, int, int]]:
    """Grasp, hold and release follow one another; the movement lies within the hold."""
    if (held := carry.grasp) is not None:
        spans = (
            ("grasp", held.grasp, held.hold),
            ("hold", held.hold, held.release),
            ("release", held.release, held.end),
        )
        yield from (span for span in spans if span[1] < span[2])
    yield "move", carry.start, carry.end


def _landmark(action: _Action, scene: _Scene) -> Track | None:
    """The box nearest to the way among those that stand when the action ends."""
    end = action[-1].end
    busy = scene.busy(end - 1, end + 1)
    path = _path(action)
    best, least = None, math.inf
    for track in scene.tracks:
        if track.object_id in busy or not track.observed.any():
            continue
        place = _standing(track, end).translation[0, :2]
        distance = float(np.linalg.norm(path - place, axis=1).min())
        if distance < least:
            best, least = track, distance
    return best


def _path(action: _Action) -> Floats:
    """Places (n, 2) on the table."""
    return np.concatenate([carry.move.path[:, :2] for carry in action])


def _at(track: Track, rows: NDArray[np.intp]) -> Rigid:
    return Rigid(track.pose.rotation[rows], track.pose.translation[rows])


def _standing(track: Track, row: int) -> Rigid:
    """The pose (1) of a box at the last row up to ``row``, or else the first after it, at which it was seen."""
    seen = np.flatnonzero(track.observed)
    return _at(track, seen[[max(int(np.searchsorted(seen, row, side="right")) - 1, 0)]])


def _way(action: _Action, scene: _Scene) -> _Way:
    landmark = _landmark(action, scene)
    if landmark is None:
        return _Way("", None)
    track, end, parameters = action[0].track, action[-1].end, scene.parameters
    here, there = _standing(track, end), _standing(landmark, end)
    gap_m = float(box_gap(here, there, track.size_m, landmark.size_m)[0])
    place = there.translation[0, :2]
    kind = path_way(_path(action), place, gap_m, beside_m=parameters.beside_m, change_m=parameters.change_m)
    return _Way(kind, landmark)


def _run(tables: Tables, images: ImagesByKind, parameters: ProposeParameters) -> dict[str, pa.Table]:
    del images
    found = propose_events(
        tables["clock"],
        poses_of(tables["poses"]),
        tables["table_plane"],
        **evidence(tables),
        parameters=parameters,
    )
    return {"event_proposals": found}


PROPOSE = Stage(
    name="propose",
    version=4,
    inputs=("clock", "poses", "table_plane", *EVIDENCE),
    outputs=("event_proposals",),
    parameters=ProposeParameters,
    run=_run,
    partly=("poses", *EVIDENCE),
    optional=EVIDENCE,
)
"""The stage that proposes events."""
