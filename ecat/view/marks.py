"""What was marked in the colour image and in space: marker faces, shapes drawn by a person, what follows them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pyarrow as pa

from ecat.geometry.transforms import Floats
from ecat.view.scene import (
    CAMERA,
    FREE,
    IMAGE,
    Frames,
    Scene,
    Thing,
    Timebase,
    by_object,
    dim,
    entity_part,
    finite,
    integers,
    numbers,
    pale,
    rgba,
    rows_per_frame,
    static,
    strips,
    temporal,
    texts,
    ui_points,
)

if TYPE_CHECKING:
    from rerun.chunk import Chunk

Shown: TypeAlias = tuple[int, Floats, bool]
"""From which frame on, the vertices (n, 2 or 3), and whether they were drawn there, not blended."""
_RING = np.array([0, 1, 2, 3, 0])
_ROOT = {2: IMAGE, 3: CAMERA}
"""Below which entity lies what has so many dimensions: pixels, or metres in ``camera/depth``."""


def markers_2d(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Marker faces (table ``markers_2d``) as closed rings, pixels; a frame without faces shows none."""
    corners = "u0_px v0_px u1_px v1_px u2_px v2_px u3_px v3_px"
    yield from _markers(table, scene, corners, dimensions=2, width=1.5)


def markers_3d(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Marker faces as measured through depth (table ``markers_3d``), quadrilaterals in ``camera/depth``."""
    yield from _markers(table, scene, "x0 y0 z0 x1 y1 z1 x2 y2 z2 x3 y3 z3", dimensions=3, width=1.2)


def _markers(
    table: pa.Table, scene: Scene, columns: str, *, dimensions: int, width: float
) -> Iterator[Chunk]:
    lines = _lines(dimensions)
    for object_id, rows in by_object(table):
        corners = numbers(rows, columns).reshape(-1, 4, dimensions)
        seen = finite(corners)
        frames, counts = rows_per_frame(integers(rows, "frame")[seen], scene.timebase.n_frames)
        thing = scene.thing(object_id)
        path = f"{_ROOT[dimensions]}/markers/{thing.part}"
        yield static(path, lines.from_fields(colors=[rgba(pale(thing.color))], radii=[ui_points(width)]))
        rings = lines.columns(strips=strips(corners[seen][:, _RING])).partition(counts)
        yield temporal(path, scene.timebase, frames, rings)


def _lines(dimensions: int) -> Any:
    import rerun as rr

    return rr.LineStrips2D if dimensions == 2 else rr.LineStrips3D


def _points(dimensions: int) -> Any:
    import rerun as rr

    return rr.Points2D if dimensions == 2 else rr.Points3D


def outline(kind: str, vertices: Floats) -> Floats:
    """The closed polyline (vertices, 2 or 3) of a drawn shape.

    ``vertices`` as in table ``keyframes``: for a 2-D rectangle its top left corner, then width and height.
    """
    if kind == "rectangle" and vertices.shape == (2, 2):
        (u, v), (width, height) = vertices
        return np.array([[u, v], [u + width, v], [u + width, v + height], [u, v + height], [u, v]])
    return np.concatenate([vertices, vertices[:1]]) if len(vertices) > 2 else vertices


def key_shapes(rows: pa.Table, dimensions: int) -> Iterator[tuple[int, Floats]]:
    """Each key frame of one object's sorted rows with its vertices (n, dimensions); none where absent."""
    frames, points = integers(rows, "frame"), numbers(rows, "x y z")[:, :dimensions]
    drawn = rows.column("present").to_numpy() & finite(points)
    for frame in np.unique(frames):
        yield int(frame), points[(frames == frame) & drawn]


def between(kind: str, keys: list[tuple[int, Floats]], n_frames: int) -> Iterator[Shown]:
    """An object's shapes in the image, at most one for each of ``n_frames``.

    Rectangles move linearly from key frame to key frame, other shapes stay (ECAT 2018 file format §2.11).
    """
    for (frame, shape), after in zip_longest(keys, keys[1:]):
        yield frame, shape, True
        if after is None or kind != "rectangle" or not len(shape) or after[1].shape != shape.shape:
            continue
        for at in range(frame + 1, min(after[0], n_frames)):
            weight = (at - frame) / (after[0] - frame)
            yield at, (1 - weight) * shape + weight * after[1], False


def shapes(keyframes: pa.Table, objects: pa.Table, scene: Scene, *, dimensions: int) -> Iterator[Chunk]:
    """Drawn shapes (tables ``keyframes``, ``objects``) of 2 or 3 ``dimensions``, in pixels or in ``camera/depth``.

    Those in the image are dark where they are blended; those in space stay until the next one.
    """
    kinds = kind_of_objects(objects)
    drawn = keyframes.filter(pa.array(integers(keyframes, "dimensions") == dimensions))
    for layer in np.unique(texts(drawn, "layer")):
        mine = drawn.filter(pa.array(texts(drawn, "layer") == layer))
        for object_id, rows in by_object(mine):
            thing = scene.thing(object_id)
            kind = kinds.get((str(layer), object_id), "other")
            keys = list(key_shapes(rows, dimensions))
            blended = kind if dimensions == 2 else "other"
            shown = list(between(blended, keys, scene.timebase.n_frames))
            path = f"{_ROOT[dimensions]}/shapes/{shape_part(str(layer), thing.part)}"
            yield from _shape(path, scene.timebase, thing, kind, shown)


def _shape(path: str, timebase: Timebase, thing: Thing, kind: str, shown: list[Shown]) -> Iterator[Chunk]:
    outlines = [(outline(kind, shape), keyed) for _, shape, keyed in shown]
    drawn = [line for line, _ in outlines if len(line)]
    keyed = np.array([keyed for line, keyed in outlines if len(line)], np.bool_)
    colors = np.where(keyed, rgba(thing.color), rgba(dim(thing.color))).astype(np.uint32)
    dimensions = shown[0][1].shape[1]
    if kind == "point":
        archetype, width = _points(dimensions), 5.0
        positions = np.concatenate(drawn or [np.zeros((0, dimensions))])
        columns = archetype.columns(positions=positions, colors=colors)
    else:
        archetype, width = _lines(dimensions), 1.5
        columns = archetype.columns(strips=drawn, colors=colors)
    yield static(path, archetype.from_fields(radii=[ui_points(width)], labels=[thing.name]))
    frames: Frames = np.array([frame for frame, _, _ in shown], np.int64)
    yield temporal(path, timebase, frames, columns.partition([int(len(line) > 0) for line, _ in outlines]))


def kind_of_objects(objects: pa.Table) -> dict[tuple[str, str], str]:
    """The kind of each (layer, object id)."""
    return dict(
        zip(
            zip(texts(objects, "layer").tolist(), texts(objects, "object_id").tolist(), strict=True),
            texts(objects, "kind").tolist(),
            strict=True,
        )
    )


def shape_part(layer: str, part: str) -> str:
    """Where a layer's shape hangs: the main layer's directly, any other's below the layer's name."""
    return part if layer == "main" else f"{entity_part(layer)}/{part}"


def tracks(tracks_2d: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Followed shapes (table ``tracks_2d``) as closed rings in the image: dark where tracked, amber where unsure."""
    for object_id, rows in by_object(tracks_2d):
        found = [
            (frame, ring[np.r_[0 : len(ring), 0]], status)
            for frame, ring, status in _by_frame(rows, "u_px v_px")
        ]
        yield from _followed(f"{IMAGE}/tracks", scene.thing(object_id), scene.timebase, found)


def hulls(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Convex hulls of objects without markers (table ``hulls``), as the edges of their triangles, ``camera/depth``."""
    for object_id, rows in by_object(table):
        found = [(frame, hull_edges(corners), status) for frame, corners, status in _by_frame(rows, "x y z")]
        yield from _followed(f"{CAMERA}/hulls", scene.thing(object_id), scene.timebase, found)


def hull_edges(corners: Floats) -> Floats:
    """One line (n, 3) along every triangle of the convex hull of ``corners`` (m, 3); themselves where they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        triangles = ConvexHull(corners).simplices
    except (QhullError, ValueError):
        return corners
    return corners[triangles[:, [0, 1, 2, 0]].reshape(-1)]


def _by_frame(rows: pa.Table, names: str) -> Iterator[tuple[int, Floats, str]]:
    """Each frame of one object's sorted rows with its points (n, dimensions) and their status."""
    frames, points, status = integers(rows, "frame"), numbers(rows, names), texts(rows, "status")
    starts = np.flatnonzero(np.diff(frames, prepend=frames[0] - 1))
    for start, some in zip(starts, np.split(points, starts[1:]), strict=True):
        known = some[finite(some)]
        if len(known):
            yield int(frames[start]), known, str(status[start])


def _followed(
    root: str, thing: Thing, timebase: Timebase, found: list[tuple[int, Floats, str]]
) -> Iterator[Chunk]:
    if not found:
        return
    archetype = _lines(found[0][1].shape[1])
    path = f"{root}/{thing.part}"
    shades = {"drawn": rgba(thing.color), "tracked": rgba(dim(thing.color))}
    colors = np.array([shades.get(status, rgba(FREE)) for _, _, status in found], np.uint32)
    frames, counts = rows_per_frame(np.array([frame for frame, _, _ in found], np.int64), timebase.n_frames)
    yield static(path, archetype.from_fields(radii=[ui_points(1.5)], labels=[thing.name]))
    columns = archetype.columns(strips=[line for _, line, _ in found], colors=colors)
    yield temporal(path, timebase, frames, columns.partition(counts))
