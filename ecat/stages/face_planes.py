"""Planes through the depth inside marker faces: which way a face leans, where its corners leave that open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.boxes import corner_order, match_codes, square_poses
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.depth import DepthCamera, RangeNoise
from ecat.geometry.faceplanes import FaceFit, fit_faces
from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import Images, ImagesByKind, read_parts
from ecat.stages.rows import Given, Rows, rows_of, stretches
from ecat.stages.sightings import PIXELS, Faces, read_faces
from ecat.stages.stage import Stage, Tables
from ecat.tables import FACE_PLANES

_FRAMES_AT_ONCE = 2048
_TOGETHER = 16
"""Depth images whose faces are fitted at once."""


@dataclass(frozen=True)
class FacePlaneParameters:
    """``prototypes`` tell how large the faces are, and so roughly how far away.

    ``max_gap_s``: the depth image nearest in time is not used if it is further away.  ``still_px``, ``still_images``: a
    face whose corners stay within so many pixels still shows the plane that was measured last, for so many depth
    images, which need not be decoded if all their faces stand still.  ``steady_m``: error of depth that repeats itself
    all over a face.  ``noise``: how far single pixels scatter.  ``shrink``, ``margin_px``: what of a
    face is used; pixels near its outline may show what is behind it.  ``min_points``: with fewer, there is no plane.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    max_gap_s: float = 0.02
    still_px: float = 0.3
    still_images: int = 8
    steady_m: float = 0.006
    noise: RangeNoise = field(default_factory=RangeNoise)
    shrink: float = 0.9
    margin_px: float = 1.0
    min_points: int = 12


def fit_face_planes(
    markers_2d: Given, depth: Images, parameters: FacePlaneParameters | None = None
) -> pa.Table:
    """The table ``face_planes``: a row for every marker face in whose middle depth shows a plane.

    Depth images without a camera, or too far away in time, show none.

    Raises
    ------
    CorruptError : the depth images cannot be decoded any further.
    """
    parts = _parts(rows_of(markers_2d), depth, parameters or FacePlaneParameters())
    return pa.concat_tables([FACE_PLANES.arrow.empty_table(), *parts])


def _parts(markers_2d: Rows, depth: Images, parameters: FacePlaneParameters) -> Iterator[pa.Table]:
    """The rows of some frames at a time: an hour of faces with all that is known of them takes much memory."""
    if depth.camera is None or not len(depth):
        return
    camera = DepthCamera(depth.camera, depth.unit_m)
    for marks in stretches(markers_2d, _FRAMES_AT_ONCE):
        known = pc.and_(pc.is_valid(marks["code"]), pc.is_valid(marks["order"]))
        yield _planes(marks.filter(known), depth, camera, parameters)


def _planes(
    markers_2d: pa.Table, depth: Images, camera: DepthCamera, parameters: FacePlaneParameters
) -> pa.Table:
    """The rows of ``face_planes`` for some markers, all with codes."""
    faces = read_faces(markers_2d, None, parameters.camera)
    rows, rings, sides = _sized(faces, parameters)
    if not len(rows):
        return FACE_PLANES.arrow.empty_table()
    centre = square_poses(rings, sides, parameters.camera)[0].translation
    quads = depth_pixels(rings, centre, parameters.camera, camera.camera)
    marked = faces.row[rows]
    image = _nearest(markers_2d, marked, depth, parameters.max_gap_s)
    use = (image >= 0) & np.isfinite(quads).all((1, 2))
    marked, quads, image = marked[use], quads[use], image[use]
    if not len(image):
        return FACE_PLANES.arrow.empty_table()
    by = np.argsort(image, kind="stable")
    marked, quads, image = marked[by], quads[by], image[by]
    measured = _measured(markers_2d, marked, image, parameters)
    own = np.flatnonzero(measured == np.arange(len(measured)))
    fits = _fits(_pictures(depth, image[own], quads[own]), image[own], quads[own], camera, parameters)
    fit = FaceFit.joined(list(fits))[np.searchsorted(own, measured)]
    return _table(markers_2d, marked, fit, parameters.min_points)


def _pictures(depth: Images, image: NDArray[np.int64], quads: Floats) -> Iterator[NDArray[Any]]:
    """Each ``image`` (n,), ascending, once, decoded at least where its ``quads`` (n, 4, 2) are."""
    low, high = np.floor(quads.min(1)).astype(int), np.ceil(quads.max(1)).astype(int) + 1
    indices, starts = np.unique(image, return_index=True)
    boxes = [(left, top, right, bottom) for left, top, right, bottom in np.hstack([low, high]).tolist()]
    parts = [boxes[start:end] for start, end in pairwise([*starts.tolist(), len(boxes)])]
    return read_parts(depth, indices.tolist(), parts)


def _fits(
    pictures: Iterator[NDArray[Any]],
    image: NDArray[np.int64],
    quads: Floats,
    camera: DepthCamera,
    parameters: FacePlaneParameters,
) -> Iterator[FaceFit]:
    """Planes of ``quads`` (n, 4, 2), each in ``image`` (n,) ascending, of some images at a time: less work than one."""
    _, starts, which = np.unique(image, return_index=True, return_inverse=True)
    for block in np.split(np.arange(len(image)), starts[_TOGETHER::_TOGETHER]):
        yield fit_faces(
            islice(pictures, int(which[block[-1]] - which[block[0]]) + 1),
            quads[block],
            which[block],
            camera,
            noise=parameters.noise,
            steady_m=parameters.steady_m,
            shrink=parameters.shrink,
            margin_px=parameters.margin_px,
        )


