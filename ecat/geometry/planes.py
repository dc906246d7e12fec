"""Planes in space: robust fit to points, and the frame that lies on a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.transforms import Floats, Rigid

_MOST_TRIED = 5000
"""Points by which planes are chosen; how far 500 planes are from each of an hour's points would fill gigabytes."""


@dataclass(frozen=True)
class PlaneFit:
    """``normal @ p + offset = 0`` with a unit normal; ``offset`` in metres.

    ``inliers`` (n,) marks the points used, ``rms_m`` and ``max_m`` are their distances from the plane.
    """

    normal: Floats
    offset: float
    inliers: NDArray[np.bool_]
    rms_m: float
    max_m: float


def fit_plane(points: Floats, *, tolerance_m: float = 0.015, trials: int = 500) -> PlaneFit:
    """The plane that most points agree on (RANSAC, then total least squares on the inliers until stable).

    Parameters
    ----------
    points : (n, 3); rows with NaN are never inliers.
    tolerance_m : largest distance of an inlier.
    trials : random triples tried; all triples when there are fewer.

    The normal points to the side of the origin (the camera).  The random choice is seeded: same points, same
    plane.

    Raises
    ------
    InputError : fewer than three finite points, or all on one line.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    finite = np.flatnonzero(np.isfinite(points).all(1))
    good = points[finite]
    if len(good) < 3:
        raise InputError(
            "cannot fit a plane",
            where=f"{len(good)} finite points of {len(points)}, at least 3 are needed",
            fix="mark more points on the surface",
        )
    some = good[:: -(-len(good) // _MOST_TRIED)]
    normals, offsets = _candidates(some, trials)
    # summed clipped distance (MSAC) tells apart planes with equally many inliers
    gap = np.abs(normals @ some.T + offsets[:, None])
    best = int(np.argmin(np.minimum(gap, tolerance_m).sum(1)))
    normal, offset = normals[best], float(offsets[best])
    inside = np.abs(good @ normal + offset) <= tolerance_m
    for _ in range(10):
        normal, offset = _least_squares(good[inside])
        now = np.abs(good @ normal + offset) <= tolerance_m
        if np.array_equal(now, inside) or now.sum() < 3:
            break
        inside = now
    if offset < 0:
        normal, offset = -normal, -offset
    away = np.abs(good @ normal + offset)[inside]
    inliers = np.zeros(len(points), bool)
    inliers[finite[inside]] = True
    return PlaneFit(normal, offset, inliers, float(np.sqrt((away**2).mean())), float(away.max()))


def _candidates(points: Floats, trials: int) -> tuple[Floats, Floats]:
    """Planes (m, 3), (m,) through triples of points."""
    n = len(points)
    if n <= 15:
        i, j, k = np.array([(a, b, c) for a in range(n) for b in range(a) for c in range(b)]).T
    else:
        i, j, k = np.random.default_rng(0).random((trials, n)).argsort(1)[:, :3].T
    normal = np.cross(points[j] - points[i], points[k] - points[i])
    length = np.linalg.norm(normal, axis=1)
    spread = float(np.ptp(points, axis=0).max())
    usable = length > 1e-9 * max(spread, 1e-9) ** 2
    if not usable.any():
        raise InputError(
            "cannot fit a plane",
            where=f"all {n} points lie on one line",
            fix="mark points that span the surface",
        )
    normal = normal[usable] / length[usable, None]
    return normal, -np.einsum("ij,ij->i", normal, points[i][usable])


def _least_squares(points: Floats) -> tuple[Floats, float]:
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][-1]
    return normal, -float(normal @ centre)


def plane_frame(normal: Floats, offset: float) -> Rigid:
    """camera-from-table: the frame on the plane ``normal @ p + offset = 0``, in the frame of the plane's
    points.

    z is the normal, x the camera's x laid onto the plane, and the origin where the optical axis meets the
    plane (the foot of the camera if it does not, or only under a very flat angle): the plane alone decides.
    """
    z = normal / np.linalg.norm(normal)
    offset = float(offset / np.linalg.norm(normal))
    x_hint = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = x_hint - (x_hint @ z) * z
    x /= np.linalg.norm(x)
    depth = -offset / z[2] if abs(z[2]) > 0.1 else -1.0
    origin = np.array([0.0, 0.0, depth]) if depth > 0 else -offset * z
    axes = np.asarray(np.stack([x, np.cross(z, x), z], -1), np.float64)
    return Rigid(axes, origin)
