"""What lies between rests is a movement; brief pauses, cusps, lifts and gaps decide how many."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.moves import Move, Segmentation, find_moves, goes_on, grouped
from ecat.geometry.transforms import Floats

RULES = Segmentation()


def legs(*points: tuple[float, float], rest: int = 20, speed: float = 0.015, pause: int = 0) -> Floats:
    """A track (n, 3) that rests, goes straight from point to point (metres a row) with pauses, and rests."""
    places = [np.repeat([points[0]], rest, 0)]
    for a, b in pairwise(points):
        n = max(int(np.hypot(b[0] - a[0], b[1] - a[1]) / speed), 2)
        places += [np.linspace(a, b, n + 1)[1:], np.repeat([b], pause, 0)]
    places.append(np.repeat([points[-1]], rest, 0))
    flat = np.concatenate(places)
    return np.column_stack([flat, np.full(len(flat), 0.08)])


def moves(
    track: Floats, free: NDArray[np.bool_] | None = None, seen: NDArray[np.intp] | None = None
) -> list[Move]:
    rows = np.arange(len(track)) if seen is None else seen
    free = np.zeros(len(track), bool) if free is None else free
    return find_moves(rows / 30.0, track[rows], np.zeros(len(rows)), free[rows], RULES)


def test_a_way_from_rest_to_rest_is_one_movement_with_exact_ends() -> None:
    (move,) = moves(legs((0, 0), (0.3, 0)))
    assert (move.first, move.last) == (19, 39)
    assert move.from_rest
    np.testing.assert_allclose(move.travel_m, 0.3)


def test_a_nudge_is_no_movement() -> None:
    assert moves(legs((0, 0), (0.03, 0))) == []


def test_a_brief_pause_on_a_straight_way_does_not_interrupt_it() -> None:
    assert len(moves(legs((0, 0), (0.3, 0), (0.6, 0), pause=8))) == 1


def test_a_brief_pause_where_the_way_turns_does() -> None:
    assert len(moves(legs((0, 0), (0.3, 0), (0.3, 0.3), pause=8))) == 2


def test_a_long_rest_interrupts_any_way() -> None:
    assert len(moves(legs((0, 0), (0.3, 0), (0.6, 0), pause=30))) == 2


def test_there_and_back_without_a_rest_are_two_movements() -> None:
    first, second = moves(legs((0, 0), (0.4, 0), (0.05, 0.05)))
    assert first.last == second.first
    assert not second.from_rest
    assert abs(first.path[-1, 0] - 0.4) < 0.02


def test_a_round_way_is_one_movement() -> None:
    angle = np.linspace(0, 1.6 * np.pi, 60)
    ring = np.column_stack([0.25 * np.cos(angle), 0.25 * np.sin(angle), np.full(60, 0.08)])
    track = np.concatenate([np.repeat(ring[:1], 20, 0), ring, np.repeat(ring[-1:], 20, 0)])
    assert len(moves(track)) == 1


def test_a_box_put_down_and_then_slid_aside_makes_two_movements() -> None:
    track = legs((0, 0), (0.4, 0), (0.4, 0.4))
    free = np.zeros(len(track), bool)
    free[22:45] = True
    first, second = moves(track, free)
    assert first.lifted > 0.8
    assert second.lifted == 0.0


def test_a_movement_that_nobody_saw_spans_the_gap() -> None:
    track = legs((0, 0), (0.3, 0))
    seen = np.r_[0:15, 45 : len(track)]
    (move,) = moves(track, seen=seen)
    assert seen[move.first] == 14
    assert seen[move.last] == 45


def unseen(track: Floats, first: int, last: int) -> NDArray[np.intp]:
    """All rows but those in ``[first, last)``."""
    return np.r_[0:first, last : len(track)]


def test_who_comes_out_of_a_long_dark_backwards_has_turned_in_its_middle() -> None:
    track = legs((0, 0), (0.4, 0), (0.1, 0), pause=50)
    turn, back = moves(track, seen=unseen(track, 35, 105))
    np.testing.assert_allclose([turn.start_s, turn.end_s], [19 / 30, (34 + 105) / 2 / 30])
    assert back.start_s == turn.end_s
    assert not back.from_rest


def test_who_comes_out_of_a_long_dark_ahead_has_gone_on() -> None:
    track = legs((0, 0), (0.4, 0), (0.8, 0), pause=50)
    assert len(moves(track, seen=unseen(track, 35, 105))) == 1


def test_a_short_dark_hides_no_turn() -> None:
    track = legs((0, 0), (0.2, 0), (0.05, 0))
    assert len(moves(track, seen=unseen(track, 28, 37))) == 1


def test_a_turn_seen_once_is_put_in_the_middle_of_the_dark() -> None:
    track = legs((0, 0), (0.6, 0), (0.1, 0), pause=10)
    seen = np.r_[0:25, 60, 90 : len(track)]
    first, second = moves(track, seen=seen)
    np.testing.assert_allclose(first.end_s, (24 + 90) / 2 / 30)
    assert second.start_s == first.end_s


def test_single_outliers_on_the_way_do_not_bend_it() -> None:
    track = legs((0, 0), (0.3, 0))
    track[30] += [0.0, 0.2, 0.0]
    (move,) = moves(track)
    assert np.abs(move.path[:, 1]).max() < 1e-9


def test_goes_on_compares_the_tangents_of_curved_ways() -> None:
    angle = np.linspace(0, np.pi, 60)
    ring = np.column_stack([0.25 * np.cos(angle), 0.25 * np.sin(angle), np.full(60, 0.08)])
    halves = ring[:30], ring[29:]
    first, second = (Move(0, len(half) - 1, 0.0, 1.0, half, 0.0, from_rest=True) for half in halves)
    assert goes_on(first, second, RULES, np.radians(15))
    assert not goes_on(second, first, RULES, np.radians(15))


def test_groups_are_runs_of_neighbours_that_belong_together() -> None:
    assert grouped([1, 2, 4, 5, 7], lambda a, b: b - a == 1) == [(1, 2), (4, 5), (7,)]
