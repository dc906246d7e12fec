"""Where a block is on the table, by the one of its markers that is seen best: Algorithm 1 of the thesis.

Source: Do, thesis on ECAT (2018), chapter 5, as its program computed it.  Tracks by poses of ecat are more exact; these
are for comparison with what the thesis did.  Points are in the axes of the Kinect's camera space.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError

Floats = NDArray[np.float64]

EDGE_M = 0.18
"""Edge of a block as the program took it to be, 3 cm more than in the features."""
_STEEP = 0.5
"""Cosine to the table's normal below which a marker is on a side of its block."""


@dataclass(frozen=True)
class TableAxes:
    """A table: its unit ``normal``, ``offset`` (normal . point), the ``origin`` of places and their ``x`` axis."""

    normal: Floats
    offset: float
    origin: Floats
    x: Floats


def table_axes(polygon: Floats) -> TableAxes:
    """The axes of a table by its corners (n, 3): origin is the first, x points to the second.

    Raises
    ------
    InputError : fewer than three corners are known.
    """
    known = polygon[np.isfinite(polygon).all(axis=1)]
    if len(known) < 3:
        raise InputError(
            "cannot find the table", where=f"{len(known)} of its corners are known", fix="draw at least three"
        )
    normal, offset = _plane(known[None])
    return TableAxes(normal[0], float(offset[0]), polygon[0], _unit(polygon[1] - polygon[0]))


def project_block(corners: Floats, table: TableAxes) -> Floats:
    """Where a block is in each frame by the corners (n, 4, 3) of one marker: (n, 3) x, y, rotation, NaN if unknown.

    A corner that alone is missing is the fourth of a parallelogram.  A marker on top is its block, seen from above,
    grown to the block's size; from one on a side the block extends away from the camera.
    """
    whole = complete_corner(corners)
    found = np.full((len(corners), 3), np.nan)
    known = np.isfinite(whole).all(axis=(1, 2))
    if not known.any():
        return found
    marker = whole[known]
    normal, _ = _plane(marker)
    side = np.abs(normal @ table.normal) < _STEEP
    square = np.where(side[:, None, None], _behind(marker, normal, table), marker)
    flat = square - ((square @ table.normal) - table.offset)[..., None] * table.normal
    middle = flat.mean(axis=1, keepdims=True)
    grown = middle + np.sqrt(0.5) * EDGE_M * _unit(flat - middle)
    flat = np.where(side[:, None, None], flat, grown)
    up, _ = _plane(flat)
    y = np.cross(up, table.x)
    moved = flat - table.origin
    place = np.stack([moved @ table.x, np.einsum("nki,ni->nk", moved, y)], axis=-1)
    edge = place[:, 1] - place[:, 0]
    found[known, :2] = place.mean(axis=1)
    found[known, 2] = np.arctan2(edge[:, 1], edge[:, 0]) % (np.pi / 2) % (np.pi / 2)
    return found


def complete_corner(corners: Floats) -> Floats:
    """Markers (n, 4, 3) with a corner that alone was missing: of the others, the two farthest apart are opposite."""
    known = np.asarray(np.isfinite(corners).all(axis=2))
    found = np.where(known[..., None], corners, np.nan)
    for row in np.flatnonzero(known.sum(axis=1) == 3):
        a, b, c = found[row, known[row]]
        pairs = ((a, b, c), (a, c, b), (b, c, a))
        p, q, r = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
        found[row, ~known[row]] = p + q - r
    return found


def _behind(marker: Floats, normal: Floats, table: TableAxes) -> Floats:
    """The square (n, 4, 3) of a block's edge behind the middle of a marker on its side."""
    away = normal * np.where(normal[:, 2:] >= 0, 1.0, -1.0)
    along = _unit(np.cross(table.normal, normal))
    middle = marker.mean(axis=1)
    half, far = along * EDGE_M / 2, away * EDGE_M
    return np.stack([middle + half + far, middle + half, middle - half, middle - half + far], axis=1)


def _plane(points: Floats) -> tuple[Floats, Floats]:
    """Unit normals (n, 3), on the side of (1, 1, 1), and offsets (n,) of the planes nearest to points (n, k, 3)."""
    middle = points.mean(axis=1)
    _, _, axes = np.linalg.svd(points - middle[:, None])
    normal = axes[:, 2]
    normal = normal * np.where(normal.sum(axis=1) >= 0, 1.0, -1.0)[:, None]
    return normal, (normal * middle).sum(axis=1)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
