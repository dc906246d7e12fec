"""Smoothed poses: less noise, no lag, short gaps filled, long ones left open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.rest import Stillness, find_rests
from ecat.geometry.smoothing import Smoothness, random_share, smooth_track
from ecat.geometry.transforms import Floats, known, quaternion_angle, skew
from ecat.stages.images import ImagesByKind
from ecat.stages.pose import LISTS, NUMBERS, UPPER, ObjectPoses, pose_table
from ecat.stages.rows import InMemory
from ecat.stages.stage import Stage, Tables
from ecat.stages.tie import pieces
from ecat.tables import POSES_SMOOTH

PLACE, TURN = NUMBERS[:3], NUMBERS[3:7]
_STILL_M = 0.005
_WINDOW = 3000
"""So many frames are smoothed at once, that memory does not grow with a recording."""
_MARGIN_S = 10.0
"""What is farther away in time has no influence: the smoother's memory is a few tenths of a second."""


@dataclass(frozen=True)
class SmoothParameters:
    """``max_gap_s``: a longer time without any observation is not bridged, and separates what is smoothed
    together; ``place`` in metres and ``turn`` in radians, per second squared; ``speed``, ``spin``: how fast things
    usually are (m/s, rad/s), by which time decides between two poses that explain a frame alike.
    """

    max_gap_s: float = 0.5
    place: Smoothness = field(default_factory=lambda: Smoothness(acceleration=0.3))
    turn: Smoothness = field(default_factory=lambda: Smoothness(acceleration=3.0))
    speed: float = 0.3
    spin: float = 1.0


def smooth_poses(
    poses: pa.Table, parameters: SmoothParameters | None = None, *, table_plane: pa.Table | None = None
) -> pa.Table:
    """The table ``poses_smooth``: every frame uses what was observed before and after it.

    Observed frames stay ``observed``, of two poses that explain one alike (``alternative``) the one that agrees with
    the frames around it; gaps up to ``max_gap_s`` become ``interpolated``, with a covariance that grows with the
    distance from the next observation; nothing is continued beyond the first or last one.  Position and rotation are
    smoothed apart: what they have to do with each other is not in the covariance.  Without times (``t_ns`` null) frames
    count as thirtieths of a second.  Where ``table_plane`` says that the camera was moved and nothing ties the table's
    frames, what is before and after is smoothed apart.

    A recording of more than a minute or two is smoothed in overlapping windows of which the middles are kept.  That
    differs from smoothing it at once by less than a thousandth of the stated sigma.
    """
    parts = _parts(poses, table_plane, parameters or SmoothParameters())
    return pa.concat_tables([POSES_SMOOTH.arrow.empty_table(), *parts])


def _parts(poses: pa.Table, table_plane: pa.Table | None, parameters: SmoothParameters) -> Iterator[pa.Table]:
    for piece in pieces(poses.select(["frame", "object_id"]), table_plane):
        yield from _smoothed_piece(piece, poses, parameters)


@dataclass(frozen=True)
class _Noise:
    """The share of the stated covariance that averages out, and what of it (d, d) does not."""

    share: float
    steady: Floats


@dataclass(frozen=True)
class _Stretch:
    """Rows from a first to a last observation without a long gap, and the noise of places and of turns there."""

    rows: slice
    place: _Noise
    turn: _Noise


@dataclass(frozen=True)
class _Track:
    """What is to be smoothed: times (n,), places (n, 3), turns (n, 4) of one sign within each stretch."""

    name: str
    t_s: Floats
    places: Floats
    turns: Floats
    stretches: list[_Stretch]


def _smoothed_piece(piece: pa.Table, poses: pa.Table, parameters: SmoothParameters) -> Iterator[pa.Table]:
    """The rows of ``piece``, which has ``frame`` and ``object_id``."""
    objects = sorted({str(name) for name in pc.unique(piece["object_id"]).to_pylist()})
    if not objects:
        return
    frame = np.asarray(_of(objects[0], piece)["frame"].to_numpy(), np.int64)
    tracks = [_track(name, poses, frame, parameters) for name in objects]
    for window, kept in _windows(tracks[0].t_s):
        part = _between(poses, frame[window])
        smoothed = [_smoothed(track, window, _of(track.name, part), parameters) for track in tracks]
        first, last = (len(tracks) * (row - window.start) for row in (kept.start, kept.stop))
        clock = _of(tracks[0].name, part)
        yield pose_table(clock, smoothed, POSES_SMOOTH).slice(first, last - first)


