"""Depth images as points: an organised cloud, where its points are in a colour image, and depth at colour pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid

REACH_PX = 6.0
"""A colour pixel has the depth of points that lie so near; two pixels of a Kinect's depth camera."""


@dataclass(frozen=True)
class RangeNoise:
    """One standard deviation of measured depth at z metres: ``floor_m + square * z**2``, metres.

    A time-of-flight camera's noise grows with the square of the distance, a structured-light camera's as well
    (Fankhauser et al., ICAR 2015; Khoshelham and Elberink, Sensors 2012).
    """

    floor_m: float = 0.001
    square: float = 0.0015

    def sigma(self, z: Floats) -> Floats:
        """Of depths z (...) in metres."""
        return self.floor_m + self.square * z * z


@dataclass(frozen=True)
class DepthCamera:
    """What turns the images of a depth camera into points.

    ``unit_m``: metres per unit of an image; 0 = nothing was measured.
    """

    camera: Camera
    unit_m: float = 0.001

    @cached_property
    def rays(self) -> Floats:
        """Sight lines (height, width, 3) through the pixels' centres, z = 1, in the camera's own frame."""
        u, v = np.meshgrid(np.arange(self.camera.width), np.arange(self.camera.height))
        return self.camera.unproject(np.stack([u, v], -1).astype(float))

    def z(self, depth: NDArray[Any]) -> Floats:
        """Metres (height, width) of a depth image, NaN = nothing was measured."""
        return np.where(depth > 0, depth * self.unit_m, np.nan)

    def cloud(self, depth: NDArray[Any], step: int = 1) -> Floats:
        """Points (height, width, 3) in the camera's reference frame, metres, NaN = nothing was measured.

        ``step``: only every so manieth row and column.
        """
        points = self.rays[::step, ::step] * self.z(depth[::step, ::step])[..., None]
        place = self.camera.from_reference
        if np.array_equal(place.rotation, np.eye(3)) and not place.translation.any():
            return points
        return _placed(points, place.inverse())


def _placed(points: Floats, place: Rigid) -> Floats:
    """As ``place.apply``; one product of matrices is much faster than one per row of the image."""
    return (points.reshape(-1, 3) @ place.rotation.T + place.translation).reshape(points.shape)


def within(pixels: Floats, low: Floats, high: Floats) -> NDArray[np.bool_]:
    """Which pixels (..., 2) are in the rectangle from ``low`` (2,) to ``high`` (2,)."""
    u, v = pixels[..., 0], pixels[..., 1]
    with np.errstate(invalid="ignore"):
        return (u >= low[0]) & (u <= high[0]) & (v >= low[1]) & (v <= high[1])


def color_pixels(points: Floats, color: Camera) -> Floats:
    """Pixels (..., 2) of a colour camera where points (..., 3) in its reference frame are; NaN if not in front.

    As ``Camera.project``, but fast for whole clouds.
    """
    seen = _placed(points, color.from_reference)
    z = np.where(seen[..., 2] > 0, seen[..., 2], np.nan)
    focal = np.array([-color.fx if color.mirrored else color.fx, color.fy])
    if any(color.distortion):
        matrix = np.array([[focal[0], 0, color.cx], [0, focal[1], color.cy], [0, 0, 1]])
        front = np.isfinite(seen[..., 0] / z)
        pixels = np.full((*z.shape, 2), np.nan)
        if front.any():
            lens = np.array(color.distortion)
            found = cv2.projectPoints(seen[front], np.zeros(3), np.zeros(3), matrix, lens)[0]
            pixels[front] = found.reshape(-1, 2)
        return pixels
    pixels = np.empty((*z.shape, 2))
    for axis, (scale, centre) in enumerate(zip(focal, (color.cx, color.cy), strict=True)):
        pixels[..., axis] = seen[..., axis] * scale / z + centre
    return pixels


def inside(pixels: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """Which of the pixels (..., 2) lie in a polygon (n, 2) of the same image, to a quarter of a pixel.

    Missing pixels (NaN) lie in none.
    """
    low = np.floor(polygon.min(0)) - 1
    width, height = (np.ceil(polygon.max(0)) + 2 - low).astype(int)
    scale = int(np.clip(2048 // max(width, height, 1), 1, 4))
    mask = np.zeros((height * scale, width * scale), np.uint8)
    cv2.fillPoly(mask, [np.rint((polygon - low) * scale).astype(np.int32)], 1)
    near = within(pixels, low, low + np.array([width - 2, height - 2]))
    result = np.zeros(pixels.shape[:-1], bool)
    column, row = np.rint((pixels[near] - low) * scale).astype(int).T
    result[near] = mask[row, column] > 0
    return result


def depth_at(
    pixels: Floats, cloud_pixels: Floats, points: Floats, *, reach_px: float = REACH_PX
) -> NDArray[np.float64]:
    """Points (n, 3) that are seen at colour pixels (n, 2); NaN where none is within ``reach_px``.

    Of the four points that lie nearest in the image the one nearest to the camera: the others may be behind it, seen
    by the depth camera alone.

    Parameters
    ----------
    cloud_pixels : where in the colour image the points are, (..., 2), of :func:`color_pixels`.
    points : the points (..., 3), metres.
    """
    from scipy.spatial import cKDTree

    found = np.full((len(pixels), 3), np.nan)
    low, high = np.nanmin(pixels, 0) - reach_px, np.nanmax(pixels, 0) + reach_px
    near = within(cloud_pixels, low, high)
    if not near.any():
        return found
    candidates = points[near]
    asked = np.isfinite(pixels).all(-1)
    tree = cKDTree(cloud_pixels[near])
    nearest = tree.query(pixels[asked], k=[1, 2, 3, 4], distance_upper_bound=reach_px)
    away, index = np.asarray(nearest[0], float), np.asarray(nearest[1], int)
    z = np.where(np.isfinite(away), np.append(candidates[:, 2], np.inf)[index], np.inf)
    best = index[np.arange(len(z)), z.argmin(1)]
    found[asked] = np.concatenate([candidates, np.full((1, 3), np.nan)])[best]
    return found


def steady(z: Floats, *, step_m: float = 0.03) -> NDArray[np.bool_]:
    """Which pixels (height, width) of metres are measured and not on an outline, where flying pixels are.

    A pixel is on an outline if it is farther than ``step_m``, and a hundredth of its distance, from the median of its
    neighbours, or if fewer than five of the nine around it are measured.
    """
    measured = np.isfinite(z)
    filled = np.where(measured, z, 0).astype(np.float32)
    middle = cv2.medianBlur(filled, 3)
    many = cv2.boxFilter(measured.astype(np.float32), -1, (3, 3), normalize=False) > 4.5
    return measured & many & (np.abs(filled - middle) < step_m + 0.01 * filled)
