"""Movements from rest to rest: where one begins and ends, and which belong together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.rest import Rest, Stillness, find_rests
from ecat.geometry.transforms import Floats

T = TypeVar("T")
Flags = NDArray[np.bool_]
_ENOUGH = 4
_OUTLIER_M = 0.02
_CLOSE_S = 0.15
_HEADING_M = 0.01
"""A box that was seen to move by less, which noise does too, was heading nowhere."""


@dataclass(frozen=True)
class Segmentation:
    """What counts as one movement.

    ``stillness`` : when a box rests.
    ``travel_m`` : the least way, by the box's corners, between start and end.
    ``arm_m``, ``bow_m`` : the direction of a path is taken over so much of it, straight or as a parabola.
    ``pause_s``, ``pause_turn_rad`` : a shorter rest interrupts a movement only where its direction turns by more.
    ``cusp_rad``, ``back_m`` : a path that turns back more sharply, and comes back by so much, is two movements.
    ``dark_s``, ``dark_rad`` : so are the parts before and after a time in which the box was not seen for so long, if
        it comes out of it in a direction that differs by so much from the one in which it went in.
    ``slide_m`` : what is slid for at least so far before it is lifted, or after it was put down, is a movement of its
        own; ``lifted_rows`` observations off the table make it lifted.
    """

    stillness: Stillness = field(default_factory=Stillness)
    travel_m: float = 0.04
    arm_m: float = 0.06
    pause_s: float = 0.5
    pause_turn_rad: float = math.radians(45)
    bow_m: float = 0.12
    cusp_rad: float = math.radians(120)
    back_m: float = 0.25
    dark_s: float = 1.5
    dark_rad: float = math.radians(90)
    slide_m: float = 0.2
    lifted_rows: int = 3


@dataclass(frozen=True)
class Move:
    """A movement: at rest (or turning) at row ``first``, on the way in between, at rest again at row ``last``.

    ``start_s`` and ``end_s`` are the times of these rows, but for a turn that was not seen: that is put in the middle
    of the time without observations.
    ``path`` (n, k) are its places, those of the rests at its ends included; ``lifted`` is the share of the
    observations in between at which the box was off the table.  ``from_rest`` tells a rest from a turn at its start.
    """

    first: int
    last: int
    start_s: float
    end_s: float
    path: Floats
    lifted: float
    from_rest: bool

    @property
    def travel_m(self) -> float:
        """The way between start and end, by the box's corners."""
        return float(np.linalg.norm(self.path[-1] - self.path[0]))


def find_moves(t_s: Floats, places: Floats, sigma_m: Floats, free: Flags, rules: Segmentation) -> list[Move]:
    """The movements of a box in their order.

    Parameters
    ----------
    t_s, places, sigma_m : its observations, see :func:`ecat.geometry.rest.find_rests`; the first three of ``places``
        are x, y, z in the ``table`` frame.
    free : (n,) whether it is off the table.
    """
    rests = find_rests(t_s, places, sigma_m, rules.stillness)
    pieces: list[Move] = []
    for before, after in pairwise(rests):
        pieces += _pieces(before, after, t_s, places, free=free, rules=rules)
    joined: list[Move] = []
    for piece in pieces:
        if joined and _goes_on(joined[-1], piece, t_s, rules):
            joined[-1] = _joined(joined[-1], piece)
        else:
            joined.append(piece)
    return [move for move in joined if move.travel_m >= rules.travel_m]


def _pieces(
    before: Rest, after: Rest, t_s: Floats, places: Floats, *, free: Flags, rules: Segmentation
) -> Iterator[Move]:
    """What happens between two rests, cut where it turns back and where the box leaves or touches the table."""
    rows = np.arange(before.last, after.first + 1)
    path = _without_outliers(t_s[rows], places[rows])
    path[0], path[-1] = before.end, after.begin
    off = free[rows]
    off[[0, -1]] = False
    times = t_s[rows]
    cuts = {row: float(times[row]) for row in (0, *_touches(path[:, :2], off, rules), len(rows) - 1)}
    dark = _dark_turns(times, path[:, :2], rules)
    cuts |= {row: float(times[row : row + 2].mean()) for row in dark}
    seen_turns = set(_cusp(path[:, :2], rules)) - {row + side for row in dark for side in (0, 1)}
    cuts |= {row: _turned_s(times, row) for row in seen_turns}
    for begin, end in pairwise(sorted(cuts)):
        inner = off[begin + 1 : end]
        lifted = float(inner.mean()) if inner.size else 0.0
        yield Move(
            int(rows[begin]),
            int(rows[end]),
            cuts[begin],
            cuts[end],
            path[begin : end + 1],
            lifted,
            from_rest=begin == 0,
        )


def _without_outliers(t_s: Floats, path: Floats) -> Floats:
    """A path (n, k) with each place that its close neighbours in time contradict put between them.

    A place that nothing else was seen near to in time stays: it may be all that is known of a movement.
    """
    path = path.copy()
    step = np.linalg.norm(path[2:] - path[:-2], axis=1)
    between = (path[2:] + path[:-2]) / 2
    off = np.linalg.norm(path[1:-1] - between, axis=1) > step + _OUTLIER_M
    off &= t_s[2:] - t_s[:-2] <= _CLOSE_S
    path[1:-1][off] = between[off]
    return path


