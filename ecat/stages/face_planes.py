"""Planes through the depth inside marker faces: which way a face leans, where its corners leave that open."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.boxes import corner_order, match_codes, square_poses
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.depth import RangeNoise
from ecat.geometry.faceplanes import FaceFit, fit_faces
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.sightings import Faces, read_faces
from ecat.stages.stage import Stage, Tables
from ecat.tables import FACE_PLANES


@dataclass(frozen=True)
class FacePlaneParameters:
    """``prototypes`` tell how large the faces are, and so roughly how far away.

    ``max_gap_s``: the depth image nearest in time is not used if it is further away.  ``steady_m``: error of depth that
    repeats itself all over a face.  ``noise``: how far single pixels scatter.  ``shrink``, ``margin_px``: what of a
    face is used; pixels near its outline may show what is behind it.  ``min_points``: with fewer, there is no plane.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    max_gap_s: float = 0.02
    steady_m: float = 0.006
    noise: RangeNoise = field(default_factory=RangeNoise)
    shrink: float = 0.9
    margin_px: float = 1.0
    min_points: int = 12


def fit_face_planes(
    markers_2d: pa.Table, depth: Images, parameters: FacePlaneParameters | None = None
) -> pa.Table:
    """The table ``face_planes``: a row for every marker face in whose middle depth shows a plane.

    Depth images without a camera, or too far away in time, show none.

    Raises
    ------
    CorruptError : the depth images cannot be decoded any further.
    """
    parameters = parameters or FacePlaneParameters()
    known = pc.and_(pc.is_valid(markers_2d["code"]), pc.is_valid(markers_2d["order"]))
    markers_2d = markers_2d.filter(known)
    faces = read_faces(markers_2d, None, parameters.camera)
    rows, rings, sides = _sized(faces, parameters)
    if depth.camera is None or not len(depth) or not len(rows):
        return FACE_PLANES.arrow.empty_table()
    centre = square_poses(rings, sides, parameters.camera)[0].translation
    quads = depth_pixels(rings, centre, parameters.camera, depth.camera)
    marked = faces.row[rows]
    image = _nearest(markers_2d, marked, depth, parameters.max_gap_s)
    use = (image >= 0) & np.isfinite(quads).all((1, 2))
    marked, quads, image = marked[use], quads[use], image[use]
    if not len(image):
        return FACE_PLANES.arrow.empty_table()
    fits: list[FaceFit] = []
    found: list[NDArray[np.intp]] = []
    by = np.argsort(image, kind="stable")
    groups = np.split(by, np.flatnonzero(np.diff(image[by])) + 1)
    for picture, group in zip(depth.read([int(image[group[0]]) for group in groups]), groups, strict=True):
        fits.append(
            fit_faces(
                picture,
                quads[group],
                depth.camera,
                unit_m=depth.unit_m,
                noise=parameters.noise,
                steady_m=parameters.steady_m,
                shrink=parameters.shrink,
                margin_px=parameters.margin_px,
            )
        )
        found.append(group)
    return _table(markers_2d, marked[np.concatenate(found)], FaceFit.joined(fits), parameters.min_points)


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
    after = np.clip(np.searchsorted(there, when), 0, len(there) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(there[before] - when) <= np.abs(there[after] - when), before, after)
    return np.where(np.abs(there[nearest] - when) <= gap, nearest, -1)


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


FACE_PLANES_STAGE = Stage(
    name="face_planes",
    version=1,
    inputs=("markers_2d",),
    outputs=("face_planes",),
    parameters=FacePlaneParameters,
    run=_run,
    images=("depth",),
)
