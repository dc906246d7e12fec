"""Rotations and rigid transforms, vectorised over any leading axes.

Conventions: right-handed, metres, radians, quaternions x, y, z, w (scalar last, w >= 0 where made here).
``Rigid`` named ``a_from_b`` maps coordinates in frame b to coordinates in frame a.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


def known(points: Floats, axes: int = 1) -> NDArray[np.bool_]:
    """Whether no number along the last ``axes`` axes is missing (NaN)."""
    flat = np.isfinite(points).reshape(*points.shape[: points.ndim - axes], -1)
    return np.asarray(flat.all(axis=-1), np.bool_)


@dataclass(frozen=True)
class Rigid:
    """A rigid transform ``x -> rotation @ x + translation`` (or a whole array of them).

    ``rotation`` (..., 3, 3), ``translation`` (..., 3) in metres; the leading axes broadcast.
    """

    rotation: Floats
    translation: Floats

    @classmethod
    def identity(cls) -> Rigid:
        """The transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_quaternion(cls, quaternion: Floats, translation: Floats) -> Rigid:
        """From a quaternion (..., 4) in x, y, z, w order and a translation (..., 3)."""
        return cls(matrix_from_quaternion(quaternion), np.asarray(translation, float))

    @property
    def quaternion(self) -> Floats:
        """(..., 4), x, y, z, w."""
        return quaternion_from_matrix(self.rotation)

    def apply(self, points: Floats) -> Floats:
        """Map points (..., 3); for an array of transforms the points' leading axes must broadcast with it."""
        return np.einsum("...ij,...j->...i", self.rotation, points) + self.translation

    def inverse(self) -> Rigid:
        """The way back: ``b_from_a`` of ``a_from_b``."""
        back = np.swapaxes(self.rotation, -1, -2)
        return Rigid(back, -np.einsum("...ij,...j->...i", back, self.translation))

    def __matmul__(self, other: Rigid) -> Rigid:
        """``(a_from_b @ b_from_c)`` is ``a_from_c``."""
        return Rigid(self.rotation @ other.rotation, self.apply(other.translation))


def skew(vectors: Floats) -> Floats:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3): ``skew(a) @ b == cross(a, b)``."""
    v = np.asarray(vectors, float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    return out - np.swapaxes(out, -1, -2)


def matrix_from_rotvec(rotvec: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues' formula)."""
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    k = skew(rotvec)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    # the series keeps the first-order term exact where the quotient would lose its digits
    a = np.where(small, 1.0 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.eye(3) + a * k + b * (k @ k)


def matrix_about_z(angle: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) by ``angle`` (...) radians about +z."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).reshape(*np.shape(angle), 3, 3)


def matrix_from_quaternion(quaternion: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), x, y, z, w; normalised first, NaN stays NaN."""
    q = np.asarray(quaternion, float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., :3])
    return np.eye(3) + 2 * (q[..., 3, None, None] * k + k @ k)


def quaternion_from_matrix(rotation: Floats) -> Floats:
    """Quaternions (..., 4), x, y, z, w with w >= 0, of rotation matrices (..., 3, 3); NaN stays NaN.

    Shepperd's method: of the four ways to take the root, the one with the largest argument.
    """
    m = np.asarray(rotation, float)
    t = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2], t], -1)
    best = np.argmax(np.nan_to_num(d, nan=-np.inf), axis=-1)
    xx, yy, zz = (1 - t + 2 * m[..., i, i] for i in range(3))
    xy, xz, yz = (m[..., i, j] + m[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    wx, wy, wz = (m[..., i, j] - m[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    rows = np.stack(
        [
            np.stack([xx, xy, xz, wx], -1),
            np.stack([xy, yy, yz, wy], -1),
            np.stack([xz, yz, zz, wz], -1),
            np.stack([wx, wy, wz, 1 + t], -1),
        ],
        -2,
    )
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., 3:] < 0, -q, q)


def quaternion_angle(a: Floats, b: Floats) -> Floats:
    """Angle (...) in radians between the orientations of quaternions (..., 4)."""
    dot = np.abs(np.sum(a * b, -1)) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return 2 * np.arccos(np.clip(dot, 0, 1))


def euler_from_quaternion(quaternion: Floats) -> tuple[Floats, Floats, Floats]:
    """Roll, pitch and yaw (...) in radians: rotation about fixed x, then y, then z; NaN in, NaN out."""
    m = matrix_from_quaternion(quaternion)
    pitch = -np.arcsin(np.clip(m[..., 2, 0], -1.0, 1.0))
    return np.arctan2(m[..., 2, 1], m[..., 2, 2]), pitch, np.arctan2(m[..., 1, 0], m[..., 0, 0])
