"""The journal of a layer: one line of JSON per operation, on the disk before it is acknowledged.
 A process that dies while it appends leaves a torn last line, which was never acknowledged: readers pass over
it, and the next append removes it.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

from pydantic_core import from_json

from ecat.errors import CorruptError, NotFoundError, UsageError
from ecat.store import files
from ecat.store.lock import exclusive
from ecat.store.manifest import is_file_name
from ecat.store.session import Session

_BLOCK = 1 << 16
MAX_BYTES = 1 << 30


def append_journal(session: Session, layer: str, record: Mapping[str, object]) -> None:
    """Append ``record`` to the journal of ``layer``; when this returns, it is on the disk.

    Raises
    ------
    UsageError : ``record`` is not JSON, or ``layer`` is not a name.
    DiskError, ReadOnlyError : nothing was appended.
    """
    path = _path(session, layer)
    try:
        line = (
            json.dumps(dict(record), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
            + b"\n"
        )
    except (TypeError, ValueError) as error:
        fix = "give what JSON can hold"
        raise UsageError(f"cannot append to {path.name}", where=f"not JSON: {error}", fix=fix) from None
    with files.typed_errors(f"cannot append to {path.name}", path, "nothing was appended"):
        files.make_folder(path.parent)
        is_new = not path.exists()
        _append(path, line)
        if is_new:
            files.sync(path.parent)
            files.sync(session.path)


def read_journal(session: Session, layer: str) -> list[dict[str, Any]]:
    """Every acknowledged record of the journal of ``layer``, oldest first; empty if there is no journal.

    Raises
    ------
    CorruptError : a line other than the last is not a record.
    LimitError : more than a gibibyte.
    """
    path = _path(session, layer)
    try:
        with files.typed_errors(f"cannot read {path.name}", path):
            data = files.read_bytes(path, MAX_BYTES)
    except NotFoundError:
        return []
    records = [_record(line) for line in io.BytesIO(data)]
    if None in records[:-1]:
        raise CorruptError(
            f"cannot read {path.name}",
            where=f"{path}: line {records.index(None) + 1} is not a record",
            consequence="the annotation itself is unaffected",
            fix="remove the line, or restore the file",
        )
    return [record for record in records if record is not None]


def _path(session: Session, layer: str) -> Path:
    if not is_file_name(layer):
        fix = "take letters, digits, '_', '-', '.' and spaces"
        raise UsageError(f"cannot use the journal of layer {layer!r}", where="not a layer's name", fix=fix)
    return files.confined(session.path, f"annotations/{layer}.journal.jsonl")


def _append(path: Path, line: bytes) -> None:
    with files.open_journal(path) as file, exclusive(file.fileno(), path):
        end = _end_of_whole_lines(file)
        try:
            file.truncate(end)
            file.seek(end)
            files.append(file, path, line)
        except OSError:
            file.truncate(end)
            raise


def _end_of_whole_lines(file: BinaryIO) -> int:
    size = file.seek(0, os.SEEK_END)
    block = _BLOCK
    while True:
        start = max(0, size - block)
        file.seek(start)
        tail = file.read(size - start)
        # the last line begins after the line break before its own
        begin = tail.rfind(b"\n", 0, max(len(tail) - 1, 0)) + 1
        if begin or not start:
            break
        block *= 2
    return size if not tail or _record(tail[begin:]) is not None else start + begin


def _record(line: bytes) -> dict[str, Any] | None:
    if not line.endswith(b"\n"):
        return None
    try:
        record = from_json(line)
    except ValueError:
        return None
    return cast("dict[str, Any]", record) if isinstance(record, dict) else None
