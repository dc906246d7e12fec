"""What lies in the colour image: marker faces, shapes drawn by a person, the image's border."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ecat.geometry.transforms import Floats
from ecat.view.scene import (
    IMAGE,
    Frames,
    Scene,
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

_RING = np.array([0, 1, 2, 3, 0])


def markers_2d(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Marker faces (table ``markers_2d``) as closed rings, pixels; a frame without faces shows none."""
    import rerun as rr

    for object_id, rows in by_object(table):
        corners = numbers(rows, "u0_px v0_px u1_px v1_px u2_px v2_px u3_px v3_px").reshape(-1, 4, 2)
        seen = finite(corners)
        frames, counts = rows_per_frame(integers(rows, "frame")[seen], scene.timebase.n_frames)
        thing = scene.thing(object_id)
        path = f"{IMAGE}/markers/{thing.part}"
        yield static(
            path,
            rr.LineStrips2D.from_fields(colors=[rgba(pale(thing.color))], radii=[ui_points(1.5)]),
        )
        yield temporal(
            path,
            scene.timebase,
            frames,
            rr.LineStrips2D.columns(strips=strips(corners[seen][:, _RING])).partition(counts),
        )


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


def between(kind: str, keys: list[tuple[int, Floats]]) -> Iterator[tuple[int, Floats, bool]]:
    """Frame, vertices and whether they were drawn there (not blended) of an object's shapes.

    Rectangles move linearly from key frame to key frame, other shapes stay (ECAT 2018 file format §2.11).
    """
    for (frame, shape), after in zip_longest(keys, keys[1:]):
        yield frame, shape, True
        if after is None or kind != "rectangle" or not len(shape) or after[1].shape != shape.shape:
            continue
        for at in range(frame + 1, after[0]):
            weight = (at - frame) / (after[0] - frame)
            yield at, (1 - weight) * shape + weight * after[1], False


def shapes_2d(keyframes: pa.Table, objects: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Drawn shapes (tables ``keyframes``, ``objects``) in pixels of the colour image, dark where blended."""
    import rerun as rr

    kinds = kind_of_objects(objects)
    flat = keyframes.filter(pa.array(integers(keyframes, "dimensions") == 2))
    for layer in np.unique(texts(flat, "layer")):
        mine = flat.filter(pa.array(texts(flat, "layer") == layer))
        for object_id, rows in by_object(mine):
            thing = scene.thing(object_id)
            kind = kinds.get((str(layer), object_id), "other")
            shown = list(between(kind, list(key_shapes(rows, 2))))
            path = f"{IMAGE}/shapes/{shape_part(str(layer), thing.part)}"
            frames: Frames = np.array([frame for frame, _, _ in shown], np.int64)
            lines = [outline(kind, shape) for _, shape, _ in shown]
            drawn = [line for line in lines if len(line)]
            keyed = np.array(
                [key for (_, _, key), line in zip(shown, lines, strict=True) if len(line)], np.bool_
            )
            colors = np.where(keyed, rgba(thing.color), rgba(dim(thing.color))).astype(np.uint32)
            counts = [int(len(line) > 0) for line in lines]
            if kind == "point":
                columns = rr.Points2D.columns(
                    positions=np.concatenate(drawn or [np.zeros((0, 2))]), colors=colors
                )
                yield static(path, rr.Points2D.from_fields(radii=[ui_points(5)], labels=[thing.name]))
            else:
                columns = rr.LineStrips2D.columns(strips=drawn, colors=colors)
                yield static(path, rr.LineStrips2D.from_fields(radii=[ui_points(1.5)], labels=[thing.name]))
            yield temporal(path, scene.timebase, frames, columns.partition(counts))


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


def border(width_px: int, height_px: int) -> Chunk:
    """The image's edge, so that marks without a video still have a place."""
    import rerun as rr

    corners = np.array([[[0, 0], [width_px, 0], [width_px, height_px], [0, height_px], [0, 0]]], float)
    return static(
        f"{IMAGE}/border", rr.LineStrips2D(strips(corners), colors=[rgba((90, 96, 104))], radii=[1.0])
    )
