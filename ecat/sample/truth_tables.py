"""The truth as tables beside a session, for whoever compares an estimate with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import os_error
from ecat.sample.body import HANDS, JOINTS
from ecat.sample.truth import HIDERS, GroundTruth, runs
from ecat.store import write_new_file

_PHASES = ("reach", "grasp", "hold", "move", "still", "release", "retreat", "end")


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


def write_truth(dest: Path, truth: GroundTruth, more: Mapping[str, pa.Table] | None = None) -> None:
    """Write ``<dest>/<table>.parquet`` for every table of the truth, and ``more``; ``dest`` is made if need be.

    Keep it beside the session, not inside: whoever is given the session alone must not find the answers.
    """
    tables = ground_truth_tables(truth) | dict(more or {})
    try:
        dest.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            buffer = pa.BufferOutputStream()
            pq.write_table(table, buffer, compression="zstd")
            write_new_file(dest / f"{name}.parquet", [buffer.getvalue().to_pybytes()])
    except OSError as error:
        raise os_error(error, "cannot write the ground truth", dest, "it is not complete") from error


def _frames(truth: GroundTruth, copies: int) -> dict[str, Any]:
    """``t_ns`` and ``frame`` with each frame repeated."""
    return {
        "t_ns": np.repeat(truth.t_ns, copies),
        "frame": np.repeat(np.arange(truth.n_frames, dtype=np.int32), copies),
    }


def _table(columns: dict[str, Any]) -> pa.Table:
    return pa.table(columns)


def _names(names: tuple[str, ...], index: NDArray[np.integer]) -> pa.Array[Any]:
    """Names by number; null where the name is empty or the number negative."""
    known = np.array([bool(name) for name in names])[index] & (index >= 0)
    return pa.array(np.array(names, object)[index], pa.string(), mask=~known)


def _poses(truth: GroundTruth) -> pa.Table:
    n_boxes = len(truth.object_ids)
    place = truth.position.transpose(1, 0, 2).reshape(-1, 3)
    turn = truth.quaternion.transpose(1, 0, 2).reshape(-1, 4)
    return _table(
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
    return _table(
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
    return _table(
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
