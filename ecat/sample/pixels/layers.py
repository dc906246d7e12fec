"""Layers of an image: what one thing covers of which pixel, in which colour, and how far away it is.

Composed by their inverse depth, pixel by pixel, so that things may reach into one another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats
from ecat.sample.pixels.view import Pixels, Rect, View

AMBIENT = 0.55
_MIN_SAMPLES, _MAX_SAMPLES = 2, 10
_PER_TEXEL = 1.25
"""Samples per texel: markers' corners are then within 0.03 px of where they belong."""
_HEADLIGHT_SAMPLES = 2
"""A time-of-flight camera's brightness needs no exact outlines."""


@dataclass(frozen=True, eq=False)
class Quad:
    """A flat picture in space: ``corner + s * right + t * down`` for s, t in [0, 1], ``table`` frame, metres.

    ``texture`` (rows, columns, 4) uint8: blue, green, red and coverage, colours multiplied by the coverage.
    """

    corner: Floats
    right: Floats
    down: Floats
    texture: NDArray[np.uint8]

    @property
    def normal(self) -> Floats:
        """Unit normal (3,) out of the picture."""
        # numpy's own cross product takes ten times as long for one pair
        (a, b, c), (x, y, z) = self.down, self.right
        n = np.array([b * z - c * y, c * x - a * z, a * y - b * x])
        return n / math.sqrt(n @ n)

    @property
    def corners(self) -> Floats:
        """(4, 3), clockwise as seen from in front, from the upper left."""
        c, r, d = self.corner, self.right, self.down
        return np.stack([c, c + r, c + r + d, c + d])


@dataclass(frozen=True)
class Capsule:
    """All points nearer than ``radius`` to the line from ``a`` to ``b`` (3,), ``table`` frame, metres."""

    a: Floats
    b: Floats
    radius: float
    color: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Layer:
    """What one thing, or several, make of the pixels of ``rect``.

    Parameters
    ----------
    color : (h, w, 3) blue, green, red, multiplied by ``cover``.
    cover : (h, w) share of the pixel's square.
    inverse_depth : (h, w) at the pixel's centre, 1/m, continued beyond the outline.
    hit : (h, w) whether the sight line through the pixel's centre meets it.
    standing : nothing that never moves is before it.
    """

    rect: Rect
    color: Pixels
    cover: Pixels
    inverse_depth: Pixels
    hit: NDArray[np.bool_]
    standing: bool = False


def lambert(normal: Floats, light: Floats) -> float:
    """Brightness of a matt surface under a lamp in direction ``light`` (3,) and light from all around."""
    return AMBIENT + (1 - AMBIENT) * max(0.0, float(normal @ light))


# ------------------------------------------------------------------------------------------------- flat


def quad_layer(view: View, quad: Quad, shade: float, rect: Rect | None = None) -> Layer | None:
    """A quad as seen, every pixel the mean of its square; None if nothing of it is in the image."""
    rect = rect or view.polygon_rect(quad.corners)
    if rect is None:
        return None
    inverse = view.inverse_depth(rect, quad.normal, quad.corner)
    seen = _warped(view, quad, rect)
    cover = seen[..., 3] / np.float32(255)
    if inverse.min() <= 0:
        seen, cover = seen * (inverse > 0)[..., None], cover * (inverse > 0)
    color = seen[..., :3] * np.float32(shade)
    if view.headlight:
        color = color * tripled(_head_on(view, rect, quad.normal, quad.corner, inverse))
    return Layer(rect, color, cover, inverse, cover >= 0.5)


