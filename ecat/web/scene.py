"""What the page needs to know of a session before it asks for rows: its cameras, boxes, bodies and table."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pyarrow as pa

from ecat.geometry.boxes import boxes_by_codes
from ecat.model import Camera
from ecat.model.prototype import BoxPrototype
from ecat.model.skeleton import BONES
from ecat.process.inputs import session_camera
from ecat.process.prototypes import kept_prototypes
from ecat.store import Session

_PLANE = ("nx", "ny", "nz", "d", "origin_x", "origin_y", "origin_z", "qx", "qy", "qz", "qw")


def boxes_of(session: Session) -> dict[str, BoxPrototype]:
    """The box that each object is: the one that most of its codes belong to; empty where none are known."""
    prototypes = kept_prototypes(session)
    tables = [name for name in ("markers_2d", "markers_3d") if session.has_table(name)]
    if not prototypes or not tables:
        return {}
    votes: Counter[tuple[str, str]] = Counter()
    for name in tables:
        for row in _counted(session, name, "object_id", "code"):
            if row["code"] is not None:
                votes[row["object_id"], row["code"]] += row["n"]
    return boxes_by_codes(votes, prototypes, mirrored=session_camera(session).mirrored)


def _counted(session: Session, table: str, *columns: str) -> list[dict[str, Any]]:
    """How often each combination of values occurs in these columns, as ``n``."""
    rows = session.table(table, columns=columns).to_arrow()
    plain = pa.Table.from_arrays([rows[name].cast(pa.string()) for name in columns], names=list(columns))
    counted: list[dict[str, Any]] = plain.group_by(list(columns)).aggregate([([], "count_all")]).to_pylist()
    return [{"n": row.pop("count_all"), **row} for row in counted]


def describe_boxes(session: Session) -> list[dict[str, Any]]:
    """Size and name of every object that is a known box."""
    return [
        {"object_id": object_id, "name": box.name, "size_m": list(box.size_m)}
        for object_id, box in boxes_of(session).items()
    ]


def describe_bodies(session: Session) -> list[dict[str, Any]]:
    """Every body with its joints, and the bones between those it has."""
    if not session.has_table("joints"):
        return []
    bodies: dict[tuple[str, str | None], set[str]] = {}
    for row in _counted(session, "joints", "body", "object_id", "joint"):
        bodies.setdefault((row["body"], row["object_id"]), set()).add(row["joint"])
    return [
        {
            "body": int(body),
            "object_id": object_id,
            "joints": sorted(joints),
            "bones": [[a, b] for a, b in BONES if a in joints and b in joints],
        }
        for (body, object_id), joints in sorted(
            bodies.items(), key=lambda item: (int(item[0][0]), item[0][1] or "")
        )
    ]


def describe_plane(session: Session) -> dict[str, Any] | None:
    """The table, in ``camera/depth``: the last plane that was fitted, and its outline where that is known.

    ``n . p + d = 0``; ``origin`` and ``rotation`` (quaternion x, y, z, w) take points of ``table`` to ``camera/depth``.
    """
    if not session.has_table("table_plane"):
        return None
    rows = session.table("table_plane").to_arrow()
    if not rows.num_rows:
        return None
    numbers = [rows[name][-1].as_py() for name in _PLANE]
    outline: list[list[float]] = []
    if session.has_table("table_outline"):
        corners = session.table("table_outline", columns=("frame", "x", "y", "z")).to_arrow().to_pylist()
        last = max((row["frame"] for row in corners), default=0)
        outline = [[row["x"], row["y"], row["z"]] for row in corners if row["frame"] == last]
    return {
        "normal": numbers[:3],
        "d": numbers[3],
        "origin": numbers[4:7],
        "rotation": numbers[7:],
        "outline": outline,
    }


def describe_camera(camera: Camera) -> dict[str, Any]:
    """A camera as the manifest has it."""
    names = ("name", "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "mirrored", "reference")
    found = {name: getattr(camera, name) for name in names}
    lists = {name: list(getattr(camera, name)) for name in ("distortion", "rotation", "translation_m")}
    return found | lists
