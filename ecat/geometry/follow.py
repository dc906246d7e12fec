"""Following a drawn shape through images: optical flow of points inside it, checked back and forth.

Points on the object are followed with the pyramidal method of Lucas and Kanade; one counts if it comes back to where it
was when it is followed backwards (Kalal, Mikolajczyk and Matas, ICPR 2010), if it moves as most others do, and if its
depth is that of the object.  How much what is inside the shape still looks like what was drawn says how sure the shape
is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats

Gray: TypeAlias = NDArray[np.uint8]
Ranges: TypeAlias = Callable[[Floats], Floats]
"""Depth in metres (n,) at pixels (n, 2) of an image, NaN where it is not known."""
_LEAST_POINTS = 5
_STILL_PX = 1.0
_TEMPLATE_PX = 64
_LEAST_OWN = 0.2
_LOOK: dict[str, Any] = {
    "winSize": (21, 21),
    "maxLevel": 3,
    "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
}


@dataclass(frozen=True)
class FollowParameters:
    """How shapes are followed.

    Parameters
    ----------
    points : at most so many are followed in a shape.
    back_px : how far from its start a point may end that is followed there and back.
    together_px : how far a point may be from where the shape's motion takes it.
    depth_m : how far behind or before the object a point may lie.
    margin_px : how far beyond the shape points are looked for.
    sure : confidence from which a shape is tracked rather than proposed.
    least : confidence below which the shape is not believed and not moved.
    patience, haste : images after which a shape that is not found again is lost, if it stood still when it was last
        seen, and if it moved.
    """

    points: int = 100
    back_px: float = 1.0
    together_px: float = 2.5
    depth_m: float = 0.06
    margin_px: int = 60
    sure: float = 0.6
    least: float = 0.3
    patience: int = 90
    haste: int = 15


@dataclass(frozen=True, eq=False)
class Followed:
    """A shape (n, 2) in an image, pixels, and how sure it is, 0 to 1."""

    polygon: Floats
    confidence: float


@dataclass(frozen=True, eq=False)
class _Sight:
    """An image, points of the object in it (n, 2), and where the same points are in the image that was drawn on."""

    gray: Gray
    points: Floats
    drawn: Floats


class Follower:
    """Follows one shape from the image in which it was drawn; the images must come one after the other.

    Parameters
    ----------
    gray : the image (height, width).
    polygon : the shape (n, 2) in it, pixels, at least three vertices.
    ranges : depth at pixels of this image, if it is known.
    """

    def __init__(
        self,
        gray: Gray,
        polygon: Floats,
        ranges: Ranges | None = None,
        parameters: FollowParameters | None = None,
    ) -> None:
        self._parameters = parameters or FollowParameters()
        self._drawn = np.asarray(polygon, float)
        self._band = _band(ranges, self._drawn, self._parameters)
        self._template = _Template(gray, self._drawn, lambda points: _within(self._band, ranges, points))
        self._now = np.eye(3)
        self._missing, self._patience = 0, self._parameters.patience
        self._last = self._sure = self._planted(gray, ranges)
        self._enough = len(self._last.points) / 2

    def step(self, gray: Gray, ranges: Ranges | None = None) -> Followed | None:
        """The shape in the next image; None once it is lost."""
        p = self._parameters
        for start in (self._last, self._sure)[: 2 if self._missing else 1]:
            found = self._found(start, gray, ranges)
            if found is not None and found[1] >= p.least:
                before = _moved(self._now, self._drawn)
                self._now, confidence, self._last = found
                way_px = float(np.abs(_moved(self._now, self._drawn) - before).max())
                self._missing, self._patience = 0, p.haste if way_px > _STILL_PX else p.patience
                if confidence >= p.sure:
                    self._renew(gray, ranges)
                return Followed(_moved(self._now, self._drawn), confidence)
        self._missing += 1
        if self._missing > self._patience:
            return None
        hope = 1 - self._missing / (self._patience + 1)
        return Followed(_moved(self._now, self._drawn), p.least * hope)

    def _found(self, start: _Sight, gray: Gray, ranges: Ranges | None) -> tuple[Floats, float, _Sight] | None:
        """Where the drawn shape is in an image (3, 3), how sure that is, and its points there."""
        p = self._parameters
        if len(start.points) < _LEAST_POINTS:
            return None
        points = _flow(start.gray, gray, start.points, p)
        seen = np.flatnonzero(np.isfinite(points).all(1))
        seen = seen[_within(self._band, ranges, points[seen])]
        if len(seen) < _LEAST_POINTS:
            return None
        points, drawn = points[seen], start.drawn[seen]
        matrix, together = cv2.estimateAffinePartial2D(
            drawn, points, ransacReprojThreshold=p.together_px, maxIters=500
        )
        kept = together.ravel() > 0
        if not np.isfinite(matrix).all() or kept.sum() < _LEAST_POINTS:
            return None
        matrix = np.array([*matrix, [0, 0, 1]], np.float64)
        support = min(1.0, 2 * int(kept.sum()) / max(len(start.points), 2 * _LEAST_POINTS))
        sight = _Sight(gray, points[kept], drawn[kept])
        return matrix, support * self._template.likeness(gray, matrix), sight

    def _renew(self, gray: Gray, ranges: Ranges | None) -> None:
        """Remember where the object was surely seen, with new points if few are left."""
        if len(self._last.points) < self._enough:
            self._last = self._planted(gray, ranges)
            self._enough = len(self._last.points) / 2
        self._sure = self._last
        if self._band is not None and ranges is not None and len(self._last.points):
            z = ranges(self._last.points)
            if np.isfinite(z).sum() >= _LEAST_POINTS:
                self._band = float(np.nanmedian(z)), self._band[1]

    def _planted(self, gray: Gray, ranges: Ranges | None) -> _Sight:
        """New points inside the shape where it is now."""
        points = _corners(gray, _moved(self._now, self._drawn), self._parameters.points)
        points = points[_within(self._band, ranges, points)]
        return _Sight(gray, points, _moved(np.asarray(np.linalg.inv(self._now), np.float64), points))


def _band(ranges: Ranges | None, polygon: Floats, p: FollowParameters) -> tuple[float, float] | None:
    """Distance of the object from the camera, and how far before or behind it a point may lie, metres.

    Measured round the middle of the shape: what is drawn too large has the background along its edge.
    """
    if ranges is None:
        return None
    middle = polygon.mean(0)
    rim = np.concatenate([polygon, (polygon + np.roll(polygon, 1, 0)) / 2]) - middle
    z = ranges(np.concatenate([middle + share * rim for share in (0.1, 0.2, 0.3, 0.4, 0.5)]))
    if np.isfinite(z).sum() < _LEAST_POINTS:
        return None
    distance = float(np.nanmedian(z))
    return distance, 3 * float(np.nanmedian(np.abs(z - distance))) + p.depth_m


def _within(band: tuple[float, float] | None, ranges: Ranges | None, points: Floats) -> NDArray[np.bool_]:
    """Which points are as far away as the object, or at a distance that is not known."""
    if band is None or ranges is None or not len(points):
        return np.ones(len(points), bool)
    return ~(np.abs(ranges(points) - band[0]) > band[1])


class _Template:
    """What was inside a drawn shape, small; ``belongs`` says which points in it (n, 2) are of the object."""

    def __init__(self, gray: Gray, polygon: Floats, belongs: Callable[[Floats], NDArray[np.bool_]]) -> None:
        low, high = polygon.min(0), polygon.max(0)
        scale = max(float((high - low).max()) / _TEMPLATE_PX, 0.5)
        width, height = np.maximum(np.ceil((high - low) / scale), 4).astype(int)
        self._size = int(width), int(height)
        self._to_image = np.array([[scale, 0, low[0]], [0, scale, low[1]], [0, 0, 1]])
        mask = np.zeros((height, width), np.uint8)
        cv2.fillPoly(mask, [np.rint((polygon - low) / scale).astype(np.int32)], 1)
        row, column = np.nonzero(mask)
        own = belongs(np.column_stack([column, row]) * scale + low)
        if own.mean() > _LEAST_OWN:
            mask[row[~own], column[~own]] = 0
        self._mask = mask > 0
        self._drawn = self._values(gray, np.eye(3))

    def likeness(self, gray: Gray, from_drawn: Floats) -> float:
        """Correlation of what is inside the shape with what was drawn, 0 to 1."""
        values = self._values(gray, from_drawn)
        return float(np.clip(values @ self._drawn, 0, 1))

    def _values(self, gray: Gray, from_drawn: Floats) -> Floats:
        """Brightness (pixels,), mean 0 and length 1."""
        matrix = (from_drawn @ self._to_image)[:2]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        patch = cv2.warpAffine(gray, matrix, self._size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        values = cv2.GaussianBlur(patch, (3, 3), 0)[self._mask].astype(float)
        values -= values.mean()
        return values / max(float(np.linalg.norm(values)), 1e-9)


def _moved(matrix: Floats, points: Floats) -> Floats:
    return points @ matrix[:2, :2].T + matrix[:2, 2]


def _corners(gray: Gray, polygon: Floats, most: int) -> Floats:
    """Points (n, 2) inside a shape whose surroundings are distinct."""
    low, high = _window(gray, polygon, 2)
    part = gray[low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(polygon - low).astype(np.int32)], 255)
    apart = max(3.0, float(np.sqrt((mask > 0).sum() / most)) / 2)
    found = cv2.goodFeaturesToTrack(part, most, 0.01, apart, mask=mask) if part.size else None
    return np.empty((0, 2)) if found is None else np.asarray(found, np.float64).reshape(-1, 2) + low


def _window(gray: Gray, points: Floats, margin: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last corner of the part of an image round points (n, 2), the last one outside."""
    limit = np.array(gray.shape[::-1])
    low = np.clip(np.floor(points.min(0)) - margin, 0, limit).astype(np.int64)
    return low, np.clip(np.ceil(points.max(0)) + 1 + margin, 0, limit).astype(np.int64)


def _flow(before: Gray, now: Gray, points: Floats, p: FollowParameters) -> Floats:
    """Where points (n, 2) of one image are in another; NaN where that is not sure."""
    low, high = _window(before, points, p.margin_px)
    window = slice(low[1], high[1]), slice(low[0], high[0])
    one, two = before[window], now[window]
    start = (points - low).astype(np.float32).reshape(-1, 1, 2)
    there, seen, _ = cv2.calcOpticalFlowPyrLK(one, two, start, np.empty_like(start), **_LOOK)
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(two, one, there, np.empty_like(start), **_LOOK)
    away = np.linalg.norm((back - start)[:, 0], axis=1)
    good = (seen[:, 0] > 0) & (seen_back[:, 0] > 0) & (away < p.back_px)
    return np.where(good[:, None], np.asarray(there[:, 0], np.float64) + low, np.nan)
