"""How a camera's chip and a time-of-flight sensor spoil what is there.

Sources for the depth camera: range noise of the Kinect v2 grows with the square of the distance and with darkness, a
pixel on an outline lies somewhere between front and back or is lost (Fankhauser et al., ICAR 2015; Sarbolandi,
Lefloch and Kolb, CVIU 2015; Wasenmueller and Stricker, ACCV Workshops 2016).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.sample.pixels.view import Pixels


@dataclass(frozen=True, kw_only=True)
class ColorNoise:
    """Noise of a colour image, in grey levels of 255, independent in every pixel and channel.

    The variance at brightness I is ``read**2 + shot * I``.
    """

    read: float = 1.2
    shot: float = 0.02


@dataclass(frozen=True, kw_only=True)
class DepthNoise:
    """Errors of a time-of-flight camera.

    Parameters
    ----------
    floor_mm, square_mm : a pixel at z metres of a white surface seen head on has the standard deviation
        ``floor_mm + square_mm * z**2``; it grows with the inverse root of brightness times cosine.
    fixed_mm : standard deviation of the error that a pixel has in every image.
    dark_mm : how much nearer a black surface seems than a white one.
    edge_m : a step of more than this between neighbours is an outline.
    flying, torn : probability that a pixel on an outline lies anywhere between both sides, or is lost.
    lost : probability that any pixel is lost.
    faint : brightness times cosine over the square of the distance in metres, below which half the pixels are lost.
    near_m, far_m : range outside which nothing is measured.
    """

    floor_mm: float = 0.5
    square_mm: float = 0.5
    fixed_mm: float = 0.4
    dark_mm: float = 2.0
    edge_m: float = 0.06
    flying: float = 0.35
    torn: float = 0.35
    lost: float = 0.001
    faint: float = 0.006
    near_m: float = 0.5
    far_m: float = 4.5

    def mean_of(self, pixels: float) -> DepthNoise:
        """The noise of a camera each of whose pixels is as large as so many of this one's."""
        less = 1 / math.sqrt(pixels)
        return replace(
            self,
            floor_mm=less * self.floor_mm,
            square_mm=less * self.square_mm,
            fixed_mm=less * self.fixed_mm,
        )


EXACT_COLOR = ColorNoise(read=0.0, shot=0.0)
EXACT_DEPTH = DepthNoise(
    floor_mm=0.0, square_mm=0.0, fixed_mm=0.0, dark_mm=0.0, edge_m=np.inf, lost=0.0, faint=0.0
)


class NoiseTape:
    """Standard normal numbers, drawn once and read from random places: much faster than fresh ones."""

    def __init__(self, seed: int, length: int) -> None:
        self._values = np.random.default_rng([seed, 21]).standard_normal(length, dtype=np.float32)

    def read(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Pixels:
        """An array of the shape, not to be written to."""
        n = int(np.prod(shape))
        start = int(rng.integers(len(self._values) - n + 1))
        return self._values[start : start + n].reshape(shape)


def noisy(image: Pixels, noise: ColorNoise, tape: NoiseTape, rng: np.random.Generator) -> NDArray[np.uint8]:
    """An image (h, w, 3) with noise, as eight bits."""
    if noise == EXACT_COLOR:
        return _eight_bits(image)
    sigma = cv2.sqrt(image * np.float32(noise.shot) + np.float32(noise.read**2))
    return _eight_bits(image + sigma * tape.read(rng, image.shape))


def _eight_bits(image: Pixels) -> NDArray[np.uint8]:
    return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0)), np.uint8)


def time_of_flight(
    depth_m: Pixels,
    bright: Pixels,
    noise: DepthNoise,
    *,
    fixed: Pixels,
    tape: NoiseTape,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """What is measured (h, w), millimetres, 0 = nothing.

    Parameters
    ----------
    depth_m : true depth (h, w).
    bright : share of the light that comes back (h, w): reflectance times the cosine of the incidence.
    fixed : standard normal pattern (h, w) of the sensor.
    """
    square = depth_m * depth_m
    bright = np.maximum(bright, np.float32(0.01))
    sigma = (noise.floor_mm + noise.square_mm * square) / np.sqrt(bright)
    shape = depth_m.shape
    z = depth_m * 1000 + sigma * tape.read(rng, shape) + noise.fixed_mm * fixed
    z = np.asarray(z - noise.dark_mm * np.clip(1 - bright / 0.8, 0, 1), np.float32)
    chance = rng.random(shape, dtype=np.float32)
    gone = (depth_m < noise.near_m) | (depth_m > noise.far_m) | (chance < noise.lost)
    gone |= bright < noise.faint * square * (0.5 + chance)
    if np.isfinite(noise.edge_m):
        z, torn = _outlines(z, depth_m, noise, chance, rng)
        gone |= torn
    measured = np.rint(z).astype(np.uint16)
    measured[gone] = 0
    return measured


def _outlines(
    z: Pixels, depth_m: Pixels, noise: DepthNoise, chance: Pixels, rng: np.random.Generator
) -> tuple[Pixels, NDArray[np.bool_]]:
    """Millimetres with flying pixels, and which are lost."""
    kernel = np.ones((3, 3), np.uint8)
    low, high = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    row, column = np.nonzero(high - low > noise.edge_m)
    draw = chance[row, column]
    between = low[row, column] + rng.random(len(row), dtype=np.float32) * (high - low)[row, column]
    fly = draw < noise.flying
    z[row[fly], column[fly]] = 1000 * between[fly]
    torn = np.zeros(z.shape, bool)
    torn[row, column] = (draw >= noise.flying) & (draw < noise.flying + noise.torn)
    return z, torn
