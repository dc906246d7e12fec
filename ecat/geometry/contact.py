"""How far apart boxes are that rest on the same table."""

from __future__ import annotations

import numpy as np

from ecat.geometry.transforms import Floats


def gap(first: Floats, second: Floats, half_first: Floats, half_second: Floats) -> Floats:
    """Signed distance (n,) between the outlines of two boxes seen from above, metres; negative when they overlap.

    The largest separation along the four directions of the sides: exact when they overlap or face each other with a
    side, a little less than the distance when corner faces corner (separating axis theorem).

    Parameters
    ----------
    first, second : (n, 3) x, y in metres and turn about z in radians, in the table's frame.
    half_first, half_second : (2,) half the edges along the boxes' x and y.
    """
    apart = second[:, :2] - first[:, :2]
    found: list[Floats] = []
    for turn in (first[:, 2], first[:, 2] + np.pi / 2, second[:, 2], second[:, 2] + np.pi / 2):
        along = np.abs(np.cos(turn) * apart[:, 0] + np.sin(turn) * apart[:, 1])
        reach = sum(
            half[0] * np.abs(np.cos(turn - box[:, 2])) + half[1] * np.abs(np.sin(turn - box[:, 2]))
            for box, half in ((first, half_first), (second, half_second))
        )
        found.append(along - reach)
    return np.max(found, axis=0)


def gap_gradient(first: Floats, second: Floats, half_first: Floats, half_second: Floats) -> tuple[Floats, Floats]:
    """Derivatives (n, 3), (n, 3) of the gap by both boxes' x, y and turn (central differences)."""
    step = 1e-6
    columns: list[list[Floats]] = [[], []]
    for k in range(3):
        move = step * np.eye(3)[k]
        columns[0].append(gap(first + move, second, half_first, half_second) - gap(first - move, second, half_first, half_second))
        columns[1].append(gap(first, second + move, half_first, half_second) - gap(first, second - move, half_first, half_second))
    by_first, by_second = (np.stack(column, -1) / (2 * step) for column in columns)
    return by_first, by_second
