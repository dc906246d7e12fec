"""Flat surfaces in a depth image, found and fitted with regard to the noise of depth cameras, and their outlines.

The inverse depth of a plane is linear in the image: ``1 / z = a @ ray`` with ``a = -normal / offset``.  Where noise
grows with the square of the distance, inverse depth has the same noise everywhere, so that a linear least-squares fit
of it is the best there is and has no bias towards what is far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.depth import RangeNoise
from ecat.geometry.planes import plane_frame
from ecat.geometry.transforms import Floats

MOST_SURFACES = 6
"""Flat surfaces looked for in one image."""
LEAST_SHARE = 0.02
"""A surface takes up at least this share of the measured pixels."""
_TRIALS = 600
_SAMPLE = 4000
_COARSE = 4.0
_FINE = 2.5
_PART = 0.05
"""A part of a table that is cut off is at least so large beside the largest."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane ``normal @ p + offset = 0``, unit normal towards the camera, and its pixels ``mask`` (height, width).

    ``rms_m`` and ``max_m`` are distances from the plane of the pixels that were used: all of ``mask``.
    """

    normal: Floats
    offset: float
    mask: NDArray[np.bool_]
    rms_m: float
    max_m: float


def surfaces(z: Floats, rays: Floats, noise: RangeNoise) -> list[Surface]:
    """The flat surfaces of an image, found one after the other by RANSAC, at most ``MOST_SURFACES``.

    Parameters
    ----------
    z : metres (height, width), NaN = nothing was measured; flying pixels left out.
    rays : sight lines (height, width, 3) with z = 1.
    """
    rng = np.random.default_rng(0)
    left = np.isfinite(z)
    least = max(50, LEAST_SHARE * left.sum())
    found: list[Surface] = []
    while len(found) < MOST_SURFACES and left.sum() >= least:
        start = _best_candidate(z, rays, left, noise, rng)
        if start is None:
            break
        surface = _settled(start, z, rays, left, noise)
        if surface is None:
            break
        found.append(surface)
        left = left & ~surface.mask & ~near_plane(plane_vector(surface), z, rays, noise, _COARSE)
    return [surface for surface in found if surface.mask.sum() >= least]


def surface_near(
    normal: Floats, offset: float, z: Floats, rays: Floats, noise: RangeNoise, *, reach_m: float = 0.04
) -> Surface | None:
    """The flat surface that lies about where a plane is believed to be; None if there is none.

    It may be turned by ten degrees and be ``reach_m`` away where the plane's frame has its origin.
    """
    scale = np.linalg.norm(normal)
    normal, offset = normal / scale, float(offset / scale)
    away = np.abs((rays @ normal) * z + offset)
    measured = np.isfinite(z)
    inside = measured & (np.where(measured, away, np.inf) < reach_m)
    if inside.sum() < max(50, LEAST_SHARE * measured.sum()):
        return None
    start = _best_candidate(z, rays, inside, noise, np.random.default_rng(0))
    surface = None if start is None else _settled(start, z, rays, measured, noise)
    if surface is None or surface.normal @ normal < np.cos(np.radians(10)):
        return None
    origin = plane_frame(normal, offset).translation
    return surface if abs(surface.normal @ origin + surface.offset) < reach_m else None


def tabletop(found: list[Surface]) -> Surface | None:
    """The surface that is most likely a table: large in the image and facing up in it.

    Which way is down is not known; cameras mostly stand upright, so up is -y.  A camera that looks straight down sees
    no surface that faces up: then size alone counts.  Of parallel surfaces the nearest of a fair size is the table, the
    others are shelves below it and the floor.
    """
    if not found:
        return None
    score = [s.mask.sum() * (0.1 + max(0.0, -float(s.normal[1]))) ** 2 for s in found]
    best = int(np.argmax(score))
    level = [
        (s.offset, k)
        for k, s in enumerate(found)
        if s.normal @ found[best].normal > np.cos(np.radians(10)) and score[k] >= score[best] / 4
    ]
    return found[min(level)[1]]


def plane_vector(surface: Surface) -> Floats:
    """``a`` (3,) with which the inverse depth of the plane is ``a @ ray``, 1/m."""
    return -surface.normal / surface.offset


def outline(surface: Surface, rays: Floats, *, epsilon_m: float = 0.02) -> Floats:
    """The outline (n, 3) of a surface on its plane, metres: convex, anticlockwise seen from the camera's side.

    What hides part of an edge does not make the surface smaller where the edge goes on behind it.
    ``epsilon_m``: by how much the outline may differ from the pixels'.
    """
    contours, _ = cv2.findContours(_body(surface.mask), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    pixels = np.concatenate([np.asarray(contour, int).reshape(-1, 2) for contour in contours])
    ray = rays[pixels[:, 1], pixels[:, 0]]
    points = ray / (ray @ plane_vector(surface))[:, None]
    frame = plane_frame(surface.normal, surface.offset)
    flat = frame.inverse().apply(points)[:, :2].astype(np.float32)
    hull = cv2.convexHull(flat, clockwise=False)
    hull = np.asarray(cv2.approxPolyDP(hull, epsilon_m, closed=True), float).reshape(-1, 2)
    if _signed_area(hull) < 0:
        hull = hull[::-1]
    return frame.apply(np.column_stack([hull, np.zeros(len(hull))]))


def _body(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The mask without threads and specks, where other things cross the plane, but with parts that things cut off."""
    size = max(3, mask.shape[1] // 80 | 1)
    filled = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    opened = cv2.morphologyEx(filled, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))
    n, label, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=8)
    if n < 2:
        return mask.astype(np.uint8)
    area = stats[1:, cv2.CC_STAT_AREA]
    kept = 1 + np.flatnonzero(area >= _PART * area.max())
    return np.isin(label, kept).astype(np.uint8)


