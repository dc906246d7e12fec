"""The part of a depth image that belongs to an object, and the convex hull of it.

SciPy's Qhull does what is needed of a hull here, so that Open3D is not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.depth import RangeNoise, inside, steady, within
from ecat.geometry.transforms import Floats

LEAST_POINTS = 20
"""Fewer points of depth say nothing about a shape."""
ABOVE_M = 0.008
"""What is lower above the table than this, and four standard deviations, belongs to the table."""
STEP_M = 0.02
"""Neighbouring pixels further apart than this, and a fiftieth of their distance, are of different things."""
_MOST_CORNERS = 48


def object_points(
    cloud: Floats,
    pixels: Floats,
    polygon: Floats,
    plane: tuple[Floats, float] | None = None,
    distance_m: tuple[float, float] = (0.0, np.inf),
) -> Floats:
    """Points (n, 3) of the thing that a shape in the colour image encloses.

    Of the points seen inside the shape and not on the table, the largest connected part: where depth makes a step, one
    thing ends.

    Parameters
    ----------
    cloud : points (height, width, 3) of a depth image, metres, NaN = nothing was measured.
    pixels : where in the colour image they are (height, width, 2).
    polygon : the shape (n, 2), pixels of the colour image.
    plane : the table, ``normal @ p + offset = 0`` with the normal towards the camera.
    distance_m : least and greatest distance of the thing's middle from the camera; parts elsewhere hide it, or are
        behind it.
    """
    rows, columns = _bounds(pixels, polygon)
    if rows.start >= rows.stop:
        return np.empty((0, 3))
    cloud, pixels = cloud[rows, columns], pixels[rows, columns]
    mask = inside(pixels, polygon) & steady(cloud[..., 2])
    if plane is not None:
        height = cloud @ plane[0] + plane[1]
        with np.errstate(invalid="ignore"):
            mask &= height > np.maximum(
                ABOVE_M, 4 * RangeNoise().sigma(cloud[..., 2]) * _slope(cloud, plane[0])
            )
    if mask.sum() < LEAST_POINTS:
        return np.empty((0, 3))
    points = cloud[mask]
    part = _parts(cloud[..., 2], mask)
    size = np.bincount(part)
    away = np.bincount(part, np.linalg.norm(points, axis=1)) / size
    size[(away < distance_m[0]) | (away > distance_m[1]) | (size < LEAST_POINTS)] = 0
    return points[part == size.argmax()] if size.any() else np.empty((0, 3))


def _bounds(pixels: Floats, polygon: Floats) -> tuple[slice, slice]:
    """Rows and columns of the depth image that may have pixels in the shape."""
    near = within(pixels, polygon.min(0), polygon.max(0))
    row, column = np.flatnonzero(near.any(1)), np.flatnonzero(near.any(0))
    if not len(row):
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(0, int(row[0]) - 2), int(row[-1]) + 3),
        slice(max(0, int(column[0]) - 2), int(column[-1]) + 3),
    )


def _slope(cloud: Floats, normal: Floats) -> Floats:
    """By how much height above a plane changes with depth along the sight line."""
    return np.abs(cloud @ normal) / cloud[..., 2]


def _parts(z: Floats, mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Which connected part (n,) each pixel of the mask belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    number = np.full(mask.shape, -1)
    number[mask] = np.arange(mask.sum())
    edges: list[NDArray[np.intp]] = []
    for one, two in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        near = mask[one] & mask[two]
        with np.errstate(invalid="ignore"):
            near &= np.abs(z[one] - z[two]) < STEP_M + 0.02 * z[one]
        edges.append(np.stack([number[one][near], number[two][near]]))
    i, j = np.concatenate(edges, 1)
    n = int(mask.sum())
    _, part = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (n, n)), directed=False)
    return np.asarray(part, np.intp)


def convex_hull(points: Floats, *, most: int = _MOST_CORNERS) -> Floats | None:
    """Corners (m, 3) of the convex hull of points (n, 3), at most ``most``; None if they span no volume.

    Of more corners those are kept that reach farthest in ``most`` evenly spread directions.
    """
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 4:
        return None
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:
        return None
    if len(corners) <= most:
        return corners
    middle = corners - corners.mean(0)
    return corners[np.unique((middle @ _directions(most).T).argmax(0))]


def _directions(n: int) -> Floats:
    """Unit vectors (n, 3) spread evenly over the sphere (Fibonacci lattice)."""
    k = np.arange(n) + 0.5
    height = 1 - 2 * k / n
    turn = np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - height * height)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], -1)
