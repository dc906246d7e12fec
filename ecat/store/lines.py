"""Files that only grow: one JSON object per line, on the disk before it is acknowledged.

A process that dies while it appends leaves a torn last line, which was never acknowledged: readers pass over
it, and the next append removes it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

from pydantic_core import from_json

from ecat.errors import CorruptError, LimitError, UsageError
from ecat.store import files
from ecat.store.lock import exclusive

MAX_BYTES = 1 << 30


def append_line(path: Path, data: Mapping[str, Any]) -> None:
    """Append ``data`` to the file at ``path``, which is made if it is not there.

    Raises
    ------
    UsageError : ``data`` is not JSON.
    DiskError, ReadOnlyError, LockedError : nothing was appended.
    """
    line = encoded(data, path)
    with files.typed_errors(f"cannot append to {path.name}", path, "nothing was appended"):
        files.make_folder(path.parent)
        with files.open_journal(path) as file, exclusive(file.fileno(), path):
            end = 0
            for _, behind in whole_lines(file, path, 0):
                end = behind
            append_at(file, path, end, line)
        if not end:
            files.sync(path.parent)
            files.sync(path.parent.parent)


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Every acknowledged line, oldest first; none if there is no file.

    Raises
    ------
    CorruptError : a line other than the last is not a JSON object.
    LimitError : more than a gibibyte.
    """
    if not path.exists():
        return []
    with files.typed_errors(f"cannot read {path.name}", path), files.open_regular(path) as file:
        return [line for line, _ in whole_lines(file, path, 0)]


def whole_lines(file: BinaryIO, path: Path, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
    """The lines of an open file from ``offset`` on, each with the offset behind it; errors as in :func:`read_lines`."""
    size = file.seek(0, 2)
    if size > MAX_BYTES:
        where = f"{path}: {size:,} bytes, at most {MAX_BYTES:,} are read"
        raise LimitError(f"cannot read {path.name}", where=where)
    file.seek(offset)
    torn: int | None = None
    while line := file.readline():
        if torn is not None:
            raise CorruptError(
                f"cannot read {path.name}",
                where=f"{path}: the line at byte {torn} is not a record",
                consequence="nothing was taken from it",
                fix="remove the line, or restore the file",
            )
        found = _parsed(line)
        if found is None:
            torn = offset
        else:
            yield found, offset + len(line)
        offset += len(line)


def append_at(file: BinaryIO, path: Path, end: int, data: bytes) -> None:
    """Write ``data`` at ``end``, where the whole lines end, and wait until it is on the disk.

    Raises
    ------
    LimitError : the file would become longer than can be read again.
    """
    if end + len(data) > MAX_BYTES:
        raise LimitError(
            f"cannot append to {path.name}",
            where=f"{path}: {end:,} bytes, and {len(data):,} more; at most {MAX_BYTES:,} can be read again",
            consequence="nothing was appended",
            fix="move the file to another folder; for a journal, ecat check --repair then begins a new one",
        )
    try:
        if file.seek(0, 2) != end:
            file.truncate(end)
            file.seek(end)
        files.append(file, path, data)
    except OSError:
        file.truncate(end)
        raise


def encoded(data: Mapping[str, Any], path: Path) -> bytes:
    """The line of ``data``.

    Raises
    ------
    UsageError : it is not JSON.
    """
    try:
        text = json.dumps(dict(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        return text.encode() + b"\n"
    except (TypeError, ValueError) as error:
        fix = "give what JSON can hold"
        raise UsageError(f"cannot append to {path.name}", where=f"not JSON: {error}", fix=fix) from None


def _parsed(line: bytes) -> dict[str, Any] | None:
    if not line.endswith(b"\n"):
        return None
    try:
        found = from_json(line)
    except ValueError:
        return None
    return cast("dict[str, Any]", found) if isinstance(found, dict) else None
