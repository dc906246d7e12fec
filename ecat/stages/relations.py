"""Spatial relations between boxes, table and hands, as intervals; docs/relations.md defines each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations
from typing import Any

import numpy as np
import pyarrow as pa

from ecat.geometry import relations as measure
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.moves import Segmentation, find_moves
from ecat.geometry.relations import Held, Threshold, held
from ecat.geometry.rest import box_places
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import ImagesByKind
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
from ecat.tables import RELATION_PROPOSALS

HANDS = {"HandLeft": "IN_LEFT_HAND", "HandRight": "IN_RIGHT_HAND"}
"""Joints that hold, each with the predicate that says so of a box and a rig."""
_AXES = {
    "LEFT_OF": (-1.0, 0.0),
    "RIGHT_OF": (1.0, 0.0),
    "IN_FRONT_OF": (0.0, -1.0),
    "BEHIND": (0.0, 1.0),
}
_AT_ONCE = 8192
_CENTRE_SHARE = 0.25
"""Two middles nearer than this share of the boxes' edges, seen from above, are in no direction from each other."""


@dataclass(frozen=True)
class RelationParameters:
    """Thresholds in metres, radians (``beside``) and metres per second (``together``).

    ``prototypes`` : the boxes.  ``surface`` : the object that is the table; without one nothing is ON it.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    surface: str = ""
    on: Threshold = field(default_factory=lambda: Threshold(0.006, 0.012))
    above: Threshold = field(default_factory=lambda: Threshold(0.006, 0.012))
    touching: Threshold = field(default_factory=lambda: Threshold(0.006, 0.01))
    near: Threshold = field(default_factory=lambda: Threshold(0.1, 0.12))
    in_hand: Threshold = field(default_factory=lambda: Threshold(0.05, 0.07))
    beside: Threshold = field(default_factory=lambda: Threshold(math.radians(42), math.radians(48)))
    together: Threshold = field(default_factory=lambda: Threshold(0.05, 0.1))
    moves: Segmentation = field(default_factory=Segmentation)


@dataclass(frozen=True)
class _Fact:
    predicate: str
    arguments: tuple[str, ...]
    held: Held


def propose_relations(
    clock: pa.Table,
    poses: pa.Table,
    table_plane: pa.Table,
    *,
    joints: pa.Table | None = None,
    markers_2d: pa.Table | None = None,
    markers_3d: pa.Table | None = None,
    parameters: RelationParameters | None = None,
) -> pa.Table:
    """The table ``relation_proposals``.

    ``poses`` may be smoothed or not; ``markers_*`` tell which prototype an object is; hands are looked at where
    ``joints`` has them.  Of a relation and its converse (LEFT_OF and RIGHT_OF, ...) one is written, with the object
    of the smaller id first; ON and ABOVE are written both ways.  All end where the camera was moved and nothing ties
    the table's frames.
    """
    parameters = parameters or RelationParameters()
    boxes = object_boxes((markers_2d, markers_3d), parameters.prototypes, mirrored=parameters.camera.mirrored)
    rows: list[dict[str, Any]] = []
    for part, placed in zip(pieces(clock, table_plane), pieces(poses, table_plane), strict=True):
        if not part.num_rows:
            continue
        line = timeline(part)
        tracks = read_tracks(placed, boxes, line)
        hands = read_hands(joints, table_plane, line, tuple(HANDS))
        rows += _rows(_facts(tracks, hands, line, parameters), line)
    rows.sort(key=lambda row: (row["start_frame"], row["predicate"], row["arguments"]))
    return pa.Table.from_pylist(rows, schema=RELATION_PROPOSALS.arrow)


def _facts(
    tracks: Sequence[Track], hands: Sequence[HandTrack], line: Timeline, parameters: RelationParameters
) -> list[_Fact]:
    facts = [fact for track in tracks for fact in _of_one(track, hands, line, parameters)]
    for a, b in combinations(tracks, 2):
        facts += _of_two(a, b, line, parameters)
    moving = {fact.arguments[0]: [] for fact in facts if fact.predicate == "MOVING"}
    for fact in facts:
        if fact.predicate == "MOVING":
            moving[fact.arguments[0]].append(fact.held)
    for a, b in combinations(tracks, 2):
        facts += _together(a, b, moving, line, parameters)
    return facts


def _rows(facts: Sequence[_Fact], line: Timeline) -> list[dict[str, Any]]:
    return [
        {
            "predicate": fact.predicate,
            "arguments": list(fact.arguments),
            "polarity": True,
            "confidence": fact.held.confidence,
        }
        | line.interval(fact.held.start, fact.held.end)
        for fact in facts
    ]


def _of_one(
    track: Track, hands: Sequence[HandTrack], line: Timeline, parameters: RelationParameters
) -> Iterator[_Fact]:
    """MOVING, ON the table, in a hand."""
    yield from (_Fact("MOVING", (track.object_id,), span) for span in _moving(track, line, parameters.moves))
    if parameters.surface:
        height = np.abs(measure.extent_z(track.pose, track.size_m)[0])
        for span in held(line.t_s, height, track.sigma_m, parameters.on):
            yield _Fact("ON", (track.object_id, parameters.surface), span)
    for hand in hands:
        gap = measure.point_gap(hand.place, track.pose, track.size_m)
        sigma = np.hypot(track.sigma_m, hand.sigma_m)
        for span in held(line.t_s, gap, sigma, parameters.in_hand):
            yield _Fact(HANDS[hand.joint], (track.object_id, hand.rig), span)


def _moving(track: Track, line: Timeline, rules: Segmentation) -> Iterator[Held]:
    """Between the rests; sure where it was seen on its way."""
    rows = np.flatnonzero(track.observed)
    places = box_places(track.pose, track.size_m)[rows]
    for move in find_moves(line.t_s[rows], places, track.sigma_m[rows], track.free[rows], rules):
        start, end = line.rows(move)
        if end > start:
            seen = float(track.observed[start:end].mean())
            yield Held(start, end, (1 + seen) / 2)


def _of_two(a: Track, b: Track, line: Timeline, parameters: RelationParameters) -> Iterator[_Fact]:
    pair = (a.object_id, b.object_id)
    sigma = np.hypot(a.sigma_m, b.sigma_m)
    known = np.isfinite(sigma)
    gap = np.full(len(sigma), np.nan)
    rows = np.flatnonzero(known)
    for some in np.split(rows, range(_AT_ONCE, len(rows), _AT_ONCE)):
        gap[some] = measure.box_gap(_at(a, some), _at(b, some), a.size_m, b.size_m)
    for predicate, threshold in (("TOUCHING", parameters.touching), ("NEAR", parameters.near)):
        yield from (_Fact(predicate, pair, span) for span in held(line.t_s, gap, sigma, threshold))
    apart = np.linalg.norm((a.pose.translation - b.pose.translation)[:, :2], axis=1)
    nowhere = apart < _CENTRE_SHARE * (a.size_m[:2].mean() + b.size_m[:2].mean())
    for predicate, axis in _AXES.items():
        off = measure.bearing_off(a.pose.translation, b.pose.translation, axis)
        off = np.where(nowhere, np.inf, off)
        for span in held(line.t_s, off, sigma / np.maximum(apart, 1e-9), parameters.beside):
            yield _Fact(predicate, pair, span)
    for upper, lower in permutations((a, b)):
        yield from _over(upper, lower, line, sigma, parameters)


def _over(
    upper: Track, lower: Track, line: Timeline, sigma: Floats, parameters: RelationParameters
) -> Iterator[_Fact]:
    height = measure.height_over(upper.pose, lower.pose, upper.size_m, lower.size_m)
    beside = measure.overhang(upper.pose, lower.pose, lower.size_m)
    pair = (upper.object_id, lower.object_id)
    for predicate, distance, threshold in (
        ("ON", np.abs(height), parameters.on),
        ("ABOVE", -height, parameters.above),
    ):
        spans = held(line.t_s, np.maximum(distance, beside), sigma, threshold)
        yield from (_Fact(predicate, pair, span) for span in spans)


def _at(track: Track, rows: Any) -> measure.Rigid:
    return measure.Rigid(track.pose.rotation[rows], track.pose.translation[rows])


def _together(
    a: Track, b: Track, moving: dict[str, list[Held]], line: Timeline, parameters: RelationParameters
) -> Iterator[_Fact]:
    """Both move, and what is between them does not."""
    between = a.pose.translation - b.pose.translation
    speed, sigma = _speed(line.t_s, between, np.hypot(a.sigma_m, b.sigma_m))
    both = np.zeros((2, len(speed)), bool)
    for row, track in enumerate((a, b)):
        for span in moving.get(track.object_id, []):
            both[row, span.start : span.end] = True
    speed = np.where(both.all(0), speed, np.inf)
    pair = (a.object_id, b.object_id)
    yield from (_Fact("TOGETHER", pair, span) for span in held(line.t_s, speed, sigma, parameters.together))


def _speed(t_s: Floats, places: Floats, sigma_m: Floats) -> tuple[Floats, Floats]:
    """Speed (n,) in m/s over the three frames before and after, and its standard deviation; NaN where unknown."""
    n = len(t_s)
    before, after = np.maximum(np.arange(n) - 3, 0), np.minimum(np.arange(n) + 3, n - 1)
    span = np.maximum(t_s[after] - t_s[before], 1e-9)
    return (
        np.linalg.norm(places[after] - places[before], axis=1) / span,
        np.hypot(sigma_m[after], sigma_m[before]) / span,
    )


def _run(tables: Tables, images: ImagesByKind, parameters: RelationParameters) -> dict[str, pa.Table]:
    del images
    found = propose_relations(
        tables["clock"],
        poses_of(tables.get("poses_smooth", tables["poses"])),
        tables["table_plane"],
        **evidence(tables),
        parameters=parameters,
    )
    return {"relation_proposals": found}


RELATIONS = Stage(
    name="relations",
    version=4,
    inputs=("clock", "poses", "poses_smooth", "table_plane", *EVIDENCE),
    outputs=("relation_proposals",),
    parameters=RelationParameters,
    run=_run,
    partly=("poses", "poses_smooth", *EVIDENCE),
    optional=("poses_smooth", *EVIDENCE),
)
"""The stage that finds the relations."""
