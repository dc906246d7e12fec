"""The table frame after the camera was moved, tied to the one before by what stood still meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.geometry.boxfit import Noise
from ecat.geometry.boxpose import box_poses
from ecat.geometry.cameras import Camera
from ecat.geometry.rest import Stillness, box_places, find_rests
from ecat.geometry.standpoints import common_motion, outline_motion
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype
from ecat.stages.pose import table_frames
from ecat.stages.sightings import BoxSightings

LOOKED_AT = 300
"""Frames before and after a move of the camera in which boxes at rest are looked for."""
_EDGE_PX = 3.0


def tied(
    table_plane: pa.Table,
    boxes: Sequence[BoxSightings],
    prototypes: Sequence[BoxPrototype],
    camera: Camera | None,
    noise: Noise,
    *,
    outlines: pa.Table | None = None,
    depth_camera: Camera | None = None,
) -> pa.Table:
    """The table ``table_plane`` with each row's frame turned and shifted on its plane so that what stood still while
    the camera was moved keeps its place; ``tie`` says what that was.

    Boxes that rest before and after, and of several those that agree, tie two frames; without any, the table's outline,
    if all of it is in view both times (``outlines``: the table ``table_outline`` of these planes).  The camera is then
    taken to have turned by less than a quarter about the table's normal.  ``camera``: that saw the boxes.
    """
    rows = sorted(table_plane.to_pylist(), key=lambda row: int(row["frame"]))
    frames = table_frames(table_plane)
    for k in range(1, len(rows)):
        (start, before), (cut, after) = frames[k - 1], frames[k]
        end = frames[k + 1][0] if k + 1 < len(frames) else cut + LOOKED_AT
        spans = (max(start, cut - LOOKED_AT), cut), (cut, min(end, cut + LOOKED_AT))
        seen = [
            (one, other)
            for box in boxes
            if camera is not None
            and (one := _rested(box, prototypes, camera, noise, table=before, span=spans[0], last=True))
            is not None
            and (other := _rested(box, prototypes, camera, noise, table=after, span=spans[1], last=False))
            is not None
        ]
        pairs = np.array(seen, float).reshape(-1, 2, 4, 2)
        motion, rows[k]["tie"] = common_motion(pairs[:, 0], pairs[:, 1]), "boxes"
        if motion is None and outlines is not None and depth_camera is not None:
            motion, rows[k]["tie"] = (
                _by_outline(outlines, (start, before), (cut, after), depth_camera),
                "outline",
            )
        if motion is None:
            rows[k]["tie"] = None
            continue
        frames[k] = cut, after @ motion.inverse()
        rows[k] |= _frame_columns(frames[k][1])
    return pa.Table.from_pylist(rows, schema=table_plane.schema)


def _frame_columns(table: Rigid) -> dict[str, Any]:
    names = [f"origin_{axis}" for axis in "xyz"] + ["qx", "qy", "qz", "qw"]
    return dict(zip(names, [*table.translation.tolist(), *table.quaternion.tolist()], strict=True))


def _rested(
    box: BoxSightings,
    prototypes: Sequence[BoxPrototype],
    camera: Camera,
    noise: Noise,
    *,
    table: Rigid,
    span: tuple[int, int],
    last: bool,
) -> Floats | None:
    """Corners (4, 2) on the table of a box at its last, or else its first, rest within a span of frames."""
    rows = np.flatnonzero((box.frame >= span[0]) & (box.frame < span[1]))
    if not rows.size:
        return None
    found = box_poses(box.seen[rows], prototypes[box.prototype], camera, table, noise=noise)
    good = np.flatnonzero((found.n_faces > 0) & ~found.free)
    pose = Rigid(found.pose.rotation[good], found.pose.translation[good])
    places = box_places(pose, np.array(prototypes[box.prototype].size_m))
    rests = find_rests(box.frame[rows[good]] / 30.0, places, found.sigma_m[good], Stillness())
    if not rests:
        return None
    place = rests[-1].end if last else rests[0].begin
    x, y = place[3:5], place[6:8]
    return place[:2] + np.stack([x + y, y - x, -x - y, x - y])


def _by_outline(
    outlines: pa.Table, before: tuple[int, Rigid], after: tuple[int, Rigid], camera: Camera
) -> Rigid | None:
    rings: list[Floats] = []
    for frame, table in (before, after):
        rows = outlines.filter(pc.field("frame") == frame)
        ring = np.stack([np.asarray(rows[axis].to_numpy(), float) for axis in "xyz"], -1)
        pixels = camera.project(ring)
        inside = (pixels > _EDGE_PX) & (pixels < np.array([camera.width, camera.height]) - 1 - _EDGE_PX)
        if len(ring) < 3 or not inside.all():
            return None
        rings.append(table.inverse().apply(ring)[:, :2])
    return outline_motion(rings[0], rings[1])


def cuts(table_plane: pa.Table | None) -> list[int]:
    """The frames from which on the table frame has nothing in common with the one before."""
    rows = [] if table_plane is None else table_plane.to_pylist()
    rows.sort(key=lambda row: int(row["frame"]))
    return [int(row["frame"]) for row in rows[1:] if row.get("tie") is None]


def pieces(table: pa.Table, table_plane: pa.Table | None) -> Iterator[pa.Table]:
    """The rows of a table with the column ``frame``, in stretches within which places on the table are comparable."""
    bounds = [None, *cuts(table_plane), None]
    for start, end in pairwise(bounds):
        part = table if start is None else table.filter(pc.field("frame") >= start)
        yield part if end is None else part.filter(pc.field("frame") < end)
