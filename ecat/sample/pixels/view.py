"""A camera that looks at the table, as the renderer needs it: rectangles of pixels and the sight lines through them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid

Pixels: TypeAlias = NDArray[np.float32]
_NEAR_M = 0.05


@dataclass(frozen=True)
class Rect:
    """Pixels ``left <= u < right``, ``top <= v < bottom``."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """To index an image (height, width, ...)."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def common(self, other: Rect) -> Rect | None:
        """What both have, if anything."""
        made = Rect(
            max(self.left, other.left),
            max(self.top, other.top),
            min(self.right, other.right),
            min(self.bottom, other.bottom),
        )
        return made if made.left < made.right and made.top < made.bottom else None

    def around(self, other: Rect) -> Rect:
        """The least rectangle with both in it."""
        return Rect(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )

    def within(self, other: Rect) -> tuple[slice, slice]:
        """To index an image of ``other``: the slices of this rectangle in it."""
        return (
            slice(self.top - other.top, self.bottom - other.top),
            slice(self.left - other.left, self.right - other.left),
        )


@dataclass(frozen=True)
class View:
    """A camera without lens distortion and where it is.

    Pixel centres are at whole numbers, as ``Camera.project`` and OpenCV have it: the image reaches from -0.5 to
    width - 0.5.  A sight line through (u, v) is ``(x, y, 1)`` in the camera's own frame.

    Parameters
    ----------
    camera : as in the session.
    from_table : the camera's own frame from the ``table`` frame.
    headlight : lit from the camera itself, as a time-of-flight camera sees its scene.

    Raises
    ------
    UsageError : the camera's lens is not modelled as a pinhole.
    """

    camera: Camera
    from_table: Rigid
    headlight: bool = False

    def __post_init__(self) -> None:
        if any(self.camera.distortion):
            raise UsageError(
                f"cannot render for {self.camera.name}",
                where="the camera has lens distortion",
                fix="render for the same camera without distortion",
            )

    @property
    def whole(self) -> Rect:
        """The image."""
        return Rect(0, 0, self.camera.width, self.camera.height)

    @cached_property
    def matrix(self) -> Floats:
        """Homogeneous pixels from points in the camera's own frame (3, 3)."""
        c = self.camera
        return np.array([[-c.fx if c.mirrored else c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def eye(self) -> Floats:
        """Centre (3,) of the camera in the ``table`` frame, metres."""
        return self.from_table.inverse().translation

    def pixels(self, points: Floats) -> Floats:
        """Pixels (..., 2) of points (..., 3) in the ``table`` frame; NaN for points that are not in front."""
        seen = self.from_table.apply(points) @ self.matrix.T
        return seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)

    @cached_property
    def _axes(self) -> tuple[Pixels, Pixels]:
        k = self.matrix
        x = (np.arange(self.camera.width) - k[0, 2]) / k[0, 0]
        y = (np.arange(self.camera.height) - k[1, 2]) / k[1, 1]
        return x.astype(np.float32)[None], y.astype(np.float32)[:, None]

    def rays(self, rect: Rect) -> tuple[Pixels, Pixels]:
        """The x (1, w) and y (h, 1) of the sight lines through the pixels of a part of the image."""
        x, y = self._axes
        return x[:, rect.left : rect.right], y[rect.top : rect.bottom]

    def inverse_depth(self, rect: Rect, normal: Floats, point: Floats) -> Pixels:
        """1 / z (h, w) where sight lines meet a plane through ``point`` (3,), ``table`` frame, 1/m.

        Negative where the plane is behind the camera: the inverse depth of a plane is linear in the image.
        """
        n = self.from_table.rotation @ normal
        n = (n / (n @ self.from_table.apply(point))).astype(np.float32)
        x, y = self.rays(rect)
        return n[0] * x + (n[1] * y + n[2])

    def rect(self, points: Floats, radius_m: float = 0.0, margin_px: int = 1) -> Rect | None:
        """The part of the image with balls of ``radius_m`` round points (n, 3) of the ``table`` frame in it."""
        seen = self.from_table.apply(points)
        if (seen[:, 2] - radius_m < _NEAR_M).any():
            return self.whole
        uv = (seen @ self.matrix.T)[:, :2] / seen[:, 2:]
        # a ball's outline is a little wider off the axis than f r / z
        reach = 1.3 * radius_m * max(self.camera.fx, self.camera.fy) / (seen[:, 2:] - radius_m) + margin_px
        low, high = np.floor((uv - reach).min(0)), np.ceil((uv + reach).max(0)) + 1
        made = Rect(int(low[0]), int(low[1]), int(high[0]), int(high[1]))
        return made.common(self.whole)

    def polygon_rect(self, ring: Floats) -> Rect | None:
        """The part of the image with a flat polygon (n, 3) of the ``table`` frame in it, as far as it is in front."""
        seen = self.from_table.apply(ring)
        kept: list[Floats] = []
        for a, b in zip(seen, np.roll(seen, -1, 0), strict=True):
            if a[2] >= _NEAR_M:
                kept.append(a)
            if (a[2] < _NEAR_M) != (b[2] < _NEAR_M):
                kept.append(a + (_NEAR_M - a[2]) / (b[2] - a[2]) * (b - a))
        if not kept:
            return None
        uv = np.array(kept) @ self.matrix.T
        uv = np.clip(uv[:, :2] / uv[:, 2:], -1e6, 1e6)
        low, high = np.floor(uv.min(0)) - 1, np.ceil(uv.max(0)) + 2
        return Rect(int(low[0]), int(low[1]), int(high[0]), int(high[1])).common(self.whole)


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same camera with other pixels."""
    x, y = width / camera.width, height / camera.height
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * x,
        fy=camera.fy * y,
        cx=(camera.cx + 0.5) * x - 0.5,
        cy=(camera.cy + 0.5) * y - 0.5,
    )


def flipped(camera: Camera) -> Camera:
    """The same camera whose images are delivered the other way round, left for right."""
    return replace(camera, mirrored=not camera.mirrored, cx=camera.width - 1 - camera.cx)
