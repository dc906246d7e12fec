"""Whether a depth camera stood still: stretches of a recording seen from one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.depth import RangeNoise
from ecat.geometry.transforms import Floats

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
        change = np.abs(others - view) / (1.4142 * noise.sigma(np.fmin(others, view)))
        common = np.isfinite(change)
        ordered = np.sort(np.where(common, change, np.inf), 1)
        count = common.sum(1)
        most = ordered[np.arange(len(others)), (share * np.maximum(count - 1, 0)).astype(int)]
        differ[k] = np.where(count >= 0.05 * change.shape[1], most, np.inf)
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
