"""The qualitative trajectory calculus: how two points move with respect to each other."""

from __future__ import annotations

import math
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecat.errors import UsageError
from learn.features.qsr.codes import MISSING, Codes, Columns, Floats, Mask, length_of, step_by_step

SIGNS = "-0+"
QTC_B = tuple(",".join(state) for state in product(SIGNS, repeat=2))
QTC_C = tuple(",".join(state) for state in product(SIGNS, repeat=4))
QTC_BC = (*QTC_C, *QTC_B)
"""Four symbols where the points are near each other, two where they are not."""
_Symbols = NDArray[np.int8]
NEAR = 1.22
"""QSRLib's distance threshold of QTC_BC, metres: where Hall's personal distance ends."""


class _Steps(NamedTuple):
    """What moved from one frame to the next, along the line between the points and across it.

    All have the unit of an area: lengths times the distance of the points.  Positive ``a_towards`` is towards b,
    ``b_towards`` towards a; positive ``right`` is to the right of one's own line of sight.
    """

    distance: Floats
    a_towards: Floats
    b_towards: Floats
    a_right: Floats
    b_right: Floats


def qtc_b(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """QTC basic: whether each point approaches the other (-), moves away (+), or neither (0).

    The first symbol is that of ``a``, the second that of ``b``.  With D from a to b in the earlier frame and v a
    point's movement to the next, the symbol of ``a`` is - where v.D/|D| > ``threshold``, + where it is
    < -``threshold``.

    Parameters
    ----------
    a, b : (..., t, 2) positions of frames in order.
    threshold : QSRLib's quantisation factor, a length in the unit of the positions.

    Returns
    -------
    (..., t-1) codes of :data:`QTC_B`; the first is that of the second frame.

    Source: Van de Weghe, Representing and reasoning about moving objects: a qualitative approach, Ghent University
    (2004), QTC_B; QSRLib's ``qtcbs``.
    """
    return step_by_step(partial(_qtc_b, threshold=length_of("threshold", threshold)), a, b)


def qtc_c(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0, angle: float = 0.0) -> Codes:
    """QTC double cross: as :func:`qtc_b`, and to which side of the line between them each point moves.

    The third and fourth symbol are + where the point moves to the right of its own line of sight to the other (y up),
    - to the left; by more than ``threshold``.  All are 0 where both were at the same place.

    Parameters
    ----------
    a, b : (..., t, 2) positions of frames in order.
    threshold : QSRLib's quantisation factor, a length in the unit of the positions.
    angle : radians from 0 to pi; the side counts only where movement and line of sight differ by more.

    Returns
    -------
    (..., t-1) codes of :data:`QTC_C`; the first is that of the second frame.

    Source: Van de Weghe (2004), QTC_C; QSRLib's ``qtccs``; the angle from ECAT's copy of it (Do, Pustejovsky,
    Learning event representation: as sparse as possible, but not sparser, 2017).
    """
    threshold, angle = length_of("threshold", threshold), _angle(angle)
    return step_by_step(partial(_qtc_c, threshold=threshold, angle=angle), a, b)


def qtc_bc(
    a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0, angle: float = 0.0, distance: float = NEAR
) -> Codes:
    """QTC basic and double cross: QTC_C where the points are now at most ``distance`` apart, else QTC_B.

    Parameters
    ----------
    a, b, threshold, angle : as of :func:`qtc_c`.
    distance : in the unit of the positions.

    Returns
    -------
    (..., t-1) codes of :data:`QTC_BC`; the first is that of the second frame.

    Source: Dondrup, Bellotto, Hanheide, Eder, Leonards, A computational model of human-robot spatial interactions
    based on a qualitative trajectory calculus, Robotics 4 (2015); QSRLib's ``qtcbcs``.
    """
    threshold, angle = length_of("threshold", threshold), _angle(angle)
    kernel = partial(_qtc_bc, threshold=threshold, angle=angle, limit=length_of("distance", distance))
    return step_by_step(kernel, a, b)


def _qtc_b(a: Columns, b: Columns, threshold: float) -> Codes:
    steps = _steps(a, b)
    least = threshold * steps.distance
    states = 3 * _symbol(steps.a_towards, least) + _symbol(steps.b_towards, least)
    return _coded(states, 4, _known(steps))


def _qtc_c(a: Columns, b: Columns, threshold: float, angle: float) -> Codes:
    steps = _steps(a, b)
    return _coded(_double_cross(steps, threshold, angle), 40, _known(steps))


def _qtc_bc(a: Columns, b: Columns, threshold: float, angle: float, limit: float) -> Codes:
    steps = _steps(a, b)
    codes = _coded(_double_cross(steps, threshold, angle), 40, _known(steps))
    dx, dy = (there[1:] - here[1:] for here, there in zip(a, b, strict=True))
    far: Mask = np.sqrt(dx * dx + dy * dy) > limit
    far &= codes != MISSING
    codes[far] = len(QTC_C) + codes[far] // 9
    return codes


def _steps(a: Columns, b: Columns) -> _Steps:
    (ax, ay), (bx, by) = a, b
    dx, dy = bx[:-1] - ax[:-1], by[:-1] - ay[:-1]
    vx, vy = ax[1:] - ax[:-1], ay[1:] - ay[:-1]
    wx, wy = bx[:-1] - bx[1:], by[:-1] - by[1:]  # backwards: b looks along -D
    return _Steps(
        np.sqrt(dx * dx + dy * dy),
        vx * dx + vy * dy,
        wx * dx + wy * dy,
        vx * dy - vy * dx,
        wx * dy - wy * dx,
    )


def _double_cross(steps: _Steps, threshold: float, angle: float) -> _Symbols:
    least = threshold * steps.distance
    sides = [_symbol(-steps.a_right, least), _symbol(-steps.b_right, least)]
    if angle:
        # sin(turned - angle) > 0, without the arc functions, which are least exact where it matters
        wide = [
            np.abs(right) * math.cos(angle) > towards * math.sin(angle)
            for right, towards in zip(steps[3:], steps[1:3], strict=True)
        ]
        sides = [side * counts for side, counts in zip(sides, wide, strict=True)]
    states = _symbol(steps.a_towards, least)
    for symbol in (_symbol(steps.b_towards, least), *sides):
        states *= 3
        states += symbol
    return states


def _symbol(value: Floats, least: Floats) -> _Symbols:
    """-1 where the value is above ``least``, 1 where it is below its opposite."""
    return (value < -least).view(np.int8) - (value > least).view(np.int8)


def _known(steps: _Steps) -> Mask:
    return np.isfinite(steps.a_towards + steps.b_towards)


def _coded(states: _Symbols, zero: int, known: Mask) -> Codes:
    codes = (states + np.int8(zero)).view(np.uint8)
    if not known.all():
        codes[~known] = MISSING
    return codes


def _angle(angle: float) -> float:
    if not 0 <= angle <= math.pi:
        raise UsageError(
            f"cannot compute with an angle of {angle:g}",
            where="angle: expected radians from 0 to pi",
            fix="choose another angle",
        )
    return angle
