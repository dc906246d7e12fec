"""``depth_<stamp>.dep``: uncompressed Kinect depth (§1.5).

Little-endian: int16 width and height, N frames of uint16 millimetres (row by row, 0 = no measurement), N
uint32 times in milliseconds since the first colour frame, uint32 N. The tail was written on a clean stop
only; without it N follows from the size and the times are unknown. ECAT stored frames from unsynchronised
tasks sharing one buffer: times may be out of order, frames repeated or torn, which `DepthFile.findings` and
`frame_findings` tell.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, NotFoundError, UsageError, os_error
from ecat.formats.ecat2018.xml_input import open_input
from ecat.store import staged_file

_HEADER = struct.Struct("<2h")
_COUNT = struct.Struct("<I")


class DepthFile:
    """An open depth file; frames are read when asked for, at any offset.

    Use it as a context manager. ``len()`` is the number of complete frames.

    Attributes
    ----------
    width, height : pixels.
    times_ms : uint32[n], or None when the recording stopped before it wrote them.
    findings : what is wrong with the file as a whole, one sentence each.

    Raises
    ------
    FormatError : not a depth file (the size of the image is not positive), or not even a header.
    StoreError : the file cannot be opened or read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._what = f"cannot read {path}"
        with ExitStack() as stack:
            self._file = stack.enter_context(open_input(path, self._what))
            self._read_layout()
            self._stack = stack.pop_all()

    def __enter__(self) -> DepthFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[NDArray[np.uint16]]:
        return (self.frame(i) for i in range(self._count))

    def frame(self, index: int) -> NDArray[np.uint16]:
        """Frame ``index`` (zero-based) as uint16[height, width] millimetres, 0 = no measurement."""
        if not 0 <= index < self._count:
            raise NotFoundError(self._what, where=f"frame {index} of {self._count}")
        data = self._read(_HEADER.size + index * self._frame_bytes, self._frame_bytes)
        return np.frombuffer(data, dtype="<u2").astype(np.uint16).reshape(self.height, self.width)

    def frame_findings(self) -> Iterator[str]:
        """Read every frame and tell those that repeat the one before, in whole or (torn) in some rows.

        Sensor noise makes a measured row never the same twice, so equal rows were copied from a shared
        buffer.
        """
        before = None
        for i, frame in enumerate(self):
            if before is not None:
                measured = frame.any(axis=1)
                same = measured & (frame == before).all(axis=1)
                if measured.any() and (same == measured).all():
                    yield f"frame {i} repeats frame {i - 1}"
                elif same.any():
                    yield f"frame {i} is torn: {int(same.sum())} of its rows are those of frame {i - 1}"
            before = frame

    def _read_layout(self) -> None:
        size = self._size()
        if size < _HEADER.size:
            raise FormatError(self._what, where=f"{size} bytes, shorter than the header of {_HEADER.size}")
        self.width, self.height = _HEADER.unpack(self._read(0, _HEADER.size))
        if self.width <= 0 or self.height <= 0:
            raise FormatError(self._what, where=f"the header says {self.width} x {self.height} pixels")
        self._frame_bytes = 2 * self.width * self.height
        stored = None
        if size >= _HEADER.size + _COUNT.size:
            (stored,) = _COUNT.unpack(self._read(size - _COUNT.size, _COUNT.size))
        self.times_ms: NDArray[np.uint32] | None = None
        if stored is not None and size == 8 + stored * (self._frame_bytes + 4):
            self._count = stored
            tail = self._read(_HEADER.size + stored * self._frame_bytes, 4 * stored)
            self.times_ms = np.frombuffer(tail, dtype="<u4").astype(np.uint32)
            self.findings = tuple(_time_findings(self.times_ms))
        else:
            self._count, rest = divmod(size - _HEADER.size, self._frame_bytes)
            left = f"{self._count} complete frames, {rest} bytes left over, no times"
            self.findings = (f"the recording was not closed: {left}",)

    def _size(self) -> int:
        try:
            return os.fstat(self._file.fileno()).st_size
        except OSError as error:
            raise os_error(error, self._what, self._path) from error

    def _read(self, offset: int, count: int) -> bytes:
        try:
            self._file.seek(offset)
            data = self._file.read(count)
        except OSError as error:
            raise os_error(error, self._what, self._path) from error
        if len(data) < count:
            raise FormatError(self._what, where=f"byte {offset}: the file became shorter while it was read")
        return data


def _time_findings(times_ms: NDArray[np.uint32]) -> Iterator[str]:
    steps = np.diff(times_ms.astype(np.int64))
    for wrong, told in ((steps < 0, "is earlier than"), (steps == 0, "has the time of")):
        if wrong.any():
            first = int(wrong.argmax()) + 1
            yield f"frame {first} {told} frame {first - 1}; {int(wrong.sum())} such times"


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
                raise UsageError(what, where=f"frames of shape {shape}, expected (height, width)")
            yield _HEADER.pack(shape[1], shape[0])
        if frame.shape != shape or frame.dtype != np.uint16 or not 0 <= time_ms < 1 << 32:
            raise UsageError(
                what,
                where=f"frame {len(times)}: {frame.dtype}{list(frame.shape)} at {time_ms} ms, "
                f"expected uint16{list(shape)} at an unsigned 32-bit time",
            )
        times.append(time_ms)
        yield frame.astype("<u2").tobytes()
    if not times:
        raise UsageError(what, where="there is no frame, so the size of the image is unknown")
    yield np.array(times, dtype="<u4").tobytes() + _COUNT.pack(len(times))
