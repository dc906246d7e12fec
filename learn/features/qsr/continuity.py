"""Sequences of QTC states without repetition, and continuous."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from learn.features.qsr.codes import MISSING, Codes, Floats
from learn.features.qsr.qtc import SIGNS

NOTHING = MISSING
"""In :func:`between`: no state has to be inserted."""
Tracks = NDArray[np.int32]


def chain(states: Codes, values: tuple[str, ...], *, collapse: bool, validate: bool) -> Codes:
    """The states of one track, collapsed, then validated, each if asked for; else as they are.

    Parameters
    ----------
    states : (n,) codes in order.
    values : the names of the codes: ``QTC_B``, ``QTC_C`` or ``QTC_BC``.
    """
    return chains(states, np.zeros(len(states), np.int32), values, collapse=collapse, validate=validate)[0]


def chains(
    states: Codes, tracks: Tracks, values: tuple[str, ...], *, collapse: bool, validate: bool
) -> tuple[Codes, Tracks]:
    """As :func:`chain`, of many tracks at once: ``tracks`` (n,) is the number of each state's track."""
    if collapse:
        states, tracks = collapsed(states, tracks)
    return validated(states, tracks, values) if validate else (states, tracks)


def collapsed(states: Codes, tracks: Tracks) -> tuple[Codes, Tracks]:
    """Without states equal to the one before; what is missing is left out.

    Parameters
    ----------
    states : (n,) codes of one calculus, those of a track together and in order.
    tracks : (n,) the number of the track that each belongs to.

    Source: QSRLib's ``no_collapse=False``.
    """
    states, tracks = _known(states, tracks)
    keep = np.ones(len(states), np.bool_)
    keep[1:] = (states[1:] != states[:-1]) | (tracks[1:] != tracks[:-1])
    return states[keep], tracks[keep]


def validated(states: Codes, tracks: Tracks, values: tuple[str, ...]) -> tuple[Codes, Tracks]:
    """With the states that continuous movement passes through; what is missing is left out.

    A symbol does not go from - to + without being 0 in between, nor do two change at once where one stands for
    an instant and the other for an interval; where they do, one state is inserted.

    Parameters
    ----------
    states, tracks : as of :func:`collapsed`.
    values : the names of the codes: ``QTC_B``, ``QTC_C`` or ``QTC_BC``.

    Source: Van de Weghe (2004), conceptual neighbourhood and dominance; with the rule of QSRLib's ``validate=True``, to
    the letter.
    """
    states, tracks = _known(states, tracks)
    if not len(states):
        return states, tracks
    inserted = np.full(len(states), NOTHING, np.uint8)
    inserted[1:] = between(values)[states[:-1], states[1:]]
    inserted[1:][tracks[1:] != tracks[:-1]] = NOTHING
    more = inserted != NOTHING
    place = np.arange(len(states)) + np.cumsum(more)
    found = np.empty(place[-1] + 1, np.uint8)
    found[place] = states
    found[place[more] - 1] = inserted[more]
    return found, np.repeat(tracks, 1 + more)


def positions(tracks: Tracks) -> Tracks:
    """(n,) the place of each state in its track's chain, from 1."""
    n = np.arange(len(tracks), dtype=np.int32)
    starts = np.ones(len(tracks), np.bool_)
    starts[1:] = tracks[1:] != tracks[:-1]
    return n - np.maximum.accumulate(np.where(starts, n, 0)) + 1 if len(tracks) else n


@cache
def between(values: tuple[str, ...]) -> Codes:
    """(n, n) the state to insert between two, or :data:`NOTHING`, for the calculus whose states are ``values``."""
    states = np.array([_symbols(name) for name in values])
    before = np.broadcast_to(states[:, None], (len(states), *states.shape))
    after = np.broadcast_to(states, before.shape)
    middle = np.where(np.abs(before - after) == 2, 0.0, after)
    for x in range(4):
        for y in range(x + 1, 4):
            one = np.abs(before[..., x]) + np.abs(before[..., y]) == 1
            other = np.abs(middle[..., x]) + np.abs(middle[..., y]) == 1
            left = before[..., [x, y]] - middle[..., [x, y]]
            # not symmetric in the signs; so is the original
            jump = one & other & (left != 0).any(-1) & (left.sum(-1) != 1)
            middle[..., x] = np.where(jump, 0.0, middle[..., x])
            middle[..., y] = np.where(jump, 0.0, middle[..., y])
    codes = {_key(state): code for code, state in enumerate(states)}
    found = np.array([[codes[_key(state)] for state in row] for row in middle], np.uint8)
    found[found == np.arange(len(states))] = NOTHING
    found.flags.writeable = False
    return found


def _known(states: Codes, tracks: Tracks) -> tuple[Codes, Tracks]:
    known = states != MISSING
    return (states, tracks) if known.all() else (states[known], tracks[known])


def _symbols(name: str) -> list[float]:
    symbols = [SIGNS.index(symbol) - 1.0 for symbol in name.split(",")]
    return symbols + [np.nan] * (4 - len(symbols))


def _key(state: Floats) -> tuple[float, ...]:
    return tuple(value for value in state.tolist() if value == value)  # noqa: PLR0124  (without NaN)
