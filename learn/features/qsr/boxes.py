"""How two boxes lie to each other: region connection calculus and rectangle algebra."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial, reduce
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from learn.features.qsr.codes import MISSING, Codes, Columns, Floats, Mask, edges, frame_by_frame, length_of

RCC8 = ("dc", "ec", "po", "tpp", "ntpp", "tppi", "ntppi", "eq")
RCC5 = ("dr", "po", "pp", "ppi", "eq")
RCC4 = ("dc", "po", "pp", "ppi")
RCC3 = ("dc", "po", "o")
RCC2 = ("dc", "c")
ALLEN = ("<", "m", "o", "fi", "di", "s", "=", "si", "d", "f", "oi", "mi", ">")
"""Allen's relations of intervals; the converse of the k-th is the k-th from the end."""
RA = tuple(f"{x},{y}" for x, y in product(ALLEN, repeat=2))

_DC, _EC, _PO, _TPP, _NTPP, _TPPI, _NTPPI, _EQ = range(8)


def rcc8(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """Region connection calculus with eight relations, of boxes parallel to the axes.

    Parameters
    ----------
    a, b : (..., 4) boxes as centre and size: x, y, w, h; without size, or (..., 2), points.
    threshold : QSRLib's quantisation factor q, a length: edges up to q apart touch from inside, up to 2 q from outside.

    Returns
    -------
    (...) codes of :data:`RCC8`.

    Raises
    ------
    InputError : a size is negative.

    Source: Randell, Cui and Cohn, A spatial logic based on regions and connection, KR 1992; QSRLib's ``rcc8``.
    """
    return frame_by_frame(partial(_rcc8, q=length_of("threshold", threshold)), a, b, keep=edges)


def rcc5(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """:func:`rcc8` without regard to whether borders touch: codes of :data:`RCC5`."""
    return _RCC5[rcc8(a, b, threshold=threshold)]


def rcc4(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """:func:`rcc8` with one relation each for connection without, and with, containment: codes of :data:`RCC4`."""
    return _RCC4[rcc8(a, b, threshold=threshold)]


def rcc3(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """:func:`rcc8` as disconnected, partially overlapping or occluding, one within the other: codes of :data:`RCC3`."""
    return _RCC3[rcc8(a, b, threshold=threshold)]


def rcc2(a: ArrayLike, b: ArrayLike, *, threshold: float = 0.0) -> Codes:
    """:func:`rcc8` as disconnected or connected: codes of :data:`RCC2`."""
    return _RCC2[rcc8(a, b, threshold=threshold)]


def ra(a: ArrayLike, b: ArrayLike) -> Codes:
    """Rectangle algebra: Allen's relation of the boxes' intervals on x, and on y.

    Equal points are ``m``, and a point on the upper end of an interval is ``mi``: meeting is asked first.

    Parameters
    ----------
    a, b : as of :func:`rcc8`.

    Returns
    -------
    (...) codes of :data:`RA`.

    Raises
    ------
    InputError : a size is negative.

    Source: Allen, Maintaining knowledge about temporal intervals, CACM 26 (1983); Balbiani, Condotta and Farinas del
    Cerro, A new tractable subclass of the rectangle algebra, IJCAI 1999; QSRLib's ``ra``.
    """
    return frame_by_frame(_ra, a, b, keep=edges)


def _rcc8(a: Columns, b: Columns, q: float) -> Codes:
    """Of the edges: left, right, lower, upper."""
    axes = [((a[k], a[k + 1]), (b[k], b[k + 1])) for k in (0, 2)]
    codes = np.full(len(a[0]), _PO, np.uint8)
    codes[_any(_meets(one, two, q) for one, two in axes)] = _EC
    inside = _all((two[0] <= one[0]) & (one[1] <= two[1]) for one, two in axes)
    around = _all((one[0] <= two[0]) & (two[1] <= one[1]) for one, two in axes)
    near = _any(np.abs(one[i] - two[j]) <= q for one, two in axes for i, j in product((0, 1), repeat=2))
    codes[around] = _NTPPI
    codes[inside] = _NTPP
    codes[around & near] = _TPPI
    codes[inside & near] = _TPP
    codes[_any((two[0] - one[1] > 2 * q) | (one[0] - two[1] > 2 * q) for one, two in axes)] = _DC
    codes[inside & around] = _EQ
    codes[_unknown(a, b)] = MISSING
    return codes


def _meets(one: tuple[Floats, Floats], two: tuple[Floats, Floats], q: float) -> Mask:
    """Whether the intervals lie beside each other, within 2 q."""
    after, before = two[0] - q, two[1] + q
    return ((one[1] <= after) & (after <= one[1] + q)) | ((one[0] - q <= before) & (before <= one[0]))


def _all(masks: Iterable[Mask]) -> Mask:
    return reduce(np.logical_and, masks)


def _any(masks: Iterable[Mask]) -> Mask:
    return reduce(np.logical_or, masks)


def _ra(a: Columns, b: Columns) -> Codes:
    codes = 13 * _allen(*a[:2], *b[:2]) + _allen(*a[2:], *b[2:])
    codes[_unknown(a, b)] = MISSING
    return codes


def _unknown(a: Columns, b: Columns) -> Mask:
    return ~np.isfinite(sum(a) + sum(b))


def _allen(a0: Floats, a1: Floats, b0: Floats, b1: Floats) -> Codes:
    """Codes of :data:`ALLEN` of intervals."""
    order = np.zeros(len(a0), np.uint8)
    for one, two in ((a0, b0), (a1, b1), (a1, b0), (a0, b1)):
        order *= 3
        order += 1 + (one > two).view(np.uint8) - (one < two).view(np.uint8)
    return _ALLEN[order]


def _allen_table() -> Codes:
    """The relation for every order of the ends: the signs of a0 - b0, a1 - b1, a1 - b0 and a0 - b1."""
    table = np.full(81, MISSING, np.uint8)
    for code, (starts, ends, end_start, start_end) in enumerate(product((-1, 0, 1), repeat=4)):
        found = _first(starts, ends, end_start, start_end)
        if found is None and (converse := _first(-starts, -ends, -start_end, -end_start)):
            found = ALLEN[len(ALLEN) - 1 - ALLEN.index(converse)]
        if found is not None:
            table[code] = ALLEN.index(found)
    return table


def _first(starts: int, ends: int, end_start: int, start_end: int) -> str | None:
    """The first of seven relations that holds, as QSRLib asks for them."""
    tests = {
        "<": end_start < 0,
        "m": end_start == 0,
        "o": starts < 0 < end_start and ends < 0,
        "s": starts == 0 and ends < 0,
        "d": starts > 0 > ends,
        "f": ends == 0 and starts > 0 > start_end,
        "=": starts == 0 and ends == 0,
    }
    return next((name for name, holds in tests.items() if holds), None)


_ALLEN = _allen_table()


def _coarser(values: tuple[str, ...], names: str) -> Codes:
    """For every code, and MISSING, of RCC-8 the code of a calculus with fewer relations."""
    table = np.full(MISSING + 1, MISSING, np.uint8)
    table[: len(RCC8)] = [values.index(name) for name in names.split()]
    return table


_RCC5 = _coarser(RCC5, "dr dr po pp pp ppi ppi eq")
_RCC4 = _coarser(RCC4, "dc po po pp pp ppi ppi pp")
_RCC3 = _coarser(RCC3, "dc po po o o o o o")
_RCC2 = _coarser(RCC2, "dc c c c c c c c")
