"""From tables of poses and joints to arrays: where every box and every hand is, on the session's frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.moves import Move
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model.prototype import BoxPrototype
from ecat.stages.pose import table_frames
from ecat.stages.rows import Given, rows_of
from ecat.stages.sightings import object_prototypes, strings
from ecat.stages.stage import Tables

JOINT_SIGMA_M = {"tracked": 0.01, "inferred": 0.03}
"""Standard deviation of a joint by its state; others are not used."""


@dataclass(frozen=True)
class Timeline:
    """The frames of a session: ``frame`` (n,) ascending, ``t_s`` (n,) seconds, ``t_ns`` as in the tables."""

    frame: NDArray[np.int64]
    t_s: Floats
    t_ns: list[int | None]

    def rows(self, move: Move) -> tuple[int, int]:
        """The rows, the last excluded, in which a box is on its way."""
        start, end = np.searchsorted(self.t_s, (move.start_s, move.end_s))
        return int(start) + move.from_rest, int(end)

    def interval(self, start: int, end: int) -> dict[str, int | None]:
        """Columns of a half-open interval of rows; the end after the last row is one usual step later."""
        if end < len(self.frame):
            return {
                "start_frame": int(self.frame[start]),
                "end_frame": int(self.frame[end]),
                "start_ns": self.t_ns[start],
                "end_ns": self.t_ns[end],
            }
        times = [t for t in self.t_ns if t is not None]
        step = int(np.median(np.diff(times))) if len(times) > 1 else 0
        return {
            "start_frame": int(self.frame[start]),
            "end_frame": int(self.frame[-1]) + 1,
            "start_ns": self.t_ns[start],
            "end_ns": times[-1] + step if times else None,
        }


@dataclass(frozen=True)
class Track:
    """One box on all n frames of a session.

    ``pose`` (n) in the ``table`` frame, NaN where unknown; ``sigma_m`` (n,) of its position; ``observed`` (n,) seen
    rather than interpolated; ``free`` (n,) off the table; ``box`` its prototype.
    """

    object_id: str
    box: BoxPrototype
    pose: Rigid
    sigma_m: Floats
    observed: NDArray[np.bool_]
    free: NDArray[np.bool_]

    @property
    def size_m(self) -> Floats:
        """(3,) edges."""
        return np.array(self.box.size_m, float)


@dataclass(frozen=True)
class HandTrack:
    """One hand on all frames: ``rig`` object, ``joint`` name, ``place`` (n, 3) in ``table``, NaN where unknown."""

    rig: str
    joint: str
    place: Floats
    sigma_m: Floats

    @property
    def target(self) -> str:
        """How a role names it."""
        return f"{self.rig}/{self.joint}"


def object_boxes(
    markers: Sequence[pa.Table | None], prototypes: Sequence[BoxPrototype], *, mirrored: bool
) -> dict[str, BoxPrototype]:
    """The prototype of each object: the one that most of its codes belong to."""
    found = object_prototypes(markers, prototypes, mirrored=mirrored)
    return {name: prototypes[index] for name, index in found.items()}


def timeline(clock: pa.Table) -> Timeline:
    """The frames of a table with the columns ``frame`` and ``t_ns``; without times they are thirtieths of a second."""
    frame = np.asarray(clock["frame"].to_numpy(), np.int64)
    t_ns: list[int | None] = clock["t_ns"].to_pylist()
    known = None not in t_ns
    return Timeline(frame, np.array(t_ns, float) / 1e9 if known else frame / 30.0, t_ns)


def read_tracks(poses: pa.Table, boxes: Mapping[str, BoxPrototype], line: Timeline) -> list[Track]:
    """A track for each object of a table of poses whose prototype is known, by object id."""
    names = np.array(strings(poses, "object_id"), object)
    rows = np.searchsorted(line.frame, poses["frame"].to_numpy())
    flagged = [
        np.array(strings(poses, column), object) == word
        for column, word in (("source", "observed"), ("support", "free"))
    ]
    found: list[Track] = []
    for name in sorted(set(names.tolist()) & set(boxes)):
        mine = np.flatnonzero(names == name)
        at = rows[mine]
        numbers = np.full((len(line.frame), len(_NUMBERS)), np.nan)
        flags = np.zeros((2, len(line.frame)), bool)
        for k, column in enumerate(_NUMBERS):
            numbers[at, k] = poses[column].to_numpy(zero_copy_only=False)[mine]
        for k, flag in enumerate(flagged):
            flags[k, at] = flag[mine]
        # an hour at once would take five times the memory of what comes out
        turns = np.split(numbers[:, 3:7], range(_AT_ONCE, len(numbers), _AT_ONCE))
        pose = Rigid(np.concatenate([matrix_from_quaternion(turn) for turn in turns]), numbers[:, :3].copy())
        found.append(Track(name, boxes[name], pose, numbers[:, 7].copy(), flags[0], flags[1]))
    return found


EVIDENCE = ("joints", "markers_2d", "markers_3d")
"""Tables that tell more than poses do: who was there, and how large the boxes are."""
_NUMBERS = ("x", "y", "z", "qx", "qy", "qz", "qw", "sigma_m")
_POSE_COLUMNS = ("frame", "object_id", *_NUMBERS, "source", "support")
_AT_ONCE = 8192
_MARK_COLUMNS = ("object_id", "code")
_COLUMNS = {
    "joints": ("frame", "body", "object_id", "joint", "state", "x", "y", "z"),
    "markers_2d": _MARK_COLUMNS,
    "markers_3d": _MARK_COLUMNS,
}


def evidence(tables: Tables) -> dict[str, pa.Table | None]:
    """What is read of the tables that tell more than poses do, as keyword arguments; None where there are none."""
    return {
        name: rows_of(tables[name]).select(_COLUMNS[name]) if name in tables else None for name in EVIDENCE
    }


def poses_of(poses: Given) -> pa.Table:
    """What is read of a table of poses: where boxes are, without the covariances, which are most of it."""
    return rows_of(poses).select(_POSE_COLUMNS)


def read_hands(
    joints: pa.Table | None, table_plane: pa.Table, line: Timeline, names: Sequence[str]
) -> list[HandTrack]:
    """The named joints of every rig, in the ``table`` frame; a body that nobody annotated is the rig ``body_N``."""
    if joints is None or not joints.num_rows:
        return []
    wanted = pa.array(list(names), pa.string())
    kept = joints.filter(pc.is_in(joints["joint"].cast(pa.string()), value_set=wanted))
    bodies = pa.array([f"body_{body}" for body in kept["body"].to_pylist()], pa.string())
    kept = kept.set_column(
        kept.schema.get_field_index("object_id"),
        "object_id",
        pc.coalesce(kept["object_id"].cast(pa.string()), bodies),
    )
    owner = np.array(
        [f"{a}/{b}" for a, b in zip(strings(kept, "object_id"), strings(kept, "joint"), strict=True)], object
    )
    frame = np.asarray(kept["frame"].to_numpy(), np.int64)
    points = np.stack([np.asarray(kept[axis].to_numpy(zero_copy_only=False), float) for axis in "xyz"], -1)
    sigma = np.array([JOINT_SIGMA_M.get(state, np.nan) for state in strings(kept, "state")], float)
    points = _on_table(np.where(np.isnan(sigma)[:, None], np.nan, points), frame, table_plane)
    found: list[HandTrack] = []
    for name in sorted(set(owner.tolist())):
        mine = (owner == name) & np.isin(frame, line.frame)
        at = np.searchsorted(line.frame, frame[mine])
        place, doubt = np.full((len(line.frame), 3), np.nan), np.full(len(line.frame), np.nan)
        place[at], doubt[at] = points[mine], sigma[mine]
        rig, joint = name.rsplit("/", 1)
        found.append(HandTrack(rig, joint, place, doubt))
    return found


def _on_table(points: Floats, frame: NDArray[np.int64], table_plane: pa.Table) -> Floats:
    """Points (n, 3) of a camera in the ``table`` frame, each by the plane that held at its frame."""
    planes = table_frames(table_plane)
    begins = [begin for begin, _ in planes]
    which = np.maximum(np.searchsorted(begins, frame, side="right") - 1, 0)
    there = np.full_like(points, np.nan)
    for number, (_, camera_from_table) in enumerate(planes):
        there[which == number] = camera_from_table.inverse().apply(points[which == number])
    return there
