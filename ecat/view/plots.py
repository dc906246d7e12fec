"""Curves over time that tell how good the poses are, and how fast the boxes move."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ecat.geometry.transforms import Floats
from ecat.view.scene import (
    Frames,
    Scene,
    Thing,
    by_object,
    entity_part,
    integers,
    numbers,
    rows_per_frame,
    static,
    temporal,
    texts,
)

if TYPE_CHECKING:
    from rerun.chunk import Chunk

QUALITY = "/quality"
IMU = "/imu"
"""What an inertial sensor measured, as ``/imu/<sensor>/<axis>``."""
_AXES = {"x": (255, 92, 92), "y": (92, 224, 122), "z": (92, 156, 255)}
METRICS = ("speed_m_per_s", "residual_px", "sigma_mm", "n_faces")
"""What is plotted, each below ``/quality/<metric>/<object>``."""


def speed(position: Floats, t_s: Floats) -> Floats:
    """Speed (rows,) in m/s at positions (rows, 3), metres, taken at times (rows,), seconds.

    Central differences over the neighbouring rows; NaN at the ends and next to a missing position.
    """
    v = np.full(len(position), np.nan)
    if len(position) > 2:
        v[1:-1] = np.linalg.norm(position[2:] - position[:-2], axis=1) / (t_s[2:] - t_s[:-2])
    return v


def quality(poses: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """How good the poses of table ``poses`` are; a frame without a value leaves a gap."""
    for object_id, rows in by_object(poses):
        frames = integers(rows, "frame")
        residual, faces, sigma = numbers(rows, "residual_px n_faces sigma_m").T
        for metric, values in (("residual_px", residual), ("n_faces", faces), ("sigma_mm", sigma * 1000)):
            yield from curve(metric, scene.thing(object_id), scene, frames, values)


def speeds(poses: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """How fast the boxes of table ``poses`` or ``poses_smooth`` are; nothing without a clock."""
    timebase = scene.timebase
    if timebase.t_ns is None:
        return
    t_s = timebase.t_ns[: timebase.n_frames].astype(np.float64) / 1e9
    for object_id, rows in by_object(poses):
        at = integers(rows, "frame")
        inside = (at >= 0) & (at < timebase.n_frames)
        frames = at[inside]
        # missing frames must not be bridged, so the rows are spread over every frame first
        everywhere = np.full((timebase.n_frames, 3), np.nan)
        everywhere[frames] = numbers(rows, "x y z")[inside]
        yield from curve(
            "speed_m_per_s", scene.thing(object_id), scene, frames, speed(everywhere, t_s)[frames]
        )


def curve(metric: str, thing: Thing, scene: Scene, frames: Frames, values: Floats) -> Iterator[Chunk]:
    """One object's curve with its name and colour; nothing at all where there is no value."""
    import rerun as rr

    known = np.isfinite(values)
    if not known.any():
        return
    path = f"{QUALITY}/{metric}/{thing.part}"
    yield static(path, rr.SeriesLines(names=[thing.name], colors=[thing.color], widths=[1.2]))
    at, counts = rows_per_frame(frames[known], scene.timebase.n_frames)
    yield temporal(path, scene.timebase, at, rr.Scalars.columns(scalars=values[known]).partition(counts))


def inertial(imu: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Table ``imu``: a curve for each sensor and axis, at its own times; nothing without a clock."""
    import rerun as rr

    if scene.timebase.t_ns is None:
        return
    sensors = texts(imu, "sensor")
    for sensor in np.unique(sensors):
        rows = imu.filter(pa.array(sensors == sensor))
        t_ns = integers(rows, "t_ns")
        for axis, color in _AXES.items():
            values = numbers(rows, axis)[:, 0]
            known = np.isfinite(values)
            if not known.any():
                continue
            path = f"{IMU}/{entity_part(str(sensor))}/{axis}"
            # a single reading makes no line
            style = rr.SeriesLines(names=[axis], colors=[color], widths=[1.0])
            if known.sum() == 1:
                style = rr.SeriesPoints(names=[axis], colors=[color], marker_sizes=[4.0])
            yield static(path, style)
            scalars, at = rr.Scalars.columns(scalars=values[known]), t_ns[known]
            yield temporal(path, scene.timebase, scene.timebase.frames_at(at), scalars, at)
