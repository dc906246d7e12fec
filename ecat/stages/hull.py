"""Objects without markers: drawn shapes followed through the images, and their convex hulls from depth."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from ecat.geometry.depth import DepthCamera, color_pixels
from ecat.geometry.follow import Followed, FollowParameters
from ecat.geometry.hulls import convex_hull, object_points
from ecat.geometry.transforms import Floats
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.shapes import Drawn, Shapes, drawn_shapes, follow_shapes, partners
from ecat.stages.stage import Stage, Tables
from ecat.tables import HULLS, TRACKS_2D, TableSchema

NEAR_M = 0.06
"""The part of a still object that is seen is not further away or nearer than this from one image to the next."""


@dataclass(frozen=True)
class HullParameters:
    """``surface``: object id of the table, which is neither followed nor has a hull."""

    follow: FollowParameters = field(default_factory=FollowParameters)
    surface: str = ""


@dataclass(frozen=True, eq=False)
class _Row:
    """A shape in an image: index of the image, object, its vertices (n, 2) or (n, 3), and what else is known."""

    index: int
    name: str
    vertices: Floats
    status: str
    confidence: float


@dataclass(frozen=True, eq=False)
class _Last:
    """Where an object was when it was last seen: distance from the camera, middle of its shape (2,)."""

    distance_m: float
    middle_px: Floats


def follow_objects(
    keyframes: pa.Table,
    color: Images,
    depth: Images | None = None,
    table_plane: pa.Table | None = None,
    parameters: HullParameters | None = None,
) -> tuple[pa.Table, pa.Table]:
    """The tables ``tracks_2d`` and ``hulls`` of the rectangles and polygons drawn in colour images.

    Shapes are followed by :func:`ecat.stages.shapes.follow_shapes`.  Their status is drawn, tracked, or proposed where
    the confidence is below ``follow.sure``.  A hull is of what the depth camera sees of the object inside the shape
    (:mod:`ecat.geometry.hulls`); images without depth, and objects too flat or hidden, have none.

    Parameters
    ----------
    keyframes : table of drawn shapes.
    color, depth : images; without depth, or without the calibration of both, there are no hulls.
    table_plane : what lies in this plane, in the row valid at a frame, is not part of an object.
    """
    parameters = parameters or HullParameters()
    drawn = drawn_shapes(keyframes, np.asarray(color.frame))
    drawn.pop(parameters.surface, None)
    found = follow_shapes(drawn, color, depth, parameters.follow)
    rows = sorted(_rows(drawn, found, parameters.follow), key=lambda row: (row.index, row.name))
    hulls = list(_hulls(rows, color, depth, table_plane)) if depth is not None else []
    return _table(TRACKS_2D, color, rows), _table(HULLS, color, hulls)


def _rows(
    drawn: Mapping[str, Drawn], found: Mapping[str, Shapes], parameters: FollowParameters
) -> Iterator[_Row]:
    for name, shapes in found.items():
        for index, shape in shapes.items():
            status = "drawn" if index in drawn[name] else _status(shape, parameters)
            yield _Row(index, name, shape.polygon, status, shape.confidence)


def _status(shape: Followed, parameters: FollowParameters) -> str:
    return "tracked" if shape.confidence >= parameters.sure else "proposed"


# ------------------------------------------------------------------------------------------------- hulls


def _hulls(
    rows: Sequence[_Row], color: Images, depth: Images, table_plane: pa.Table | None
) -> Iterator[_Row]:
    """A hull for every shape in an image that has depth."""
    partner = partners(color, depth)
    if depth.camera is None or color.camera is None:
        return
    camera, planes = DepthCamera(depth.camera, depth.unit_m), _Planes(table_plane)
    rows = [row for row in rows if partner[row.index] >= 0]
    stream = iter(depth.read(np.unique([partner[row.index] for row in rows]).tolist())) if rows else iter(())
    current, cloud, pixels = -1, np.empty(0), np.empty(0)
    last: dict[str, _Last] = {}
    for row in rows:
        if partner[row.index] != current:
            current = int(partner[row.index])
            cloud = camera.cloud(next(stream))
            pixels = color_pixels(cloud, color.camera)
        plane = planes.at(int(color.frame[row.index]))
        points = object_points(
            cloud, pixels, row.vertices, plane, _distances(last.get(row.name), row, color.camera.fx)
        )
        corners = convex_hull(points)
        if corners is not None:
            last[row.name] = _Last(float(np.linalg.norm(points, axis=1).mean()), row.vertices.mean(0))
            yield _Row(row.index, row.name, corners, row.status, row.confidence)


def _distances(last: _Last | None, row: _Row, focal_px: float) -> tuple[float, float]:
    """Within which distances from the camera an object is, metres, by where it was when it was last seen.

    What has not moved in the image has not come nearer either: a thing before it hides it.
    """
    if last is None or row.status == "drawn":
        return 0.0, np.inf
    way_px = float(np.linalg.norm(row.vertices.mean(0) - last.middle_px))
    reach_m = NEAR_M + 1.5 * way_px / focal_px * last.distance_m
    return last.distance_m - reach_m, last.distance_m + reach_m


class _Planes:
    """The planes of a ``table_plane`` table, each valid from its frame on."""

    def __init__(self, table: pa.Table | None) -> None:
        self._rows = sorted(table.to_pylist(), key=lambda row: row["frame"]) if table is not None else []
        self._frames = [row["frame"] for row in self._rows]

    def at(self, frame: int) -> tuple[Floats, float] | None:
        """Unit normal (3,) and offset in metres; None without a table."""
        if not self._rows:
            return None
        row = self._rows[max(0, bisect_right(self._frames, frame) - 1)]
        return np.array([row["nx"], row["ny"], row["nz"]]), float(row["d"])


# ------------------------------------------------------------------------------------------------ tables


def _table(schema: TableSchema, color: Images, rows: Sequence[_Row]) -> pa.Table:
    """Rows with their vertices, one row each, in the order of the columns of ``tracks_2d`` or ``hulls``."""
    count = np.array([len(row.vertices) for row in rows], int)
    index = np.repeat(np.array([row.index for row in rows], int), count)
    vertices = np.concatenate([row.vertices for row in rows]) if rows else np.empty((0, 3))
    columns: dict[str, Any] = {
        "t_ns": pa.array(np.asarray(color.t_ns)[index])
        if color.t_ns is not None
        else pa.nulls(len(index), pa.int64()),
        "frame": pa.array(np.asarray(color.frame)[index].astype(np.int32)),
        "vertex": pa.array(np.concatenate([np.arange(n) for n in count] or [[]]).astype(np.int16)),
        "confidence": pa.array(np.repeat(np.array([row.confidence for row in rows], float), count)),
    }
    for name, values in (("object_id", [r.name for r in rows]), ("status", [r.status for r in rows])):
        kinds = sorted(set(values))
        number = np.repeat(np.array([kinds.index(value) for value in values], np.int32), count)
        columns[name] = pa.DictionaryArray.from_arrays(number, pa.array(kinds, pa.string()))
    axes = ("u_px", "v_px") if "u_px" in schema.arrow.names else ("x", "y", "z")
    columns |= {axis: pa.array(vertices[:, k]) for k, axis in enumerate(axes)}
    return pa.Table.from_arrays([columns[name] for name in schema.arrow.names], schema=schema.arrow)


def _run(tables: Tables, images: ImagesByKind, parameters: HullParameters) -> dict[str, pa.Table]:
    tracks, hulls = follow_objects(
        tables["keyframes"], images["color"], images.get("depth"), tables.get("table_plane"), parameters
    )
    return {"tracks_2d": tracks, "hulls": hulls}


HULL = Stage(
    name="hull",
    version=1,
    inputs=("keyframes", "table_plane"),
    images=("color", "depth"),
    outputs=("tracks_2d", "hulls"),
    parameters=HullParameters,
    run=_run,
    optional=("table_plane", "depth"),
)
