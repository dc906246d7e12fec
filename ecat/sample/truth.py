"""What really happened in a sample: everything that a session's tables only hint at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import os_error
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype
from ecat.model.session import Clock
from ecat.sample.body import HANDS, JOINTS
from ecat.sample.motion import box_gap
from ecat.sample.scene import Scene
from ecat.sample.script import Move

HIDERS = ("", "turned away", "other box", "hand")
"""Why a marker face cannot be seen, by the numbers in ``GroundTruth.hidden``; empty: it can."""
LIFTED_M = 0.001
TILTED_RAD = 0.01
"""A cube lifted or tilted by more than these is ``free``, otherwise it rests on the table."""


@dataclass(frozen=True, kw_only=True)
class GroundTruth:
    """The exact state of the world at every frame.  Boxes, frames, faces are axes of the arrays, in that order.

    Parameters
    ----------
    name, seed, clock, n_frames : the session's.
    scene : camera, table and performer.
    object_ids, prototypes : of each box.
    position : (boxes, frames, 3) centres in the ``table`` frame, metres.
    quaternion : (boxes, frames, 4) orientations in the ``table`` frame, x, y, z, w.
    lift_m, tilt_rad : (boxes, frames) height of the lowest point over the table, angle from upright.
    holder : (boxes, frames) index into ``HANDS`` of the hand that grasps the box, -1 for none.
    joints : (frames, 25, 3) in the ``table`` frame, metres.
    moves : what happens when.
    corners : (boxes, frames, faces, 4, 3) marker corners in the ``table`` frame, in the marker's own order, metres.
    facing : (boxes, frames, faces) cosine between a face's normal and the direction to the camera.
    hidden : (boxes, frames, faces) index into ``HIDERS``.
    joint_hidden : (frames, 25) whether a box or the table is before the joint.
    """

    name: str
    seed: int
    clock: Clock
    n_frames: int
    scene: Scene
    object_ids: tuple[str, ...]
    prototypes: tuple[BoxPrototype, ...]
    position: Floats
    quaternion: Floats
    lift_m: Floats
    tilt_rad: Floats
    holder: NDArray[np.int8]
    joints: Floats
    moves: tuple[Move, ...]
    corners: Floats
    facing: Floats
    hidden: NDArray[np.int8]
    joint_hidden: NDArray[np.bool_]

    @cached_property
    def poses(self) -> Rigid:
        """Table-from-box transforms (boxes, frames)."""
        return Rigid.from_quaternion(self.quaternion, self.position)

    @cached_property
    def pixels(self) -> Floats:
        """Marker corners (boxes, frames, faces, 4, 2) in the colour image, px."""
        return self.scene.pixels(self.corners)

    @cached_property
    def gap_m(self) -> Floats:
        """Free distance (frames,) between the two boxes, metres."""
        (a, b), turn = self.position, self.poses.rotation
        return box_gap(Rigid(turn[0], a), Rigid(turn[1], b))

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(boxes, frames) whether the box is on its way."""
        moving = np.zeros(self.lift_m.shape, bool)
        for move in self.moves:
            for carry in move.carries:
                moving[move.box, carry.move : carry.still] = True
        return moving

    @property
    def free(self) -> NDArray[np.bool_]:
        """(boxes, frames) whether the box is lifted or tilted."""
        return (self.lift_m > LIFTED_M) | (np.abs(self.tilt_rad) > TILTED_RAD)

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time (frames,) of every frame, nanoseconds."""
        return np.array([self.clock.t_ns(frame, self.n_frames) for frame in range(self.n_frames)], np.int64)


def runs(states: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open intervals in which a state (frames,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], states, [False]])))
    return [(int(start), int(end)) for start, end in edges.reshape(-1, 2)]


# ---------------------------------------------------------------------------------------------- tables


def ground_truth_tables(truth: GroundTruth) -> dict[str, pa.Table]:
    """The truth as Arrow tables, rows by frame: ``poses``, ``faces``, ``joints``, ``states``, ``moves``,
    ``table_plane`` (one row) and ``prototypes`` (a row per face).

    Columns that a session's table of the same name has, have the same names, units and frames of reference.
    """
    return {
        "poses": _poses(truth),
        "faces": _faces(truth),
        "joints": _joints(truth),
        "states": _states(truth),
        "moves": _moves(truth),
        "table_plane": _table_plane(truth),
        "prototypes": _prototypes(truth),
    }


def write_truth(dest: Path, truth: GroundTruth) -> None:
    """Write ``<dest>/<table>.parquet`` for every table of the truth; ``dest`` is made if need be.

    Keep it beside the session, not inside: whoever is given the session alone must not find the answers.
    """
    tables: Mapping[str, pa.Table] = ground_truth_tables(truth)
    try:
        dest.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            pq.write_table(table, dest / f"{name}.parquet", compression="zstd")
    except OSError as error:
        raise os_error(error, "cannot write the ground truth", dest) from error


def _frames(truth: GroundTruth, copies: int) -> dict[str, NDArray[np.generic]]:
    """``t_ns`` and ``frame`` with each frame repeated."""
    return {
        "t_ns": np.repeat(truth.t_ns, copies),
        "frame": np.repeat(np.arange(truth.n_frames, dtype=np.int32), copies),
    }


def _names(names: tuple[str, ...], index: NDArray[np.integer]) -> pa.Array:
    """Names by number; null where the name is empty or the number negative."""
    known = np.array([bool(name) for name in names])[index] & (index >= 0)
    return pa.array(np.array(names, object)[index], pa.string(), mask=~known)


def _poses(truth: GroundTruth) -> pa.Table:
    n_boxes = len(truth.object_ids)
    place = truth.position.transpose(1, 0, 2).reshape(-1, 3)
    turn = truth.quaternion.transpose(1, 0, 2).reshape(-1, 4)
    return pa.table(
        _frames(truth, n_boxes)
        | {"object_id": np.tile(truth.object_ids, truth.n_frames)}
        | dict(zip("xyz", place.T, strict=True))
        | dict(zip(("qx", "qy", "qz", "qw"), turn.T, strict=True))
        | {
            "support": np.where(truth.free, "free", "table").T.ravel(),
            "lift_m": truth.lift_m.T.ravel(),
            "tilt_rad": truth.tilt_rad.T.ravel(),
            "moving": truth.moving.T.ravel(),
            "held_by": _names(HANDS, truth.holder.T.ravel()),
        }
    )


def _faces(truth: GroundTruth) -> pa.Table:
    n_boxes, n, n_faces = truth.hidden.shape
    names = [face.face for box in truth.prototypes for face in box.faces]
    pixels = truth.pixels.transpose(1, 0, 2, 3, 4).reshape(-1, 8)
    return pa.table(
        _frames(truth, n_boxes * n_faces)
        | {
            "object_id": np.tile(np.repeat(truth.object_ids, n_faces), n),
            "face": np.tile(names, n),
            "facing": truth.facing.transpose(1, 0, 2).ravel(),
            "hidden_by": _names(HIDERS, truth.hidden.transpose(1, 0, 2).ravel()),
        }
        | {f"{axis}{i}_px": pixels[:, 2 * i + k] for i in range(4) for k, axis in enumerate("uv")}
    )


def _joints(truth: GroundTruth) -> pa.Table:
    points = truth.scene.depth_from_table.apply(truth.joints).reshape(-1, 3)
    return pa.table(
        _frames(truth, len(JOINTS))
        | {"joint": np.tile(JOINTS, truth.n_frames)}
        | dict(zip("xyz", points.T, strict=True))
        | {"hidden": truth.joint_hidden.ravel()}
    )


def _states(truth: GroundTruth) -> pa.Table:
    """When each box moves and when it stands."""
    rows = [
        {"object_id": object_id, "state": state, "start_frame": start, "end_frame": end}
        for object_id, moving in zip(truth.object_ids, truth.moving, strict=True)
        for state, holds in (("moving", moving), ("standing", ~moving))
        for start, end in runs(holds)
    ]
    return pa.Table.from_pylist(sorted(rows, key=lambda row: (row["start_frame"], row["object_id"])))


def _moves(truth: GroundTruth) -> pa.Table:
    """Every grasp with its phases; ``kind`` ``set`` is a rearrangement between two actions."""
    return pa.Table.from_pylist(
        [
            {
                "move": number,
                "kind": move.kind,
                "theme": truth.object_ids[move.box],
                "landmark": truth.object_ids[move.landmark],
                "hand": move.hand,
            }
            | {f"{phase}_frame": getattr(carry, phase) for phase in _PHASES}
            for number, move in enumerate(truth.moves)
            for carry in move.carries
        ]
    )


_PHASES = ("reach", "grasp", "hold", "move", "still", "release", "retreat", "end")


def _table_plane(truth: GroundTruth) -> pa.Table:
    pose = truth.scene.depth_from_table
    normal = pose.rotation[:, 2]
    names = ("nx", "ny", "nz", "d", "origin_x", "origin_y", "origin_z", "qx", "qy", "qz", "qw")
    values = [*normal, -normal @ pose.translation, *pose.translation, *pose.quaternion]
    return pa.table({name: [float(value)] for name, value in zip(names, values, strict=True)})


def _prototypes(truth: GroundTruth) -> pa.Table:
    return pa.Table.from_pylist(
        [
            {"object_id": object_id, "name": box.name, "size_m": list(box.size_m)} | face
            for object_id, box in zip(truth.object_ids, truth.prototypes, strict=True)
            for face in box.to_dict()["faces"]
        ]
    )