def _measured(
    markers_2d: pa.Table, marked: NDArray[np.intp], image: NDArray[np.int64], parameters: FacePlaneParameters
) -> NDArray[np.intp]:
    """For each of the rows ``marked`` of depth images ``image`` (n,), ascending, that (n,) whose plane it has: its own,
    or where it is still the same, that of an image before.
    """
    columns = [markers_2d[name].to_numpy()[marked] for name in PIXELS]
    corners = np.stack([np.asarray(column, float) for column in columns], -1)
    names = [markers_2d[name].cast(pa.string()).combine_chunks() for name in ("object_id", "code")]
    thing, code = (name.dictionary_encode().indices.to_numpy()[marked] for name in names)
    face = thing.astype(np.int64) * (int(code.max()) + 1) + code
    last = np.full(face.max() + 1, -1)
    measured = np.arange(len(marked))
    starts = np.flatnonzero(np.diff(image, prepend=-1))
    for start, end in zip(starts, [*starts[1:], len(image)], strict=True):
        before = last[face[start:end]]
        recent = (before >= 0) & (image[start] - image[before] < parameters.still_images)
        if (recent & (np.abs(corners[start:end] - corners[before]).max(1) <= parameters.still_px)).all():
            measured[start:end] = before
        else:
            last[face[start:end]] = np.arange(start, end)
    return measured


def depth_pixels(rings: Floats, centre: Floats, color: Camera, depth: Camera) -> Floats:
    """Where in the depth image (n, 4, 2) the corners of markers are, all as far away as the marker's middle.

    Parameters
    ----------
    rings : (n, 4, 2) pixels of the colour image.
    centre : (n, 3) in the reference frame of both cameras, metres.
    """
    away = color.from_reference.apply(centre)[:, 2]
    points = color.unproject(rings) * away[:, None, None]
    return depth.project(color.from_reference.inverse().apply(points))


def _sized(faces: Faces, parameters: FacePlaneParameters) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Rows whose codes are known, with their corners (n, 4, 2) in the marker's own order and sides (n,) in metres."""
    mirrored = parameters.camera.mirrored
    known = match_codes(faces.code, parameters.prototypes, mirrored=mirrored)
    rows = np.array([i for i, code in enumerate(faces.code) if code in known], np.intp)
    orders = np.array(
        [corner_order(known[faces.code[i]][2], mirrored=mirrored) for i in rows], np.intp
    ).reshape(-1, 4)
    rings = np.take_along_axis(faces.pixels[rows], orders[..., None], 1)
    sides = [
        parameters.prototypes[known[faces.code[i]][0]].faces[known[faces.code[i]][1]].side_m for i in rows
    ]
    return rows, rings, np.array(sides)


def _nearest(markers_2d: pa.Table, rows: NDArray[Any], depth: Images, max_gap_s: float) -> NDArray[np.int64]:
    """The depth image (n,) taken nearest in time to each row, -1 where that is too far away."""
    timed = depth.t_ns is not None and not markers_2d["t_ns"].null_count
    name, there, gap = ("t_ns", depth.t_ns, max_gap_s * 1e9) if timed else ("frame", depth.frame, 0)
    there = np.asarray(there, np.int64)
    when = markers_2d[name].to_numpy()[rows].astype(np.int64)
    return nearest_in_time(there, when, within=gap)


def _table(markers_2d: pa.Table, rows: NDArray[Any], fit: FaceFit, min_points: int) -> pa.Table:
    good = np.flatnonzero((fit.n_points >= min_points) & np.isfinite(fit.sigma_m))
    good = good[np.argsort(rows[good], kind="stable")]
    marks = markers_2d.take(rows[good])
    columns: dict[str, Any] = {
        name: marks[name].combine_chunks() for name in ("t_ns", "frame", "object_id", "order")
    }
    columns |= {
        name: pa.array(values) for name, values in zip(("nx", "ny", "nz"), fit.normal[good].T, strict=True)
    }
    for name, values in (
        ("d", fit.offset),
        ("sigma_m", fit.sigma_m),
        ("rms_m", fit.rms_m),
        ("n_points", fit.n_points),
    ):
        columns[name] = pa.array(values[good])
    schema = FACE_PLANES.arrow
    return pa.Table.from_arrays([columns[f.name].cast(f.type) for f in schema], schema=schema)


def _run(tables: Tables, images: ImagesByKind, parameters: FacePlaneParameters) -> dict[str, pa.Table]:
    return {"face_planes": fit_face_planes(tables["markers_2d"], images["depth"], parameters)}


def _run_parts(tables: Tables, images: ImagesByKind, parameters: FacePlaneParameters) -> Iterator[pa.Table]:
    return _parts(rows_of(tables["markers_2d"]), images["depth"], parameters)


FACE_PLANES_STAGE = Stage(
    name="face_planes",
    version=2,
    inputs=("markers_2d",),
    partly=("markers_2d",),
    outputs=("face_planes",),
    parameters=FacePlaneParameters,
    run=_run,
    parts=_run_parts,
    images=("depth",),
)
