"""The features of chapter 5: two blocks on a table, seen from above, one of which is moved about the other.

Source: Do, thesis on ECAT (2018), §2.2 and chapter 5, as its programs computed them.  A track is where a block is on
the table, (n, 3): x and y of its middle in metres, and its rotation in radians, which for a square block is
known up to quarter turns.  Features are of two tracks, of which the first is the one that moves (:func:`ranked`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from learn.features import qsr

Floats = NDArray[np.float64]
Codes = NDArray[np.int16]
Places = NDArray[np.int64]

BLOCK_M = 0.15
"""Edge of a block; a step of the qualitative distance is half of it."""
THRESHOLDS = tuple(step * BLOCK_M / 2 for step in range(20))
QTC_THRESHOLD, QTC_ANGLE = 0.001, np.pi / 5
SECTOR = np.pi / 8
"""Radians of a quantised rotation."""
CHUNK = 5
"""Frames, after sub-sampling, for which it is decided anew which block is the one that moves."""
STEPS = 20
"""Frames of a window, and of an event after sub-sampling, on average."""
SCALES = (1.0, 1.5, 2.0)

_CORNERS = tuple(f"{axis}{corner}" for corner in range(1, 5) for axis in "xy")
QUANTITATIVE_COLUMNS = tuple(
    f"{what}_{corner}"
    for what in ("first", "first_change", "second", "second_change", "difference")
    for corner in _CORNERS
)
_TRANSFORM = ("x", "y", "rotation")
TRANSFORM_COLUMNS = tuple(
    f"{what}_{part}"
    for what in ("first", "second", "difference", "first_change", "second_change")
    for part in _TRANSFORM
)
QUALITATIVE_COLUMNS = (
    *("cardir", "argd", "cardir_change", "argd_change"),
    *("qtc_towards_first", "qtc_towards_second", "qtc_side_first", "qtc_side_second"),
    *("rotation_first", "rotation_second", "rotation_difference"),
    *("rotation_first_change", "rotation_second_change"),
)
"""F1 to F13 of the thesis."""
NETWORK_COLUMNS = (
    *("cardir_turn", "argd_change"),
    *("qtc_towards_first", "qtc_towards_second", "qtc_side_first", "qtc_side_second"),
    "half_rotation_difference",
)
NETWORK8_COLUMNS = ("argd", *NETWORK_COLUMNS)


# --- tracks


def interpolated(track: Floats) -> Floats:
    """The track (n, 3) with gaps (NaN) filled in straight lines, and its ends as what is known next to them.

    Rotations are interpolated as numbers, without a way around, as they were for the thesis.

    Raises
    ------
    InputError : nothing is known.
    """
    known = np.isfinite(track).all(axis=1)
    if not known.any():
        raise InputError(
            "cannot follow a block", where="it was never seen", fix="choose objects that were seen"
        )
    frame = np.arange(len(track))
    return np.stack([np.interp(frame, frame[known], column[known]) for column in track.T], axis=1)


def quotient(events: Sequence[tuple[int, int]], steps: int = STEPS) -> int:
    """Of how many frames one is kept, so that events (start, end) last ``steps`` on average; at least 1.

    The thesis took one for each action: 2 of SlideToward, 1 of SlideAway, 3, 2 and 5 of SlideNext, -Past and -Around.
    """
    if not events:
        return 1
    return max(1, int(np.mean([(end - start) / steps for start, end in events])))


def subsampled(track: Floats, every: int) -> Floats:
    """Frames 0, ``every``, 2 ``every``, ... of a track (n, ...): (n // every, ...)."""
    return track[::every][: len(track) // every]


def ranked(
    tracks: Floats, *, chunk: int = CHUNK, second: Literal["farthest", "nearest"] = "farthest"
) -> Places:
    """Which track is the first object of each frame, and which the second: (n, 2).

    For each ``chunk`` of frames, the first is the one with the longest path in it, of equals the one that comes first.
    The second is of the others the one that is farthest from it, as in the program of the thesis, or nearest, as in its
    text; of two tracks there is no choice.

    Parameters
    ----------
    tracks : (objects, n, 3), of at least two objects, all of it known.
    """
    _require_known(tracks)
    if len(tracks) < 2:
        raise InputError("cannot rank objects", where=f"there is {len(tracks)}", fix="give two objects")
    found = np.empty((tracks.shape[1], 2), np.int64)
    sign = 1.0 if second == "farthest" else -1.0
    for start in range(0, tracks.shape[1], chunk):
        places = tracks[:, start : start + chunk, :2]
        paths = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
        first = int(paths.argmax())
        apart = sign * np.linalg.norm(places - places[first], axis=2).mean(axis=1)
        apart[first] = -np.inf
        found[start : start + chunk] = first, int(apart.argmax())
    return found


def by_salience(tracks: Floats, *, chunk: int = CHUNK) -> tuple[Floats, Floats]:
    """The tracks (n, 3) of what is the first and the second object (:func:`ranked`): identities change with chunks."""
    who, frame = ranked(tracks, chunk=chunk), np.arange(tracks.shape[1])
    return tracks[who[:, 0], frame], tracks[who[:, 1], frame]


# --- features


def corners(track: Floats, half_side: float = BLOCK_M / 2) -> Floats:
    """The corners (n, 8), x and y of each, of blocks: right and up of the middle, right and down, and so around."""
    cos, sin = np.cos(track[:, 2]), np.sin(track[:, 2])
    turn = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    square = half_side * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    return (np.einsum("nij,kj->nki", turn, square) + track[:, None, :2]).reshape(len(track), 8)


def quantitative(first: Floats, second: Floats, half_side: float = BLOCK_M / 2) -> Floats:
    """Corners of both blocks, how these change to the next frame (0 at the last), and the first's minus the second's.

    Source: thesis chapter 5; (n, 40) :data:`QUANTITATIVE_COLUMNS`, metres.
    """
    _require_known(first, second)
    a, b = corners(first, half_side), corners(second, half_side)
    return np.concatenate([a, _to_next(a), b, _to_next(b), a - b], axis=1)


def transforms(first: Floats, second: Floats) -> Floats:
    """Both transforms, the first minus the second, and how both change to the next frame (0 at the last).

    Source: the list of thesis §2.2.1; (n, 15) :data:`TRANSFORM_COLUMNS`, metres and radians.
    """
    _require_known(first, second)
    return np.concatenate([first, second, first - second, _to_next(first), _to_next(second)], axis=1)


def qualitative(first: Floats, second: Floats) -> Codes:
    """F1 to F13: direction, distance, movement and rotations as codes, and changes of codes from the frame before.

    Source: thesis §2.2.2; (n, 13) :data:`QUALITATIVE_COLUMNS`.  Changes and movement are 0 at the first frame; those
    where blocks change their ranks are told as if the block had jumped, as they were.
    """
    _require_known(first, second)
    a, b = first[:, :2], second[:, :2]
    found = np.zeros((len(first), 13), np.int16)
    found[:, 0], found[:, 1] = qsr.cardir(a, b), qsr.argd(a, b, THRESHOLDS)
    found[:, 2:4] = _from_before(found[:, :2])
    if len(first) > 1:
        states = qsr.qtc_c(a, b, threshold=QTC_THRESHOLD, angle=QTC_ANGLE).astype(np.int16)
        found[1:, 4:8] = states[:, None] // [27, 9, 3, 1] % 3 - 1
    found[:, 8], found[:, 9] = np.floor(first[:, 2] / SECTOR), np.floor(second[:, 2] / SECTOR)
    found[:, 10] = found[:, 8] - found[:, 9]
    found[:, 11:13] = _from_before(found[:, 8:10])
    return found


def network_input(
    features: Codes,
    *,
    distance: bool = False,
    wrap: Literal["cardir", "argd"] = "cardir",
    floor: bool = False,
) -> Floats:
    """What the networks of chapter 5 were given of (n, 13) :func:`qualitative` features: (n, 7), or (n, 8).

    A change of direction by seven sectors is one the other way; so is a difference of rotations by three.

    Parameters
    ----------
    distance : with the distance as the first of 8 numbers, as for SlideNext.
    wrap : which change goes around; programs before February 2018 had the wrong one, that of the distance.
    floor : halves of differences that went around are rounded down, as Python 2 did, under which the networks that are
        kept were trained: 0 and -1 instead of 0.5 and -0.5.
    """
    found = features[:, [1, 2, 3, 4, 5, 6, 7]].astype(np.float64)
    around = 1 if wrap == "cardir" else 2
    found[:, around] = _around(found[:, around], 7)
    difference = features[:, 10].astype(np.float64)
    turned = _around(difference, 3)
    half = turned / 2
    if floor:
        half = np.where(turned == difference, half, np.floor(half))
    found = np.column_stack([found, half])
    return found if distance else found[:, 1:]


def windows(features: NDArray[np.floating] | Codes, scale: float = 1.0) -> Floats:
    """Windows (w, 20, k) of features (n, k) of a session, one from every frame, at one of the :data:`SCALES`.

    At 2.0 every other frame counts; at 1.5, of each three frames the first, and the mean of the other two (codes too:
    that is what the networks saw).  A session that is shorter than the window has none.

    Raises
    ------
    UsageError : no such scale.
    """
    if scale not in SCALES:
        known = ", ".join(map(str, SCALES))
        raise UsageError(f"cannot make windows at scale {scale}", where=f"there are {known}", fix="take one")
    values = np.asarray(features, np.float64)
    starts = np.arange(max(0, len(values) - int(STEPS * scale) + 1))[:, None]
    if scale != 1.5:
        return values[starts + int(scale) * np.arange(STEPS)]
    threes = starts + 3 * np.arange(STEPS // 2)
    pairs = np.stack([values[threes], (values[threes + 1] + values[threes + 2]) / 2], axis=2)
    return pairs.reshape(len(starts), STEPS, *values.shape[1:])


def _to_next(values: Floats) -> Floats:
    change = np.zeros_like(values)
    change[:-1] = np.diff(values, axis=0)
    return change


def _from_before(codes: Codes) -> Codes:
    change = np.zeros_like(codes)
    change[1:] = np.diff(codes, axis=0)
    return change


def _around(values: Floats, most: int) -> Floats:
    return np.where(np.abs(values) == most, -np.sign(values), values)


def _require_known(*tracks: Floats) -> None:
    for track in tracks:
        unknown = ~np.isfinite(track).all(axis=-1)
        if unknown.any():
            frame = int(np.argwhere(unknown)[0, -1])
            raise InputError(
                "cannot compute features of blocks",
                where=f"frame {frame}: a block's place is not known",
                consequence="nothing was computed",
                fix="interpolate the track, or leave the session out",
            )