def _between(poses: pa.Table, frame: NDArray[np.int64]) -> pa.Table:
    """The rows of some frames (n,), ascending."""
    return InMemory(poses).between(int(frame[0]), int(frame[-1]) + 1)


def _of(name: str, poses: pa.Table) -> pa.Table:
    return poses.filter(pc.field("object_id").cast(pa.string()) == name)


def _windows(t_s: Floats) -> Iterator[tuple[slice, slice]]:
    """Rows that are smoothed at once, and those of them that are kept: each row once, in their order."""
    n = len(t_s)
    bounds = np.linspace(0, n, max(round(n / _WINDOW), 1) + 1).astype(int)
    for start, end in pairwise(bounds.tolist()):
        # of a clock that hardly goes on, not all that is within the margin
        first = max(int(np.searchsorted(t_s, t_s[start] - _MARGIN_S)), start - _WINDOW, 0)
        stop = min(int(np.searchsorted(t_s, t_s[end - 1] + _MARGIN_S, side="right")), end + _WINDOW, n)
        yield slice(first, stop), slice(start, end)


def _seconds(track: pa.Table) -> Floats:
    if track["t_ns"].null_count:
        return track["frame"].to_numpy() / 30.0
    return track["t_ns"].to_numpy() / 1e9


def _track(name: str, poses: pa.Table, frame: NDArray[np.int64], parameters: SmoothParameters) -> _Track:
    """An object's poses in these frames, of two that explain a frame alike the one that agrees with the others."""
    table = _between(_of(name, poses.drop_columns("covariance")), frame)  # half of it, looked at by windows
    if not np.array_equal(table["frame"].to_numpy(), frame):
        raise InputError(
            "cannot smooth the poses",
            where=f"table poses: {name} has not a row for each frame that other objects have rows for",
            consequence="nothing was changed",
            fix="write a row for every frame and object, with nulls where a pose is unknown",
        )
    t_s = _seconds(table)
    sigma_m, sigma_rad = (_column(table, key) for key in ("sigma_m", "sigma_rad"))
    places, turns = (np.stack([_column(table, key) for key in keys], 1) for keys in (PLACE, TURN))
    _decide(t_s, (places, turns), sigma_rad, _lists(table, "alternative"), parameters)
    observed = _observed(table)
    del table
    stretches: list[_Stretch] = []
    for rows in _stretches(t_s, observed, parameters.max_gap_s):
        rest = _rests(t_s[rows], places[rows], sigma_m[rows])
        turns[rows] = _same_sign(turns[rows])
        by_place, by_turn = _covariances(name, poses, frame[rows], turns[rows])
        place = _noise(places[rows], by_place, rest)
        stretches.append(_Stretch(rows, place, _noise(turns[rows], by_turn, rest)))
    return _Track(name, t_s, places, turns, stretches)


def _smoothed(track: _Track, window: slice, table: pa.Table, parameters: SmoothParameters) -> ObjectPoses:
    """The track in a window, ``table`` being its rows there."""
    t_s, places, turns = track.t_s[window], track.places[window].copy(), track.turns[window].copy()
    numbers = {key: _column(table, key) for key in NUMBERS}
    observed = _observed(table)
    free = np.array([support == "free" for support in table["support"].to_pylist()], bool)
    n_faces = np.where(observed, np.nan_to_num(_column(table, "n_faces")), 0)
    source = observed.astype(np.int64)
    covariance = pose_covariances(table)
    spread = np.full(covariance.shape, np.nan)
    for stretch in track.stretches:
        start, stop = max(stretch.rows.start, window.start), min(stretch.rows.stop, window.stop)
        if start >= stop:
            continue
        part = slice(start - window.start, stop - window.start)
        place, spread_m = _without_scatter(
            t_s[part], places[part], covariance[part, :3, :3], stretch.place, parameters.place
        )
        by_turn = _quaternion_covariance(turns[part], covariance[part, 3:, 3:])
        turn, by_turn = _without_scatter(t_s[part], turns[part], by_turn, stretch.turn, parameters.turn)
        turn = turn / np.linalg.norm(turn, axis=1, keepdims=True)
        places[part], turns[part] = place, np.where(turn[:, 3:] < 0, -turn, turn)
        spread[part] = 0.0
        spread[part, :3, :3], spread[part, 3:, 3:] = spread_m, _turn_covariance(turn, by_turn)
        source[part] = np.where(observed[part], 1, np.where(np.isfinite(place[:, 0]), 2, 0))
        free[part] = _carried(free[part], observed[part])
    for keys, values in ((PLACE, places), (TURN, turns)):
        numbers.update(zip(keys, values.T, strict=True))
    numbers["sigma_m"] = np.sqrt(np.einsum("nii->n", spread[:, :3, :3]) / 3)
    numbers["sigma_rad"] = np.sqrt(np.einsum("nii->n", spread[:, 3:, 3:]) / 3)
    lists = {"covariance": spread[:, UPPER[0], UPPER[1]], "alternative": np.full((len(t_s), 7), np.nan)}
    return ObjectPoses(track.name, numbers, lists, source, free, n_faces.astype(np.int64))


