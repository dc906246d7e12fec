"""When a thing rests: stretches of a track that stay in one place, without any smoothing and so without lag.

A rest is found as a fixation of the eye is (I-DT: Salvucci and Goldberg, ETRA 2000): a dwell during which the
dispersion is small, extended while the track stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats, Rigid

_MEMORY_S = 1.0
"""A rest's place is the median over as much of its last seconds, so that slow creeping is not taken for resting."""


@dataclass(frozen=True)
class Stillness:
    """``dwell_s``: least duration of a rest.  ``enter_m``: dispersion within it.  ``leave_m``: farther away than this
    from where it rested, a thing has left, in ``leave_frames`` observations on end (fewer are outliers).
    ``edge_m``: a rest ends with the last moment at which the median of five observations is within this distance.
    The first two are widened by ``sigmas`` standard deviations of the position, the last by half of one.
    """

    dwell_s: float = 0.1
    enter_m: float = 0.008
    leave_m: float = 0.01
    edge_m: float = 0.002
    leave_frames: int = 3
    sigmas: float = 2.0


@dataclass(frozen=True)
class Rest:
    """Rows ``first`` to ``last``, both included, of a track that stays at ``place`` (12,), see :func:`box_places`.

    ``begin`` (12,) and ``end`` (12,) are its places in the first and the last second.
    """

    first: int
    last: int
    begin: Floats
    end: Floats


def box_places(pose: Rigid, size_m: Floats) -> Floats:
    """Poses (n,) as points (n, 12) whose Euclidean distance is the root mean square way of the box's corners, metres.

    A corner is ``p + sum(s_k h_k r_k)`` with half edges h, axes r and signs s; over all signs the mixed terms of the
    squared distance of two poses vanish, which leaves ``|dp|^2 + sum(h_k^2 |dr_k|^2)``.
    """
    axes = np.swapaxes(pose.rotation, -1, -2) * (np.asarray(size_m, float) / 2)[:, None]
    return np.concatenate([pose.translation, axes.reshape(*axes.shape[:-2], 9)], -1)


def find_rests(t_s: Floats, places: Floats, sigma_m: Floats, stillness: Stillness) -> list[Rest]:
    """The rests of a track in their order.

    Parameters
    ----------
    t_s : (n,) ascending times of the observations, seconds; gaps are allowed: a thing that is where it was before
        a gap has rested.
    places : (n, k) points whose distance is that of the poses (:func:`box_places`), metres, all known.
    sigma_m : (n,) standard deviation of the distance.
    """
    slack = stillness.sigmas * sigma_m
    found: list[Rest] = []
    row = 0
    while row < len(t_s):
        end = int(np.searchsorted(t_s, t_s[row] + stillness.dwell_s - 1e-9))
        if end >= len(t_s):
            break
        place = np.median(places[row : end + 1], axis=0)
        away = _distance(places[row : end + 1], place) - slack[row : end + 1]
        # two observations far apart in time tell nothing of the time between
        if end - row < 2 or away[0] > stillness.enter_m or np.mean(away > stillness.enter_m) > 0.15:
            row += 1
            continue
        last = _stays(t_s, places, slack, (row, end), stillness)
        found.append(_with_sharp_edges(t_s, places, slack, (row, last), stillness))
        row = last + 1
    return found


def _distance(points: Floats, place: Floats) -> Floats:
    return np.sqrt(((points - place) ** 2).sum(-1))


def _stays(t_s: Floats, places: Floats, slack: Floats, rows: tuple[int, int], stillness: Stillness) -> int:
    """The last row of the rest that begins with the given rows."""
    first, last = rows
    outside = 0
    place = np.median(places[first : last + 1], axis=0)
    for row in range(last + 1, len(t_s)):
        if _distance(places[row], place) - slack[row] <= stillness.leave_m:
            outside, last = 0, row
            if row % 5 == 0:  # a median over a second hardly changes from one frame to the next
                begin = int(np.searchsorted(t_s, t_s[row] - _MEMORY_S))
                place = np.median(places[max(begin, first) : row + 1], axis=0)
        else:
            outside += 1
            if outside >= stillness.leave_frames:
                break
    return last


def _with_sharp_edges(
    t_s: Floats, places: Floats, slack: Floats, rows: tuple[int, int], stillness: Stillness
) -> Rest:
    """A rest without the slow beginning of the movement that follows and the slow end of the one before."""
    from scipy.ndimage import median_filter

    first, last = rows
    head = slice(first, min(int(np.searchsorted(t_s, t_s[first] + _MEMORY_S)), last + 1))
    tail = slice(max(int(np.searchsorted(t_s, t_s[last] - _MEMORY_S)), first), last + 1)
    begin, end = np.median(places[head], axis=0), np.median(places[tail], axis=0)
    around = median_filter(places[max(first - 2, 0) : last + 3], size=(5, 1), mode="nearest")
    around = around[first - max(first - 2, 0) :][: last + 1 - first]
    near: list[NDArray[np.intp]] = []
    for part, place in ((head, begin), (tail, end)):
        limit = stillness.edge_m + slack[part] / (2 * stillness.sigmas)
        near.append(np.flatnonzero(_distance(around[part.start - first : part.stop - first], place) <= limit))
    first = head.start + int(near[0][0]) if near[0].size else first
    last = tail.start + int(near[1][-1]) if near[1].size else last
    return Rest(min(first, last), last, begin, end)
