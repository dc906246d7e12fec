"""The numbers of an episode: where boxes and joints are, which hands are closed, and what is done next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats, Rigid
from ecat.model import AnnotatedObject, Event, Layer
from ecat.model.annotation import MACHINE
from ecat.stages.pose import table_frames
from ecat.stages.resample import held, interpolated, same_side, unit
from ecat.stages.sightings import strings
from ecat.stages.tracks import JOINT_SIGMA_M
from ecat.store import Session

PARTS = ("boxes", "joints", "hands")
"""What a state may consist of."""
HANDS = ("HandLeft", "HandRight")
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_DELTA = ("dx", "dy", "dz", "rx", "ry", "rz")
_HOLD = "hold"
_AT_ONCE = 4096

Action: TypeAlias = Literal["next_pose", "delta", "next_state", "none"]
Numbers: TypeAlias = tuple[Floats, tuple[str, ...]]
"""Values (n, k), NaN where nothing is known, and the names of the k columns."""


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """How values that are known at the session's frames are taken at other moments: see
    :class:`ecat.formats.episodes.EpisodeOptions`.
    """

    linear: bool
    within_ns: int

    def at(self, values: Floats, known_ns: NDArray[np.int64], asked_ns: NDArray[np.int64]) -> Floats:
        """Values (n, k) at the moments asked for (m,): (m, k)."""
        take = interpolated if self.linear else held
        return take(values, known_ns, asked_ns, within_ns=self.within_ns)


class States:
    """What a session tells about boxes, joints and hands, read a stretch at a time.

    Parameters
    ----------
    frame_ns : when each frame of the session was taken (n,), not descending.
    layer : whose objects and events name boxes, rigs and held boxes.
    parts : some of :data:`PARTS`.
    joints : names of the joints wanted, all of them by default.
    smooth : whether poses are taken from ``poses_smooth`` where there is such a table.
    """

    def __init__(
        self,
        session: Session,
        layer: Layer,
        frame_ns: NDArray[np.int64],
        *,
        parts: Sequence[str],
        joints: Sequence[str],
        smooth: bool,
        sampling: Sampling,
    ) -> None:
        self._session, self._layer, self._frame_ns = session, layer, frame_ns
        self._parts, self._wanted_joints, self._sampling = parts, tuple(joints), sampling
        names = ("poses_smooth", "poses") if smooth else ("poses",)
        self.poses_table = next((name for name in names if session.has_table(name)), "")

    @cached_property
    def boxes(self) -> dict[str, str]:
        """The name of every box that has poses, by its id, in the order of their names."""
        if not self.poses_table:
            return {}
        column = self._session.table(self.poses_table, columns=["object_id"]).to_arrow()["object_id"]
        return box_names(self._layer.objects, map(str, pc.unique(column.cast(pa.string())).to_pylist()))

    @cached_property
    def rig(self) -> str:
        """Whose joints they are: the rig that events name most often, else the first; empty without joints."""
        if not self._has_joints:
            return ""
        owners = self._session.table("joints", columns=["object_id"]).to_arrow()["object_id"]
        there = sorted(name for name in pc.unique(owners.cast(pa.string())).to_pylist() if name is not None)
        acting = Counter(role.target.split("/")[0] for event in self._layer.events for role in event.roles)
        return max(there, key=lambda name: acting[name], default="")

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """The joints, in the order of their names."""
        if "joints" not in self._parts or not self._has_joints:
            return ()
        column = self._session.table("joints", columns=["joint"]).to_arrow()["joint"]
        there = {str(name) for name in pc.unique(column.cast(pa.string())).to_pylist()}
        return tuple(sorted(there & set(self._wanted_joints) if self._wanted_joints else there))

    @property
    def _has_joints(self) -> bool:
        # joints are seen by a camera; without a table there is no frame that boxes and joints share
        return self._session.has_table("joints") and self._session.has_table("table_plane")

    @cached_property
    def _holds(self) -> dict[str, list[tuple[int, int]]] | None:
        """When each hand is closed; None where nobody said of any."""
        found = [
            (role.target, segment.start_frame, segment.end_frame)
            for event in self._layer.events
            if event.type == _HOLD and (event.status == "confirmed" or self._layer.name == MACHINE)
            for role in event.roles
            if role.kind == "joint"
            for segment in event.segments
        ]
        if not found and self._session.has_table("event_proposals"):
            rows = self._session.table("event_proposals").to_arrow().to_pylist()
            held_by = [row for row in rows if row["type"] == _HOLD and row["hand"]]
            found = [(row["hand"], row["start_frame"], row["end_frame"]) for row in held_by]
        if not found:
            return None
        return {hand: [(a, b) for by, a, b in found if by.rpartition("/")[2] == hand] for hand in HANDS}

    def state(self, times_ns: NDArray[np.int64]) -> Numbers:
        """The state at moments (n,) in ascending order, of the parts that were asked for."""
        made: dict[str, Callable[[NDArray[np.int64]], Numbers]] = {
            "boxes": self.box_state,
            "joints": lambda times: _piecewise(self._joint_state, times),
            "hands": self._hand_state,
        }
        parts = [made[part](times_ns) for part in PARTS if part in self._parts]
        values = [np.empty((len(times_ns), 0)), *(part for part, _ in parts)]
        return np.concatenate(values, axis=1), tuple(name for _, names in parts for name in names)

    def box_state(self, times_ns: NDArray[np.int64]) -> Numbers:
        """Position and orientation of every box in ``table``: metres, unit quaternion x, y, z, w."""
        values, names = _piecewise(self._box_state, times_ns)
        for first in range(3, len(names), len(POSE)):
            values[:, first : first + 4] = same_side(values[:, first : first + 4])
        return values, names

    def _box_state(self, times_ns: NDArray[np.int64]) -> Numbers:
        names = tuple(f"{name}.{axis}" for name in self.boxes.values() for axis in POSE)
        if not self.boxes:
            return np.empty((len(times_ns), 0)), names
        start, end = self._frames(times_ns)
        rows = self._session.table(
            self.poses_table, start_frame=start, end_frame=end, columns=["frame", "object_id", *POSE]
        ).to_arrow()
        values = np.stack([np.asarray(rows[n].to_numpy(zero_copy_only=False), float) for n in POSE], -1)
        owner = np.array(strings(rows, "object_id"), object)
        frame = np.asarray(rows["frame"].to_numpy(), np.int64)
        poses = [self._box(values[owner == i], frame[owner == i], times_ns) for i in self.boxes]
        return np.concatenate(poses, axis=1), names

    def _box(self, values: Floats, frame: NDArray[np.int64], times_ns: NDArray[np.int64]) -> Floats:
        inside = frame < len(self._frame_ns)
        values, known_ns = values[inside], self._frame_ns[frame[inside]]
        values = np.hstack([values[:, :3], same_side(values[:, 3:])])
        found = self._sampling.at(values, known_ns, times_ns)
        return np.hstack([found[:, :3], unit(found[:, 3:])])

    def _joint_state(self, times_ns: NDArray[np.int64]) -> Numbers:
        names = tuple(f"{joint}.{axis}" for joint in self.joints for axis in "xyz")
        if not names:
            return np.empty((len(times_ns), 0)), names
        start, end = self._frames(times_ns)
        columns = ["frame", "object_id", "joint", "x", "y", "z", "state"]
        rows = self._session.table("joints", start_frame=start, end_frame=end, columns=columns).to_arrow()
        if self.rig:
            rows = rows.filter(pc.equal(rows["object_id"].cast(pa.string()), pa.scalar(self.rig)))
        seen = pc.is_in(rows["state"].cast(pa.string()), value_set=pa.array(list(JOINT_SIGMA_M)))
        wanted = pc.index_in(rows["joint"].cast(pa.string()), value_set=pa.array(list(self.joints)))
        rows = rows.filter(pc.and_(seen, pc.is_valid(wanted)))
        which = np.asarray(wanted.filter(pc.and_(seen, pc.is_valid(wanted))).to_numpy(), np.int64)
        frame = np.asarray(rows["frame"].to_numpy(), np.int64)
        points = np.stack([np.asarray(rows[n].to_numpy(zero_copy_only=False), float) for n in "xyz"], -1)
        places = np.full((end - start, len(self.joints), 3), np.nan)
        places[frame - start, which] = points
        known = np.arange(start, end)
        values = self._on_table(places, known).reshape(len(known), -1)
        return self._sampling.at(values, self._frame_ns[start:end], times_ns), names

    def _on_table(self, places: Floats, frame: NDArray[np.int64]) -> Floats:
        """Points (n, k, 3) of ``camera/depth`` in ``table``, each by the plane that held at its frame (n,)."""
        begins = [begin for begin, _ in self._planes]
        which = np.maximum(np.searchsorted(begins, frame, side="right") - 1, 0)
        moved = np.empty_like(places)
        for number in np.unique(which):
            mine = which == number
            moved[mine] = self._planes[number][1].inverse().apply(places[mine])
        return moved

    @cached_property
    def _planes(self) -> list[tuple[int, Rigid]]:
        return table_frames(self._session.table("table_plane").to_arrow())

    def _hand_state(self, times_ns: NDArray[np.int64]) -> Numbers:
        """One while a hand holds a box, else zero; nothing where nobody said of any hand."""
        if self._holds is None:
            return np.empty((len(times_ns), 0)), ()
        frame = np.searchsorted(self._frame_ns, times_ns, side="right") - 1
        values = np.zeros((len(times_ns), len(HANDS)))
        for column, hand in enumerate(HANDS):
            for start, end in self._holds[hand]:
                values[(frame >= start) & (frame < end), column] = 1.0
        return values, tuple(f"{hand}.closed" for hand in HANDS)

    def _frames(self, times_ns: NDArray[np.int64]) -> tuple[int, int]:
        """Frames from which the values at these moments follow."""
        around = times_ns[0] - self._sampling.within_ns, times_ns[-1] + self._sampling.within_ns
        start, end = np.searchsorted(self._frame_ns, around)
        return int(start), min(int(end) + 1, len(self._frame_ns))


def _piecewise(read: Callable[[NDArray[np.int64]], Numbers], times_ns: NDArray[np.int64]) -> Numbers:
    """The numbers at moments (n,), read for some of them at a time: tables are larger than what is taken of them."""
    pieces = [read(times_ns[at : at + _AT_ONCE]) for at in range(0, len(times_ns), _AT_ONCE)]
    return np.concatenate([values for values, _ in pieces]), pieces[0][1]


def box_names(objects: Sequence[AnnotatedObject], ids: Iterable[str]) -> dict[str, str]:
    """A name for each of these objects, by id, in the order of the names: its own, with the id where two share it."""
    named = {thing.id: thing.name or thing.id for thing in objects}
    wanted = {i: named.get(i, i) for i in ids}
    times = Counter(wanted.values())
    unique = {i: name if times[name] == 1 else f"{name} {i}" for i, name in wanted.items()}
    return dict(sorted(unique.items(), key=lambda item: item[1]))


def moved_box(event: Event, boxes: Sequence[str], role: str) -> int:
    """Which of the boxes (ids) the event says is moved: what fills ``role``; -1 if it says of none."""
    for filled in event.roles:
        if filled.name.lower() == role.lower() and filled.target in boxes:
            return boxes.index(filled.target)
    return -1


def furthest(poses: Floats) -> int:
    """Which box of poses (n, 7 k) moved the furthest; -1 if none is known to have moved."""
    ways = [
        np.ptp(place[np.isfinite(place[:, 0])], axis=0) if np.isfinite(place[:, 0]).any() else np.zeros(3)
        for place in (poses[:, k : k + 3] for k in range(0, poses.shape[1], len(POSE)))
    ]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    return int(np.argmax(lengths)) if lengths and max(lengths) > 0 else -1


def box_action(kind: Action, poses: Floats, moved: NDArray[np.int64]) -> Numbers:
    """What is done at each of n moments: of the box ``moved`` (n,), -1 where none is.

    ``poses`` (n + 1, 7 k) of all boxes at these moments and the one after.  ``next_pose``: (n, 7) the box's next pose
    in ``table``.  ``delta``: (n, 6) from its pose to the next one: metres, and a rotation vector about the axes of
    ``table``, radians.
    """
    n = len(moved)
    padded = np.hstack([poses, np.full((len(poses), len(POSE)), np.nan)])
    columns = np.where(moved < 0, poses.shape[1], moved * len(POSE))[:, None] + np.arange(len(POSE))
    now, then = np.take_along_axis(padded[:-1], columns, 1), np.take_along_axis(padded[1:], columns, 1)
    if kind == "next_pose":
        return then, POSE
    from scipy.spatial.transform import Rotation

    turn = np.full((n, 3), np.nan)
    known = np.isfinite(now).all(axis=1) & np.isfinite(then).all(axis=1)
    before, after = (Rotation.from_quat(part[known, 3:]) for part in (now, then))
    turn[known] = (after * before.inv()).as_rotvec()
    return np.hstack([then[:, :3] - now[:, :3], turn]), _DELTA