def _covariances(
    name: str, poses: pa.Table, frame: NDArray[np.int64], turns: Floats
) -> tuple[Floats, Floats]:
    """Of an object's places (n, 3, 3), and of its turns (n, 4) as quaternions (n, 4, 4); whole ones (n, 6, 6) only of
    some frames at a time.
    """
    places, by_turn = np.empty((len(turns), 3, 3)), np.empty((len(turns), 4, 4))
    for start in range(0, len(turns), _WINDOW):
        rows = slice(start, start + _WINDOW)
        covariance = pose_covariances(_of(name, _between(poses, frame[rows])))
        places[rows] = covariance[:, :3, :3]
        by_turn[rows] = _quaternion_covariance(turns[rows], covariance[:, 3:, 3:])
    return places, by_turn


def _observed(table: pa.Table) -> NDArray[np.bool_]:
    return np.array([source == "observed" for source in table["source"].to_pylist()], bool)


def _rests(t_s: Floats, places: Floats, sigma_m: Floats) -> NDArray[np.int64]:
    """The number (n,) of the rest that a row belongs to, -1 if it is seen on its way or not at all."""
    rest = np.full(len(t_s), -1)
    seen = np.flatnonzero(known(places) & np.isfinite(sigma_m))
    for number, found in enumerate(find_rests(t_s[seen], places[seen], sigma_m[seen], Stillness())):
        rest[seen[found.first : found.last + 1]] = number
    return rest


def _noise(values: Floats, covariance: Floats, rest: NDArray[np.int64]) -> _Noise:
    """How much the values (n, d) scatter, of what their covariance (n, d, d) says."""
    share = random_share(values, covariance, rest)
    measured = covariance[np.isfinite(covariance).all((1, 2))]
    return _Noise(share, (1 - share) * np.median(measured, axis=0))


def _without_scatter(
    t_s: Floats, values: Floats, covariance: Floats, noise: _Noise, smoothness: Smoothness
) -> tuple[Floats, Floats]:
    """Smoothed by as much as the values scatter; errors that stay the same remain in the covariance."""
    track, spread = smooth_track(t_s, values, noise.share * covariance, smoothness)
    return track, spread + noise.steady


def _column(track: pa.Table, name: str) -> Floats:
    return np.array(track[name].to_numpy(zero_copy_only=False), float)


def _lists(track: pa.Table, name: str) -> Floats:
    """A column of lists as (n, k), NaN where null."""
    known = track.filter(pc.is_valid(track[name]))[name].combine_chunks()
    values = np.full((track.num_rows, LISTS[name]), np.nan)
    flat = pc.list_flatten(known).to_numpy(zero_copy_only=False)
    values[track[name].is_valid().to_numpy()] = flat.reshape(-1, LISTS[name])
    return values


def pose_covariances(poses: pa.Table) -> Floats:
    """The covariances (n, 6, 6) of a table of poses, NaN where unknown; where only ``sigma_m`` and ``sigma_rad`` are
    known, those of errors alike along all axes.
    """
    found = np.full((poses.num_rows, 6, 6), np.nan)
    listed = _lists(poses, "covariance")
    found[:, UPPER[0], UPPER[1]] = listed
    found[:, UPPER[1], UPPER[0]] = listed
    sigma = np.stack([_column(poses, name) for name in ("sigma_m", "sigma_rad")], 1).repeat(3, axis=1)
    plain = np.isnan(listed).any(1) & np.isfinite(sigma).all(1)
    found[plain] = sigma[plain, :, None] ** 2 * np.eye(6)
    return found


