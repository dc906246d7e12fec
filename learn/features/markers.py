"""One marker of each box, frame by frame, and where a box lies on the table.

The corners of a marker begin with the leftmost in the Kinect's image, which shows left for right, and go around
clockwise in it: that is how its detector gave them, and how they are in learning exports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners
from ecat.geometry.transforms import Rigid, matrix_from_quaternion
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.process import kept_prototypes
from ecat.process.inputs import annotated_objects, box_objects, sane
from ecat.store import Session
from learn.features.points import KINECT_FROM_CAMERA

Floats = NDArray[np.float64]
_QUARTER = np.pi / 2


def marker_corners(
    session: Session, n: int, poses: Mapping[str, Floats], planes: Sequence[tuple[int, Rigid]]
) -> dict[str, Floats]:
    """Of each box, the corners (n, 4, 3) of one marker in the Kinect's camera space, NaN where none was seen.

    Those of ``markers_3d``: of the markers of a box in a frame, the one of which most corners are known, and of equals
    the one that looks largest.  Without that table, those of boxes in ``poses`` on the table of ``planes``.
    """
    record = session.manifest.table("markers_3d")
    if record is not None and record.rows:
        return _recorded(sane(session.table("markers_3d").to_arrow()), n)
    if not poses or not planes:
        return {}
    boxes = kept_prototypes(session) or NOMINAL_BOXES
    by_object = dict(zip(box_objects(annotated_objects(session), boxes), boxes, strict=True))
    return {name: _turned(pose, by_object[name], planes) for name, pose in poses.items() if name in by_object}


def track_of(pose: Floats) -> Floats:
    """Of poses (n, 7) on the table, x, y, and the rotation of the edge that is most level, in [0, pi / 2): (n, 3)."""
    found = np.full((len(pose), 3), np.nan)
    known = np.isfinite(pose).all(axis=1)
    axes = matrix_from_quaternion(pose[known, 3:])
    level = np.abs(axes[:, 2]).argmin(axis=1)
    edge = np.take_along_axis(axes, level[:, None, None], axis=2)[:, :, 0]
    found[known, :2] = pose[known, :2]
    found[known, 2] = np.arctan2(edge[:, 1], edge[:, 0]) % _QUARTER % _QUARTER  # twice: -1e-17 % q is q
    return found


def texts(table: pa.Table, name: str) -> NDArray[np.str_]:
    """A column of names; empty where one is null."""
    return np.array([text or "" for text in table[name].cast(pa.string()).to_pylist()], np.str_)


def _recorded(marks: pa.Table, n: int) -> dict[str, Floats]:
    names = texts(marks, "object_id")
    frame = np.asarray(marks["frame"].to_numpy(), np.int64)
    corners = np.column_stack(
        [np.asarray(marks[f"{axis}{k}"].to_numpy(), np.float64) for k in range(4) for axis in "xyz"]
    ).reshape(-1, 4, 3)
    corners = np.where(np.isfinite(corners).all(axis=2, keepdims=True), corners, np.nan) * KINECT_FROM_CAMERA
    count = np.isfinite(corners[..., 0]).sum(axis=1)
    rank = np.lexsort((_area(corners), count))  # the best comes last, and is what stays
    found: dict[str, Floats] = {}
    for name in sorted(set(names.tolist())):
        mine = rank[(names[rank] == name) & (frame[rank] >= 0) & (frame[rank] < n) & (count[rank] > 0)]
        found[name] = np.full((n, 4, 3), np.nan)
        found[name][frame[mine]] = corners[mine]
    return found


def _area(corners: Floats) -> Floats:
    """How large markers (m, 4, 3) look; 0 where a corner is not known."""
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = corners[..., :2] / corners[..., 2:]
    across, along = seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1]
    return np.nan_to_num(np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]), posinf=0.0)


def _turned(pose: Floats, box: BoxPrototype, planes: Sequence[tuple[int, Rigid]]) -> Floats:
    """(n, 4, 3) the marker of a box in its poses (n, 7) that is turned most towards the camera."""
    camera_from_box, place = _in_camera(pose, planes)
    corners = np.einsum("nij,fkj->nfki", camera_from_box, box_corners(box)) + place[:, None, None]
    normals = matrix_from_quaternion(np.array([face.quaternion for face in box.faces]))[..., 2]
    middle = corners.mean(axis=2)
    facing = -(np.einsum("nij,fj->nfi", camera_from_box, normals) * middle).sum(axis=2)
    facing /= np.linalg.norm(middle, axis=2)
    best = np.nan_to_num(facing, nan=-1.0).argmax(axis=1)
    chosen = np.take_along_axis(corners, best[:, None, None, None], axis=1)[:, 0] * KINECT_FROM_CAMERA
    hidden = np.take_along_axis(facing, best[:, None], axis=1) <= 0
    return _from_leftmost(np.where(hidden[..., None], np.nan, chosen))


def _in_camera(pose: Floats, planes: Sequence[tuple[int, Rigid]]) -> tuple[Floats, Floats]:
    """Rotations (n, 3, 3) to the camera's axes from the box's, and its places (n, 3); NaN where not known."""
    known = np.isfinite(pose).all(axis=1)
    rotation, place = np.full((len(pose), 3, 3), np.nan), np.full((len(pose), 3), np.nan)
    rotation[known], place[known] = matrix_from_quaternion(pose[known, 3:]), pose[known, :3]
    starts = [frame for frame, _ in planes]
    which = np.maximum(np.searchsorted(starts, np.arange(len(pose)), side="right") - 1, 0)
    for number, (_, plane) in enumerate(planes):
        mine = which == number
        rotation[mine] = plane.rotation @ rotation[mine]
        place[mine] = plane.apply(place[mine])
    return rotation, place


def _from_leftmost(corners: Floats) -> Floats:
    """Corners (n, 4, 3) in the Kinect's order; a print's own goes around the other way in an image left for right."""
    ring = corners[:, ::-1]
    across = np.nan_to_num(ring[..., 0] / ring[..., 2])
    order = (across.argmin(axis=1)[:, None] + np.arange(4)) % 4
    return np.take_along_axis(ring, order[..., None], axis=1)
