"""``depth_<stamp>.dep``: uncompressed Kinect depth (§1.5), written; :mod:`ecat.store.media.dep` reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.store import staged_file
from ecat.store.media.dep import COUNT, HEADER, DepthFile

__all__ = ["DepthFile", "write_depth_file"]


def write_depth_file(path: Path, frames: Iterable[tuple[int, NDArray[np.uint16]]]) -> None:
    """Write a depth file from (time in ms, uint16[height, width] mm) pairs, one frame in memory at a time.

    The file appears under its name only when it is complete.

    Raises
    ------
    UsageError : no frame, frames of different sizes, not uint16, or a time outside uint32.
    ExistsError : ``path`` exists.
    StoreError : the disk.
    """
    with staged_file(path) as staging, staging.open("wb") as file:
        for piece in _pieces(frames, f"cannot write {path}"):
            file.write(piece)


def _pieces(frames: Iterable[tuple[int, NDArray[np.uint16]]], what: str) -> Iterator[bytes]:
    shape: tuple[int, ...] = ()
    times: list[int] = []
    for time_ms, frame in frames:
        if not times:
            shape = frame.shape
            if len(shape) != 2 or not all(0 < side < 1 << 15 for side in shape):
                raise UsageError(
                    what, where=f"frames of shape {shape}", fix="give frames of shape (height, width)"
                )
            yield HEADER.pack(shape[1], shape[0])
        if frame.shape != shape or frame.dtype != np.uint16 or not 0 <= time_ms < 1 << 32:
            raise UsageError(
                what,
                where=f"frame {len(times)}: {frame.dtype}{list(frame.shape)} at {time_ms} ms, "
                f"expected uint16{list(shape)} at an unsigned 32-bit time",
                fix="give images of one size, and milliseconds",
            )
        times.append(time_ms)
        yield frame.astype("<u2").tobytes()
    if not times:
        raise UsageError(what, where="no frame, so no size of the image", fix="give at least one frame")
    yield np.array(times, dtype="<u4").tobytes() + COUNT.pack(len(times))
