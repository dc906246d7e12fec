"""Where one object lies as seen from another: cardinal directions, left and right, TPCC."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from learn.features.qsr.codes import MISSING, Codes, Columns, Floats, Mask, frame_by_frame, points

CARDIR = ("n", "nw", "w", "sw", "s", "se", "e", "ne", "eq")
MWE = ("left", "together", "right")
TPCC_SECTORS = ("lb", "bl", "fl", "lf", "rf", "fr", "br", "rb")
"""Eighths of the plane around the relatum, counter-clockwise from straight on: b is ahead, f towards the origin."""
TPCC_AXES = ("sb", "sl", "sf", "sr")
"""Straight on, left, back and right."""
TPCC = ("sam", *(d + s for d in "cd" for s in (*TPCC_SECTORS, *TPCC_AXES)))

_TAN = math.sqrt(2) - 1  # of 22.5 degrees
_NEAR = 1e-12
# sectors clockwise from south, where a is when b lies north of it
_CLOCKWISE = np.array([CARDIR.index(name) for name in ("s", "sw", "w", "nw", "n", "ne", "e", "se")], np.uint8)
_EQ = CARDIR.index("eq")


def cardir(a: ArrayLike, b: ArrayLike) -> Codes:
    """Cardinal direction of ``a`` seen from ``b``; +y is north.

    Eight sectors of 45 degrees around the compass points, each with its border that comes first clockwise;
    ``eq`` where both are at the same place.

    Parameters
    ----------
    a, b : (..., 2) positions; of boxes, the centres.

    Returns
    -------
    (...) codes of :data:`CARDIR`.

    Source: Frank, Qualitative spatial reasoning about cardinal directions, Auto-Carto 10 (1991), cone-shaped sectors;
    QSRLib's ``cardir``.
    """
    return frame_by_frame(_cardir, a, b, keep=points)


def _cardir(a: Columns, b: Columns) -> Codes:
    dx, dy = b[0] - a[0], b[1] - a[1]
    wide, high = np.abs(dx), np.abs(dy)
    more = np.maximum(wide, high)
    oblique = np.minimum(wide, high)
    oblique -= _TAN * more
    eastern = wide > high
    codes = _SECTORS[
        (oblique > 0).view(np.uint8)
        + 2 * eastern.view(np.uint8)
        + 4 * (dx < 0).view(np.uint8)
        + 8 * (dy < 0).view(np.uint8)
    ]
    # on a border, at the same place, or unknown: few, and exactly as the definition in degrees rounds
    more *= _NEAR
    special = np.flatnonzero(~(np.abs(oblique, out=oblique) > more))
    if special.size:
        codes[special] = _special_cardir(dx[special], dy[special])
    return codes


def _sectors() -> Codes:
    """Codes by the bits oblique, nearer to east-west than to north-south, dx < 0, dy < 0."""
    table = np.empty(16, np.uint8)
    for bits in range(16):
        oblique, eastern, west, south = (bits >> k & 1 for k in range(4))
        angle = 45 if oblique else 90 * eastern  # clockwise from +y, in the quadrant of dx, dy > 0
        if south:
            angle = 180 - angle
        table[bits] = _CLOCKWISE[(-angle if west else angle) % 360 // 45]
    return table


_SECTORS = _sectors()


def _special_cardir(dx: Floats, dy: Floats) -> Codes:
    codes = np.full(len(dx), MISSING, np.uint8)
    codes[(dx == 0) & (dy == 0)] = _EQ
    for k in np.flatnonzero(np.isfinite(dx) & np.isfinite(dy) & (codes != _EQ)):
        turned = math.degrees(math.atan2(dx[k], dy[k])) + 22.5
        # a hair below -22.5 degrees: the remainder would round to a full turn
        codes[k] = _CLOCKWISE[7 if -1e-9 < turned < 0 else int(turned % 360 // 45)]
    return codes


def mwe(a: ArrayLike, b: ArrayLike) -> Codes:
    """Whether ``a`` is left of ``b``, right of it, or together with it, by x alone.

    Parameters
    ----------
    a, b : (..., 2) positions; of boxes, the centres.

    Returns
    -------
    (...) codes of :data:`MWE`.

    Source: QSRLib's minimal working example, the point algebra of Vilain and Kautz (1986) on x.
    """
    return frame_by_frame(_mwe, a, b, keep=points)


def _mwe(a: Columns, b: Columns) -> Codes:
    (ax, _), (bx, _) = a, b
    codes = 1 + (ax > bx).view(np.uint8) - (ax < bx).view(np.uint8)
    codes[~np.isfinite(ax - bx)] = MISSING
    return codes


def tpcc(origin: ArrayLike, relatum: ArrayLike, referent: ArrayLike) -> Codes:
    """Ternary point configuration: where the referent lies, going from the origin to the relatum.

    The first letter is c (close) or d (distant): nearer to the relatum than the origin is, or not.  The others name
    the eighth of the plane around the relatum, half-open counter-clockwise, or s and a letter on an axis; ``sam``
    where the referent is at the relatum.

    Parameters
    ----------
    origin, relatum, referent : (..., 2) positions; of boxes, the centres.

    Returns
    -------
    (...) codes of :data:`TPCC`.

    Source: Moratz and Ragni, Qualitative spatial reasoning about relative point position, Journal of Visual
    Languages and Computing 19 (2008); letters as of QSRLib's ``tpcc``.
    """
    return frame_by_frame(_tpcc, origin, relatum, referent, keep=points)


def _tpcc(a: Columns, b: Columns, c: Columns) -> Codes:
    (ux, uy), (vx, vy) = ([to - of for of, to in zip(*ends, strict=True)] for ends in ((a, b), (b, c)))
    near, far = np.sqrt(ux * ux + uy * uy), np.sqrt(vx * vx + vy * vy)
    known: Mask = np.isfinite(near) & np.isfinite(far)
    angle = _heading(vx, vy) - _heading(ux, uy)
    angle[angle < 0] += 2 * math.pi
    eighth = angle / (math.pi / 4)
    # on a diagonal rounding decides, and then by the C library, which NumPy need not use
    nearest = np.rint(np.where(known, eighth, 0.0))
    for k in np.flatnonzero((np.abs(eighth - nearest) < 1e-9) & (nearest % 2 == 1)):
        turn = _exact_heading(vx[k], vy[k]) - _exact_heading(ux[k], uy[k])
        eighth[k] = (turn + 2 * math.pi if turn < 0 else turn) / (math.pi / 4)
    sector = np.where(known, eighth, 0.0).astype(np.int64) % 8
    sine = np.abs(np.sin(angle))
    axis = (sine < 1e-5) | (sine > 0.99999)
    place = np.where(axis, 8 + ((sector + 1) // 2) % 4, sector)
    codes = (1 + place + 12 * (far > near)).astype(np.uint8)
    codes[far == 0] = 0
    codes[~known] = MISSING
    return codes


def _heading(x: Floats, y: Floats) -> Floats:
    heading = np.arctan2(y, x)
    heading[heading < 0] += 2 * math.pi
    return heading


def _exact_heading(x: float, y: float) -> float:
    heading = math.atan2(y, x)
    return heading + 2 * math.pi if heading < 0 else heading
