"""Photographs of printed markers, with known corners: drawn eight times as large and averaged down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.markers import cells_of
from ecat.geometry.transforms import Floats

_FINE = 8
_CELL = 16


@dataclass(frozen=True)
class Print:
    """Light on a marker: grey levels of its ink and paper, and the paper's margin in shares of its side."""

    ink: float = 30.0
    paper: float = 210.0
    margin: float = 0.25


def seen_ring(side_px: float, tilt: float, azimuth: float, roll: float, focal_px: float = 1066.0) -> Floats:
    """Corners (4, 2) around (0, 0) of a square, top left of the print first, whose mean side is ``side_px``."""
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    lean = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))[0]
    turned = square @ (np.asarray(lean) @ np.asarray(cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0])).T
    ring, away = np.empty((4, 2)), focal_px / side_px
    for _ in range(8):
        points = turned + np.array([0, 0, away])
        ring = points[:, :2] / points[:, 2:] * focal_px
        away *= float(np.linalg.norm(np.roll(ring, -1, 0) - ring, axis=1).mean()) / side_px
    return np.asarray(ring, np.float64)


def random_ring(rng: np.random.Generator, side_px: float, most_tilt: float = np.radians(65)) -> Floats:
    """A ring around (0, 0) whose normal is drawn from all directions up to a tilt."""
    tilt = float(np.arccos(rng.uniform(np.cos(most_tilt), 1)))
    return seen_ring(side_px, tilt, rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi))


def paint(image: NDArray[np.float32], code: str, ring: Floats, paper: Print | None = None) -> None:
    """Put a marker on a sheet of paper into an image (height, width), its corners (4, 2) at the ring, in its order."""
    paper = paper or Print()
    cells = np.pad(cells_of(code).astype(np.float32), 1)
    texture = np.kron(cells, np.ones((_CELL, _CELL), np.float32)) * (paper.paper - paper.ink) + paper.ink
    edge, size = round(paper.margin * len(texture)), len(texture)
    sheet = cv2.copyMakeBorder(texture, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(paper.paper,))
    span = (1 + 2 * paper.margin) * np.ptp(ring, axis=0).max()
    low = np.maximum(np.floor(ring.mean(0) - span), 0).astype(int)
    high = np.minimum(np.ceil(ring.mean(0) + span).astype(int), image.shape[::-1])
    patch = image[low[1] : high[1], low[0] : high[0]]
    fine = np.kron(patch, np.ones((_FINE, _FINE), np.float32))
    corners = edge - 0.5 + size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    # a pixel's centre is in the middle of its fine pixels
    there = (ring - low + 0.5) * _FINE - 0.5
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), there.astype(np.float32))
    size_px = fine.shape[::-1]
    cv2.warpPerspective(
        sheet, matrix, size_px, dst=fine, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
    )
    small = cv2.resize(fine, patch.shape[::-1], interpolation=cv2.INTER_AREA)
    image[low[1] : high[1], low[0] : high[0]] = small


def exposed(
    image: NDArray[np.float32], rng: np.random.Generator, *, blur_px: float = 0.5, noise: float = 2.0
) -> NDArray[np.uint8]:
    """What a camera makes of it: blurred, noisy, in whole grey levels."""
    blurred = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px > 0 else image
    noisy = blurred + rng.normal(0, noise, image.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def wall(rng: np.random.Generator, shape: tuple[int, int], light: float = 120.0) -> NDArray[np.float32]:
    """An uneven background (height, width)."""
    coarse = rng.normal(0, 1, (shape[0] // 24 + 2, shape[1] // 24 + 2)).astype(np.float32)
    soft = np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)
    return np.asarray(light + 10 * soft, np.float32)


def photograph(
    rng: np.random.Generator,
    codes: Sequence[str],
    rings: Sequence[Floats],
    *,
    shape: tuple[int, int] = (240, 320),
    blur_px: float = 0.5,
    noise: float = 2.0,
    paper: Print | None = None,
) -> NDArray[np.uint8]:
    """An image of several markers."""
    image = wall(rng, shape)
    for code, ring in zip(codes, rings, strict=True):
        paint(image, code, ring, paper)
    return exposed(image, rng, blur_px=blur_px, noise=noise)
