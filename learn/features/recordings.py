"""What features are made of, from any session of ecat and from learning exports: a performer's arms, and two boxes.

Joints and markers are in the axes of the Kinect's camera space (:mod:`learn.features.points`), tracks on the table.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from ecat.formats.ecat2018.learning_export import ExportedSession, read_learning_export
from ecat.geometry.transforms import Rigid
from ecat.process.inputs import MOST_COORDINATE, clock_table, sane
from ecat.stages.pose import table_frames
from ecat.store import Session
from learn.features.ch5 import interpolated
from learn.features.markers import marker_corners, texts, track_of
from learn.features.points import JOINTS, KINECT_FROM_CAMERA, N_POINTS
from learn.features.windows import Table

Floats = NDArray[np.float64]

_STAND_INS = {
    "SpineShoulder": ("ShoulderLeft", "ShoulderRight"),
    **{f"{part}{side}": (f"Hand{side}",) for side in ("Left", "Right") for part in ("HandTip", "Thumb")},
}
"""What a body has instead that lacks a joint; a joint between two is in their middle."""
_STEP = 10
"""Frames between which a path is measured, so that noise does not add up."""


@dataclass(frozen=True)
class Recording:
    """One recording of two boxes.

    Attributes
    ----------
    name : of the session; of an export, with the file that it is in.
    points : (n, 21, 3) metres in the Kinect's camera space, NaN where nothing was seen: 13 joints, then four corners
        of one marker of each box.
    tracks : (2, n, 3) x, y and rotation, below a quarter turn, of each box on the table, without gaps; None where poses
        are not known.
    t_s : (n,) seconds, ascending; None where there is no clock that can be used.
    objects : the boxes' ids, in the order of points and tracks.
    rig : id of the performer; empty if no object is one.
    planes : camera-from-table, each with the frame from which on it holds; empty where the table is not known.
    moves : first frame, and the one after the last, of each movement of either box, by the stage `relations`; None
        where it did not run.
    findings : what was missing, and what was chosen, a line each.
    called : boxes in messages, by id: the id, and the name where there is one.
    """

    name: str
    points: Floats
    tracks: Floats | None
    t_s: Floats | None
    objects: tuple[str, str]
    rig: str = ""
    planes: tuple[tuple[int, Rigid], ...] = ()
    moves: tuple[tuple[int, int], ...] | None = None
    findings: tuple[str, ...] = ()
    called: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def has_joints(self) -> bool:
        """Whether any joint was seen."""
        return bool(np.isfinite(self.points[:, : len(JOINTS)]).any())

    def filled(self) -> Recording:
        """The recording with gaps in its points filled in straight lines; what was never seen stays unknown."""
        flat = self.points.reshape(len(self.points), N_POINTS, 3).copy()
        for point in range(N_POINTS):
            if np.isfinite(flat[:, point]).all(axis=1).any():
                flat[:, point] = interpolated(flat[:, point])
        return replace(self, points=flat)

    def leveled(self) -> list[tuple[int, Floats, Table | None]]:
        """Stretches of frames with one table each: the first frame, points turned about the camera's line of sight so
        that the table is level from side to side, and the table; None where it is not known, or not below the camera.

        As for a fitted table (:func:`learn.features.windows.fit_table`), its height is that of the markers on it.
        """
        if not self.planes:
            return [(0, self.points, None)]
        starts = [0, *(frame for frame, _ in self.planes[1:])]
        ends = [*starts[1:], len(self.points)]
        parts: list[tuple[int, Floats, Table | None]] = []
        for start, end, (_, plane) in zip(starts, ends, self.planes, strict=True):
            normal = plane.rotation[:, 2] * KINECT_FROM_CAMERA
            steep = float(np.hypot(normal[0], normal[1]))
            if normal[1] <= 0 or start >= end:
                parts.append((start, self.points[start:end], None))
                continue
            sin, cos = normal[:2] / steep
            points = self.points[start:end] @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T
            slope = float(-normal[2]) / steep
            marks = points[:, len(JOINTS) :].reshape(-1, 3)
            heights = (marks[:, 1] - slope * marks[:, 2])[np.isfinite(marks).all(axis=1)]
            table = Table(slope, float(np.median(heights))) if len(heights) else None
            parts.append((start, points, table))
        return parts


# --- sessions


def read_session(session: Session, objects: Sequence[str] = ()) -> Recording:
    """The recording in a session.

    Boxes are where ``poses_smooth`` or ``poses`` say, and their markers those of ``markers_3d``; without any, those
    that a box in its pose turns to the camera.  Of more than two boxes, the one that moves most and the one that is
    nearest to it on average are taken, unless ``objects`` names two, by id or by name.  Coordinates beyond
    ``MOST_COORDINATE`` are not known, as for stages; nor are times that do not ascend.

    Raises
    ------
    InputError : there are not two boxes, or one was never seen.
    UsageError : ``objects`` are not two of the session's boxes.
    """
    clock = clock_table(session)
    n = clock.num_rows
    poses = _poses(session, n)
    planes = (
        tuple(table_frames(session.table("table_plane").to_arrow())) if _has(session, "table_plane") else ()
    )
    corners = marker_corners(session, n, poses, planes)
    seen = [(name, _middle(corner)) for name, corner in corners.items()]
    seen += [(name, pose[:, :3]) for name, pose in poses.items()]  # a pose says it better, if there is any
    places = {name: place for name, place in seen if np.isfinite(place).all(axis=1).any()}
    pair, findings = _pair(session, places, objects)
    names = _names(session)
    called = {name: _called(name, names) for name in pair}
    joints, rig, missing = _joints(session, n)
    points = np.full((n, N_POINTS, 3), np.nan)
    points[:, : len(JOINTS)] = joints
    for number, name in enumerate(pair):
        at = len(JOINTS) + 4 * number
        if name in corners:
            points[:, at : at + 4] = corners[name]
        else:
            missing.append(f"no marker of {called[name]} is known in space")
    t_s, told = _times(clock["t_ns"].to_numpy() / 1e9)
    both = all(name in poses and np.isfinite(poses[name]).all(axis=1).any() for name in pair)
    tracks = np.stack([interpolated(track_of(poses[name])) for name in pair]) if both else None
    if tracks is None:
        missing.append(
            "there are no poses of both boxes, so it is not known where they are on the table (ecat process)"
        )
    moves = _moves(session, pair)
    said = (*findings, *missing, *told)
    return Recording(session.name, points, tracks, t_s, pair, rig, planes, moves, said, called)


def _has(session: Session, name: str) -> bool:
    record = session.manifest.table(name)
    return record is not None and bool(record.rows)


def _times(t_s: Floats) -> tuple[Floats | None, list[str]]:
    """Seconds (n,) that ascend, and what was wrong with them: frames without a time, or with one out of order, take
    theirs from the others in straight lines.
    """
    n, known = len(t_s), np.flatnonzero(np.isfinite(t_s))
    good = known[_ascending(t_s[known])]
    if not len(known):
        return None, []
    if len(good) == n:
        return t_s, []
    if len(good) < 2 or 2 * len(good) <= len(known):
        return None, [f"its clock is not used: only {len(good):,} of {n:,} frames have times in order"]
    frame, (first, last) = np.arange(n), good[[0, -1]]
    step = float(np.median(np.diff(t_s[good]) / np.diff(good)))
    beyond = np.minimum(frame - first, 0) + np.maximum(frame - last, 0)
    lost = f"{n - len(good):,} of {n:,} frames have no time, or one out of order: theirs are those between others"
    return np.interp(frame, good, t_s[good]) + step * beyond, [lost]


def _ascending(times: Floats) -> NDArray[np.int64]:
    """Places of the longest sequence of times that ascends (Schensted 1961)."""
    if (np.diff(times) > 0).all():
        return np.arange(len(times))
    lowest, ends = (
        list[float](),
        list[int](),
    )  # of the sequences of each length, the lowest last time, and its place
    before = np.full(len(times), -1)
    for place, time in enumerate(times.tolist()):
        length = bisect_left(lowest, time)
        before[place] = ends[length - 1] if length else -1
        lowest[length : length + 1], ends[length : length + 1] = [time], [place]
    found = [ends[-1]]
    while before[found[-1]] >= 0:
        found.append(int(before[found[-1]]))
    return np.array(found[::-1])


def _poses(session: Session, n: int) -> dict[str, Floats]:
    """(n, 7) place and quaternion of each box, NaN where it was not seen."""
    name = next((name for name in ("poses_smooth", "poses") if _has(session, name)), None)
    if name is None:
        return {}
    columns = ("x", "y", "z", "qx", "qy", "qz", "qw")
    table = sane(session.table(name, columns=["frame", "object_id", *columns]).to_arrow())
    found = _by_frame(table, texts(table, "object_id"), columns, n)
    for pose in found.values():
        pose[(pose[:, 3:] == 0).all(axis=1)] = np.nan  # turned in no way
    return found


def _moves(session: Session, pair: Sequence[str]) -> tuple[tuple[int, int], ...] | None:
    if not _has(session, "relation_proposals"):
        return None
    columns = ["predicate", "arguments", "start_frame", "end_frame"]
    rows = session.table("relation_proposals", columns=columns).to_arrow().to_pylist()
    moving = (row for row in rows if row["predicate"] == "MOVING" and row["arguments"][0] in pair)
    return tuple(sorted((row["start_frame"], row["end_frame"]) for row in moving))


def _by_frame(table: pa.Table, names: NDArray[np.str_], columns: Sequence[str], n: int) -> dict[str, Floats]:
    """Of each name, columns (n, k) by frame; NaN where there is no row."""
    frame = np.asarray(table["frame"].to_numpy(), np.int64)
    values = np.column_stack([np.asarray(table[column].to_numpy(), np.float64) for column in columns])
    found: dict[str, Floats] = {}
    for name in sorted(set(names.tolist())):
        mine = (names == name) & (frame >= 0) & (frame < n)
        found[name] = np.full((n, len(columns)), np.nan)
        found[name][frame[mine]] = np.where(np.isfinite(values[mine]), values[mine], np.nan)
    return found


def _pair(
    session: Session, places: Mapping[str, Floats], wanted: Sequence[str]
) -> tuple[tuple[str, str], list[str]]:
    what = f"cannot compute features of session {session.name}"
    names = _names(session)
    there = ", ".join(_called(key, names) for key in places) or "none"
    if wanted:
        chosen = [key for word in wanted for key in places if word in {key, names.get(key)}]
        if len(wanted) != 2 or len(set(chosen)) != 2:
            raise UsageError(
                what,
                where=f"{' and '.join(wanted)}: the boxes that were seen are {there}",
                fix="--objects with two of these, by id or by name",
            )
        return (chosen[0], chosen[1]), []
    if len(places) < 2:
        raise InputError(
            what,
            where=f"two boxes are needed; those that were seen: {there}",
            consequence="nothing was computed",
            fix="give a session in which two boxes are handled; ecat process finds boxes in videos",
        )
    if len(places) == 2:
        first, second = sorted(places)
        return (first, second), []
    mover = max(places, key=lambda key: _travelled(places[key]))
    others = [key for key in places if key != mover]
    nearest = min(others, key=lambda key: _mean_distance(places[mover], places[key]))
    first, second = sorted((mover, nearest))
    chosen_names = f"{first} and {second}: the box that moves most, and the one nearest to it"
    return (first, second), [
        f"of {len(places)} boxes ({there}) chosen were {chosen_names}; --objects chooses"
    ]


def _names(session: Session) -> dict[str, str]:
    return {row["object_id"]: row["name"] for row in session.objects.to_arrow().to_pylist()}


def _called(key: str, names: Mapping[str, str]) -> str:
    return f"{key} ({names[key]})" if names.get(key) else key


def _middle(corners: Floats) -> Floats:
    """The mean of the corners (n, 4, 3) that are known, NaN where none is."""
    known = np.isfinite(corners.sum(axis=2))
    count = np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    return np.where(known[..., None], corners, 0).sum(axis=1) / count[:, None]


def _travelled(place: Floats) -> float:
    steps = np.diff(interpolated(place)[::_STEP], axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())


def _mean_distance(a: Floats, b: Floats) -> float:
    return float(np.linalg.norm(interpolated(a) - interpolated(b), axis=1).mean())


def _joints(session: Session, n: int) -> tuple[Floats, str, list[str]]:
    """(n, 13, 3) of the body that was seen in most frames, the rig that it is, and what was missing."""
    found = np.full((n, len(JOINTS), 3), np.nan)
    rigs = [row["object_id"] for row in session.objects.to_arrow().to_pylist() if row["kind"] == "rig"]
    rig = rigs[0] if rigs else ""
    if not _has(session, "joints"):
        return (
            found,
            rig,
            ["there are no joints: of the performer nothing is known (ecat file add, for a rig file)"],
        )
    table = sane(session.table("joints").to_arrow())
    bodies, counts = np.unique(table["body"].to_numpy(), return_counts=True)
    body = bodies[counts.argmax()]
    mine = table.filter(pa.array(table["body"].to_numpy() == body))
    owner = next((name for name in mine["object_id"].cast(pa.string()).to_pylist() if name), "")
    unseen = texts(mine, "state") == "not_tracked"
    by_name = _by_frame(mine.filter(pa.array(~unseen)), texts(mine, "joint")[~unseen], ("x", "y", "z"), n)
    missing = [name for name in JOINTS if name not in by_name]
    lost: list[str] = []
    for place, joint in enumerate(JOINTS):
        parts = [by_name[name] for name in _STAND_INS.get(joint, ()) if name in by_name]
        if joint in by_name:
            found[:, place] = by_name[joint]
        elif parts:
            found[:, place] = np.mean(parts, axis=0)
        else:
            lost.append(joint)
    said = [f"{len(bodies)} bodies were seen; of them the one seen most was taken"] if len(bodies) > 1 else []
    if stood_in := [name for name in missing if name not in lost]:
        said.append(f"joints next to them stand in for {', '.join(stood_in)}")
    if lost:
        said.append(f"joints are missing: {', '.join(lost)}")
    return found * KINECT_FROM_CAMERA, owner or rig, said


# --- exports


def read_export(path: Path) -> Iterator[Recording]:
    """The recordings in a learning export, without those that were named but not exported.

    Raises
    ------
    FormatError : it is no learning export.
    """
    for session in read_learning_export(path):
        if not session.empty:
            yield Recording(
                f"{path.stem}/{session.name}", _points(session), None, None, ("Object_1", "Object_2")
            )


def _points(session: ExportedSession) -> Floats:
    parts = [
        np.column_stack([np.asarray(table[axis].to_numpy(), np.float64) for axis in "xyz"]).reshape(
            -1, count, 3
        )
        for table, count in ((session.joints, len(JOINTS)), (session.boxes, 8))
    ]
    points = np.concatenate(parts, axis=1) * KINECT_FROM_CAMERA
    return np.where(np.abs(points) <= MOST_COORDINATE, points, np.nan)
