"""What several readers make of numbers: poses of a moving camera, readings of an IMU, numbers of text, wall clocks."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import EcatError
from ecat.geometry.transforms import Rigid
from ecat.store import files
from ecat.tables import CAMERA_POSES, IMU

_MAX_BYTES = 256 << 20
_MAX_TOKEN = 64
_NUMBERS_PER_POSE = 19
_BATCH = 1 << 16
_UNIT_TOLERANCE = 0.05


def numbers_of(text: bytes) -> NDArray[np.float64] | None:
    """All numbers of a text, or None where there is anything else."""
    words = text.split()
    if not words or max(map(len, words)) > _MAX_TOKEN:
        return None
    try:
        return np.array(words).astype(np.float64)
    except ValueError:
        return None


def wall_clock(t_ns: int) -> str | None:
    """ISO 8601 with microseconds of a time since 1970 (UTC); None before 2001 or from 2096 on, when it is none.

    A recorder without a wall clock counts from its own start.
    """
    if not 10**18 <= t_ns < 4 * 10**18:
        return None
    return datetime.fromtimestamp(t_ns // 1000 / 1e6, UTC).isoformat(timespec="microseconds")


def trajectory_rows(path: Path, camera: str) -> tuple[Iterator[pa.RecordBatch] | None, str]:
    """The poses in Open3D's ``.log``: three whole numbers, the first that of the image, and a 4 x 4 matrix, row by row.

    Returns
    -------
    The rows (None where the file cannot be used) and what is to be told.
    """
    try:
        numbers = numbers_of(files.read_bytes(path, _MAX_BYTES))
    except (OSError, EcatError):
        numbers = None
    if numbers is None or len(numbers) % _NUMBERS_PER_POSE:
        return None, f"{path.name} is not a trajectory that can be read; it was left out"
    poses = numbers.reshape(-1, _NUMBERS_PER_POSE)
    matrices = poses[:, 3:].reshape(-1, 4, 4)
    rotations = matrices[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        good = (error < _UNIT_TOLERANCE) & (np.linalg.det(np.nan_to_num(rotations, posinf=0, neginf=0)) > 0)
    good &= np.isfinite(matrices).all(axis=(1, 2)) & (poses[:, 0] >= 0) & (poses[:, 0] < 1 << 31)
    quaternions = np.array([_quaternion(matrix) for matrix in rotations[good]]).reshape(-1, 4)
    rows = np.hstack([matrices[good, :3, 3], quaternions])
    order = np.argsort(poses[good, 0], kind="stable")
    left_out = int((~good).sum())
    told = f"{path.name}: {left_out} poses are not rigid and were left out" if left_out else ""
    return pose_rows(None, poses[good, 0].astype(np.int32)[order], rows[order], camera), told


def _quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(Rigid(u @ v, np.zeros(3)).quaternion, np.float64)


def pose_rows(
    t_ns: NDArray[np.int64] | None, frame: NDArray[np.int32] | None, poses: NDArray[np.float64], camera: str
) -> Iterator[pa.RecordBatch]:
    """Rows of ``camera_poses``: (n,) times or frames, either unknown, and (n, 7) position and quaternion x, y, z, w."""
    for start in range(0, len(poses), _BATCH):
        part = slice(start, start + _BATCH)
        n = len(poses[part])
        yield pa.record_batch(
            [
                pa.array(t_ns[part]) if t_ns is not None else pa.nulls(n, pa.int64()),
                pa.array(frame[part]) if frame is not None else pa.nulls(n, pa.int32()),
                pa.DictionaryArray.from_arrays(
                    pa.array(np.zeros(n, np.int32), pa.int32()), pa.array([camera])
                ),
                *(pa.array(poses[part, i], from_pandas=True) for i in range(7)),
            ],
            schema=CAMERA_POSES.arrow,
        )


def imu_rows(
    t_ns: NDArray[np.int64], sensor: NDArray[np.int8], values: NDArray[np.float64]
) -> Iterator[pa.RecordBatch]:
    """Rows of ``imu``, sorted: (n,) times, (n,) 0 = accelerometer (m/s^2), 1 = gyroscope (rad/s), (n, 3) readings."""
    order = np.lexsort((sensor, t_ns))
    for start in range(0, len(order), _BATCH):
        rows = order[start : start + _BATCH]
        names = pa.DictionaryArray.from_arrays(
            pa.array(sensor[rows].astype(np.int32), pa.int32()), pa.array(["accelerometer", "gyroscope"])
        )
        columns = [
            pa.array(t_ns[rows]),
            names,
            *(pa.array(values[rows, i], from_pandas=True) for i in range(3)),
        ]
        yield pa.record_batch(columns, schema=IMU.arrow)
