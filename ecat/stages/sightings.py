"""From marker tables to arrays: which corners of which box are seen in which frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
from ecat.geometry.detection import Found
from ecat.geometry.transforms import Floats
from ecat.model.prototype import BoxPrototype

PIXELS = tuple(f"{axis}{i}_px" for i in range(4) for axis in "uv")
PLANE = ("nx", "ny", "nz", "d", "sigma_m")
POINTS = tuple(f"{axis}{i}" for i in range(4) for axis in "xyz")
_ORDERS = 1 << 16


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
    met = _met(flat.keys, solid.keys)
    pixels = flat.values.reshape(-1, 4, 2)
    points = np.full((len(pixels), 4, 3), np.nan)
    paired = np.flatnonzero(met >= 0)
    solid_points = solid.values[met[paired]].reshape(-1, 4, 3)
    order = pair_corners(pixels[paired], solid_points, camera)
    points[paired] = np.take_along_axis(solid_points, order[..., None], 1)
    alone = np.setdiff1d(np.arange(len(solid.code)), met)
    code = flat.code + [solid.code[i] for i in alone]
    pixels = np.concatenate([pixels, np.full((len(alone), 4, 2), np.nan)])
    points = np.concatenate([points, solid.values[alone].reshape(-1, 4, 3)])
    ring = pixels.copy()
    gaps = np.flatnonzero(
        ~np.isfinite(pixels).all((1, 2))
    )  # few if any, and an hour has half a million faces
    missing = ~np.isfinite(pixels[gaps]).all(-1, keepdims=True)
    ring[gaps] = np.where(missing, project_ring(points[gaps], camera), pixels[gaps])
    known = plausible(ring)
    start = from_leftmost(ring)[..., None]
    pixels, points = (np.take_along_axis(corners, start, 1)[known] for corners in (pixels, points))
    kept = np.flatnonzero(known)
    keys = _Keys.joined(flat.keys, solid.keys[alone])[kept]
    planes = _planes(face_planes, keys)
    return Faces(keys.frame, keys.name, [code[i] for i in kept], pixels, points, planes, kept)


@dataclass(frozen=True)
class _Keys:
    """What tells faces (n,) apart: ``frame`` (n,), ``name`` n objects, ``order`` (n,)."""

    frame: NDArray[np.int64]
    name: list[str]
    order: NDArray[np.int64]

    def __getitem__(self, rows: NDArray[np.intp]) -> _Keys:
        return _Keys(self.frame[rows], [self.name[i] for i in rows], self.order[rows])

    @classmethod
    def of(cls, table: pa.Table) -> _Keys:
        frame, order = (table[name].to_numpy().astype(np.int64) for name in ("frame", "order"))
        return cls(frame, strings(table, "object_id"), order)

    @classmethod
    def none(cls) -> _Keys:
        return cls(np.empty(0, np.int64), [], np.empty(0, np.int64))

    @classmethod
    def joined(cls, one: _Keys, other: _Keys) -> _Keys:
        frame, order = (
            np.concatenate([getattr(keys, name) for keys in (one, other)]) for name in ("frame", "order")
        )
        return cls(frame, one.name + other.name, order)

    def numbers(self, places: Mapping[str, int]) -> NDArray[np.int64]:
        """One number (n,) for each, by the place of its name."""
        name = np.array([places[name] for name in self.name], np.int64)
        return (self.frame * len(places) + name) * _ORDERS + self.order


def _met(keys: _Keys, others: _Keys) -> NDArray[np.int64]:
    """Where among the others each key is (n,), the last where there are several, -1 if it is not."""
    if not len(others.name):
        return np.full(len(keys.name), -1)
    places = {name: i for i, name in enumerate({*keys.name, *others.name})}
    wanted, there = keys.numbers(places), others.numbers(places)
    by = np.argsort(there, kind="stable")
    at = by[np.searchsorted(there, wanted, side="right", sorter=by) - 1]
    return np.where(there[at] == wanted, at, -1)


def _planes(face_planes: pa.Table | None, keys: _Keys) -> Floats:
    """Planes (n, 5) of faces, NaN where depth shows none."""
    planes = np.full((len(keys.name), 5), np.nan)
    if face_planes is None or not face_planes.num_rows:
        return planes
    columns = [face_planes[name].to_numpy(zero_copy_only=False) for name in PLANE]
    values = np.stack([np.asarray(column, float) for column in columns], -1)
    met = _met(keys, _Keys.of(face_planes))
    planes[met >= 0] = values[met[met >= 0]]
    return planes


@dataclass(frozen=True)
class _Block:
    keys: _Keys
    code: list[str]
    values: Floats


def _column_block(table: pa.Table | None, names: Sequence[str]) -> _Block:
    """Rows with a code: their keys, codes, and the named columns (n, len(names)), null as NaN."""
    if table is None:
        return _Block(_Keys.none(), [], np.empty((0, len(names))))
    table = table.filter(pc.is_valid(table["code"]))
    columns = [table[name].to_numpy(zero_copy_only=False) for name in names]
    columns = [np.asarray(column, float) for column in columns]
    return _Block(_Keys.of(table), strings(table, "code"), np.stack(columns, -1))


def strings(table: pa.Table, name: str) -> list[str]:
    """A column as strings, equal ones being the same object: of an hour's markers there are half a million."""
    column = table[name].cast(pa.string()).combine_chunks().dictionary_encode()
    words = [*map(str, column.dictionary.to_pylist()), str(None)]
    return [words[i] for i in column.indices.fill_null(-1).to_numpy().tolist()]


