"""Measures behind the spatial relations between boxes, and the intervals in which a relation holds.

Every measure is one number per frame that falls as the relation becomes more true, so that one rule with two
thresholds (:func:`held`) serves all.  Poses are table-from-box, metres; the ``table`` frame has x to the viewer's
right, y away from the viewer and z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ecat.geometry.transforms import Floats, Rigid

PAST_COS = 0.31
_CHUNK = 2_048
_STEPS = np.linspace(-1.0, 1.0, 5)
_EDGES: Floats = np.array([p for p in product(_STEPS, repeat=3) if sum(abs(v) == 1.0 for v in p) >= 2])


@dataclass(frozen=True)
class Threshold:
    """A relation begins when its measure falls to ``on`` and ends when it rises above ``off`` by more than ``sigmas``
    standard deviations.  It must hold for ``min_s``; a stretch without measurement up to ``max_gap_s`` is bridged, a
    longer one ends it.  In the first measurement, and in the first after such a stretch, the ``middle`` decides.
    """

    on: float
    off: float
    sigmas: float = 1.0
    min_s: float = 0.2
    max_gap_s: float = 1.0

    @property
    def middle(self) -> float:
        """Where it is as probable that the relation holds as that it does not."""
        return (self.on + self.off) / 2


@dataclass(frozen=True)
class Held:
    """Rows ``start`` to ``end`` (excluded) in which a relation holds; ``confidence`` 0 to 1."""

    start: int
    end: int
    confidence: float


def held(t_s: Floats, measure: Floats, sigma: Floats, threshold: Threshold) -> list[Held]:
    """The intervals in which a relation holds, apart from each other and in order.

    Confidence is the mean over the interval's frames of the probability that the measure is below the middle of both
    thresholds, given its standard deviation; half where it was not measured.

    Parameters
    ----------
    t_s : (n,) ascending times, seconds.
    measure : (n,) NaN where unknown; infinite where the relation makes no sense.
    sigma : (n,) standard deviation of the measure, in its unit.
    """
    from scipy.special import ndtr

    known = np.flatnonzero(~np.isnan(measure))
    if not known.size:
        return []
    at, value, doubt = t_s[known], measure[known], sigma[known]
    says = np.where(
        value <= threshold.on, 1, np.where(value > threshold.off + threshold.sigmas * doubt, -1, 0)
    )
    # between the thresholds the last word counts, but not across a long gap: there is none then
    fresh = np.diff(at, prepend=-np.inf) > threshold.max_gap_s
    says = np.where(fresh & (says == 0), np.where(value <= threshold.middle, 1, -1), says)
    spoken = np.maximum.accumulate(np.where(says != 0, np.arange(len(says)), 0))
    holds = says[spoken] > 0
    begins = np.flatnonzero(holds & (fresh | ~np.r_[False, holds[:-1]]))
    ends = np.flatnonzero(holds & (np.r_[fresh[1:], True] | ~np.r_[holds[1:], False]))
    sure = np.full(len(measure), 0.5)
    sure[known] = ndtr((threshold.middle - value) / np.maximum(doubt, 1e-9))
    found: list[Held] = []
    for begin, end in zip(known[begins].tolist(), known[ends].tolist(), strict=True):
        after = t_s[end + 1] if end + 1 < len(t_s) else t_s[end]
        if after - t_s[begin] >= threshold.min_s - 1e-9:
            found.append(Held(begin, end + 1, float(sure[begin : end + 1].mean())))
    return found


def box_gap(a: Rigid, b: Rigid, a_size: Floats, b_size: Floats) -> Floats:
    """Free distance (n,) between two boxes, 0 where they overlap.

    Exact while both stand upright; with a tilted one, edges are compared at five points each.
    """
    n = len(a.translation)
    out = np.full(n, np.nan)
    for start in range(0, n, _CHUNK):
        rows = slice(start, start + _CHUNK)
        first, second = (Rigid(p.rotation[rows], p.translation[rows]) for p in (a, b))
        out[rows] = np.minimum(
            _edges_to_box(first, second, a_size, b_size), _edges_to_box(second, first, b_size, a_size)
        )
    return out


def _edges_to_box(one: Rigid, other: Rigid, one_size: Floats, other_size: Floats) -> Floats:
    points = np.einsum("nij,kj->nki", one.rotation, _EDGES * (one_size / 2)) + one.translation[:, None]
    return _outside(points, other, other_size).min(1)


def point_gap(points: Floats, box: Rigid, size: Floats) -> Floats:
    """Distance (n,) of points (n, 3) from a box's surface, 0 inside."""
    return _outside(points[:, None], box, size)[:, 0]


