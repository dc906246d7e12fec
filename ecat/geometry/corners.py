"""Corners of dark quadrilaterals on bright ground, to a fraction of a pixel.

A corner is where two edges meet, and an edge is known from everything along it: the place of the steepest step across
the edge is measured at many places, a line is fitted through them, and neighbouring lines are intersected.  The
steepest place of a blurred step stays where the step is, so neither blur nor a threshold shifts the corner.

Pixels are OpenCV's: the centre of the top left pixel is (0, 0).  Where it saves work they are complex numbers, x + iy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats

Complex: TypeAlias = NDArray[np.complex128]
Single: TypeAlias = NDArray[np.float32]

_STEP_PX = 0.5
_NEXT, _LAST = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
# a way along an edge times this is the way out of a ring that runs clockwise on the screen
_OUT = -1j
_LEAST_PX = 0.02
# where profiles are taken across an edge, as shares of the part of it that is measured, from its middle
_PLACES = np.linspace(-0.5, 0.5, 12, dtype=np.float32)
_POWERS = np.stack([np.ones_like(_PLACES), _PLACES, _PLACES**2], 1)
# columns of a map that OpenCV's remap takes at once
_COLUMNS = 32_000
# so many bits number the steps of a profile; above them, a step of 255 grey levels still fits into an int16
_BITS = 7
# a least-squares parabola through five equally spaced values: slope and half the curvature, per step
_FIVE = np.arange(5)[:, None]
_PARABOLA = np.array(
    [(-2 / 10, -1 / 10, 0.0, 1 / 10, 2 / 10), (2 / 14, -1 / 14, -2 / 14, -1 / 14, 2 / 14)], np.float32
)
# variance in px^2 that sampling itself adds to the width of a step: the difference over one pixel, the
# interpolation, and the parabola that is wider than the step's top
_SAMPLING_PX2 = 0.45
# what remap takes for a second map where the first has both coordinates
_NO_MAP: Any = None


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

    def __getitem__(self, rows: NDArray[Any] | slice) -> Several:
        return Several(self.images, self.which[rows])

    def spans(self, n: int) -> list[tuple[NDArray[np.uint8], int, int]]:
        """Each image with the first and the end of what belongs to its rings, of n things for all of them."""
        each = n // max(len(self.which), 1)
        ends = (np.searchsorted(self.which, np.arange(len(self.images) + 1)) * each).tolist()
        return list(zip(self.images, ends, ends[1:], strict=False))


def sample(grey: NDArray[np.uint8] | Several, points: Single) -> NDArray[np.uint8]:
    """Grey values (k, n) at pixels (k, n, 2), bilinear; beyond the image its border goes on.

    In several images, the same number of columns belongs to each of their rings.
    """
    import cv2

    k, n, _ = points.shape
    values = np.empty((k, n), np.uint8)
    for image, first, last in grey.spans(n) if isinstance(grey, Several) else [(grey, 0, n)]:
        for i in range(first, last, _COLUMNS):
            part = slice(i, min(i + _COLUMNS, last))
            cv2.remap(
                image, points[:, part], _NO_MAP, cv2.INTER_LINEAR, values[:, part], cv2.BORDER_REPLICATE
            )
    return values


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
    n, each = len(rings), 4 * len(_PLACES)
    edges = _edges(rings)
    offset, step, width2 = _steps(grey, edges, reach_px)
    weight = step * (step > min_step)
    line = _fit_lines(offset, weight)
    corners, sigma, bend = _intersect(edges, line)
    weight = weight.reshape(n, each)
    total = np.maximum(weight.sum(1), 1e-9)
    blur = np.sqrt(np.maximum((weight * width2.reshape(n, each)).sum(1) / total - _SAMPLING_PX2, 0.05))
    contrast = total / np.maximum((weight > 0).sum(1), 1)
    return Outlines(corners, sigma, blur, contrast, bend, line.agree.min(1))


@dataclass(frozen=True)
class _Edges:
    """Edges (n, 4): their middle, and which way they go, of length one; ``length`` in pixels, of which ``span`` are
    measured.
    """

    middle: Complex
    along: Complex
    length: Floats
    span: Floats


def _edges(rings: Floats) -> _Edges:
    corner = np.ascontiguousarray(rings, np.float64).view(np.complex128)[..., 0]
    side = corner[:, _NEXT] - corner
    length = np.maximum(np.abs(side), 1e-6)
    # corners round off under blur, so profiles keep away from them
    margin = np.minimum(np.maximum(1.5, 0.08 * length), 0.25 * length)
    return _Edges(corner + 0.5 * side, side / length, length, length - 2 * margin)


@dataclass(frozen=True)
class _Lines:
    """Lines (n, 4) ``offset = shift + tilt * place``, the place from -1/2 to 1/2, and the variances of both.

    ``agree``: the share of profiles that the line agrees with.
    """

    shift: Floats
    tilt: Floats
    shift_variance: Floats
    tilt_variance: Floats
    agree: Floats


@cache
def _profile(half: int) -> tuple[Single, NDArray[np.int16]]:
    """Where a profile is sampled (2 * half + 1, 1), in pixels; and its steps' numbers, from the last to the first."""
    across = (np.arange(-half, half + 1) * _STEP_PX).astype(np.float32)
    return across[:, None], np.arange(2 * half - 6, -1, -1, dtype=np.int16)[:, None]