def object_prototypes(
    markers: Sequence[pa.Table | None], prototypes: Sequence[BoxPrototype], *, mirrored: bool
) -> dict[str, int]:
    """The prototype of each object, by its index: the one that most of its codes belong to; sorted by object."""
    votes: Counter[tuple[str, str]] = Counter()
    for table in markers:
        if table is not None:
            names = ["object_id", "code"]
            words = pa.Table.from_arrays([table[name].cast(pa.string()) for name in names], names=names)
            counted = words.group_by(words.column_names).aggregate([([], "count_all")])
            pairs = zip(strings(counted, "object_id"), strings(counted, "code"), strict=True)
            votes.update(dict(zip(pairs, counted["count_all"].to_pylist(), strict=True)))
    known = match_codes([code for _, code in votes], prototypes, mirrored=mirrored)
    boxes: dict[str, Counter[int]] = {}
    for (name, code), n in sorted(votes.items()):
        if code in known:
            boxes.setdefault(name, Counter())[known[code][0]] += n
    return {name: vote.most_common(1)[0][0] for name, vote in sorted(boxes.items())}


def box_sightings(
    faces: Faces,
    prototypes: Sequence[BoxPrototype],
    camera: Camera,
    noise: Noise,
    objects: Mapping[str, int] | None = None,
) -> list[BoxSightings]:
    """The faces sorted by object; an object is the prototype (by its index) that ``objects`` says, or else the one that
    most of its codes belong to.

    A face seen twice in a frame counts once, the first (largest) one.  Objects without a known code are left
    out.
    """
    known = match_codes(faces.code, prototypes, mirrored=camera.mirrored)
    orders = np.stack([corner_order(k, mirrored=camera.mirrored) for k in range(4)])
    found: list[BoxSightings] = []
    names = np.array(faces.object_id, dtype=object)
    match = np.array([known.get(code, (-1, -1, 0)) for code in faces.code], dtype=np.int64).reshape(-1, 3)
    for object_id in sorted(set(faces.object_id)):
        mine = (names == object_id) & (match[:, 0] >= 0)
        if not mine.any():
            continue
        prototype = int(np.bincount(match[mine, 0]).argmax()) if objects is None else objects[object_id]
        rows = np.flatnonzero(mine & (match[:, 0] == prototype))[::-1]
        if not len(rows):
            continue
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


@dataclass(frozen=True)
class FoundInAll:
    """Faces (n,) that were found in a video, image after image: what of them becomes a row of ``markers_2d``."""

    image: NDArray[np.int32]
    box: NDArray[np.int16]
    face: NDArray[np.int16]
    rings: Floats

    @classmethod
    def of(cls, image: int, found: Found) -> FoundInAll:
        """Those of the image with this index."""
        numbers = np.full(len(found), image, np.int32)
        return cls(numbers, found.box.astype(np.int16), found.face.astype(np.int16), found.rings)

    @classmethod
    def joined(cls, parts: Sequence[FoundInAll]) -> FoundInAll:
        """All of them, one after the other."""
        names = ("image", "box", "face", "rings")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def __getitem__(self, rows: NDArray[Any] | slice) -> FoundInAll:
        return FoundInAll(self.image[rows], self.box[rows], self.face[rows], self.rings[rows])
