"""The table's plane: from polygons that a person drew, from the boxes that stand on it, and from depth."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.boxes import square_poses
from ecat.geometry.boxfit import Noise
from ecat.geometry.bundle import Priors, Track, adjust
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.planes import PlaneFit, fit_plane, plane_frame
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion, quaternion_from_matrix
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.rows import Given, Rows, frames_of, rows_of, stretches
from ecat.stages.sightings import BoxSightings, box_sightings, read_faces
from ecat.stages.stage import Stage, Tables
from ecat.stages.table_depth import fit_table_in_depth, outline_table
from ecat.stages.tie import LOOKED_AT, tied
from ecat.tables import TABLE_PLANE

MIN_BOX_FRAMES, MOST_BOX_FRAMES = 20, 1000
"""Fewer frames with a box say less about the table than the polygon does, more say nothing new."""
_MOST_FRAMES = 6000
"""What is read of a recording to choose those from; all of an hour would fill half a gigabyte."""


@dataclass(frozen=True)
class PlaneParameters:
    """``camera``: of the colour images; None where it is unknown, so that marks in them tell no place.
    ``surface``: object id of the polygon on the table (empty: every 3-D polygon of the session).

    ``tolerance_m``: largest distance of a polygon point that is believed; annotated points are up to 21 mm
    off. ``every``: only every so manieth frame with boxes is used, neighbours being nearly alike.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera | None = KINECT_V2_COLOR
    noise: Noise = field(default_factory=Noise)
    priors: Priors = field(default_factory=Priors)
    surface: str = ""
    tolerance_m: float = 0.015
    every: int = 6


