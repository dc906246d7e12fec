"""Are marks sound: each once, inside the recording, with depth, seen often enough, moving as things do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ecat.check.finding import Finding, Patient, error, note, some, warning
from ecat.process.inputs import MOST_COORDINATE, sane

MOST_HOLES = 0.05
"""Share of corners without depth: below 2 % in good Kinect v2 recordings; poses begin to lack frames
above."""
LEAST_COVERAGE = 0.5
"""Share of frames in which a box is seen: 58-86 % in good recordings; below, most poses would be guesses."""
LONGEST_LOSS_S = 10.0
"""Longest time a box goes unseen: up to 6.6 s in good recordings, where hands or boxes hide it; actions last
1-3 s."""
ASSUMED_PERIOD_S = 1 / 30
"""Frame period assumed for sessions without a clock: that of the depth cameras in use."""
JUMP_SIDES = 4.0
"""Distance that a marker's centre moves on screen from one frame to the next, in sides of that marker: with 9
cm markers at 30 frames per second 4 sides are 11 m/s, more than a throw."""
LEAST_REPEAT = 3
"""Frames in a stretch that repeats an earlier one: two may be chance where corners are whole pixels."""
REPEAT_LAGS = range(2, 31)
"""Frames between a stretch and its repetition, up to a second; real recorders repeat 3 to 8."""
MOVES_PX = 2.0
"""A marker moves when it does so by more than the jitter of its corners, a pixel."""
MOST_SPEED_M_S = 5.0
"""Speed of a box between consecutive frames: hands that handle objects stay below 3 m/s; the rest is
noise."""

_CORNERS_2D = [f"{axis}{i}_px" for i in range(4) for axis in "uv"]
_CORNERS_3D = [f"{axis}{i}" for i in range(4) for axis in "xyz"]
_MARKS = ("markers_2d", "markers_3d")


def _frame(patient: Patient, name: str, columns: list[str]) -> pd.DataFrame | None:
    table = patient.table(name)
    if table is None or table.num_rows == 0:
        return None
    data: pd.DataFrame = sane(table.select(columns)).to_pandas()
    return data


def _faces(patient: Patient, name: str, columns: list[str]) -> pd.DataFrame | None:
    """The rows that are marker faces: neither absences nor markers without faces."""
    data = _frame(patient, name, ["frame", "object_id", "order", "present", "code", *columns])
    if data is None:
        return None
    data = data[data["present"] & data["order"].notna()]
    return data.assign(object_id=data["object_id"].astype(str)) if len(data) else None


def absurd_numbers(patient: Patient) -> Iterator[Finding]:
    """Coordinates are those of places: neither infinite nor beyond any image or room."""
    for name in (*_MARKS, "joints", "poses", "poses_smooth"):
        table = patient.table(name)
        if table is None or (sound := sane(table)) is table:
            continue
        columns = [c for c in table.column_names if table[c].null_count < sound[c].null_count]
        lost = sum(sound[c].null_count - table[c].null_count for c in columns)
        message = f"{lost:,} numbers are no places (beyond {MOST_COORDINATE:,.0f}), in column {some(columns)}"
        yield error("mark-absurd", f"table {name}", message)


def duplicate_marks(patient: Patient) -> Iterator[Finding]:
    """A face occurs once per frame, object and position."""
    for name in _MARKS:
        data = _frame(patient, name, ["frame", "object_id", "order"])
        if data is None:
            continue
        twice = data[data.duplicated()]
        if len(twice):
            message = (
                f"{len(twice):,} marks occur twice, at frame {some(np.unique(twice['frame'].to_numpy()))}"
            )
            yield error("mark-duplicate", f"table {name}", message)


def marks_outside(patient: Patient) -> Iterator[Finding]:
    """Frame numbers of marks and poses lie within the recording."""
    n = patient.manifest.n_frames
    for name in (*_MARKS, "joints", "poses", "poses_smooth"):
        table = patient.table(name)
        if table is None or not n:
            continue
        frame: NDArray[np.int32] = table["frame"].to_numpy()
        outside = np.unique(frame[(frame < 0) | (frame >= n)])
        if len(outside):
            message = f"rows at frame {some(outside)}, but the recording has frames 0 to {n - 1:,}"
            yield error("mark-outside", f"table {name}", message)


def depth_holes(patient: Patient) -> Iterator[Finding]:
    """Corners mapped through depth have coordinates, save for a few at the edges of things."""
    data = _faces(patient, "markers_3d", _CORNERS_3D)
    if data is None:
        return
    for name, box in data.groupby("object_id"):
        corners = box[_CORNERS_3D].to_numpy(dtype=float).reshape(-1, 4, 3)
        holes = ~np.isfinite(corners).all(axis=2)
        if holes.mean() > MOST_HOLES:
            yield warning(
                "depth-holes",
                f"table markers_3d, box {name}",
                f"{holes.sum():,} of {holes.size:,} corners ({holes.mean():.0%}) have no depth",
            )


def marks_without_depth(patient: Patient) -> Iterator[Finding]:
    """A box that has marks in space has them wherever it has marks in the image."""
    flat, deep = _faces(patient, "markers_2d", []), _faces(patient, "markers_3d", [])
    if flat is None or deep is None:
        return
    for name, box in flat.groupby("object_id"):
        there = deep["frame"][deep["object_id"] == name].unique()
        seen = box["frame"].unique()
        lost = np.setdiff1d(seen, there)
        if len(there) and len(lost):
            report = warning if len(lost) > MOST_HOLES * len(seen) else note
            amount = f"{len(lost):,} of {len(seen):,} frames with marks in the image have none in space"
            yield report("depth-missing", f"table markers_3d, box {name}", f"{amount}: frame {some(lost)}")


def marker_loss(patient: Patient) -> Iterator[Finding]:
    """A box is seen most of the time, and never lost for long."""
    data = _frame(patient, "markers_2d", ["frame", "object_id", "order", "present"])
    n = patient.manifest.n_frames
    if data is None or not n:
        return
    period = patient.frame_period_s or ASSUMED_PERIOD_S
    for name, box in data.groupby("object_id", observed=True):
        seen, away = _sightings(box, n)
        here = n - away
        if not len(seen) or not here:
            continue
        place = f"table markers_2d, box {name}"
        if len(seen) < LEAST_COVERAGE * here:
            message = f"seen in {len(seen):,} of {here:,} frames ({len(seen) / here:.0%})"
            yield warning("marker-coverage", place, message)
        gone = np.unique(box["frame"][~box["present"]].to_numpy())
        gaps = np.diff(seen) - 1
        # a gap during which the box was declared absent is no loss
        hidden = np.searchsorted(gone, seen[1:]) == np.searchsorted(gone, seen[:-1])
        long = hidden & (gaps * period > LONGEST_LOSS_S)
        if long.any():
            most = int(gaps[long].max())
            message = (
                f"unseen for {most:,} frames ({most * period:.1f} s), after frame {some(seen[:-1][long])}"
            )
            yield warning("marker-loss", place, message)


def _sightings(box: pd.DataFrame, n_frames: int) -> tuple[NDArray[Any], int]:
    """Frames in which one box has faces, and the number of frames for which it is declared absent."""
    state = box.groupby("frame")["present"].any().sort_index()
    frames, present = state.index.to_numpy(), state.to_numpy()
    until = np.append(frames[1:], n_frames)
    seen: NDArray[Any] = np.unique(box["frame"][box["present"] & box["order"].notna()].to_numpy())
    return seen, int((until - frames)[~present].sum())


def _moving_faces(patient: Patient) -> pd.DataFrame | None:
    """The faces on screen with ``side`` and ``moved`` (pixels since the frame before; NaN if not seen)."""
    data = _faces(patient, "markers_2d", _CORNERS_2D)
    if data is None:
        return None
    corners = data[_CORNERS_2D].to_numpy(dtype=float).reshape(-1, 4, 2)
    sides = np.linalg.norm(np.diff(corners, axis=1, append=corners[:, :1]), axis=2).mean(axis=1)
    u, v = corners.mean(axis=1).T
    data = data.assign(u=u, v=v, side=sides, code=data["code"].astype(str))
    # a code seen twice in a frame is ambiguous, not a jump
    data = data.drop_duplicates(["frame", "object_id", "code"], keep=False)
    data = data.sort_values(["object_id", "code", "frame"])
    before = data.shift()
    same = (data["object_id"] == before["object_id"]) & (data["code"] == before["code"])
    moved = np.hypot(data["u"] - before["u"], data["v"] - before["v"])
    return data.assign(moved=np.where(same & (data["frame"] == before["frame"] + 1), moved, np.nan))


def mark_jumps(patient: Patient) -> Iterator[Finding]:
    """A marker on screen moves less than a few of its own sides from one frame to the next."""
    data = _moving_faces(patient)
    if data is None:
        return
    far = data[data["moved"] > JUMP_SIDES * data["side"]]
    for name, box in far.groupby("object_id"):
        frames = np.unique(box["frame"].to_numpy())
        message = f"a marker jumps by more than {JUMP_SIDES:g} of its sides into frame {some(frames)}"
        yield warning("mark-jump", f"table markers_2d, box {name}", message)


MOST_FRAMES = 4_000_000
"""A day and a half of video: no recording is longer."""


def repeated_frames(patient: Patient) -> Iterator[Finding]:
    """While things move, no stretch of frames equals the one before: some recorders write a buffer twice."""
    data = _moving_faces(patient)
    if data is None:
        return
    # what lies outside of any recording is a finding of its own, and no reason to reserve memory for it
    data = data[(data["frame"] >= 0) & (data["frame"] < MOST_FRAMES)]
    if data.empty:
        return
    n = int(data["frame"].max()) + 1
    rows = pd.util.hash_pandas_object(data[["object_id", "code", *_CORNERS_2D]], index=False).to_numpy()
    seen, moves = np.zeros(n, dtype=np.uint64), np.zeros(n, dtype=bool)
    np.add.at(seen, data["frame"].to_numpy(), rows)
    moves[data["frame"][data["moved"] > MOVES_PX].to_numpy()] = True
    starts: list[int] = []
    total = end = 0
    for start, length in sorted(run for lag in REPEAT_LAGS for run in _repeats(seen, moves, lag)):
        if start >= end and length >= LEAST_REPEAT:
            starts.append(start)
            end = start + length
            total += length
    if starts:
        where = some([str(start) for start in starts])
        message = (
            f"{total:,} frames repeat earlier ones exactly while things move: stretches from frame {where}"
        )
        yield warning("frame-repeat", "table markers_2d", message)


def _repeats(seen: NDArray[np.uint64], moves: NDArray[np.bool_], lag: int) -> list[tuple[int, int]]:
    """First frame and length of every stretch in which things move as they did ``lag`` frames before."""
    same = np.zeros(len(seen), dtype=bool)
    same[lag:] = (seen[lag:] == seen[:-lag]) & (seen[lag:] != 0)
    goes_on = np.concatenate([[False], same[1:] & same[:-1] & moves[1:], [False]])
    edges = np.flatnonzero(np.diff(goes_on)).reshape(-1, 2)
    return [(int(first), int(last - first) + 1) for first, last in edges]


def pose_jumps(patient: Patient) -> Iterator[Finding]:
    """A box moves no faster than hands move things."""
    period = patient.frame_period_s or ASSUMED_PERIOD_S
    for name in ("poses", "poses_smooth"):
        data = _frame(patient, name, ["frame", "object_id", "x", "y", "z"])
        if data is None:
            continue
        for box_id, rows in data.dropna().groupby("object_id", observed=True):
            box = rows.sort_values("frame")
            frame, xyz = box["frame"].to_numpy(), box[["x", "y", "z"]].to_numpy()
            step_m = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
            jump = (np.diff(frame) == 1) & (step_m > MOST_SPEED_M_S * period)
            if jump.any():
                message = (
                    f"it moves up to {step_m[jump].max():.2f} m in one frame "
                    f"({step_m[jump].max() / period:.0f} m/s), into frame {some(frame[1:][jump])}"
                )
                yield warning("pose-jump", f"table {name}, box {box_id}", message)


MARKS = (
    absurd_numbers,
    duplicate_marks,
    marks_outside,
    depth_holes,
    marks_without_depth,
    marker_loss,
    mark_jumps,
    repeated_frames,
    pose_jumps,
)
