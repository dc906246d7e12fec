"""Rows that wait on the disk while more of them are made, so that a table need not fit into memory."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import ExitStack, contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from ecat.store import files


@contextmanager
def set_aside(parts: Iterable[pa.Table], folder: Path, what: str) -> Generator[Iterable[pa.RecordBatch]]:
    """The rows of all ``parts``, which are made now, to be read within the block, once.

    A single part stays in memory.  More go to a scratch file in ``folder``.

    Raises
    ------
    DiskError : the file cannot be written, as ``what`` says.
    """
    coming = iter(parts)
    first, second = next(coming, None), next(coming, None)
    if first is None or second is None:
        yield [] if first is None else first.to_batches()
        return
    with files.typed_errors(what, folder, "nothing was changed"):
        file = files.scratch_file(folder)
    try:
        _write(file, chain((first, second), coming), folder, what)
        source: Any = file
        with pa.ipc.open_stream(source) as rows:
            yield rows
    finally:
        with suppress(OSError):  # what could not be written is of no use any more
            file.close()


def _write(file: BinaryIO, parts: Iterable[pa.Table], folder: Path, what: str) -> None:
    """Write them, and go back to the beginning."""
    sink: Any = file
    with ExitStack() as opened:
        writer: pa.RecordBatchStreamWriter | None = None
        for part in parts:
            with files.typed_errors(what, folder, "nothing was changed"):
                writer = writer or opened.enter_context(pa.ipc.new_stream(sink, part.schema))
                writer.write_table(part)
        with files.typed_errors(what, folder, "nothing was changed"):
            opened.close()
            file.seek(0)
