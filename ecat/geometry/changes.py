"""Which parts of a video's images have changed since they were last looked at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats

Region: TypeAlias = tuple[int, int, int, int]
"""left, top, right, bottom in pixels; right and bottom are outside."""

TILE_PX = 8
# of eight bytes every other one, as four sums of two bytes each; the product's topmost two bytes are the sum of all
_EVERY_OTHER, _BYTE = np.uint64(0x00FF00FF00FF00FF), np.uint64(8)
_ADD_UP, _MEAN = np.uint64(0x0001000100010001), np.uint64(48 + 4)


def tile_means(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mean grey values of the tiles of an image, TILE_PX wide and high; an incomplete last row or column is cut off.

    Every fourth row is enough.
    """
    height, width = grey.shape[0] // TILE_PX, grey.shape[1] // TILE_PX
    # a row of a tile is one number of eight bytes: its pixels are added up where they are, which is three times as fast
    # as OpenCV's averages
    total = np.zeros((height, width), np.uint64)
    for first in range(0, TILE_PX, 4):
        rows = np.array(grey[first : height * TILE_PX : TILE_PX, : width * TILE_PX], order="C").view(
            np.uint64
        )
        total += rows & _EVERY_OTHER
        rows >>= _BYTE
        rows &= _EVERY_OTHER
        total += rows
    total *= _ADD_UP
    total >>= _MEAN
    return total.astype(np.uint8)


class Changes:
    """Remembers how every tile looked when it was last looked at.

    What is found in a tile can differ from what was found before only if its pixels do.  Sensor noise hardly moves
    the mean of 16 pixels, so ``least`` grey levels are enough of a difference; slow ones add up until they count.
    """

    def __init__(self, least: int) -> None:
        self._least = least
        self._known: NDArray[np.uint8] | None = None

    def look(self, tiles: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Which tiles (rows, columns) changed, or are next to one that did: 1.  They are known from now on."""
        import cv2

        if self._known is None or self._known.shape != tiles.shape:
            return self.all_seen(tiles)
        if not tiles.size:
            return np.zeros_like(tiles)
        changed = cv2.threshold(cv2.absdiff(tiles, self._known), self._least - 1, 1, cv2.THRESH_BINARY)[1]
        cv2.copyTo(tiles, changed, self._known)
        return np.asarray(cv2.dilate(changed, np.ones((3, 3), np.uint8)), np.uint8)

    def all_seen(self, tiles: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Everything is looked at, whether it changed or not."""
        self._known = tiles.copy()
        return np.ones_like(tiles)


def regions(changed: NDArray[np.uint8]) -> list[Region]:
    """Rectangles around tiles (rows, columns) that belong together."""
    import cv2

    if not changed.max(initial=0):
        return []
    outlines, _ = cv2.findContours(changed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = [cv2.boundingRect(outline) for outline in outlines]
    return [(x * TILE_PX, y * TILE_PX, (x + w) * TILE_PX, (y + h) * TILE_PX) for x, y, w, h in boxes]


def marked(changed: NDArray[np.uint8], regions: Sequence[Region]) -> NDArray[np.uint8]:
    """The same, with the tiles of these regions."""
    changed = changed.copy()
    for left, top, right, bottom in regions:
        changed[top // TILE_PX : -(-bottom // TILE_PX), left // TILE_PX : -(-right // TILE_PX)] = 1
    return changed


def touched(
    changed: NDArray[np.uint8], rings: Floats, among: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Which rings (n, 4, 2), of those ``among`` (n,) them, are where some tile (rows, columns) changed."""
    found = np.zeros(len(rings), np.bool_)
    rows = np.arange(len(rings)) if among is None else np.flatnonzero(among)
    if not rows.size or not changed.max(initial=0):
        return found
    tiles = (rings[rows] * (1 / TILE_PX)).clip(0).astype(np.intp)
    # what is beyond the last tile belongs to it
    limit = np.array(changed.shape[::-1]) - 1
    first, last = np.minimum(tiles.min(1), limit).tolist(), tiles.max(1).tolist()
    found[rows] = [changed[t : b + 1, x : r + 1].any() for (x, t), (r, b) in zip(first, last, strict=True)]
    return found


def grown(region: Region, margin: float, shape: tuple[int, int]) -> Region:
    """The region with a margin all around, inside of an image (height, width)."""
    m = int(np.ceil(margin))
    left, top, right, bottom = region
    return max(left - m, 0), max(top - m, 0), min(right + m, shape[1]), min(bottom + m, shape[0])


def around(ring: Floats, way: Floats, shape: tuple[int, ...]) -> Region:
    """Where in an image of this shape something may be that was at a ring (4, 2) one image ago.

    It had moved by ``way`` (4, 2) before.
    """
    far = np.ptp(ring, axis=0).max() / 2 + 3 * np.abs(way).max() + TILE_PX
    (left, top), (right, bottom) = ring.min(0), ring.max(0)
    return grown((int(left), int(top), int(right) + 1, int(bottom) + 1), far, (shape[0], shape[1]))


def merged(regions: list[Region]) -> list[Region]:
    """The same with those that overlap united, until none do."""
    left = list(regions)
    done: list[Region] = []
    while left:
        a = left.pop()
        for other in [*left, *done]:
            if a[0] < other[2] and other[0] < a[2] and a[1] < other[3] and other[1] < a[3]:
                (left if other in left else done).remove(other)
                left.append(
                    (min(a[0], other[0]), min(a[1], other[1]), max(a[2], other[2]), max(a[3], other[3]))
                )
                break
        else:
            done.append(a)
    return sorted(done)
