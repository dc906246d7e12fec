"""A regular clock over a recording: which moments, and what is known at each of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.transforms import Floats

NS = 1_000_000_000
ROUNDED_NS = 1000
"""Times that are nearer to each other are the same one, rounded in two ways."""


def regular_times(start_ns: int, end_ns: int, fps: int) -> NDArray[np.int64]:
    """Moments (n,) int64 from ``start_ns`` on, ``fps`` a second, before ``end_ns``; none if it is not later.

    Each is rounded to the nanosecond by itself, so that errors do not add up.  As those of frames are rounded too, a
    moment less than a microsecond before the end is the end.
    """
    n = max(-(-(end_ns - start_ns - ROUNDED_NS) * fps // NS), 0)
    return start_ns + (2 * np.arange(n, dtype=np.int64) * NS + fps) // (2 * fps)


def held(
    values: Floats, known_ns: NDArray[np.int64], asked_ns: NDArray[np.int64], *, within_ns: int
) -> Floats:
    """What was known (n, k) at the moment nearest to each one asked for (m,); NaN where that is further away.

    Returns (m, k).
    """
    nearest = nearest_in_time(known_ns, asked_ns, within=within_ns)
    if not len(values):
        return np.full((len(asked_ns), values.shape[1]), np.nan)
    return np.where((nearest >= 0)[:, None], values[nearest], np.nan)


def interpolated(
    values: Floats, known_ns: NDArray[np.int64], asked_ns: NDArray[np.int64], *, within_ns: int
) -> Floats:
    """Values (n, k) on straight lines between the moments before and after each one asked for (m,).

    A column's moments are those at which it is not NaN.  It is NaN where one of the two is further away than
    ``within_ns``, and before the first and after the last, except at a moment that is known itself.  Returns (m, k).
    """
    found = np.full((len(asked_ns), values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        known = np.flatnonzero(np.isfinite(values[:, column]))
        if len(known):
            found[:, column] = _between(values[known, column], known_ns[known], asked_ns, within_ns)
    return found


def _between(
    values: Floats, known_ns: NDArray[np.int64], asked_ns: NDArray[np.int64], within_ns: int
) -> Floats:
    after = np.minimum(np.searchsorted(known_ns, asked_ns), len(known_ns) - 1)
    exact = known_ns[after] == asked_ns
    before = np.where(exact, after, np.maximum(after - 1, 0))
    to_before, to_after = asked_ns - known_ns[before], known_ns[after] - asked_ns
    inside = (to_before >= 0) & (to_after >= 0) & (to_before <= within_ns) & (to_after <= within_ns)
    span = np.maximum(to_before + to_after, 1)
    between = values[before] + (values[after] - values[before]) * (to_before / span)
    return np.where(inside, between, np.nan)


def same_side(quaternions: Floats) -> Floats:
    """Unit quaternions (n, 4) of the same rotations, each with the sign that is nearer to the last known one before.

    The two quaternions of a rotation then never alternate, and what learns from them sees steady numbers.
    """
    known = np.flatnonzero(np.isfinite(quaternions).all(axis=1))
    if not len(known):
        return quaternions
    rows = quaternions[known]
    turns = np.where((rows[1:] * rows[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    first = -1.0 if rows[0, 3] < 0 else 1.0
    result = quaternions.copy()
    result[known] = rows * (first * np.cumprod(np.concatenate([[1.0], turns])))[:, None]
    return result


def unit(quaternions: Floats) -> Floats:
    """Quaternions (n, 4) of length one; NaN where the length is zero."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return quaternions / np.where(length > 0, length, np.nan)


def filled(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Values (n, k) without NaN: the last known one before, else the first known one after, else zero."""
    if not len(values):
        return values
    known = np.isfinite(values)
    rows = np.arange(len(values))[:, None]
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
    first = np.where(known.any(axis=0), known.argmax(axis=0), -1)
    source = np.where(last >= 0, last, first)
    taken = np.take_along_axis(values, np.maximum(source, 0), axis=0)
    return np.where(source >= 0, taken, np.zeros((), values.dtype))
