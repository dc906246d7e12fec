"""Planes fitted to the depth inside quadrilaterals of a depth image, all of an image at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.depth import RangeNoise
from ecat.geometry.transforms import Floats

_ROUNDS = 4
_TUKEY = 4.0
_LEAST_SHARE = 0.5
_MOST_PX, _LARGE_PX = 200, 14


@dataclass(frozen=True)
class FaceFit:
    """Planes (n,): ``normal @ p + offset = 0`` in the camera's reference frame, the normal towards the camera.

    ``sigma_m``: one standard deviation of the plane's distance at the quadrilateral's corners, NaN where there is no
    plane; ``rms_m`` distance of the pixels used along the sight line, ``n_points`` how many they are.
    """

    normal: Floats
    offset: Floats
    sigma_m: Floats
    rms_m: Floats
    n_points: NDArray[np.int64]

    @classmethod
    def joined(cls, parts: Sequence[FaceFit]) -> FaceFit:
        """All of them, one after the other."""
        names = ("normal", "offset", "sigma_m", "rms_m", "n_points")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def fit_faces(
    image: NDArray[Any],
    quads: Floats,
    camera: Camera,
    *,
    unit_m: float,
    noise: RangeNoise,
    steady_m: float,
    shrink: float = 0.9,
    margin_px: float = 1.0,
) -> FaceFit:
    """Fit planes to what a depth image shows inside quadrilaterals.

    A plane's inverse depth is linear in the image, so that weighted least squares with the noise of the range camera is
    a system of three unknowns each; Tukey's weights leave out what is before or behind (Beaton and Tukey 1974).

    Parameters
    ----------
    image : (height, width) in units of ``unit_m``, 0 = nothing measured.
    quads : (n, 4, 2) pixels, finite, running round either way.
    noise : of single pixels; ``steady_m`` is the error that all have alike, which no fit lessens.
    shrink, margin_px : share of the quadrilateral that is used, and by how much less still.
    """
    inner, box = _shrunk(quads, shrink, margin_px), np.asarray(image)
    v, u, inside = _windows(inner, box.shape[:2])
    raw = box[v, u].astype(float) * unit_m
    use = inside & (raw > 0)
    z = np.where(use, raw, 1.0)
    x, y = _sight(camera, u, v)
    rows = np.stack([x, y, np.ones_like(x)], -1)
    weight = use * (z**2 / noise.sigma(z)) ** 2
    plane, trust = _robust(rows, 1 / z, weight)
    used = use & (trust > 0)
    n_points = used.sum(1)
    left = np.where(used, z - 1 / np.maximum(np.einsum("nki,ni->nk", rows, plane), 1e-6), 0.0)
    rms = np.sqrt((left**2).sum(1) / np.maximum(n_points, 1))
    sound = (n_points >= 3) & (n_points > _LEAST_SHARE * inside.sum(1))
    length = np.maximum(np.linalg.norm(plane, axis=1), 1e-9)
    normal, offset = -plane / length[:, None], 1 / length
    sigma = np.hypot(_corner_sigma(rows, weight * trust, quads, plane, camera), steady_m)
    # from the camera's own frame to its reference frame
    to = camera.from_reference
    offset = offset + normal @ to.translation
    return FaceFit(normal @ to.rotation, offset, np.where(sound, sigma, np.nan), rms, n_points)


def _shrunk(quads: Floats, shrink: float, margin_px: float) -> Floats:
    middle = quads.mean(1, keepdims=True)
    arm = quads - middle
    # the least distance of a side from the middle is about half the shorter diagonal's share
    reach = np.linalg.norm(arm, axis=-1, keepdims=True)
    return middle + arm * np.maximum(shrink - margin_px * np.sqrt(2) / np.maximum(reach, 1e-6), 0.0)


def _windows(
    quads: Floats, shape: tuple[int, ...]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Rows, columns and whether inside (n, k), of windows that are as large as the largest quadrilateral."""
    low = np.floor(quads.min(1)).astype(np.intp)
    size = np.clip(np.ceil(quads.max(1)).astype(np.intp) + 1 - low, 1, _MOST_PX)
    # every other pixel of every other row is enough where faces are large
    step = 2 if size.min() >= _LARGE_PX else 1
    du, dv = np.meshgrid(np.arange(0, size[:, 0].max(), step), np.arange(0, size[:, 1].max(), step))
    u, v = low[:, :1] + du.ravel(), low[:, 1:] + dv.ravel()
    side = np.roll(quads, -1, 1) - quads
    gap_u, gap_v = u[:, None] - quads[..., :1], v[:, None] - quads[..., 1:]
    turn = side[..., :1] * gap_v - side[..., 1:] * gap_u
    inside = (turn > 0).all(1) | (turn < 0).all(1)
    inside &= (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
    return np.clip(v, 0, shape[0] - 1), np.clip(u, 0, shape[1] - 1), inside


def _sight(camera: Camera, u: NDArray[Any], v: NDArray[Any]) -> tuple[Floats, Floats]:
    rays = camera.unproject(np.stack([u, v], -1).astype(float))
    return rays[..., 0], rays[..., 1]


def _robust(rows: Floats, inverse: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Planes (n, 3) with ``rows @ plane = inverse`` and how far each pixel (n, k) is trusted."""
    trust, plane = np.ones_like(weight), np.zeros((len(rows), 3))
    for turn in range(_ROUNDS):
        plane = _solve(rows, inverse, weight * trust)
        gap = np.abs(inverse - np.einsum("nki,ni->nk", rows, plane)) * np.sqrt(weight)
        # what is far off at first may only be so because other pixels pulled the plane away
        spread = np.maximum(_middle(gap, weight > 0), 1.0) * (1.5 if turn == 0 else 1.0)
        trust = np.maximum(1 - (gap / (_TUKEY * spread[:, None])) ** 2, 0) ** 2
    return plane, trust


def _middle(gap: Floats, use: NDArray[np.bool_]) -> Floats:
    """Standard deviations (n,) by the median of absolute values."""
    ordered = np.sort(np.where(use, gap, np.inf), axis=1)
    at = np.maximum(use.sum(1) // 2, 0)
    middle = np.take_along_axis(ordered, np.minimum(at, gap.shape[1] - 1)[:, None], 1)[:, 0]
    return np.asarray(np.where(np.isfinite(middle), 1.48 * middle, 1.0), dtype=np.float64)


def _normal(rows: Floats, weight: Floats) -> Floats:
    matrix = np.swapaxes(rows * weight[..., None], 1, 2) @ rows
    # keeps what has too few pixels solvable; far below what one pixel weighs
    return matrix + 1e-9 * (1 + np.einsum("nii->n", matrix))[:, None, None] * np.eye(3)


def _solve(rows: Floats, inverse: Floats, weight: Floats) -> Floats:
    right = ((weight * inverse)[:, None] @ rows)[:, 0]
    return np.asarray(np.linalg.solve(_normal(rows, weight), right[..., None])[..., 0], np.float64)


def _corner_sigma(rows: Floats, weight: Floats, quads: Floats, plane: Floats, camera: Camera) -> Floats:
    """Standard deviation (n,) of the plane's distance at the corners, root mean square."""
    inverse = np.linalg.inv(_normal(rows, weight))
    corners = camera.unproject(quads)
    variance = np.einsum("nci,nij,ncj->nc", corners, inverse, corners)
    there = np.einsum("nci,ni->nc", corners, plane)
    # of inverse depth to depth, and from along the sight line to across the plane
    across = there / np.maximum(np.linalg.norm(plane, axis=1), 1e-9)[:, None]
    z = 1 / np.maximum(np.abs(there), 1e-6)
    return np.sqrt((variance * (z * z * across) ** 2).mean(1))
