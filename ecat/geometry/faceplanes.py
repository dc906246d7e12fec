"""Planes fitted to the depth inside quadrilaterals of depth images, those of some images at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.depth import DepthCamera, RangeNoise
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

    def __getitem__(self, rows: NDArray[Any]) -> FaceFit:
        return FaceFit(
            self.normal[rows], self.offset[rows], self.sigma_m[rows], self.rms_m[rows], self.n_points[rows]
        )

    @classmethod
    def joined(cls, parts: Sequence[FaceFit]) -> FaceFit:
        """All of them, one after the other."""
        names = ("normal", "offset", "sigma_m", "rms_m", "n_points")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def fit_faces(
    images: Iterable[NDArray[Any]],
    quads: Floats,
    which: NDArray[np.intp],
    depth: DepthCamera,
    *,
    noise: RangeNoise,
    steady_m: float,
    shrink: float = 0.9,
    margin_px: float = 1.0,
) -> FaceFit:
    """Fit planes to what depth images show inside quadrilaterals.

    A plane's inverse depth is linear in the image, so that weighted least squares with the noise of the range camera is
    a system of three unknowns each; Tukey's weights leave out what is before or behind (Beaton and Tukey 1974).

    Parameters
    ----------
    images : of the camera ``depth``, taken one after the other.
    quads : (n, 4, 2) pixels, finite, running round either way.
    which : (n,) the image that each is in, ascending; every image has one or more.
    noise : of single pixels; ``steady_m`` is the error that all have alike, which no fit lessens.
    shrink, margin_px : share of the quadrilateral that is used, and by how much less still.
    """
    camera = depth.camera
    v, u, inside = _windows(_shrunk(quads, shrink, margin_px))
    inside &= (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    v, u = np.clip(v, 0, camera.height - 1), np.clip(u, 0, camera.width - 1)
    z = np.empty(u.shape)
    first = np.flatnonzero(np.diff(which, prepend=-1))
    for image, start, end in zip(images, first, [*first[1:], len(which)], strict=True):
        z[start:end] = image[v[start:end], u[start:end]] * depth.unit_m
    use = inside & (z > 0)
    z = np.where(use, z, 1.0)
    rows = depth.rays[v, u]
    weight = use * (z**2 / noise.sigma(z)) ** 2
    plane, trust = _robust(rows, 1 / z, weight)
    used = use & (trust > 0)
    n_points = used.sum(1)
    left = np.where(used, z - 1 / np.maximum((rows @ plane[..., None])[..., 0], 1e-6), 0.0)
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


def _windows(quads: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Rows, columns and whether inside (n, k), of windows with as many pixels as the largest quadrilateral needs."""
    low = np.floor(quads.min(1)).astype(np.intp)
    size = np.clip(np.ceil(quads.max(1)).astype(np.intp) + 1 - low, 1, _MOST_PX)
    # every other pixel of every other row is enough where faces are large
    step = np.where(size.min(1) >= _LARGE_PX, 2, 1)[:, None]
    du, dv = np.meshgrid(*(np.arange(n) for n in (-(-size // step)).max(0)))
    u, v = low[:, :1] + step * du.ravel(), low[:, 1:] + step * dv.ravel()
    side = np.roll(quads, -1, 1) - quads
    turn = [side[:, i, :1] * (v - quads[:, i, 1:]) - side[:, i, 1:] * (u - quads[:, i, :1]) for i in range(4)]
    inside = np.logical_and.reduce([t > 0 for t in turn]) | np.logical_and.reduce([t < 0 for t in turn])
    return v, u, inside


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
