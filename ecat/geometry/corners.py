"""Corners of dark quadrilaterals on bright ground, to a fraction of a pixel.

A corner is where two edges meet, and an edge is known from everything along it: the place of the steepest step across
the edge is measured at many places, a line is fitted through them, and neighbouring lines are intersected.  The
steepest place of a blurred step stays where the step is, so neither blur nor a threshold shifts the corner.

Pixels are OpenCV's: the centre of the top left pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats

_STEP_PX = 0.5
_NEXT, _LAST = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
# turns a way along an edge, x and y swapped, into the way out of a ring that runs clockwise on the screen
_OUT = np.array([1.0, -1.0])
_LEAST_PX = 0.02
# rows of a map that OpenCV's remap takes at once
_ROWS = 16_000
# a least-squares parabola through five equally spaced values: slope and half the curvature, per step
_SLOPE = np.array([-2.0, -1.0, 0.0, 1.0, 2.0], np.float32) / 10
_BEND = np.array([2.0, -1.0, -2.0, -1.0, 2.0], np.float32) / 14
# variance in px^2 that sampling itself adds to the width of a step: the difference over one pixel, the
# interpolation, and the parabola that is wider than the step's top
_SAMPLING_PX2 = 0.45


@dataclass(frozen=True)
class Outlines:
    """Quadrilaterals with straight, sharp edges; n of them, all arrays finite.

    Parameters
    ----------
    rings : (n, 4, 2) pixels, in the order they were given.
    sigma_px : (n, 4) one standard deviation of each corner, per coordinate.
    blur_px : (n,) standard deviation of the blur across the edges.
    contrast : (n,) grey levels from inside to outside, across one pixel at the edges.
    bend : (n,) the least sine of a turn from one edge to the next; positive if the ring is convex.
    support : (n,) the least share of an edge, of the four, along which there is a step that the line agrees with.
    """

    rings: Floats
    sigma_px: Floats
    blur_px: Floats
    contrast: Floats
    bend: Floats
    support: Floats

    def __len__(self) -> int:
        return len(self.rings)

    def __getitem__(self, rows: NDArray[Any]) -> Outlines:
        return Outlines(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def sample(grey: NDArray[np.uint8], points: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Grey values (n, k) at pixels (n, k, 2), bilinear; beyond the image its border goes on."""
    import cv2

    blocks = [
        cv2.remap(grey, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for part in (points[i : i + _ROWS] for i in range(0, len(points), _ROWS))
    ]
    every = blocks[0] if len(blocks) == 1 else np.concatenate(blocks or [np.empty(points.shape[:2])])
    return np.asarray(every, np.uint8)


def clockwise(rings: Floats) -> Floats:
    """The same rings (n, 4, 2), those that ran anticlockwise on the screen reversed."""
    x, y = rings[..., 0], rings[..., 1]
    area = (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1)
    return np.where((area < 0)[:, None, None], rings[:, ::-1], rings)


def outline(
    grey: NDArray[np.uint8], rings: Floats, *, reach_px: float, places: int = 12, min_step: float = 8.0
) -> Outlines:
    """The outlines (n) of dark quadrilaterals near the given rings (n, 4, 2), clockwise on the screen.

    Parameters
    ----------
    grey : (height, width) uint8.
    reach_px : how far from the ring an edge is looked for.
    places : how many profiles are taken across each edge.
    min_step : grey levels per pixel below which a profile has no edge.
    """
    edges = _edges(np.asarray(rings, np.float64))
    # corners round off under blur, so profiles keep away from them
    margin = np.clip(1.5 / edges.length, 0.08, 0.25)[..., None]
    tau = (0.5 + (1 - 2 * margin) * np.linspace(-0.5, 0.5, places)) * edges.length[..., None]
    offset, step, width2 = _steps(grey, edges, tau, reach_px)
    weight = np.where(step > min_step, step, 0.0)
    line = _fit_lines(tau - 0.5 * edges.length[..., None], offset, weight)
    corners, sigma, bend = _intersect(edges, line)
    total = np.maximum(weight.sum((1, 2)), 1e-9)
    blur = np.sqrt(np.maximum((weight * width2).sum((1, 2)) / total - _SAMPLING_PX2, 0.05))
    contrast = total / np.maximum((weight > 0).sum((1, 2)), 1)
    return Outlines(corners, sigma, blur, contrast, bend, line.agree.min(1))


@dataclass(frozen=True)
class _Edges:
    """Edges (n, 4): where they start, which way they go, and the way out; ``length`` in pixels."""

    start: Floats
    along: Floats
    out: Floats
    length: Floats


def _edges(rings: Floats) -> _Edges:
    side = rings[:, _NEXT] - rings
    length = np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-6)
    along = side / length[..., None]
    return _Edges(rings, along, along[..., ::-1] * _OUT, length)