def _signed_area(ring: Floats) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


# --------------------------------------------------------------------------------------------- fitting


def _best_candidate(
    z: Floats, rays: Floats, left: NDArray[np.bool_], noise: RangeNoise, rng: np.random.Generator
) -> Floats | None:
    """The plane through three neighbouring pixels that most pixels agree with (MSAC)."""
    triples = _triples(left, rng)
    if not len(triples[0][0]):
        return None
    ray = np.stack([rays[t] for t in triples], 1)
    inverse = np.stack([1 / z[t] for t in triples], 1)
    sound = np.abs(np.linalg.det(ray)) > 1e-6
    if not sound.any():
        return None
    candidates = np.linalg.solve(ray[sound], inverse[sound][..., None])[..., 0]
    candidates = candidates[np.linalg.norm(candidates, axis=1) > 1e-3]
    if not len(candidates):
        return None
    row, column = np.nonzero(left)
    some = rng.permutation(len(row))[:_SAMPLE]
    depth, sight = z[row[some], column[some]], rays[row[some], column[some]]
    limit, inverse = _COARSE * noise.sigma(depth) / depth**2, 1 / depth
    cost = [np.minimum(np.abs(sight @ a - inverse) / limit, 1).sum() for a in candidates]
    return candidates[int(np.argmin(cost))]


