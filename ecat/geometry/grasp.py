"""Which hand carries a box, and when it closes and opens: it is where the hand stays fixed to the box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.relations import point_gap
from ecat.geometry.transforms import Floats, Rigid

_RESTING = 10
"""So many observations tell where a box rests."""
_STEADY_M = 0.002
"""A hand is not known to be off its place by less, however little it moved on the box."""


@dataclass(frozen=True)
class Grip:
    """``reach_m``: greatest distance of a holding hand from the box's surface.  ``spread_m``: how much, by its median,
    its place on the box may vary during the movement.  ``hold_m``: it holds while it is this near to that place;
    ``grasp_m``: it closes or opens while it is this near.  Both are widened by the hand's standard deviation.
    ``frames``: so many frames on end outside are believed.  A hand sets off and arrives gently: where it is near enough
    to hold, but farther than it mostly was during the movement, it opens or closes already.
    """

    reach_m: float = 0.1
    spread_m: float = 0.03
    hold_m: float = 0.01
    grasp_m: float = 0.05
    frames: int = 2


@dataclass(frozen=True)
class Grasp:
    """Rows at which the hand begins to close, holds, opens, and is away (excluded); ``spread_m``: see :class:`Grip`."""

    grasp: int
    hold: int
    release: int
    end: int
    spread_m: float


def find_grasp(
    pose: Rigid,
    size_m: Floats,
    hand: Floats,
    sigma_m: Floats,
    *,
    move: tuple[int, int],
    bounds: tuple[int, int],
    grip: Grip,
) -> Grasp | None:
    """How the hand holds the box during a movement, or None if it is not this hand.

    Parameters
    ----------
    pose : (n,) table-from-box, NaN where unknown.
    hand : (n, 3) in the same frame, NaN where unknown; ``sigma_m`` (n,) its standard deviation.
    move : rows ``[start, end)`` of the movement; the box rests before and after it.
    bounds : rows between which the grasp lies.
    """
    start, end = move
    rows = np.arange(max(start - 1, 0), min(end, len(hand) - 1) + 1)
    held = _at(pose, rows)
    on_box = _on_box(hand[rows], held)
    known = np.isfinite(on_box[:, 0])
    if known.sum() < 2:
        return None
    place = np.median(on_box[known], axis=0)
    spread = float(np.median(np.linalg.norm(on_box[known] - place, axis=1)))
    gap = np.median(point_gap(hand[rows[known]], _at(held, np.flatnonzero(known)), size_m))
    if spread > grip.spread_m or gap > grip.reach_m:
        return None
    # before and after the movement the box is where it rests, seen or not
    seen = np.flatnonzero(np.isfinite(pose.translation[:, 0]))
    sides = (
        (np.arange(start - 1, bounds[0] - 1, -1), seen[seen < start][-_RESTING:]),
        (np.arange(end, bounds[1]), seen[seen >= end][:_RESTING]),
    )
    lasting: list[tuple[int, int]] = []
    for part, around in sides:
        resting = _at(pose, _typical(pose, around if around.size else rows[known][:1]))
        distance = np.linalg.norm(_on_box(hand[part], resting) - place, axis=1)
        away = distance - sigma_m[part]
        held_for = _before(distance, _lasts(away, grip.hold_m, grip.frames), max(spread, _STEADY_M))
        lasting.append((held_for, _lasts(away, grip.grasp_m, grip.frames)))
    (closed, near), (opened, left) = lasting
    return Grasp(start - near, start - closed, end + opened, end + left, spread)


def _at(pose: Rigid, rows: NDArray[np.intp]) -> Rigid:
    return Rigid(pose.rotation[rows], pose.translation[rows])


def _typical(pose: Rigid, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The one row whose place is the nearest to the median place."""
    places = pose.translation[rows]
    return rows[[int(np.linalg.norm(places - np.median(places, axis=0), axis=1).argmin())]]


def _on_box(points: Floats, pose: Rigid) -> Floats:
    return np.einsum(
        "nji,nj->ni", np.broadcast_to(pose.rotation, (len(points), 3, 3)), points - pose.translation
    )


def _before(distance: Floats, rows: int, usual: float) -> int:
    """How many of the first ``rows`` there are before the distance rises from the usual one to where it ends."""
    while rows and distance[rows - 1] > usual:
        rows -= 1
    return rows


def _lasts(away: Floats, limit: float, frames: int) -> int:
    """How many of the first values are within the limit, until ``frames`` on end are not; unknown ones wait."""
    last, outside = 0, 0
    for number, value in enumerate(away.tolist()):
        if value <= limit:
            last, outside = number + 1, 0
        elif value > limit:
            outside += 1
            if outside >= frames:
                break
    return last
