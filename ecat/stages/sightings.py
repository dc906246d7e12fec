"""From marker tables to arrays: which corners of which box are seen in which frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.boxes import (
    corner_order,
    from_leftmost,
    match_codes,
    pair_corners,
    plausible,
    project_ring,
)
from ecat.geometry.boxfit import Noise, Sightings, corner_sharpness
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats
from ecat.model.prototype import BoxPrototype

PIXELS = tuple(f"{axis}{i}_px" for i in range(4) for axis in "uv")
PLANE = ("nx", "ny", "nz", "d", "sigma_m")
POINTS = tuple(f"{axis}{i}" for i in range(4) for axis in "xyz")


@dataclass(frozen=True)
class Faces:
    """Marker faces as detected, row by row: rings of corners as the detector wrote them, NaN = missing.

    ``frame`` (n,), ``object_id`` and ``code`` n strings, ``pixels`` (n, 4, 2), ``points`` (n, 4, 3) paired
    with the pixels, both starting at the leftmost corner and running clockwise on the screen; ``planes`` (n, 5) the
    plane that depth shows there: unit normal, offset, sigma in metres; ``row`` (n,) the face's row among those of
    markers_2d that have a code, then markers_3d's.
    """

    frame: NDArray[np.int64]
    object_id: list[str]
    code: list[str]
    pixels: Floats
    points: Floats
    planes: Floats
    row: NDArray[np.intp]


@dataclass(frozen=True)
class BoxSightings:
    """All that is seen of one object: which prototype it is, and its corners in each frame (n,) it is seen
    in.
    """

    object_id: str
    prototype: int
    frame: NDArray[np.int64]
    seen: Sightings


def read_faces(
    markers_2d: pa.Table | None,
    markers_3d: pa.Table | None,
    camera: Camera,
    face_planes: pa.Table | None = None,
) -> Faces:
    """Join the tables ``markers_2d``, ``markers_3d`` and ``face_planes`` (all may be None) by frame, object and order.

    Faces with missing 2-D corners are kept when at least three of their 3-D corners are known: their
    projections tell which corner is the leftmost (ECAT 2018 file format §0.3-0.4).
    """
    flat = _column_block(markers_2d, PIXELS)
    solid = _column_block(markers_3d, POINTS)
    rows = {key: i for i, key in enumerate(solid.keys)}
    met = np.array([rows.get(key, -1) for key in flat.keys], dtype=np.int64)
    pixels = flat.values.reshape(-1, 4, 2)
    points = np.full((len(pixels), 4, 3), np.nan)
    points[met >= 0] = solid.values[met[met >= 0]].reshape(-1, 4, 3)
    points = np.take_along_axis(points, pair_corners(pixels, points, camera)[..., None], 1)
    alone = np.setdiff1d(np.arange(len(solid.keys)), met)
    keys = flat.keys + [solid.keys[i] for i in alone]
    code = flat.code + [solid.code[i] for i in alone]
    pixels = np.concatenate([pixels, np.full((len(alone), 4, 2), np.nan)])
    points = np.concatenate([points, solid.values[alone].reshape(-1, 4, 3)])
    ring = np.where(np.isfinite(pixels).all(-1, keepdims=True), pixels, project_ring(points, camera))
    known = plausible(ring)
    start = from_leftmost(ring)[..., None]
    pixels, points = (np.take_along_axis(corners, start, 1)[known] for corners in (pixels, points))
    kept = np.flatnonzero(known)
    frame = np.array([keys[i][0] for i in kept], dtype=np.int64)
    planes = _planes(face_planes, [keys[i] for i in kept])
    return Faces(frame, [keys[i][1] for i in kept], [code[i] for i in kept], pixels, points, planes, kept)


def _planes(face_planes: pa.Table | None, keys: Sequence[tuple[int, str, int]]) -> Floats:
    """Planes (n, 5) of faces, NaN where depth shows none."""
    planes = np.full((len(keys), 5), np.nan)
    if face_planes is None or not face_planes.num_rows:
        return planes
    columns = [face_planes[name].to_numpy(zero_copy_only=False) for name in PLANE]
    values = np.stack([np.asarray(column, float) for column in columns], -1)
    frame, order = (face_planes[name].to_numpy().tolist() for name in ("frame", "order"))
    names = _strings(face_planes, "object_id")
    rows = {key: i for i, key in enumerate(zip(frame, names, order, strict=True))}
    met = np.array([rows.get(key, -1) for key in keys], np.int64)
    planes[met >= 0] = values[met[met >= 0]]
    return planes


@dataclass(frozen=True)
class _Block:
    keys: list[tuple[int, str, int]]
    code: list[str]
    values: Floats


def _column_block(table: pa.Table | None, names: Sequence[str]) -> _Block:
    """Rows with a code: (frame, object, order), code, and the named columns (n, len(names)), null as NaN."""
    if table is None:
        return _Block([], [], np.empty((0, len(names))))
    table = table.filter(pc.is_valid(table["code"]))
    columns = [table[name].to_numpy(zero_copy_only=False) for name in names]
    columns = [np.asarray(column, float) for column in columns]
    frame, order = table["frame"].to_numpy().tolist(), table["order"].to_numpy().tolist()
    objects, codes = (_strings(table, name) for name in ("object_id", "code"))
    return _Block(list(zip(frame, objects, order, strict=True)), codes, np.stack(columns, -1))


def _strings(table: pa.Table, name: str) -> list[str]:
    return [str(value) for value in table[name].to_pylist()]


def box_sightings(
    faces: Faces, prototypes: Sequence[BoxPrototype], camera: Camera, noise: Noise
) -> list[BoxSightings]:
    """The faces sorted by object; an object is the prototype that most of its codes belong to.

    A face seen twice in a frame counts once, the first (largest) one.  Objects without a known code are left
    out.
    """
    known = match_codes(faces.code, prototypes, mirrored=camera.mirrored)
    orders = np.stack([corner_order(k, mirrored=camera.mirrored) for k in range(4)])
    found: list[BoxSightings] = []
    objects = np.array(faces.object_id, dtype=object)
    match = np.array([known.get(code, (-1, -1, 0)) for code in faces.code], dtype=np.int64).reshape(-1, 3)
    for object_id in sorted(set(faces.object_id)):
        mine = (objects == object_id) & (match[:, 0] >= 0)
        if not mine.any():
            continue
        prototype = int(np.bincount(match[mine, 0]).argmax())
        rows = np.flatnonzero(mine & (match[:, 0] == prototype))[::-1]
        frame, place = np.unique(faces.frame[rows], return_inverse=True)
        shape = (len(frame), len(prototypes[prototype].faces), 4)
        pixels, points = np.full((*shape, 2), np.nan), np.full((*shape, 3), np.nan)
        corner = orders[match[rows, 2]][..., None]
        pixels[place, match[rows, 1]] = np.take_along_axis(faces.pixels[rows], corner, 1)
        points[place, match[rows, 1]] = np.take_along_axis(faces.points[rows], corner, 1)
        planes = None
        if np.isfinite(faces.planes[rows]).any():
            planes = np.full((*shape[:2], 5), np.nan)
            planes[place, match[rows, 1]] = faces.planes[rows]
        sharpness = np.nan_to_num(corner_sharpness(pixels, noise))
        seen = Sightings(pixels, points, sharpness, planes)
        found.append(BoxSightings(object_id, prototype, frame, seen))
    return found