def _cusp(path: Floats, rules: Segmentation) -> list[int]:
    """The place (if any) where a path (n, 2) turns back, far from both its ends."""
    ends = [np.linalg.norm(path - path[k], axis=1) for k in (0, -1)]
    back = ends[0] + ends[1] - ends[0][-1]
    for row in np.argsort(-back, kind="stable"):
        if back[row] < rules.back_m:
            break
        sides = _direction(path[: row + 1][::-1], rules.arm_m), _direction(path[row:], rules.arm_m)
        if min(ends[0][row], ends[1][row]) > rules.arm_m and _angle(-sides[0], sides[1]) > rules.cusp_rad:
            return [int(row)]
    return []


def _turned_s(t_s: Floats, row: int) -> float:
    """When a path turned that turns at a row: of a single observation in the dark, the middle of the dark."""
    before, after = t_s[row - 1], t_s[row + 1]
    alone = min(t_s[row] - before, after - t_s[row]) > _CLOSE_S
    return float((before + after) / 2 if alone else t_s[row])


def _dark_turns(t_s: Floats, path: Floats, rules: Segmentation) -> list[int]:
    """The rows after which a path (n, 2) is in the dark for long and comes out elsewhere than it was heading for."""
    found: list[int] = []
    for row in np.flatnonzero(np.diff(t_s) >= rules.dark_s):
        into, out = -_direction(path[: row + 1][::-1], rules.arm_m), _direction(path[row + 1 :], rules.arm_m)
        sure = min(np.linalg.norm(into), np.linalg.norm(out)) > _HEADING_M
        if sure and _angle(into, out) > rules.dark_rad:
            found.append(int(row))
    return found


def _touches(path: Floats, off: Flags, rules: Segmentation) -> list[int]:
    """Where a box that is lifted in between leaves the table and touches it again, if it also slides."""
    lifted = np.flatnonzero(off)
    if len(lifted) < rules.lifted_rows:
        return []
    found: list[int] = []
    if np.linalg.norm(path[lifted[0]] - path[0]) > rules.slide_m:
        found.append(int(lifted[0]))
    down = int(lifted[-1]) + 1
    if np.linalg.norm(path[-1] - path[down]) > rules.slide_m:
        found.append(down)
    return found


def goes_on(first: Move, second: Move, rules: Segmentation, turn_rad: float) -> bool:
    """Whether the second movement goes on in the direction in which the first ended."""
    end, start = -_tangent(first.path[::-1, :2], rules.bow_m), _tangent(second.path[:, :2], rules.bow_m)
    return _angle(end, start) <= turn_rad


def _goes_on(first: Move, second: Move, t_s: Floats, rules: Segmentation) -> bool:
    """Whether a brief rest between two pieces is no rest: the box goes on, or is only nudged before or after."""
    unseen_turn = first.end_s != t_s[first.last]
    if unseen_turn or second.start_s - first.end_s > rules.pause_s:
        return False
    nudge = second.from_rest and min(first.travel_m, second.travel_m) < rules.travel_m
    end, start = (
        -_direction(first.path[::-1, :2], rules.arm_m),
        _direction(second.path[:, :2], rules.arm_m),
    )
    return nudge or _angle(end, start) <= rules.pause_turn_rad


def _joined(first: Move, second: Move) -> Move:
    counts = [len(move.path) for move in (first, second)]
    lifted = float(np.average([first.lifted, second.lifted], weights=counts))
    path = np.concatenate([first.path, second.path])
    return Move(
        first.first, second.last, first.start_s, second.end_s, path, lifted, from_rest=first.from_rest
    )


def _direction(path: Floats, arm_m: float) -> Floats:
    """From the path's first place (n, 2) to where it is farther than the arm, or as far as it gets."""
    away = np.linalg.norm(path - path[0], axis=1)
    beyond = np.flatnonzero(away > arm_m)
    return path[beyond[0] if beyond.size else int(away.argmax())] - path[0]


def _tangent(path: Floats, bow_m: float) -> Floats:
    """The direction in which a path (n, 2) sets out: of the parabola through its first place and what is near it.

    Zero, which is no direction, where too little was seen there.
    """
    offset = path - path[0]
    away = np.linalg.norm(offset, axis=1)
    beyond = np.flatnonzero(away > bow_m)
    near = slice(1, int(beyond[0]) + 1 if beyond.size else len(path))
    if away[near].size < _ENOUGH:
        return np.zeros(2)
    return np.linalg.lstsq(np.stack([away[near], away[near] ** 2], -1), offset[near], rcond=None)[0][0]


def _angle(a: Floats, b: Floats) -> float:
    """Between two directions (2,); half a circle if one has no length."""
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return math.acos(max(-1.0, min(1.0, float(a @ b) / length))) if length > 1e-9 else math.pi


def grouped(things: Sequence[T], together: Callable[[T, T], bool]) -> list[tuple[T, ...]]:
    """Neighbours in groups, where one belongs to the one before it."""
    groups: list[list[T]] = []
    for thing in things:
        if groups and together(groups[-1][-1], thing):
            groups[-1].append(thing)
        else:
            groups.append([thing])
    return [tuple(group) for group in groups]
