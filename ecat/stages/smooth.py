"""Smoothed poses: less noise, no lag, short gaps filled, long ones left open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.smoothing import Smoothness, smooth_track
from ecat.geometry.transforms import Floats
from ecat.stages.pose import NUMBERS, ObjectPoses, pose_table
from ecat.stages.stage import Stage, Tables
from ecat.tables import POSES_SMOOTH

PLACE, TURN = NUMBERS[:3], NUMBERS[3:7]


@dataclass(frozen=True)
class SmoothParameters:
    """``max_gap_s``: a longer time without any observation is not bridged, and separates what is smoothed
    together; ``place`` in metres and ``turn`` in radians, per second squared.
    """

    max_gap_s: float = 0.5
    place: Smoothness = field(default_factory=lambda: Smoothness(acceleration=0.3))
    turn: Smoothness = field(default_factory=lambda: Smoothness(acceleration=3.0))


def smooth_poses(poses: pa.Table, parameters: SmoothParameters | None = None) -> pa.Table:
    """The table ``poses_smooth``: every frame uses what was observed before and after it.

    Observed frames stay ``observed``; gaps up to ``max_gap_s`` become ``interpolated``, with standard
    deviations that grow with the distance from the next observation; nothing is continued beyond the first
    or last one. Without times (``t_ns`` null) frames count as thirtieths of a second.
    """
    parameters = parameters or SmoothParameters()
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
    numbers = {key: np.array(track[key].to_numpy(zero_copy_only=False), float) for key in NUMBERS}
    observed = np.array([source == "observed" for source in track["source"].to_pylist()], bool)
    free = np.array([support == "free" for support in track["support"].to_pylist()], bool)
    n_faces = np.where(
        observed, np.nan_to_num(np.array(track["n_faces"].to_numpy(zero_copy_only=False), float)), 0
    )
    source = observed.astype(np.int64)
    for part in _stretches(t_s, observed, parameters.max_gap_s):
        place = np.stack([numbers[key][part] for key in PLACE], 1)
        turn = _same_sign(np.stack([numbers[key][part] for key in TURN], 1))
        place, sigma_m = smooth_track(t_s[part], place, numbers["sigma_m"][part], parameters.place)
        # a quaternion's components change by half the angle
        turn, sigma_half = smooth_track(t_s[part], turn, numbers["sigma_rad"][part] / 2, parameters.turn)
        turn = turn / np.linalg.norm(turn, axis=1, keepdims=True)
        turn = np.where(turn[:, 3:] < 0, -turn, turn)
        for keys, values in ((PLACE, place), (TURN, turn)):
            for key, column in zip(keys, values.T, strict=True):
                numbers[key][part] = column
        numbers["sigma_m"][part], numbers["sigma_rad"][part] = sigma_m, 2 * sigma_half
        source[part] = np.where(observed[part], 1, np.where(np.isfinite(place[:, 0]), 2, 0))
        free[part] = _carried(free[part], observed[part])
    return ObjectPoses(name, numbers, source, free, n_faces.astype(np.int64))


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


def _run(tables: Tables, parameters: SmoothParameters) -> dict[str, pa.Table]:
    return {"poses_smooth": smooth_poses(tables["poses"], parameters)}


SMOOTH = Stage(
    name="smooth",
    version=1,
    inputs=("poses",),
    outputs=("poses_smooth",),
    parameters=SmoothParameters,
    run=_run,
)
