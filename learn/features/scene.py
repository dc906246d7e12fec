"""Windows of frames as what lies and moves on a table: where rays through corners of markers meet it, and joints.

The depth of a marker's corner jumps by decimetres now and then, while the direction in which a corner is seen does not;
so places of boxes are where the rays through their corners meet the table, and the shape of a marker is the one in the
image.  Within a window, corners are medians of three frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KNOTS = 5
NEAREST_M = 0.3
"""What is nearer to the camera is no marker, but a point that was not seen."""
UNKNOWN = -1.0
"""All three coordinates of a point that was not seen, in exports."""
FLATTEST = -0.15
"""Rays that fall less than this per metre, relative to the table, meet it too far away to say where."""
_SHOULDERS, _HANDS = [1, 7], ([3, 4, 5], [9, 10, 11])


@dataclass(frozen=True)
class Table:
    """The table in camera space: y = slope z + height, level from side to side."""

    slope: float
    height: float


@dataclass(frozen=True)
class Scene:
    """What features are made of, each (windows, frames, ...), in metres along x, along the table, above it."""

    corners: Floats  # (w, t, box, 4, 2) on the table
    rays: Floats  # (w, t, box, 4, 2) to the corners, in camera space, where z is 1
    shape: Floats  # (w, t, box, 4, 2) about the middle, across the line of sight
    height: Floats  # (w, t, box) above the table by depth
    depth: Floats  # (w, t, box) how much farther than the table by depth
    joints: Floats  # (w, t, 13, 3)
    slope: float  # of the table

    def level(self, directions: Floats) -> Floats:
        """Directions (..., 3) of camera space along x, along the table, and up from it."""
        x, y, z = np.moveaxis(directions, -1, 0)
        steep = np.hypot(1.0, self.slope)
        return np.stack([x, (self.slope * y + z) / steep, (y - self.slope * z) / steep], axis=-1)

    @property
    def exchanged(self) -> Scene:
        """The same with the boxes exchanged."""
        of_boxes = ("corners", "rays", "shape", "height", "depth")
        return replace(self, **{name: getattr(self, name)[:, :, ::-1] for name in of_boxes})

    @property
    def boxes(self) -> Floats:
        """(w, t, box, 2) the middles of their markers, on the table."""
        return self.corners.mean(axis=3)

    @property
    def hands(self) -> Floats:
        """(w, t, hand, 3) left and right: the middles of wrist, palm and tip."""
        return np.stack([self.joints[:, :, of].mean(axis=2) for of in _HANDS], axis=2)

    @property
    def body(self) -> Floats:
        """(w, t, 3) the middle between the shoulders."""
        return self.joints[:, :, _SHOULDERS].mean(axis=2)


def scene_of(windows: Floats, table: Table) -> Scene:
    """What windows (w, t, 21, 3) show; points that are not known take the nearest known of their window, and 0 if
    there is none.
    """
    n = windows.shape[:2]
    steep = np.hypot(1.0, table.slope)
    x, y, z = np.moveaxis(filled(windows[:, :, :13]), -1, 0)
    joints = np.stack(
        [x, (table.slope * y + z) / steep, (y - table.slope * z - table.height) / steep], axis=-1
    )
    seen = windows[:, :, 13:]
    seen = np.where(lost(seen)[..., None], np.nan, seen)
    right, up = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    far = table.height / np.minimum(up - table.slope, FLATTEST)
    corners = np.stack([right * far, far * (table.slope * up + 1) / steep], axis=-1)
    rays = steady(filled(np.stack([right, up], axis=-1))).reshape(*n, 2, 4, 2)
    distance = steady(filled(far)).reshape(*n, 2, 4).mean(axis=-1)
    by_depth = filled(seen).reshape(*n, 2, 4, 3)
    y, z = np.median(by_depth[..., 1], axis=-1), np.median(by_depth[..., 2], axis=-1)
    return Scene(
        corners=steady(filled(corners)).reshape(*n, 2, 4, 2),
        rays=rays,
        shape=(rays - rays.mean(axis=3, keepdims=True)) * distance[..., None, None],
        height=(y - table.slope * z - table.height) / steep,
        depth=z - distance,
        joints=joints,
        slope=table.slope,
    )


def lost(corners: Floats) -> NDArray[np.bool_]:
    """Which corners (..., 8, 3) were not seen: those that say so, and all of a marker with three in one place.

    A marker that was lost is written as a corner that is none and three that are the same for as long as it is: in some
    sessions a quarter of all frames, and as if the box had jumped there.
    """
    alone = (corners == UNKNOWN).all(axis=-1) | ~np.isfinite(corners).all(axis=-1)
    markers = corners.reshape(*corners.shape[:-2], 2, 4, 3)
    same = [
        (markers[..., one, :] == markers[..., other, :]).all(axis=-1)
        for one, other in combinations(range(4), 2)
    ]
    flat = np.sum(same, axis=0) >= 3
    return alone | (corners[..., 2] < NEAREST_M) | np.repeat(flat, 4, axis=-1)


def filled(values: Floats) -> Floats:
    """(w, t, ...) with the nearest earlier value, or else the next, where one is NaN; 0 where all are."""
    n, t = values.shape[:2]
    flat = values.reshape(n, t, math.prod(values.shape[2:]))  # there may be no windows
    known = np.isfinite(flat)
    if known.all():
        return values
    frame = np.arange(t)[:, None]
    before = np.maximum.accumulate(np.where(known, frame, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, frame, t)[:, ::-1], axis=1)[:, ::-1]
    source = np.where(before >= 0, before, after % t)
    return np.nan_to_num(np.take_along_axis(flat, source, axis=1)).reshape(values.shape)


def steady(values: Floats) -> Floats:
    """Medians of three frames of (w, t, ...)."""
    padded = np.concatenate([values[:, :1], values, values[:, -1:]], axis=1)
    a, b, c = padded[:, :-2], padded[:, 1:-1], padded[:, 2:]
    return np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))


def knots(values: Floats) -> Floats:
    """Means of four frames of (w, 20, ...): (w, 5, ...)."""
    n, t = values.shape[:2]
    return values.reshape(n, KNOTS, t // KNOTS, *values.shape[2:]).mean(axis=2)


def unit(vectors: Floats) -> Floats:
    """Of length 1, or shorter for movements that are hardly any."""
    return vectors / np.maximum(norm(vectors), 0.02)[..., None]


def norm(vectors: Floats) -> Floats:
    """Lengths (...) of vectors (..., n)."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def cross(a: Floats, b: Floats) -> Floats:
    """The height (...) of the cross product of vectors (..., 2) in the plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def wrapped(angles: Floats) -> Floats:
    """Angles from -pi to pi."""
    return (angles + np.pi) % (2 * np.pi) - np.pi