@dataclass(frozen=True)
class _Lines:
    """Lines (n, 4) ``offset = shift + slope * tau``, tau from the middle of the edge, and the variances of both.

    ``agree``: the share of profiles that the line agrees with.
    """

    shift: Floats
    slope: Floats
    shift_variance: Floats
    slope_variance: Floats
    agree: Floats


def _steps(
    grey: NDArray[np.uint8], edges: _Edges, tau: Floats, reach_px: float
) -> tuple[Floats, Floats, Floats]:
    """Of every profile (n, 4, places): where its steepest step lies along ``out``, how high, and how wide squared."""
    n, _, places = tau.shape
    half = int(np.ceil(reach_px / _STEP_PX)) + 3
    across = (np.arange(-half, half + 1) * _STEP_PX).astype(np.float32)
    base = (edges.start[:, :, None] + tau[..., None] * edges.along[:, :, None]).astype(np.float32)
    ways = (edges.out[:, :, None] * across[:, None]).astype(np.float32)
    points = base[:, :, :, None] + ways[:, :, None]
    values = sample(grey, points.reshape(n * 4, places * len(across), 2)).astype(np.float32)
    values = values.reshape(n * 4 * places, len(across))
    rise = values[:, 2:] - values[:, :-2]
    peak = np.argmax(rise[:, 2:-2], 1) + 2
    top = rise[np.arange(len(rise))[:, None], peak[:, None] + np.arange(-2, 3)]
    slope, bend = top @ _SLOPE, np.minimum(top @ _BEND, np.float32(-1e-3))
    moved = np.clip(-slope / (2 * bend), -1.0, 1.0)
    height = top[:, 2]
    offset = (across[1:-1][peak] + moved * _STEP_PX).astype(np.float64)
    width2 = np.minimum(height / (-2 * bend) * _STEP_PX**2, 16.0)
    found = np.stack([offset, height, width2]).reshape(3, *tau.shape)
    return found[0], found[1], found[2]


def _fit_lines(tau: Floats, offset: Floats, weight: Floats) -> _Lines:
    """Iteratively reweighted least squares: profiles that are off count less and less."""
    w = weight
    gap, s0, spread = offset, offset[..., 0], offset[..., 0]
    shift = slope = offset[..., 0]
    for scale_px in (1.0, 0.4, 0.25):
        s0 = np.maximum(w.sum(-1), 1e-9)
        wt = w * tau
        mean_t, mean_o = wt.sum(-1) / s0, (w * offset).sum(-1) / s0
        # tau runs evenly around zero, so these differences lose no digits
        spread = np.maximum((wt * tau).sum(-1) - s0 * mean_t**2, 1e-9)
        slope = ((wt * offset).sum(-1) - s0 * mean_t * mean_o) / spread
        shift = mean_o - slope * mean_t
        gap = offset - shift[..., None] - slope[..., None] * tau
        w = weight / (1 + (gap * (1 / scale_px)) ** 2) ** 2
    agree = ((np.abs(gap) < 0.75) & (weight > 0)).mean(-1)
    s0 = np.maximum(w.sum(-1), 1e-9)
    # how far profiles are off says how well the line is known; never better than pixels let it
    scatter = (w * gap**2).sum(-1) / s0 + _LEAST_PX**2
    effective = s0**2 / np.maximum((w**2).sum(-1), 1e-9)
    return _Lines(shift, slope, scatter / effective, scatter / effective * s0 / spread, agree)


def _intersect(edges: _Edges, line: _Lines) -> tuple[Floats, Floats, Floats]:
    """Where each line meets the one before it, the standard deviation per coordinate, and the least sine."""
    half = 0.5 * edges.length
    middle = edges.start + edges.along * half[..., None] + edges.out * line.shift[..., None]
    direction = edges.along + edges.out * line.slope[..., None]
    direction = direction / np.maximum(np.hypot(direction[..., 0], direction[..., 1]), 1e-9)[..., None]
    last, before = middle[:, _LAST], direction[:, _LAST]
    cross = before[..., 0] * direction[..., 1] - before[..., 1] * direction[..., 0]
    bend = cross.min(1)
    cross = np.where(np.abs(cross) < 1e-3, 1e-3, cross)
    gap = middle - last
    way = (gap[..., 0] * direction[..., 1] - gap[..., 1] * direction[..., 0]) / cross
    corners = last + before * way[..., None]
    # each line is off by its shift and by its turn times half its length; the sine spreads both
    variance = line.shift_variance + line.slope_variance * half**2
    return corners, np.sqrt((variance + variance[:, _LAST]) / 2) / np.abs(cross), bend
