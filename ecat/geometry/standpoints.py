"""Whether a depth camera stood still: stretches of a recording seen from one place, and what ties them together."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.depth import RangeNoise
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z

MOVED = 3.0
"""Change of depth, in standard deviations, from which the camera has moved.

Noise alone makes about one.
"""
STILL_SHARE, STILL_SHARE_OF_TABLE = 0.7, 0.5
"""The change is that of the pixel that so many, of all and of a table's, change less than.

Hands and what they move change fewer pixels than the rest.  A turn of the camera changes all that is seen at a flat
angle, as tables and floors are, and little of a wall that faces it.
"""
LEAST_IMAGES = 3
"""So many images in succession make a place: somebody who passes before the camera does not."""
_REFERENCES = 5
STOOD_M = 0.02
"""A box that stood still is where the others say, but for this much: its own error, and theirs at its distance."""
SAME_SHAPE = 0.95
"""Two outlines are of one table if so much of both is common to them."""


def thinned(mask: NDArray[np.bool_], most: int = 1500) -> NDArray[np.intp]:
    """Flat indices of evenly spread pixels of a mask (height, width), at most about ``most``."""
    step = max(1, int(np.sqrt(mask.sum() / most)))
    grid = np.zeros_like(mask)
    grid[step // 2 :: step, step // 2 :: step] = True
    return np.flatnonzero(mask & grid)


def changes(some: Floats, others: Floats, noise: RangeNoise, share: float = STILL_SHARE) -> Floats:
    """By how much views differ (m, n): ``share`` of their pixels change by fewer standard deviations.

    Parameters
    ----------
    some, others : metres (m, pixels) and (n, pixels) of the same pixels, NaN = nothing was measured.

    Pixels that only one of two views measured do not count; views with nothing in common differ infinitely.
    """
    differ = np.empty((len(some), len(others)))
    for k, view in enumerate(some):
        first = k if some is others else 0  # two views differ as much either way
        rest = others[first:]
        change = np.abs(rest - view) / (1.4142 * noise.sigma(np.fmin(rest, view)))
        common = np.isfinite(change)
        ordered = np.sort(np.where(common, change, np.inf), 1)
        count = common.sum(1)
        most = ordered[np.arange(len(rest)), (share * np.maximum(count - 1, 0)).astype(int)]
        differ[k, first:] = np.where(count >= 0.05 * change.shape[1], most, np.inf)
        if some is others:
            differ[first:, k] = differ[k, first:]
    return differ


@dataclass(frozen=True, eq=False)
class Standpoint:
    """Images ``members`` (n,) taken from one place, by their positions."""

    members: NDArray[np.intp]


def standpoints(differ: Floats, moved: float = MOVED) -> list[Standpoint]:
    """The places of a camera one after the other, from how much its images differ (n, n).

    Images that agree with no place, because somebody stood before the camera or it was on its way, are in none.
    Fewer than ``LEAST_IMAGES`` images are all from one place; more that never agree are from none.
    """
    n = len(differ)
    if n < LEAST_IMAGES:
        return [Standpoint(np.arange(n))] if n else []
    places: list[list[int]] = []
    waiting: list[int] = []
    for k in range(n):
        if places and np.median(differ[k, places[-1][:_REFERENCES]]) < moved:
            places[-1].append(k)
            waiting.clear()
            continue
        waiting.append(k)
        recent = waiting[-LEAST_IMAGES:]
        if len(recent) == LEAST_IMAGES and differ[np.ix_(recent, recent)].max() < moved:
            places.append(recent)
            waiting = []
    return [Standpoint(np.array(place)) for place in places]


def common_motion(first: Floats, second: Floats) -> Rigid | None:
    """The motion in the plane that takes what stood still from where it is in one frame to where it is in another.

    Parameters
    ----------
    first, second : (boxes, points, 2) places on the table of the same points in both frames, metres.

    Returns
    -------
    first-from-second, as most boxes have it; None without a box, or where no two of several agree.
    """
    most = np.zeros(len(first), bool)
    for one, other in zip(first, second, strict=True):
        motion = _fitted(one, other)
        stood = np.linalg.norm(_moved(motion, second) - first, axis=-1).max(-1) < STOOD_M
        if stood.sum() > most.sum():
            most = stood
    if most.sum() < min(2, len(first)) or not len(first):
        return None
    return _fitted(first[most].reshape(-1, 2), second[most].reshape(-1, 2))


def outline_motion(first: Floats, second: Floats) -> Rigid | None:
    """The motion in the plane that lays one outline (n, 2) of a table on another (m, 2), turned as little as may be.

    By their centres and principal axes; None where they do not fit, as those of two tables, or of a round or square
    one, whose axes could be any.
    """
    (middle, axis), (middle_second, axis_second) = _moments(first), _moments(second)
    turn = (axis - axis_second + np.pi / 2) % np.pi - np.pi / 2
    rotation = matrix_about_z(np.array([turn]))[0]
    motion = Rigid(rotation, np.append(middle, 0.0) - rotation @ np.append(middle_second, 0.0))
    laid = np.asarray(_moved(motion, second), np.float32)
    one = first.astype(np.float32)
    common = cv2.intersectConvexConvex(one, laid)[0]
    share = common / (cv2.contourArea(one) + cv2.contourArea(laid) - common)
    return motion if share >= SAME_SHAPE else None


def _fitted(first: Floats, second: Floats) -> Rigid:
    """The turn and shift in the plane that take points (n, 2) as near as can be to others (Procrustes)."""
    middle, middle_second = first.mean(0), second.mean(0)
    a, b = first - middle, second - middle_second
    turn = np.arctan2((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum(), (a * b).sum())
    rotation = matrix_about_z(np.array([turn]))[0]
    return Rigid(rotation, np.append(middle, 0.0) - rotation @ np.append(middle_second, 0.0))


def _moved(motion: Rigid, points: Floats) -> Floats:
    return points @ motion.rotation[:2, :2].T + motion.translation[:2]


def _moments(outline: Floats) -> tuple[Floats, float]:
    """Centre (2,) and direction of the long axis of a polygon (n, 2)."""
    about = outline.mean(0)
    m = cv2.moments((outline - about).astype(np.float32))
    middle = np.array([m["m10"], m["m01"]]) / m["m00"]
    return middle + about, float(np.arctan2(2 * m["mu11"], m["mu20"] - m["mu02"]) / 2)