def _decide(
    t_s: Floats, track: tuple[Floats, Floats], sigma: Floats, other: Floats, parameters: SmoothParameters
) -> None:
    """Put the alternative in the pose's stead wherever the whole track is smoother so (Viterbi's algorithm)."""
    places, turns = track
    rows = np.flatnonzero(known(turns))
    if not np.isfinite(other[rows]).any():
        return
    states = np.stack([np.concatenate([places, turns], 1), other], 1)[rows]
    there, price = known(states), np.array([0.0, 1.0])
    total = np.where(there[0], price, np.inf)
    came: list[NDArray[np.intp]] = []
    for i in range(1, len(rows)):
        span = min(t_s[rows[i]] - t_s[rows[i - 1]], parameters.max_gap_s)
        far = np.linalg.norm(states[i, None, :, :3] - states[i - 1, :, None, :3], axis=-1)
        turned = quaternion_angle(states[i - 1, :, None, 3:], states[i, None, :, 3:])
        doubt = float(np.nan_to_num(np.hypot(sigma[rows[i]], sigma[rows[i - 1]])))
        step = (far / (_STILL_M + parameters.speed * span)) ** 2 + (
            turned / (doubt + parameters.spin * span)
        ) ** 2
        reached = total[:, None] + np.log1p(np.nan_to_num(step))
        came.append(reached.argmin(0))
        total = np.where(there[i], reached.min(0) + price, np.inf)
    state = int(total.argmin())
    for i in range(len(rows) - 1, -1, -1):
        places[rows[i]], turns[rows[i]] = states[i, state, :3], states[i, state, 3:]
        state = int(came[i - 1][state]) if i else state


def _left(turn: Floats) -> Floats:
    """(n, 4, 3): the quaternion changes by half of this times a small turn about the frame's axes."""
    vector, scalar = turn[:, :3], turn[:, 3]
    return np.concatenate([scalar[:, None, None] * np.eye(3) - skew(vector), -vector[:, None]], 1)


def _quaternion_covariance(turn: Floats, covariance: Floats) -> Floats:
    """Of quaternions (n, 4), whose length is as uncertain as the turn on average: covariances (n, 4, 4)."""
    by_turn = _left(turn)
    length = np.einsum("nii->n", covariance)[:, None, None] / 12 * turn[:, :, None] * turn[:, None]
    return by_turn @ covariance @ np.swapaxes(by_turn, 1, 2) / 4 + length


def _turn_covariance(turn: Floats, covariance: Floats) -> Floats:
    """Covariances (n, 3, 3) of turns, of those (n, 4, 4) of quaternions."""
    by_turn = _left(turn)
    return 4 * np.swapaxes(by_turn, 1, 2) @ covariance @ by_turn


def _stretches(t_s: Floats, observed: NDArray[np.bool_], max_gap_s: float) -> Iterator[slice]:
    """From a first to a last observation without a longer gap in between."""
    rows = np.flatnonzero(observed)
    if not rows.size:
        return
    breaks = np.flatnonzero(np.diff(t_s[rows]) > max_gap_s)
    starts, ends = np.r_[0, breaks + 1], np.r_[breaks, len(rows) - 1]
    for start, end in zip(starts, ends, strict=True):
        yield slice(int(rows[start]), int(rows[end]) + 1)


def _same_sign(turn: Floats) -> Floats:
    """Quaternions (n, 4) with signs such that neighbours are near each other; NaN rows stay."""
    rows = np.flatnonzero(np.isfinite(turn).all(1))
    flips = np.sign((turn[rows][1:] * turn[rows][:-1]).sum(1))
    out = turn.copy()
    out[rows[1:]] *= np.cumprod(np.where(flips == 0, 1.0, flips))[:, None]
    return out


def _carried(free: NDArray[np.bool_], observed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """In a gap, a box counts as resting on the table only if it does on both sides."""
    n = len(free)
    last = np.maximum.accumulate(np.where(observed, np.arange(n), 0))
    following = np.minimum.accumulate(np.where(observed, np.arange(n), n - 1)[::-1])[::-1]
    return np.where(observed, free, free[last] | free[following])


def _run(tables: Tables, images: ImagesByKind, parameters: SmoothParameters) -> dict[str, pa.Table]:
    del images
    smoothed = smooth_poses(tables["poses"], parameters, table_plane=tables.get("table_plane"))
    return {"poses_smooth": smoothed}


def _run_parts(tables: Tables, images: ImagesByKind, parameters: SmoothParameters) -> Iterator[pa.Table]:
    del images
    return _parts(tables["poses"], tables.get("table_plane"), parameters)


SMOOTH = Stage(
    name="smooth",
    version=3,
    inputs=("poses", "table_plane"),
    outputs=("poses_smooth",),
    parameters=SmoothParameters,
    run=_run,
    parts=_run_parts,
    optional=("table_plane",),
)
