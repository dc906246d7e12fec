"""Shapes that a person drew in some images, followed through the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, TypeAlias

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.depth import DepthCamera, color_pixels, depth_at
from ecat.geometry.follow import Followed, Follower, FollowParameters, Gray, Ranges
from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.transforms import Floats
from ecat.stages.images import Images

CHUNK = 24
"""Images held at once when a shape is followed backwards."""
SAME_MOMENT_NS = 40_000_000
"""A depth image belongs to a colour image if they were taken so near in time."""
_STRIDE = 2
"""Every other pixel of depth is enough to tell what is as far away as an object."""
_LEAST_PX = 4

Drawn: TypeAlias = dict[int, Floats | None]
"""Shapes (n, 2) in pixels by index of the image; None: absent from there on."""
Shapes: TypeAlias = dict[int, Followed]
"""Shapes by index of the image."""
_Sight: TypeAlias = tuple[int, Gray, Ranges | None]


def drawn_shapes(keyframes: pa.Table, frame: NDArray[Any]) -> dict[str, Drawn]:
    """The rectangles and polygons of a ``keyframes`` table in colour images, by object.

    Parameters
    ----------
    frame : frame of the session (n,) that each image belongs to, ascending.

    Of an object that several layers draw, the layer that comes first by name counts.  Points are no shapes, and a shape
    of less than four pixels is none.
    """
    names = ("layer", "object_id", "frame", "present", "vertex", "x", "y")
    rows = keyframes.filter(pc.field("dimensions") == 2).select(names).to_pylist()
    rows.sort(key=lambda row: (row["layer"], row["object_id"], row["frame"], row["vertex"] or 0))
    keys: dict[str, dict[int, list[tuple[float, float]]]] = {}
    layers: dict[str, str] = {}
    for row in rows:
        if layers.setdefault(row["object_id"], row["layer"]) != row["layer"]:
            continue
        corners = keys.setdefault(row["object_id"], {}).setdefault(max(int(row["frame"]), 0), [])
        if row["present"] and row["vertex"] is not None:
            corners.append((row["x"], row["y"]))
    found = {name: _by_image(by_frame, frame) for name, by_frame in keys.items()}
    return {name: drawn for name, drawn in found.items() if any(s is not None for s in drawn.values())}


def _by_image(keys: Mapping[int, Sequence[tuple[float, float]]], frame: NDArray[Any]) -> Drawn:
    drawn: Drawn = {}
    for key, corners in sorted(keys.items()):
        image = int(np.searchsorted(frame, key))
        shape = _ring(corners)
        if image < len(frame) and (shape is not None or not corners):
            drawn[image] = shape
    return drawn


def _ring(corners: Sequence[tuple[float, float]]) -> Floats | None:
    """A polygon (n, 2); two rows are a rectangle: top left corner, width and height."""
    ring = np.array(corners, float).reshape(-1, 2)
    if len(ring) == 2:
        (u, v), (width, height) = ring
        ring = np.array([[u, v], [u + width, v], [u + width, v + height], [u, v + height]])
    if len(ring) < 3 or not np.isfinite(ring).all() or np.ptp(ring, axis=0).min() < _LEAST_PX:
        return None
    return ring


def follow_shapes(
    shapes: Mapping[str, Drawn],
    color: Images,
    depth: Images | None = None,
    parameters: FollowParameters | None = None,
) -> dict[str, Shapes]:
    """Every shape in every image from where it was drawn on, until it is drawn as absent or is lost.

    Between two images that were drawn on, the shape is followed from both and what both say is blended: the nearer and
    the surer counts for more.

    Parameters
    ----------
    color : images, in grey or colour.
    depth : of a calibrated camera; then only what is as far away as the object is followed.
    """
    parameters = parameters or FollowParameters()
    starts = {name: _later_starts(drawn) for name, drawn in shapes.items()}
    ahead = _pass(shapes, _forwards(shapes, color, depth), parameters)
    back = _pass(starts, _backwards(shapes, starts, color, depth), parameters)
    return {
        name: _blended(drawn, ahead[name], back[name], parameters.least) for name, drawn in shapes.items()
    }


def partners(color: Images, depth: Images | None) -> NDArray[np.int64]:
    """Index of the depth image that belongs to each colour image (n,), -1 where there is none.

    It is the nearest in time, or without a clock the one of the same frame; none without calibration.
    """
    none = np.full(len(color), -1, np.int64)
    if depth is None or depth.camera is None or color.camera is None or not len(depth):
        return none
    if color.t_ns is not None and depth.t_ns is not None:
        when, there, most = np.asarray(color.t_ns), np.asarray(depth.t_ns), SAME_MOMENT_NS
    else:
        when, there, most = np.asarray(color.frame), np.asarray(depth.frame), 0
    return nearest_in_time(there, when, within=most)


# ---------------------------------------------------------------------------------------- there and back


def _later_starts(drawn: Drawn) -> Drawn:
    """Where shapes are followed backwards from: all that have been drawn before; at the others that ends."""
    keys = sorted(drawn)
    starts: Drawn = {}
    for before, key in zip([None, *keys], keys, strict=False):
        follows = before is not None and drawn[before] is not None
        starts[key] = drawn[key] if follows else None
    return starts


def _pass(
    starts: Mapping[str, Drawn], sights: Iterable[_Sight], parameters: FollowParameters
) -> dict[str, Shapes]:
    """The shapes in one order of the images; an object without a shape, or lost, is in none."""
    found: dict[str, Shapes] = {name: {} for name in starts}
    followers: dict[str, Follower] = {}
    waiting = {(name, index) for name, drawn in starts.items() for index in drawn}
    for index, gray, ranges in sights:
        for name, drawn in starts.items():
            if index in drawn:
                waiting.discard((name, index))
                followers.pop(name, None)
                shape = drawn[index]
                if shape is not None:
                    followers[name] = Follower(gray, shape, ranges, parameters)
            elif name in followers:
                followed = followers[name].step(gray, ranges)
                if followed is None:
                    del followers[name]
                else:
                    found[name][index] = followed
        if not followers and not waiting:
            break
    return found


def _forwards(shapes: Mapping[str, Drawn], color: Images, depth: Images | None) -> Iterator[_Sight]:
    if shapes:
        yield from _sights(range(min(min(drawn) for drawn in shapes.values()), len(color)), color, depth)


def _backwards(
    shapes: Mapping[str, Drawn], starts: Mapping[str, Drawn], color: Images, depth: Images | None
) -> Iterator[_Sight]:
    """The images between those drawn on, from the last to the first."""
    needed = np.zeros(len(color), bool)
    for name, drawn in starts.items():
        keys = sorted(shapes[name])
        for before, key in pairwise(keys):
            needed[before : key + 1] |= drawn[key] is not None
    indices = np.flatnonzero(needed)
    for last in range(len(indices), 0, -CHUNK):
        part = indices[max(0, last - CHUNK) : last].tolist()
        yield from reversed(list(_sights(part, color, depth)))


def _sights(indices: Sequence[int], color: Images, depth: Images | None) -> Iterator[_Sight]:
    """Images with these indices, ascending, in grey, and what tells the depth at their pixels."""
    partner = partners(color, depth)[list(indices)]
    wanted = np.unique(partner[partner >= 0]).tolist()
    stream = iter(depth.read(wanted)) if depth is not None and wanted else iter(())
    camera = None if depth is None or depth.camera is None else DepthCamera(depth.camera, depth.unit_m)
    current, ranges = -1, None
    for k, index, image in zip(partner.tolist(), indices, color.read(indices), strict=False):
        if k >= 0 and k != current and camera is not None and color.camera is not None:
            current, ranges = k, _ranges(camera.cloud(next(stream), _STRIDE), camera.camera, color.camera)
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        yield index, np.asarray(gray, np.uint8), ranges if k >= 0 else None


def _ranges(cloud: Floats, depth: Camera, color: Camera) -> Ranges:
    """What tells the depth at pixels of the colour image."""
    reach_px = 1.5 * _STRIDE * color.fx / depth.fx
    return partial(_range_at, cloud=cloud, pixels=color_pixels(cloud, color), reach_px=reach_px)


def _range_at(asked: Floats, *, cloud: Floats, pixels: Floats, reach_px: float) -> Floats:
    return depth_at(asked, pixels, cloud, reach_px=reach_px)[:, 2]


# --------------------------------------------------------------------------------------------- blending


def _blended(drawn: Drawn, ahead: Shapes, back: Shapes, least: float) -> Shapes:
    """What was drawn, and in between what both ways say, the nearer and the surer more."""
    keys = np.array(sorted(drawn))
    found = {key: Followed(shape, 1.0) for key, shape in drawn.items() if shape is not None}
    for index in sorted(ahead.keys() | back.keys()):
        one, two = ahead.get(index), back.get(index)
        if one is None or two is None:
            found[index] = one or two or found[index]
            continue
        after = int(np.searchsorted(keys, index))
        share = (index - keys[after - 1]) / (keys[after] - keys[after - 1])
        weights = (
            (1 - share) * max(one.confidence - least, 0.01),
            share * max(two.confidence - least, 0.01),
        )
        found[index] = _between(one, two, weights[1] / sum(weights))
    return dict(sorted(found.items()))


def _between(one: Followed, two: Followed, share: float) -> Followed:
    if len(one.polygon) != len(two.polygon):
        return two if share > 0.5 else one
    other = _aligned(two.polygon, one.polygon)
    return Followed(
        (1 - share) * one.polygon + share * other,
        float((1 - share) * one.confidence + share * two.confidence),
    )


def _aligned(ring: Floats, like: Floats) -> Floats:
    """The ring (n, 2) begun at the vertex, and gone round the way, that brings it nearest to another."""
    turned = [np.roll(way, k, 0) for way in (ring, ring[::-1]) for k in range(len(ring))]
    return min(turned, key=lambda way: float(((way - like) ** 2).sum()))
