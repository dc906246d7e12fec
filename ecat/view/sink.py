"""Where a recording's bytes go: through a pipe to a file that Python writes.

Rerun's own file and standard-output sinks log a failed write (disk full, reader gone) and then wait for ever.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from threading import Thread
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from rerun import RecordingStream

_BLOCK = 1 << 20


@contextmanager
def written_to(out: BinaryIO, stream: RecordingStream) -> Generator[None]:
    """What is sent to ``stream`` inside the block is in ``out`` when it ends; the stream is closed.

    Raises
    ------
    OSError : a write failed; what was sent after it was dropped.
    """
    readable, writable = os.pipe()
    errors: list[OSError] = []

    def copy() -> None:
        while data := os.read(readable, _BLOCK):
            try:
                if not errors:
                    out.write(data)
            except OSError as error:
                # keep reading: a full pipe would stop the stream, and this process with it
                errors.append(error)
        os.close(readable)

    copier = Thread(target=copy, name="rerun sink", daemon=True)
    copier.start()
    try:
        stream.save(f"/dev/fd/{writable}")
    finally:
        os.close(writable)
    try:
        yield
        stream.flush()
    finally:
        stream.disconnect()
        copier.join()
    if errors:
        raise errors[0]
    out.flush()
