"""Smoothed poses: less noise, no lag, short gaps filled, long ones left open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.rest import Stillness, find_rests
from ecat.geometry.smoothing import Smoothness, random_share, smooth_track
from ecat.geometry.transforms import Floats, known, quaternion_angle, skew
from ecat.stages.images import ImagesByKind
from ecat.stages.pose import LISTS, NUMBERS, UPPER, ObjectPoses, pose_table
from ecat.stages.stage import Stage, Tables
from ecat.stages.tie import pieces
from ecat.tables import POSES_SMOOTH

PLACE, TURN = NUMBERS[:3], NUMBERS[3:7]
_STILL_M = 0.005
_WINDOW = 9000
"""So many frames are smoothed together, and the noise measured in them: memory does not grow with a recording."""
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

    A recording of more than some minutes is smoothed in overlapping windows of which the middles are kept: with the same
    noise all along, places and sigmas are those of smoothing it at once to within a tenth of the stated sigma.
    """
    parameters = parameters or SmoothParameters()
    windows = (window for part in pieces(poses, table_plane) for window in _windows(part))
    return pa.concat_tables(
        [_smoothed_piece(window.poses, parameters).slice(window.first, window.rows) for window in windows]
    )


@dataclass(frozen=True)
class _Window:
    """Consecutive rows of a table of poses; of what comes of them, ``rows`` from ``first`` on are kept."""

    poses: pa.Table
    first: int
    rows: int


def _windows(poses: pa.Table) -> Iterator[_Window]:
    """Stretches of about ``_WINDOW`` frames, all objects in them, with ``_MARGIN_S`` of what is around them."""
    frames, row = np.unique(poses["frame"].to_numpy(), return_index=True)
    row = np.append(row, poses.num_rows)
    t_s = _seconds(poses)[row[:-1]]
    bounds = np.linspace(0, len(frames), max(round(len(frames) / _WINDOW), 1) + 1).astype(int)
    for start, end in pairwise(bounds.tolist()):
        # of a clock that hardly goes on, no more than this
        low, high = max(start - _WINDOW, 0), min(end + _WINDOW, len(frames))
        if len(bounds) > 2:
            low = max(low, int(np.searchsorted(t_s, t_s[start] - _MARGIN_S)))
            high = min(high, int(np.searchsorted(t_s, t_s[end - 1] + _MARGIN_S, side="right")))
        part = poses.slice(row[low], row[high] - row[low])
        yield _Window(part, row[start] - row[low], row[end] - row[start])


def _smoothed_piece(poses: pa.Table, parameters: SmoothParameters) -> pa.Table:
    objects = sorted({str(name) for name in poses["object_id"].to_pylist()})
    tracks = [poses.filter(pc.field("object_id").cast(pa.string()) == name) for name in objects]
    clock = tracks[0] if tracks else poses
    smoothed = [_smoothed(name, track, parameters) for name, track in zip(objects, tracks, strict=True)]
    return pose_table(clock, smoothed, POSES_SMOOTH)


def _seconds(track: pa.Table) -> Floats:
    if track["t_ns"].null_count:
        return track["frame"].to_numpy() / 30.0
    return track["t_ns"].to_numpy() / 1e9


def _smoothed(name: str, track: pa.Table, parameters: SmoothParameters) -> ObjectPoses:
    t_s = _seconds(track)
    numbers = {key: _column(track, key) for key in NUMBERS}
    observed = np.array([source == "observed" for source in track["source"].to_pylist()], bool)
    free = np.array([support == "free" for support in track["support"].to_pylist()], bool)
    n_faces = np.where(observed, np.nan_to_num(_column(track, "n_faces")), 0)
    source = observed.astype(np.int64)
    places, turns = (np.stack([numbers[key] for key in keys], 1) for keys in (PLACE, TURN))
    covariance = pose_covariances(track)
    _decide(t_s, (places, turns), numbers["sigma_rad"], _lists(track, "alternative"), parameters)
    spread = np.full(covariance.shape, np.nan)
    for part in _stretches(t_s, observed, parameters.max_gap_s):
        rest = _rests(t_s[part], places[part], numbers["sigma_m"][part])
        place, spread_m = _without_scatter(
            t_s[part], places[part], covariance[part, :3, :3], rest, parameters.place
        )
        turn = _same_sign(turns[part])
        by_turn = _quaternion_covariance(turn, covariance[part, 3:, 3:])
        turn, by_turn = _without_scatter(t_s[part], turn, by_turn, rest, parameters.turn)
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
    return ObjectPoses(name, numbers, lists, source, free, n_faces.astype(np.int64))


def _rests(t_s: Floats, places: Floats, sigma_m: Floats) -> NDArray[np.int64]:
    """The number (n,) of the rest that a row belongs to, -1 if it is seen on its way or not at all."""
    rest = np.full(len(t_s), -1)
    seen = np.flatnonzero(known(places) & np.isfinite(sigma_m))
    for number, found in enumerate(find_rests(t_s[seen], places[seen], sigma_m[seen], Stillness())):
        rest[seen[found.first : found.last + 1]] = number
    return rest


def _without_scatter(
    t_s: Floats, values: Floats, covariance: Floats, rest: NDArray[np.int64], smoothness: Smoothness
) -> tuple[Floats, Floats]:
    """Smoothed by as much as the values scatter; errors that stay the same remain in the covariance."""
    share = random_share(values, covariance, rest)
    track, spread = smooth_track(t_s, values, share * covariance, smoothness)
    measured = covariance[np.isfinite(covariance).all((1, 2))]
    return track, spread + (1 - share) * np.median(measured, axis=0)


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


SMOOTH = Stage(
    name="smooth",
    version=3,
    inputs=("poses", "table_plane"),
    outputs=("poses_smooth",),
    parameters=SmoothParameters,
    run=_run,
    optional=("table_plane",),
)
