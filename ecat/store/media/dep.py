"""The images of ``.dep`` files: uncompressed Kinect depth (ECAT 2018 file format §1.5).

Little-endian: int16 width and height, N frames of uint16 millimetres (row by row, 0 = no measurement), N
uint32 times in milliseconds since the first colour frame, uint32 N. The tail was written on a clean stop
only; without it N follows from the size and the times are unknown. ECAT stored frames from unsynchronised
tasks sharing one buffer: times may be out of order, frames repeated or torn, which `DepthFile.findings` and
`frame_findings` tell.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, NotFoundError, os_error
from ecat.store import files

HEADER = struct.Struct("<2h")
COUNT = struct.Struct("<I")


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
            with files.typed_errors(self._what, path):
                self._file = stack.enter_context(files.open_regular(path))
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
            raise NotFoundError(
                self._what, where=f"frame {index} of {self._count}", fix="ask for a frame from 0 on"
            )
        data = self._read(HEADER.size + index * self._frame_bytes, self._frame_bytes)
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
        if size < HEADER.size:
            raise FormatError(self._what, where=f"{size} bytes, shorter than the header of {HEADER.size}")
        self.width, self.height = HEADER.unpack(self._read(0, HEADER.size))
        if self.width <= 0 or self.height <= 0:
            raise FormatError(self._what, where=f"the header says {self.width} x {self.height} pixels")
        self._frame_bytes = 2 * self.width * self.height
        stored = None
        if size >= HEADER.size + COUNT.size:
            (stored,) = COUNT.unpack(self._read(size - COUNT.size, COUNT.size))
        self.times_ms: NDArray[np.uint32] | None = None
        if stored is not None and size == 8 + stored * (self._frame_bytes + 4):
            self._count = stored
            tail = self._read(HEADER.size + stored * self._frame_bytes, 4 * stored)
            self.times_ms = np.frombuffer(tail, dtype="<u4").astype(np.uint32)
            self.findings = tuple(_time_findings(self.times_ms))
        else:
            self._count, rest = divmod(size - HEADER.size, self._frame_bytes)
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