def _outside(points: Floats, box: Rigid, size: Floats) -> Floats:
    """Distance (n, k) of points (n, k, 3) from boxes (n)."""
    inside = np.einsum("nji,nkj->nki", box.rotation, points - box.translation[:, None])
    return np.linalg.norm(np.maximum(np.abs(inside) - size / 2, 0.0), axis=-1)


def extent_z(box: Rigid, size: Floats) -> tuple[Floats, Floats]:
    """Heights (n,) of a box's lowest and highest point."""
    reach = _reach(box.rotation[:, 2], size)
    return box.translation[:, 2] - reach, box.translation[:, 2] + reach


def overhang(a: Rigid, b: Rigid, b_size: Floats) -> Floats:
    """How far (n,) the middle of ``a`` is beside box ``b``, seen from above; 0 over it.

    A body stands as long as its centre of gravity is over what carries it.
    """
    # of an upright box this is its outline; of a tilted one, the rectangle along the same axes that holds it
    along = b.rotation[:, :2, 0]
    along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], -1)
    offset = (a.translation - b.translation)[:, :2]
    beyond = [
        np.abs((offset * axis).sum(-1)) - _reach(np.einsum("nij,ni->nj", b.rotation[:, :2], axis), b_size)
        for axis in (along, across)
    ]
    return np.hypot(*(np.maximum(side, 0.0) for side in beyond))


def _reach(direction: Floats, size: Floats) -> Floats:
    """How far (n,) boxes go from their middles along directions (n, 3), which are given in their own axes."""
    return (np.abs(direction) * (size / 2)).sum(-1)


def height_over(a: Rigid, b: Rigid, a_size: Floats, b_size: Floats) -> Floats:
    """Height (n,) of the lowest point of ``a`` over the highest of ``b``, negative below it."""
    return extent_z(a, a_size)[0] - extent_z(b, b_size)[1]


def bearing_off(a: Floats, b: Floats, axis: tuple[float, float]) -> Floats:
    """Angle (n,) in radians between the direction from place ``b`` to ``a`` (n, 3) on the table and ``axis``."""
    offset = (a - b)[:, :2]
    return np.abs(np.arctan2(offset[:, 1] * axis[0] - offset[:, 0] * axis[1], offset @ np.array(axis)))


def way(path: Floats, landmark: Floats, gap_m: float, *, beside_m: float, change_m: float) -> str:
    """How a thing went with regard to another that stood: ``next``, ``past``, ``around``, ``toward``, ``away``, or
    ``""`` if none of them.

    The conditions follow the automatic evaluators of thesis §5.8.  ``around``: turns by more than 1.1 half circles
    about the landmark; ``next``: ends beside it, having been farther; ``past``: the landmark lies ahead at the start
    and behind at the end, at most 72 degrees off the straight way; otherwise ``toward`` or ``away`` by the change of
    the distance.

    Parameters
    ----------
    path : (n, 2) places of its middle on the table from rest to rest, metres.
    landmark : (2,) the place of the other's middle.
    gap_m : free distance between both at the end; up to ``beside_m`` is beside.
    change_m : the least change of the distance of both middles that counts.
    """
    offset = path - landmark
    distance = np.linalg.norm(offset, axis=-1)
    step = offset[-1] - offset[0]
    length = float(np.linalg.norm(step))
    turned = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    if abs(turned[-1] - turned[0]) >= 1.1 * np.pi:
        return "around"
    if gap_m <= beside_m and distance.max() > distance[-1] + change_m:
        return "next"
    along = offset[[0, -1]] @ step / np.maximum(distance[[0, -1]] * length, 1e-9)
    if length > change_m and min(-along[0], along[1]) > PAST_COS:
        return "past"
    if distance[-1] < distance[0] - change_m:
        return "toward"
    return "away" if distance[-1] > distance[0] + change_m else ""
