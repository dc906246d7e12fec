"""The features of the first recogniser of actions: a performer's arms and two boxes, frame by frame.

Source: Do, thesis on ECAT (2018), chapter 4, as its program computed them.  A frame is 21 points: thirteen joints, then
four corners of one marker of each box; sets are made of each other: raw, PCAS (points in a plane), QSR (changes of
relations), SPARSE (the same, one-hot), EVENT (of a window).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from learn.features import qsr
from learn.features.points import JOINTS

Floats = NDArray[np.float64]
Small = NDArray[np.int8]

PLACES = (
    "body",
    "left_hand",
    "right_hand",
    "o1_centroid",
    "o2_centroid",
    "o1_corner1",
    "o1_corner2",
    "o2_corner1",
    "o2_corner2",
)
PAIRS = ((0, 1), (0, 2), (1, 3), (2, 3), (1, 4), (2, 4), (3, 4), (5, 6), (7, 8))
"""Of :data:`PLACES`, those that are related."""
THRESHOLDS = tuple(k / 20 for k in range(20))
"""Metres, of distances."""
MOVED = 0.005
"""Metres between frames that count as movement of the body or a box."""
QTC_THRESHOLD, QTC_ANGLE = 0.001, np.pi / 5

PCAS_COLUMNS = tuple(f"{place}_{axis}" for place in PLACES for axis in "xy")
QSR_COLUMNS = (
    *(f"{name}_diff_{pair}" for pair in range(len(PAIRS)) for name in ("cardir", "argd")),
    *("mos_body", "mos_o1", "mos_o2", "qtc_q1", "qtc_q2", "qtc_q4", "qtc_q5"),
)
_LEAST = np.array([-8, -19] * 9 + [0] * 3 + [-1] * 4)
_MOST = np.array([8, 19] * 9 + [1] * 7)
SPARSE_COLUMNS = tuple(
    f"{name}={value}"
    for name, least, most in zip(QSR_COLUMNS, _LEAST.tolist(), _MOST.tolist(), strict=True)
    for value in range(least, most + 1)
)
EVENT_COLUMNS = tuple(
    f"{when}_{name}" for when, name in product(("first", "last", "last_minus_first"), QSR_COLUMNS)
)

SWAP_PCAS = np.r_[0:6, 8, 9, 6, 7, 14:18, 10:14]
SWAP_QSR = np.r_[0:4, 8:12, 4:8, 12, 13, 16, 17, 14, 15, 18, 20, 19, 22, 21, 24, 23]
"""Where each number comes from when the two boxes are exchanged: ``features[:, SWAP_QSR]``."""


@dataclass(frozen=True)
class Projection:
    """A plane in space with two axes: points (..., 3) become (points - mean) . components, (..., 2)."""

    mean: Floats
    components: Floats

    def __call__(self, points: Floats) -> Floats:
        """The points (..., 3) in the plane, (..., 2)."""
        return (points - self.mean) @ self.components.T


@dataclass(frozen=True)
class Projections:
    """The planes that points are seen in: ``inter`` for places of things, ``intra`` for corners of a box."""

    inter: Projection
    intra: Projection


def fit_projection(points: Floats) -> Projection:
    """The plane in which points (n, 3) vary most; an axis points to where the farthest of them along it is.

    So one outlier may turn an axis round, and with it every direction: features are comparable only under one fit.

    Raises
    ------
    InputError : fewer than three points are known.
    """
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < 3:
        raise InputError(
            "cannot fit a plane to points",
            where=f"{len(known)} of {len(points)} points are known",
            fix="fit it to more sessions",
        )
    mean = known.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(known.T))
    components = axes.T[:0:-1]
    scores = (known - mean) @ components.T
    farthest = scores[np.abs(scores).argmax(axis=0), [0, 1]]
    return Projection(mean, components * np.where(farthest < 0, -1.0, 1.0)[:, None])


def fit_projections(points: Floats) -> Projections:
    """Planes fitted to the frames (n, 21, 3) of the sessions that a recogniser is trained on, and of no others."""
    return Projections(
        fit_projection(points.reshape(-1, 3)), fit_projection(points[:, len(JOINTS) :].reshape(-1, 3))
    )


def pcas(points: Floats, projections: Projections) -> Floats:
    """The nine places of a frame in the plane.

    Parameters
    ----------
    points : (n, 21, 3) metres.

    Returns
    -------
    (n, 18) metres, :data:`PCAS_COLUMNS`: shoulders' middle, finger tips, boxes' centres; two opposite corners of each.
    """
    inter, intra = projections.inter(points), projections.intra(points[:, [13, 15, 17, 19]])
    places = [
        inter[:, [1, 7]].mean(axis=1),
        inter[:, 5],
        inter[:, 11],
        inter[:, 13:17].mean(axis=1),
        inter[:, 17:21].mean(axis=1),
        *intra.swapaxes(0, 1),
    ]
    return np.stack(places, axis=1).reshape(len(points), 18)


def qsr25(places: Floats) -> Small:
    """Changes of direction and distance of nine pairs, and what moved how, of one session.

    Directions and distances are codes, and their differences those of codes.  Movement is that of the frame before:
    the last frame's is not used.  The first row is zeros.

    Parameters
    ----------
    places : (n, 18) of :func:`pcas`, of all frames of a session in order.

    Returns
    -------
    (n, 25) :data:`QSR_COLUMNS`.

    Raises
    ------
    InputError : a place is not known.
    """
    points = places.reshape(len(places), 9, 2).swapaxes(0, 1)
    _require_known(points)
    found = np.zeros((len(places), 25), np.int8)
    if len(places) < 2:
        return found
    a, b = (points[[pair[side] for pair in PAIRS]] for side in (0, 1))
    codes = np.stack([qsr.cardir(a, b), qsr.argd(a, b, THRESHOLDS)], axis=1).reshape(18, -1).astype(np.int8)
    found[1:, :18] = np.diff(codes, axis=1).T
    found[2:, 18:21] = qsr.mos(points[[0, 3, 4]], threshold=MOVED).T[:-1]
    states = qsr.qtc_c(points[3], points[4], threshold=QTC_THRESHOLD, angle=QTC_ANGLE)[:-1].astype(np.int8)
    found[2:, 21:] = states[:, None] // [27, 9, 3, 1] % 3 - 1
    return found


def sparse522(features: Small) -> NDArray[np.uint8]:
    """Of (n, 25) numbers of :func:`qsr25`, each as one of its possible values: (n, 522) :data:`SPARSE_COLUMNS`."""
    widths = _MOST - _LEAST + 1
    starts = np.cumsum(widths) - widths
    found = np.zeros((len(features), int(widths.sum())), np.uint8)
    np.put_along_axis(found, features - _LEAST + starts, 1, axis=1)
    return found


def event75(windows: Small) -> Small:
    """Of windows (..., t, 25) the first row, the last, and last minus first: (..., 75) :data:`EVENT_COLUMNS`."""
    first, last = windows[..., 0, :], windows[..., -1, :]
    return np.concatenate([first, last, last - first], axis=-1)


def _require_known(points: Floats) -> None:
    place, frame, _ = np.nonzero(~np.isfinite(points))
    if len(frame):
        first = int(np.argmin(frame))
        raise InputError(
            "cannot compute qualitative features",
            where=f"frame {frame[first]}: {PLACES[place[first]]} is not known",
            consequence="nothing was computed",
            fix="fill the gap, or leave the session out",
        )