def _warped(view: View, quad: Quad, rect: Rect) -> Pixels:
    """The texture (h, w, 4) as it falls on the pixels of ``rect``."""
    k = _samples(view, quad)
    rows, columns = quad.texture.shape[:2]
    axes = np.stack([quad.right, quad.down, quad.corner - view.eye], -1)
    pixel_from_quad = view.matrix @ view.from_table.rotation @ axes
    texel_from_quad = np.array([[columns, 0, -0.5], [0, rows, -0.5], [0, 0, 1.0]])
    offset = 0.5 / k - 0.5
    pixel_from_sample = np.array([[1 / k, 0, rect.left + offset], [0, 1 / k, rect.top + offset], [0, 0, 1.0]])
    texel_from_sample = texel_from_quad @ np.linalg.solve(pixel_from_quad, pixel_from_sample)
    height, width = rect.shape
    samples = cv2.warpPerspective(
        quad.texture,
        texel_from_sample,
        (width * k, height * k),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    return np.asarray(cv2.resize(samples, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def _samples(view: View, quad: Quad) -> int:
    """Samples per pixel and axis, so that no texel is left out where the texture is smallest."""
    ring = view.pixels(quad.corners)
    if view.headlight:
        return _HEADLIGHT_SAMPLES
    if not np.isfinite(ring).all():
        return _MIN_SAMPLES
    x, y = ring.T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    longest = float(np.sqrt(((np.roll(ring, -1, 0) - ring) ** 2).sum(-1)).max())
    texels = max(quad.texture.shape[:2]) * longest / max(area, 1e-6)
    return int(np.clip(math.ceil(_PER_TEXEL * texels), _MIN_SAMPLES, _MAX_SAMPLES))


def _head_on(view: View, rect: Rect, normal: Floats, point: Floats, inverse: Pixels) -> Pixels:
    """Cosine (h, w) between a plane's normal and the way back to the camera."""
    x, y = view.rays(rect)
    away = abs(float(normal @ (point - view.eye)))
    return np.asarray(np.abs(inverse) * away / np.sqrt(1 + x * x + y * y), np.float32)


def box_layer(view: View, faces: Sequence[Quad], light: Floats) -> Layer | None:
    """A closed convex body by its faces: those that face the camera, next to one another without a seam."""
    rect = view.rect(np.concatenate([face.corners for face in faces]))
    if rect is None:
        return None
    color, cover = np.zeros((*rect.shape, 3), np.float32), np.zeros(rect.shape, np.float32)
    enter, leave = np.full(rect.shape, np.inf, np.float32), np.full(rect.shape, -np.inf, np.float32)
    for face in faces:
        inverse = view.inverse_depth(rect, face.normal, face.corner)
        if face.normal @ (view.eye - face.corner) <= 0:
            np.maximum(leave, inverse, out=leave)
            continue
        np.minimum(enter, inverse, out=enter)
        shade = 1.0 if view.headlight else lambert(face.normal, light)
        seen = quad_layer(view, face, shade)
        if seen is not None:
            color[seen.rect.within(rect)] += seen.color
            cover[seen.rect.within(rect)] += seen.cover
    return Layer(rect, color, np.minimum(cover, 1), enter, enter > np.maximum(leave, 0), standing=True)


# ------------------------------------------------------------------------------------------------ round


def limb_layer(view: View, capsules: Sequence[Capsule], light: Floats) -> Layer | None:
    """Several capsules that reach into one another, as one layer."""
    rects = [view.rect(np.stack([c.a, c.b]), c.radius, 2) for c in capsules]
    seen = [(capsule, rect) for capsule, rect in zip(capsules, rects, strict=True) if rect is not None]
    if not seen:
        return None
    rect = seen[0][1]
    for _, other in seen[1:]:
        rect = rect.around(other)
    which, bright = np.zeros(rect.shape, np.uint8), np.zeros(rect.shape, np.float32)
    cover, nearest = np.zeros(rect.shape, np.float32), np.zeros(rect.shape, np.float32)
    first, hit = np.zeros(rect.shape, np.float32), np.zeros(rect.shape, bool)
    for number, (capsule, own) in enumerate(seen):
        part = own.within(rect)
        inverse, share, met, shade = _capsule(view, own, capsule, light)
        # a pixel whose centre is beside the outline belongs to it only if nothing else has its centre
        rank = inverse * np.where(met, np.float32(1), np.float32(1e-3)) * (share > 0)
        before = rank > first[part]
        for kept, value in ((first, rank), (nearest, inverse), (bright, shade), (which, np.uint8(number))):
            np.copyto(kept[part], value, where=before)
        hit[part] |= met
        np.maximum(cover[part], share, out=cover[part])
    palette = np.array([capsule.color for capsule, _ in seen], np.float32)
    return Layer(rect, palette[which] * tripled(bright * cover), cover, nearest, hit)


def tripled(values: Pixels) -> Pixels:
    """The same (h, w) for every channel (h, w, 3): multiplying by that is faster than broadcasting."""
    return np.asarray(cv2.merge([values, values, values]), np.float32)


def _capsule(
    view: View, rect: Rect, capsule: Capsule, light: Floats
) -> tuple[Pixels, Pixels, NDArray[np.bool_], Pixels]:
    """Inverse depth, cover, hit and brightness (h, w) of one capsule.

    The sight line's nearest approach to the axis tells the cover; where it is within the radius, the depth is that of
    the line's intersection with the cylinder, or with the ball at the end that it meets first.
    """
    a, b = view.from_table.apply(np.stack([capsule.a, capsule.b])).astype(np.float32)
    axis, r = b - a, np.float32(capsule.radius)
    x, y = view.rays(rect)
    length2 = 1 + x * x + y * y
    by_axis = axis[0] * x + (axis[1] * y + axis[2])
    by_a = a[0] * x + (a[1] * y + a[2])
    axis2, a_axis, a2 = axis @ axis, a @ axis, a @ a
    # nearest approach of sight line and axis
    flat = np.maximum(axis2 * length2 - by_axis**2, 1e-12)
    s = np.clip((by_a * by_axis - a_axis * length2) / flat, 0, 1)
    by_near = by_a + s * by_axis
    gap2 = a2 + s * (2 * a_axis + s * axis2) - by_near**2 / length2
    depth = by_near / length2
    gap = np.sqrt(np.maximum(gap2, 0))
    focal = np.float32(max(view.camera.fx, view.camera.fy))
    cover = np.clip(0.5 + (r - gap) * focal / depth, 0, 1)
    hit = gap < r
    # the cylinder, then whichever ball
    shift = by_a * axis2 - a_axis * by_axis
    root = shift * shift - flat * (axis2 * (a2 - r * r) - a_axis**2)
    met = (shift - np.sqrt(np.maximum(root, 0))) / flat
    along = (met * by_axis - a_axis) / max(axis2, np.float32(1e-12))
    beyond = along > 1
    by_end, end2 = np.where(beyond, by_a + by_axis, by_a), np.where(beyond, b @ b, a2)
    ball = (by_end - np.sqrt(np.maximum(by_end**2 - length2 * (end2 - r * r), 0))) / length2
    inside = (along >= 0) & (along <= 1) & (root > 0)
    depth = np.where(hit, np.where(inside, met, ball), depth)
    return 1 / depth, cover, hit, _round_shade(view, rect, depth, capsule, light)


def _round_shade(view: View, rect: Rect, depth: Pixels, capsule: Capsule, light: Floats) -> Pixels:
    """Brightness (h, w) of a capsule's surface at a depth (h, w)."""
    a, b = view.from_table.apply(np.stack([capsule.a, capsule.b])).astype(np.float32)
    axis, radius, ray = b - a, capsule.radius, view.rays(rect)
    px, py, pz = ray[0] * depth - a[0], ray[1] * depth - a[1], depth - a[2]
    s = (px * axis[0] + py * axis[1] + pz * axis[2]) / np.float32(max(float(axis @ axis), 1e-12))
    s = np.clip(s, 0, 1)
    px, py, pz = px - s * axis[0], py - s * axis[1], pz - s * axis[2]
    if view.headlight:
        length = np.sqrt(1 + ray[0] ** 2 + ray[1] ** 2)
        toward = -(px * ray[0] + py * ray[1] + pz) / (length * np.float32(radius))
        return np.clip(toward, 0.02, 1)
    lamp = (view.from_table.rotation @ light).astype(np.float32)
    toward = (px * lamp[0] + py * lamp[1] + pz * lamp[2]) / np.float32(radius)
    return np.float32(AMBIENT) + np.float32(1 - AMBIENT) * np.clip(toward, 0, 1)


# ------------------------------------------------------------------------------------------ together


def smeared(layer: Layer, way_px: Floats, whole: Rect) -> Layer:
    """The layer while it moves by ``way_px`` (2,), the middle of the way where it was."""
    if float(np.abs(way_px).max()) < 0.25:
        return layer
    reach = math.ceil(float(np.abs(way_px).max()) / 2) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for share in (np.arange(33) - 16) / 33:
        u, v = way_px * share + reach
        i, j = int(v), int(u)
        fu, fv = u - j, v - i
        kernel[i : i + 2, j : j + 2] += np.outer([1 - fv, fv], [1 - fu, fu])
    kernel /= kernel.sum()
    old = layer.rect
    grown = Rect(old.left - reach, old.top - reach, old.right + reach, old.bottom + reach)
    seen = np.dstack([layer.color, layer.cover])
    seen = np.pad(seen, ((reach, reach), (reach, reach), (0, 0)))
    seen = np.asarray(cv2.filter2D(seen, -1, kernel), np.float32)
    inverse = np.pad(layer.inverse_depth, reach, mode="edge")
    hit = np.pad(layer.hit, reach)
    kept = grown.common(whole)
    if kept is None:
        return layer
    part = kept.within(grown)
    return replace(
        layer,
        rect=kept,
        color=seen[part][..., :3],
        cover=seen[part][..., 3],
        inverse_depth=inverse[part],
        hit=hit[part],
    )


def transmissions(layers: Sequence[Layer], background: Pixels | None = None) -> list[Pixels]:
    """What share of each layer's light (h, w) arrives past the others, and past a background's inverse depth."""
    passed = [np.ones(layer.rect.shape, np.float32) for layer in layers]
    for k, layer in enumerate(layers):
        if background is not None and not layer.standing:
            passed[k] *= layer.inverse_depth >= background[layer.rect.slices]
        for other in layers:
            shared = layer.rect.common(other.rect) if other is not layer else None
            if shared is None:
                continue
            mine, theirs = shared.within(layer.rect), shared.within(other.rect)
            nearer = other.inverse_depth[theirs] > layer.inverse_depth[mine]
            passed[k][mine] *= 1 - other.cover[theirs] * nearer
    return passed
