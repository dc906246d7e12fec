"""How far, and whether something moves: distances by named thresholds, moving or stationary."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ecat.errors import UsageError
from learn.features.qsr.codes import (
    MISSING,
    Codes,
    Columns,
    Floats,
    frame_by_frame,
    length_of,
    points,
    step_by_step,
)

MOS = ("s", "m")
_MOST = MISSING
_COMPARED = 48
"""Up to so many thresholds, comparing with each is faster than searching among all."""


def mos(a: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """Whether an object moves (m) or is stationary (s): m if it went farther than ``threshold`` since the last frame.

    Parameters
    ----------
    a : (..., t, 2) positions of frames in order.
    threshold : QSRLib's quantisation factor, a length in the unit of the positions.

    Returns
    -------
    (..., t-1) codes of :data:`MOS`; the first is that of the second frame.

    Source: QSRLib's ``mos`` (Gatsoulis and others, QSRlib: a software library for online acquisition of qualitative
    spatial relations from video, QR 2016).
    """
    limit = length_of("threshold", threshold)

    def kernel(places: Columns) -> Codes:
        way = _norm(*(place[1:] - place[:-1] for place in places))
        codes = (way > limit).view(np.uint8)
        return _without_unknown(codes, way)

    return step_by_step(kernel, a)


def argd(a: ArrayLike, b: ArrayLike, thresholds: Mapping[str, float] | Sequence[float]) -> Codes:
    """Distance by thresholds: the first that it does not exceed, or the last.

    With ascending thresholds t_0 < t_1 < ... the value is i where t_(i-1) < |a - b| <= t_i.

    Parameters
    ----------
    a, b : (..., 2) positions; (..., 3) in space, where z counts if both have one.
    thresholds : lengths in the unit of the positions, in any order, with their names if they have any.

    Returns
    -------
    (...) codes: the threshold's place in ascending order, whose names :func:`argd_values` gives.

    Raises
    ------
    UsageError : no thresholds, more than 255, or one that is not finite.

    Source: QSRLib's ``argd``, the absolute distances of Clementini, Di Felice and Hernandez, Qualitative
    representation of positional information, Artificial Intelligence 95 (1997).
    """
    limits = np.array([limit for _, limit in _ascending(thresholds)])

    def kernel(a: Columns, b: Columns) -> Codes:
        dx, dy, *height = (there - here for here, there in zip(a, b, strict=True))
        for dz in height:
            dz[np.isnan(dz)] = 0.0
        return _banded(_norm(dx, dy, *height), limits)

    in_space = np.shape(a)[-1:] == np.shape(b)[-1:] == (3,)
    return frame_by_frame(kernel, a, b, keep=list if in_space else points)


def argd_values(thresholds: Mapping[str, float] | Sequence[float]) -> tuple[str, ...]:
    """The names of the codes of :func:`argd`; of thresholds without names, their places."""
    return tuple(name for name, _ in _ascending(thresholds))


def argprobd(
    a: ArrayLike,
    b: ArrayLike,
    bands: Mapping[str, tuple[float, float]],
    *,
    generator: np.random.Generator,
) -> Codes:
    """Distance by normal distributions: of a draw for each, from 0 to its density at the distance, the largest wins.

    Densities are rounded to three digits.  Where all are zero, the band with the largest mean is the answer.

    Parameters
    ----------
    a, b : (..., 2) positions.
    bands : name, and mean and standard deviation of its distances.
    generator : draws are taken frame by frame in the order of the array, of each for the bands by ascending
        mean; :func:`seeded` gives those of QSRLib.

    Returns
    -------
    (...) codes: the band's place by ascending mean, whose names :func:`argprobd_values` gives.

    Raises
    ------
    UsageError : no bands, more than 255, a mean that is not finite or a deviation that is not positive.

    Source: QSRLib's ``argprobd``.
    """
    parameters = np.array([band for _, band in _ascending_bands(bands)])

    def kernel(a: Columns, b: Columns) -> Codes:
        distance = _norm(b[0] - a[0], b[1] - a[1])
        mean, deviation = parameters.T
        with np.errstate(over="ignore", invalid="ignore"):
            z = (distance[:, None] - mean) / deviation
            density = np.exp(-z * z / 2) / (deviation * math.sqrt(2 * math.pi))
        draws = generator.random(density.shape) * np.round(density, 3)
        best = np.argmax(draws, axis=1)
        best[~(draws > 0).any(axis=1)] = len(mean) - 1
        return _without_unknown(best.astype(np.uint8), distance)

    return frame_by_frame(kernel, a, b, keep=points)


def argprobd_values(bands: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """The names of the codes of :func:`argprobd`."""
    return tuple(name for name, _ in _ascending_bands(bands))


def seeded(seed: int) -> np.random.Generator:
    """A generator whose numbers are those of Python's ``random.seed(seed)``, which QSRLib draws from."""
    _, (*key, place), _ = random.Random(seed).getstate()
    twister = np.random.MT19937()
    twister.state = {"bit_generator": "MT19937", "state": {"key": np.array(key, np.uint32), "pos": place}}
    return np.random.Generator(twister)


def _norm(*differences: Floats) -> Floats:
    total = differences[0] * differences[0]
    for each in differences[1:]:
        total += each * each
    return np.sqrt(total, out=total)


def _banded(distance: Floats, limits: Floats) -> Codes:
    if len(limits) > _COMPARED:
        codes = np.searchsorted(limits[:-1], distance).astype(np.uint8)
    else:
        codes = np.zeros(len(distance), np.uint8)
        for limit in limits[:-1]:
            codes += (distance > limit).view(np.uint8)
    return _without_unknown(codes, distance)


def _without_unknown(codes: Codes, value: Floats) -> Codes:
    finite = np.isfinite(value)
    if not finite.all():
        codes[~finite] = MISSING
    return codes


def _ascending(thresholds: Mapping[str, float] | Sequence[float]) -> list[tuple[str, float]]:
    pairs = (
        list(thresholds.items())
        if isinstance(thresholds, Mapping)
        else [(str(place), limit) for place, limit in enumerate(sorted(thresholds))]
    )
    wrong = [f"{name} = {limit:g}" for name, limit in pairs if not math.isfinite(limit)]
    _refuse("thresholds", len(pairs), wrong)
    return sorted(pairs, key=lambda pair: pair[1])


def _ascending_bands(bands: Mapping[str, tuple[float, float]]) -> list[tuple[str, tuple[float, float]]]:
    wrong = [
        f"{name} = {mean:g}, {deviation:g}"
        for name, (mean, deviation) in bands.items()
        if not (math.isfinite(mean) and math.isfinite(deviation) and deviation > 0)
    ]
    _refuse("bands", len(bands), wrong)
    return sorted(bands.items(), key=lambda pair: pair[1][0])


def _refuse(what: str, n: int, wrong: Sequence[str]) -> None:
    if not n or n > _MOST or wrong:
        where = f"not finite, or not positive: {', '.join(wrong)}" if wrong else f"there are {n} of them"
        raise UsageError(
            f"cannot compare distances with these {what}",
            where=where,
            fix="give from 1 to 255 finite lengths, each with its name, and deviations above 0 where they have any",
        )
