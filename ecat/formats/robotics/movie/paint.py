"""Drawing on images (height, width, 3) uint8, blue first: smooth lines, see-through areas, text of any script."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics.scene import Rgb
from ecat.geometry.transforms import Floats

Image: TypeAlias = NDArray[np.uint8]
_SHIFT = 4
_FAR_PX = 1e5


def line(image: Image, points: Floats, color: Rgb, width: float, *, closed: bool = False) -> None:
    """A line through pixels (n, 2), to a fraction of one; nothing where one of them is unknown."""
    if len(points) > 1 and np.isfinite(points).all():
        cv2.polylines(image, [_fixed(points)], closed, bgr(color), max(round(width), 1), cv2.LINE_AA, _SHIFT)


def area(image: Image, corners: Floats, color: Rgb, opacity: float) -> None:
    """A convex area with these corners (n, 2), through which what lies below is seen."""
    if len(corners) < 3 or not np.isfinite(corners).all():
        return
    low = np.floor(corners.min(0)).astype(int).clip(0)
    high = np.minimum(np.ceil(corners.max(0)).astype(int) + 1, image.shape[1::-1])
    if (high <= low).any():
        return
    part = image[low[1] : high[1], low[0] : high[0]]
    painted = part.copy()
    cv2.fillConvexPoly(painted, _fixed(corners - low), bgr(color), cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(painted, opacity, part, 1 - opacity, 0, dst=part)


def dot(image: Image, place: Floats, color: Rgb, radius: float) -> None:
    """A full circle around a pixel (2,)."""
    if np.isfinite(place).all():
        x, y = _fixed(place[None])[0].tolist()
        cv2.circle(image, (x, y), round(radius * 2**_SHIFT), bgr(color), -1, cv2.LINE_AA, _SHIFT)


def box(image: Image, edges: tuple[float, float, float, float], color: Rgb, opacity: float = 1.0) -> None:
    """A rectangle with round corners: left, top, right, bottom."""
    x0, y0, x1, y1 = map(round, edges)
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, image.shape[1]), min(y1, image.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    part = image[y0:y1, x0:x1]
    mask = _round_mask(y1 - y0, x1 - x0)[..., None] * np.float32(opacity)
    part[:] = part + mask * (np.array(bgr(color), np.float32) - part)


@lru_cache(maxsize=256)
def _round_mask(height: int, width: int) -> NDArray[np.float32]:
    mask = np.zeros((height, width), np.uint8)
    r = min(height // 4, width // 2, 10)
    cv2.rectangle(mask, (r, 0), (width - 1 - r, height - 1), 255, -1)
    cv2.rectangle(mask, (0, r), (width - 1, height - 1 - r), 255, -1)
    for x in (r, width - 1 - r):
        for y in (r, height - 1 - r):
            cv2.circle(mask, (x, y), r, 255, -1, cv2.LINE_AA)
    return mask.astype(np.float32) / np.float32(255)


def text(
    image: Image, at: tuple[float, float], words: str, size: int, color: Rgb, *, weight: int = 400
) -> None:
    """Words, ``size`` pixels high, that begin on the baseline at a pixel."""
    cv2.putText(image, words, (round(at[0]), round(at[1])), bgr(color), _font(), size, weight)


@lru_cache(maxsize=4096)
def text_width(words: str, size: int, weight: int = 400) -> int:
    """How wide words are, pixels."""
    found: Any = cv2.getTextSize((1 << 14, 1 << 8), words, (0, 100), _font(), size, weight)
    return int(found[2])


@lru_cache(maxsize=4096)
def shortened(words: str, size: int, width: float, weight: int = 400) -> str:
    """As many of the characters as fit, with an ellipsis where some do not; nothing where hardly any would."""
    if text_width(words, size, weight) <= width:
        return words
    n = len(words)
    while n > 1 and text_width(words[:n] + "…", size, weight) > width:
        n -= 1 + n // 12
    return f"{words[:n].rstrip()}…" if n > 2 else ""


def wrapped(words: str, size: int, width: float, weight: int = 400) -> list[str]:
    """Words in lines that fit."""
    lines: list[str] = []
    for word in words.split():
        if lines and text_width(f"{lines[-1]} {word}", size, weight) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(shortened(word, size, width, weight))
    return lines


def bgr(color: Rgb) -> tuple[int, int, int]:
    """As OpenCV wants it."""
    return color[2], color[1], color[0]


def mixed(color: Rgb, other: Rgb, share: float) -> Rgb:
    """A colour with a share of another."""
    r, g, b = (round(a + share * (z - a)) for a, z in zip(color, other, strict=True))
    return r, g, b


@cache
def _font() -> Any:
    # OpenCV's own outline font; its drawn-by-lines one has neither weights nor anything beyond ASCII
    return cv2.FontFace("sans")


def _fixed(points: Floats) -> NDArray[np.int32]:
    return np.rint(points.clip(-_FAR_PX, _FAR_PX) * 2**_SHIFT).astype(np.int32)