def fit_table(
    polygon: Floats,
    markers_2d: Given | None = None,
    markers_3d: Given | None = None,
    parameters: PlaneParameters | None = None,
) -> pa.Table:
    """The table ``table_plane``, one row for the whole session.

    Parameters
    ----------
    polygon : (n, 3) points on the table in ``camera/depth``, all key frames together, NaN = missing; may be
    empty.
    markers_2d, markers_3d : boxes that mostly stand on the table; None if there are none.

    Raises
    ------
    InputError : neither the polygon nor the boxes determine a plane.
    """
    parameters = parameters or PlaneParameters()
    polygon = np.asarray(polygon, float).reshape(-1, 3)
    drawn = np.isfinite(polygon).all(1).sum() >= 3
    camera = parameters.camera
    step, (flat, solid) = _spread(markers_2d, markers_3d)
    boxes = _standing_boxes(flat, solid, parameters, unmeasured=not drawn, step=step)
    if drawn:
        start = fit_plane(polygon, tolerance_m=parameters.tolerance_m)
    elif boxes and camera is not None:
        start = fit_plane(standing_points(boxes, parameters.prototypes, camera), tolerance_m=0.03)
    else:
        raise InputError(
            "cannot fit the table's plane",
            where=f"{np.isfinite(polygon).all(1).sum()} polygon points, no known box seen in the image",
            consequence="no table_plane was made",
            fix="draw the table as a 3-D polygon, or give the prototypes of the boxes that stand on it",
        )
    if not boxes or camera is None:
        return _rows(start, plane_frame(start.normal, start.offset), "polygon", len(polygon))
    apart = -(-parameters.every // step)
    every = [max(apart, -(-len(box.frame) // MOST_BOX_FRAMES)) for box in boxes]
    tracks = [Track(0, box.prototype, box.seen[::nth]) for box, nth in zip(boxes, every, strict=True)]
    first = plane_frame(start.normal, start.offset)
    bundle = adjust(
        tracks,
        [first],
        parameters.prototypes,
        camera,
        parameters.noise,
        polygons=[polygon] if drawn else [],
        priors=parameters.priors,
        fixed_prototypes=True,
    )
    fit = _on(bundle.tables[0], polygon if drawn else np.empty((0, 3)), parameters.tolerance_m)
    frame = plane_frame(fit.normal, fit.offset)
    seen = sum(len(track.seen) for track in tracks)
    return _rows(fit, frame, "polygon+boxes" if drawn else "boxes", len(polygon) + seen, seen)


def _standing_boxes(
    markers_2d: pa.Table | None,
    markers_3d: pa.Table | None,
    parameters: PlaneParameters,
    *,
    unmeasured: bool,
    step: int = 1,
) -> list[BoxSightings]:
    """Boxes seen often enough, or without a polygon (``unmeasured``) all that are seen; nominal ones only then: they
    pull the plane to where their tables are wrong.  Of the frames there are, only each ``step``-th is given.
    """
    camera = parameters.camera
    if markers_2d is None or camera is None:
        return []
    faces = read_faces(markers_2d, markers_3d, camera)
    boxes = box_sightings(faces, parameters.prototypes, camera, parameters.noise)
    measured = [all(f.sigma_m is not None for f in p.faces) for p in parameters.prototypes]
    boxes = [b for b in boxes if np.isfinite(b.seen.pixels).any()]
    if unmeasured:
        return boxes
    return [b for b in boxes if len(b.frame) * step >= MIN_BOX_FRAMES and measured[b.prototype]]


def _spread(*markers: Given | None) -> tuple[int, list[pa.Table | None]]:
    """Every so manieth frame, at most ``_MOST_FRAMES``, spread over the recording; and the rows of these."""
    read = [None if given is None else rows_of(given) for given in markers]
    end = max((int(frames_of(rows).max(initial=-1)) + 1 for rows in read if rows is not None), default=0)
    step = max(-(-end // _MOST_FRAMES), 1)
    return step, [None if rows is None else _every(step, rows) for rows in read]


def _every(step: int, rows: Rows) -> pa.Table:
    """The rows of every so manieth frame."""
    parts = [
        part.filter(pa.array(np.asarray(part["frame"].to_numpy()) % step == 0))
        for part in stretches(rows, _MOST_FRAMES)
    ]
    return pa.concat_tables(parts or [rows.between(0, 0)]).unify_dictionaries()


def _beside(given: Given | None, moves: NDArray[np.int64]) -> pa.Table | None:
    """The rows of frames beside moves of the camera, as far from them as is looked at."""
    if given is None:
        return None
    rows, end, parts = rows_of(given), 0, list[pa.Table]()
    for move in moves.tolist():
        parts.append(rows.between(max(move - LOOKED_AT, end), move + LOOKED_AT + 1))
        end = move + LOOKED_AT + 1
    return pa.concat_tables(parts).unify_dictionaries()


def standing_points(
    boxes: Sequence[BoxSightings], prototypes: Sequence[BoxPrototype], camera: Camera
) -> Floats:
    """Corners (n, 3) of the faces that boxes stand on, in the camera's reference frame, each from one marker
    alone.
    """
    points: list[Floats] = []
    for box in boxes:
        prototype = prototypes[box.prototype]
        half = np.array(prototype.size_m) / 2
        base = half * np.array([[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]])
        for i, face in enumerate(prototype.faces):
            pixels = box.seen.pixels[:, i]
            pixels = pixels[np.isfinite(pixels).all((1, 2))][::10]
            if not len(pixels):
                continue
            marker = Rigid(matrix_from_quaternion(np.array(face.quaternion)), np.array(face.centre)).inverse()
            for pose in square_poses(pixels, np.full(len(pixels), face.side_m), camera):
                upright = pose @ marker
                points.extend(upright.apply(corner) for corner in base)
    return np.concatenate(points) if points else np.empty((0, 3))


def _on(table: Rigid, polygon: Floats, tolerance_m: float) -> PlaneFit:
    """A plane with the polygon's distances from it."""
    normal = table.rotation[:, 2]
    offset = -float(normal @ table.translation)
    away = np.abs(polygon @ normal + offset)
    inliers = np.where(np.isfinite(away), away, np.inf) <= tolerance_m
    rms = float(np.sqrt((away[inliers] ** 2).mean())) if inliers.any() else float("nan")
    return PlaneFit(
        normal, offset, inliers, rms, float(away[inliers].max()) if inliers.any() else float("nan")
    )


def _rows(fit: PlaneFit, frame: Rigid, evidence: str, n_points: int, extra: int = 0) -> pa.Table:
    values: dict[str, object] = {
        "t_ns": 0,
        "frame": 0,
        "d": fit.offset,
        "rms_m": fit.rms_m,
        "max_m": fit.max_m,
    }
    values |= {"n_points": n_points, "n_inliers": int(fit.inliers.sum()) + extra, "evidence": evidence}
    values |= dict(zip(("nx", "ny", "nz"), fit.normal.tolist(), strict=True))
    values |= dict(zip(("origin_x", "origin_y", "origin_z"), frame.translation.tolist(), strict=True))
    values |= dict(
        zip(("qx", "qy", "qz", "qw"), quaternion_from_matrix(frame.rotation).tolist(), strict=True)
    )
    schema = TABLE_PLANE.arrow
    unknown = [name for name in ("rms_m", "max_m") if not np.isfinite(getattr(fit, name))]
    row = {name: None if name in unknown else values.get(name) for name in schema.names}
    return pa.Table.from_pylist([row], schema=schema)


def polygon_points(keyframes: pa.Table, surface: str = "") -> Floats:
    """Vertices (n, 3) of the 3-D shapes in a ``keyframes`` table, of one object or of all; missing as NaN."""
    rows = keyframes.filter((pc.field("dimensions") == 3) & pc.field("vertex").is_valid())
    if surface:
        rows = rows.filter(pc.field("object_id").cast(pa.string()) == surface)
    columns = [np.asarray(rows[axis].to_numpy(zero_copy_only=False), float) for axis in "xyz"]
    return np.stack(columns, -1)


def _run(tables: Tables, images: ImagesByKind, parameters: PlaneParameters) -> dict[str, pa.Table]:
    keyframes = tables.get("keyframes")
    polygon = polygon_points(keyframes, parameters.surface) if keyframes is not None else np.empty((0, 3))
    evidence = polygon, tables.get("markers_2d"), tables.get("markers_3d"), parameters
    depth = images.get("depth")
    plane = fit_table(*evidence) if depth is None else _fit_with_depth(depth, *evidence)
    if depth is None or plane.num_rows < 2:
        return {"table_plane": plane}
    moves = np.asarray(plane["frame"].to_numpy(), np.int64)[1:]
    flat, solid = (_beside(tables.get(name), moves) for name in ("markers_2d", "markers_3d"))
    boxes = _standing_boxes(flat, solid, parameters, unmeasured=True)
    return {
        "table_plane": tied(
            plane,
            boxes,
            parameters.prototypes,
            parameters.camera,
            parameters.noise,
            outlines=outline_table(depth, plane),
            depth_camera=depth.camera,
        )
    }


def _fit_with_depth(
    depth: Images,
    polygon: Floats,
    markers_2d: Given | None,
    markers_3d: Given | None,
    parameters: PlaneParameters,
) -> pa.Table:
    """The plane that depth shows where polygon and boxes have it, or what they say where depth shows none."""
    believed: pa.Table | None = None
    with suppress(InputError):
        believed = fit_table(polygon, markers_2d, markers_3d, parameters)
    try:
        return fit_table_in_depth(depth, believed)
    except InputError:
        if believed is None:
            raise
        return believed


PLANE = Stage(
    name="plane",
    version=2,
    inputs=("keyframes", "markers_2d", "markers_3d"),
    partly=("markers_2d", "markers_3d"),
    images=("depth",),
    outputs=("table_plane",),
    parameters=PlaneParameters,
    run=_run,
    optional=("keyframes", "markers_2d", "markers_3d", "depth"),
)
