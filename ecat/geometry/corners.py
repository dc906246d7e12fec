"""Corners of dark quadrilaterals on bright ground, to a fraction of a pixel.

A corner is where two edges meet, and an edge is known from everything along it: the place of the steepest step across
the edge is measured at many places, a line is fitted through them, and neighbouring lines are intersected.  The
steepest place of a blurred step stays where the step is, so neither blur nor a threshold shifts the corner.

Pixels are OpenCV's: the centre of the top left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
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
# where profiles are taken across an edge, as shares of the part of it that is measured, from its middle
_PLACES = np.linspace(-0.5, 0.5, 12)
# rows of a map that OpenCV's remap takes at once
_ROWS = 16_000
# a least-squares parabola through five equally spaced values: slope and half the curvature, per step
_FIVE = np.arange(5)
_PARABOLA = np.array(
    [(-2 / 10, 2 / 14), (-1 / 10, -1 / 14), (0.0, -2 / 14), (1 / 10, -1 / 14), (2 / 10, 2 / 14)], np.float32
)
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

    def replaced(self, rows: NDArray[np.intp], others: Outlines) -> Outlines:
        """The same with others in these rows."""
        new = Outlines(*(getattr(self, name).copy() for name in self.__dataclass_fields__))
        for name in self.__dataclass_fields__:
            getattr(new, name)[rows] = getattr(others, name)
        return new


@dataclass(frozen=True)
class Several:
    """Some images, each (height, width), and of rings (n,) the image that each is in: its index, ascending.

    Most of what measuring a few rings takes is not spent on pixels: those of some images are measured at once.
    """

    images: Sequence[NDArray[np.uint8]]
    which: NDArray[np.intp]

    def __getitem__(self, rows: NDArray[Any]) -> Several:
        return Several(self.images, self.which[rows])


def sample(
    grey: NDArray[np.uint8] | Several, x: NDArray[np.float32], y: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Grey values (n, k) at pixels x, y (n, k), bilinear; beyond the image its border goes on.

    In several images, the same number of rows belongs to each of their rings.
    """
    if isinstance(grey, Several):
        # ends of the rows of each image
        rows = np.cumsum(np.bincount(grey.which, minlength=len(grey.images))) * len(x)
        ends = [0, *(rows // max(len(grey.which), 1)).tolist()]
        parts = list(zip(grey.images, ends, ends[1:], strict=False))
    else:
        parts = [(grey, 0, len(x))]
    blocks = [
        _remapped(image, x[i : min(i + _ROWS, end)], y[i : min(i + _ROWS, end)])
        for image, start, end in parts
        for i in range(start, end, _ROWS)
    ]
    every = blocks[0] if len(blocks) == 1 else np.concatenate(blocks or [np.empty(x.shape)])
    return np.asarray(every, np.uint8)


def _remapped(grey: NDArray[np.uint8], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[Any]:
    import cv2

    return cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def clockwise(rings: Floats) -> Floats:
    """The same rings (n, 4, 2), those that ran anticlockwise on the screen reversed."""
    x, y = rings[..., 0], rings[..., 1]
    area = (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1)
    return np.where((area < 0)[:, None, None], rings[:, ::-1], rings)


def outline(
    grey: NDArray[np.uint8] | Several, rings: Floats, *, reach_px: float, min_step: float = 8.0
) -> Outlines:
    """The outlines (n) of dark quadrilaterals near the given rings (n, 4, 2), clockwise on the screen.

    Parameters
    ----------
    grey : (height, width) uint8; or some of these, each with its own rings.
    reach_px : how far from the ring an edge is looked for.
    min_step : grey levels per pixel below which a profile has no edge.
    """
    edges = _edges(np.asarray(rings, np.float64))
    # corners round off under blur, so profiles keep away from them
    margin = np.minimum(np.maximum(1.5, 0.08 * edges.length), 0.25 * edges.length)
    tau = (edges.length - 2 * margin)[..., None] * _PLACES
    offset, step, width2 = _steps(grey, edges, tau, reach_px)
    found = step > min_step
    weight = step * found
    line = _fit_lines(tau, offset, weight)
    corners, sigma, bend = _intersect(edges, line)
    total = np.maximum(weight.sum((1, 2)), 1e-9)
    blur = np.sqrt(np.maximum((weight * width2).sum((1, 2)) / total - _SAMPLING_PX2, 0.05))
    contrast = total / np.maximum(found.sum((1, 2)), 1)
    return Outlines(corners, sigma, blur, contrast, bend, line.agree.min(1))


@dataclass(frozen=True)
class _Edges:
    """Edges (n, 4): their middle, which way they go, and the way out; ``length`` in pixels."""

    middle: Floats
    along: Floats
    out: Floats
    length: Floats


def _edges(rings: Floats) -> _Edges:
    side = rings[:, _NEXT] - rings
    length = np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-6)
    along = side / length[..., None]
    return _Edges(rings + 0.5 * side, along, along[..., ::-1] * _OUT, length)


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
    grey: NDArray[np.uint8] | Several, edges: _Edges, tau: Floats, reach_px: float
) -> tuple[Floats, Floats, Floats]:
    """Of every profile (n, 4, places), ``tau`` pixels along the edge from its middle: where its steepest step lies
    along ``out``, how high it is, and its width squared.
    """
    n, _, places = tau.shape
    half = int(np.ceil(reach_px / _STEP_PX)) + 3
    across = (np.arange(-half, half + 1) * _STEP_PX).astype(np.float32)
    x, y = (
        (edges.middle[..., i, None] + tau * edges.along[..., i, None]).astype(np.float32)[..., None]
        + (edges.out[..., i, None] * across).astype(np.float32)[:, :, None]
        for i in (0, 1)
    )
    rows = n * 4, places * len(across)
    values = sample(grey, x.reshape(rows), y.reshape(rows)).astype(np.int16)
    values = values.reshape(n * 4 * places, len(across))
    rise = values[:, 2:] - values[:, :-2]
    peak = np.argmax(rise[:, 2:-2], 1) + 2
    first = np.arange(-2, rise.size - 2, rise.shape[1])
    top = rise.ravel()[(first + peak)[:, None] + _FIVE].astype(np.float32)
    slope, bend = (top @ _PARABOLA).T
    twice = np.minimum(2 * bend, np.float32(-2e-3))
    moved = np.minimum(np.maximum(slope / -twice, -1.0), 1.0)
    height = top[:, 2]
    offset = (peak + (1 - half) + moved) * _STEP_PX
    width2 = np.minimum(height / -twice * _STEP_PX**2, 16.0)
    shape = tau.shape
    return offset.reshape(shape), height.astype(np.float64).reshape(shape), width2.reshape(shape)


def _fit_lines(tau: Floats, offset: Floats, weight: Floats) -> _Lines:
    """Iteratively reweighted least squares: profiles that are off count less and less."""
    w, gap2 = weight, offset
    spread = shift = slope = offset[..., 0]
    moments = np.stack([np.ones_like(tau), tau, tau * tau, offset, tau * offset])
    for scale_px in (1.0, 0.4, 0.25):
        s0, st, stt, so, sto = (moments * w).sum(-1)
        s0 = np.maximum(s0, 1e-9)
        mean_t = st / s0
        # tau runs evenly around zero, so these differences lose no digits
        spread = np.maximum(stt - st * mean_t, 1e-9)
        slope = (sto - so * mean_t) / spread
        shift = so / s0 - slope * mean_t
        gap = offset - shift[..., None] - slope[..., None] * tau
        gap2 = gap * gap
        fall = 1 + gap2 * (1 / scale_px**2)
        w = weight / (fall * fall)
    agree = ((gap2 < 0.75**2) & (weight > 0)).sum(-1) / tau.shape[-1]
    s0 = np.maximum(w.sum(-1), 1e-9)
    # how far profiles are off says how well the line is known; never better than pixels let it
    scatter = (w * gap2).sum(-1) / s0 + _LEAST_PX**2
    # the variance of a mean of so many profiles as the weights are worth
    variance = scatter * np.maximum((w * w).sum(-1), 1e-9) / s0**2
    return _Lines(shift, slope, variance, variance * s0 / spread, agree)


def _intersect(edges: _Edges, line: _Lines) -> tuple[Floats, Floats, Floats]:
    """Where each line meets the one before it, the standard deviation per coordinate, and the least sine."""
    half = 0.5 * edges.length
    middle = edges.middle + edges.out * line.shift[..., None]
    direction = edges.along + edges.out * line.slope[..., None]
    # along and out are at right angles and of length one
    direction /= np.sqrt(1 + line.slope**2)[..., None]
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