def _triples(
    left: NDArray[np.bool_], rng: np.random.Generator
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Three rows and columns of pixels that are near each other: they more often lie on one surface."""
    height, width = left.shape
    row, column = np.nonzero(left)
    pick = rng.integers(len(row), size=_TRIALS)
    reach = max(4, min(height, width) // 6)
    spots = [(row[pick], column[pick])]
    for _ in range(2):
        down, right = rng.integers(-reach, reach + 1, (2, _TRIALS))
        spots.append((np.clip(row[pick] + down, 0, height - 1), np.clip(column[pick] + right, 0, width - 1)))
    usable = left[spots[1]] & left[spots[2]]
    return [(r[usable], c[usable]) for r, c in spots]


def near_plane(a: Floats, z: Floats, rays: Floats, noise: RangeNoise, limit: float) -> NDArray[np.bool_]:
    """Which pixels lie within ``limit`` standard deviations of the plane, along the sight line."""
    with np.errstate(invalid="ignore"):
        return np.abs(rays @ a - 1 / z) * z * z < limit * noise.sigma(z)


def _settled(
    a: Floats, z: Floats, rays: Floats, allowed: NDArray[np.bool_], noise: RangeNoise
) -> Surface | None:
    """The surface round a first guess: least squares on what agrees, until that is always the same.

    First everything near counts, in the end only the largest connected part of it, and only what is near by the scatter
    that was found: what stands on a table lies on one side of it and would lift the plane.
    """
    agree = np.zeros_like(allowed)
    a, agree[allowed] = _agreed(a, z[allowed], rays[allowed], noise)
    part = kept = _largest_part(agree)
    if part.sum() < 20:
        return None
    depth, sight = z[part], rays[part]
    inverse, squared, sigma = 1 / depth, depth**2, noise.sigma(depth)
    for _ in range(12):
        residual = (sight @ a - inverse) * squared / sigma
        middle = float(np.median(residual))
        scale = max(1.4826 * float(np.median(np.abs(residual - middle))), 0.05)
        used = np.abs(residual - middle) < _FINE * scale
        kept = np.zeros_like(part)
        kept[part] = used
        before, a = a, _least_squares(depth[used], sight[used], noise)
        if np.abs(a - before).max() < 1e-7:
            break
    length = float(np.linalg.norm(a))
    away = np.abs(rays[kept] @ a * z[kept] - 1) / length
    return Surface(-a / length, 1 / length, kept, float(np.sqrt((away**2).mean())), float(away.max()))


def _agreed(a: Floats, z: Floats, rays: Floats, noise: RangeNoise) -> tuple[Floats, NDArray[np.bool_]]:
    """The plane that fits the pixels (n,) near it best, and which they are; none if they are too few."""
    inside = near_plane(a, z, rays, noise, _COARSE)
    for _ in range(6):
        if inside.sum() < 20:
            return a, np.zeros_like(inside)
        a = _least_squares(z[inside], rays[inside], noise)
        before, inside = inside, near_plane(a, z, rays, noise, _COARSE)
        if np.array_equal(before, inside):
            break
    return a, inside


def _least_squares(z: Floats, rays: Floats, noise: RangeNoise) -> Floats:
    weight = (z * z / noise.sigma(z)) ** 2
    weighted = rays * weight[:, None]
    return np.asarray(np.linalg.solve(weighted.T @ rays, weighted.T @ (1 / z)), np.float64)


def _largest_part(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected part, without threads of single pixels."""
    kernel = np.ones((3, 3), np.uint8)
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(opened, cv2.MORPH_OPEN, kernel)
    n, label, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if n < 2:
        return mask
    return mask & (label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


# ---------------------------------------------------------------------------------------- whole sequences


def resting_depth(stack: NDArray[np.uint16]) -> NDArray[np.float64]:
    """What a depth camera mostly saw: the median (height, width) of images (n, height, width), in their units.

    Only measured values count (0 = none); NaN where fewer than a fifth of the images measured anything.
    """
    return np.concatenate([_median(rows) for rows in _row_blocks(stack)])


def _row_blocks(stack: NDArray[np.uint16]) -> Iterator[NDArray[np.uint16]]:
    for first in range(0, stack.shape[1], 64):
        yield stack[:, first : first + 64]


def _median(stack: NDArray[np.uint16]) -> NDArray[np.float64]:
    n = len(stack)
    ordered = np.sort(np.ascontiguousarray(np.moveaxis(stack, 0, -1)), -1)
    empty = (ordered == 0).sum(-1)
    low, high = (empty + n - 1) // 2, (empty + n) // 2
    pair = [
        np.take_along_axis(ordered, np.minimum(k, n - 1)[..., None], -1)[..., 0].astype(float)
        for k in (low, high)
    ]
    return np.where(n - empty >= max(1, n / 5), (pair[0] + pair[1]) / 2, np.nan)