def _steps(
    grey: NDArray[np.uint8] | Several, edges: _Edges, reach_px: float
) -> tuple[Single, Single, Single]:
    """Of every profile (n * 4, places): where its steepest step lies on the way out, how high it is, and its width
    squared.
    """
    places = len(_PLACES)
    half = math.ceil(reach_px / _STEP_PX) + 3
    across, number = _profile(half)
    # profiles lie side by side: what is done to one of them is done to many at once
    start = edges.middle[..., None] + (edges.along * edges.span)[..., None] * _PLACES
    out = (edges.along * _OUT).astype(np.complex64).repeat(places)
    points = across * out.view(np.float32)
    points += start.astype(np.complex64).reshape(-1).view(np.float32)
    values = sample(grey, points.reshape(len(across), -1, 2)).astype(np.int16)
    rise = values[2:] - values[:-2]
    # the highest step, of equal ones the first: its number is in the lowest bits
    highest = ((rise[2:-2] << _BITS) + number).max(0)
    peak = len(number) - 1 - (highest & ((1 << _BITS) - 1)).astype(np.intp)
    n = len(peak)
    top = rise.take((peak * n + np.arange(n)) + _FIVE * n).astype(np.float32)
    slope, bend = _PARABOLA @ top
    twice = np.minimum(2 * bend, np.float32(-2e-3))
    moved = np.minimum(np.maximum(slope / -twice, -1.0), 1.0)
    height = top[2]
    offset = (peak.astype(np.float32) + moved + np.float32(3 - half)) * np.float32(_STEP_PX)
    width2 = np.minimum(height / -twice * np.float32(_STEP_PX**2), 16.0)
    return offset.reshape(-1, places), height.reshape(-1, places), width2.reshape(-1, places)


def _fit_lines(offset: Single, weight: Single) -> _Lines:
    """Iteratively reweighted least squares (n * 4, places): profiles that are off count less and less."""
    w, gap2 = weight, offset
    spread = shift = tilt = offset[:, 0]
    for scale_px in (1.0, 0.4, 0.25):
        s0, sp, spp = (w @ _POWERS).T
        so, spo, _ = ((w * offset) @ _POWERS).T
        s0 = np.maximum(s0, 1e-9)
        mean = sp / s0
        # places run evenly around zero, so these differences lose no digits
        spread = np.maximum(spp - sp * mean, 1e-9)
        tilt = (spo - so * mean) / spread
        shift = so / s0 - tilt * mean
        gap = offset - tilt[:, None] * _PLACES
        gap -= shift[:, None]
        gap2 = gap * gap
        fall = gap2 * np.float32(1 / scale_px**2)
        fall += 1
        fall *= fall
        w = weight / fall
    agree = ((gap2 < 0.75**2) & (weight > 0)).sum(1) / len(_PLACES)
    s0 = np.maximum(w.sum(1), 1e-9)
    # how far profiles are off says how well the line is known; never better than pixels let it
    scatter = (w * gap2).sum(1) / s0 + _LEAST_PX**2
    # the variance of a mean of so many profiles as the weights are worth
    variance = scatter * np.maximum((w * w).sum(1), 1e-9) / s0**2
    every = np.array([shift, tilt, variance, variance * s0 / spread, agree], np.float64)
    return _Lines(*every.reshape(5, -1, 4))


def _intersect(edges: _Edges, line: _Lines) -> tuple[Floats, Floats, Floats]:
    """Where each line meets the one before it, the standard deviation per coordinate, and the least sine."""
    middle = edges.middle + edges.along * _OUT * line.shift
    turn = 1 + _OUT * (line.tilt / edges.span)
    direction = edges.along * turn / np.abs(turn)
    last, before = middle[:, _LAST], direction[:, _LAST]
    cross = (before.conj() * direction).imag
    bend = cross.min(1)
    cross = np.where(np.abs(cross) < 1e-3, 1e-3, cross)
    way = ((middle - last).conj() * direction).imag / cross
    corners = last + before * way
    # each line is off by its shift and by its turn times half its length; the sine spreads both
    variance = line.shift_variance + line.tilt_variance * (0.5 * edges.length / edges.span) ** 2
    sigma = np.sqrt((variance + variance[:, _LAST]) / 2) / np.abs(cross)
    return corners.view(np.float64).reshape(-1, 4, 2), sigma, bend
