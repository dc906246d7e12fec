"""Whether the end of a media file was cut off, told by the sizes that its outermost parts declare.

Matroska (RFC 8794, RFC 9559), RIFF (AVI) and ISO base media (MP4, MOV; ISO/IEC 14496-12) are all a row of parts that
each say how long they are.  Players go on silently where such a file ends too early.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

_EBML = bytes.fromhex("1A45DFA3")
_SEGMENT = bytes.fromhex("18538067")
_MAX_PARTS = 100_000


def bytes_missing(path: Path) -> int:
    """How many bytes are missing at the end of ``path``; 0 where none are, or where nothing says so."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(12)
        if head.startswith(_EBML):
            end = _end_of_matroska(file)
        elif head.startswith(b"RIFF"):
            end = _end_of_parts(file, size, _riff)
        elif head[4:8] in {b"ftyp", b"moov", b"mdat", b"free", b"wide", b"skip"}:
            end = _end_of_parts(file, size, _box)
        else:
            end = size
    return max(0, end - size)


def _vint(file: BinaryIO) -> int | None:
    """A length of EBML: the first 1 bit tells how many bytes it has; all bits 1 means unknown."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    length = 9 - first[0].bit_length()
    rest = file.read(length - 1)
    bits = 7 * length
    value = int.from_bytes(first + rest, "big") & ((1 << bits) - 1)
    return value if len(rest) == length - 1 and value != (1 << bits) - 1 else None


def _end_of_matroska(file: BinaryIO) -> int:
    """Where the segment ends that follows the header; 0 if that was not known when it was written."""
    file.seek(len(_EBML))
    header = _vint(file)
    if header is None or header > 1 << 20:
        return 0
    file.seek(header, os.SEEK_CUR)
    if file.read(len(_SEGMENT)) != _SEGMENT:
        return 0
    size = _vint(file)
    return 0 if size is None else file.tell() + size


def _riff(head: bytes) -> int:
    return 8 + struct.unpack_from("<I", head, 4)[0]


def _box(head: bytes) -> int:
    size = struct.unpack_from(">I", head)[0]
    return struct.unpack_from(">Q", head, 8)[0] if size == 1 and len(head) == 16 else size


def _end_of_parts(file: BinaryIO, size: int, length_of: Callable[[bytes], int]) -> int:
    """Where the last of the parts ends that follow each other from the file's beginning."""
    start = 0
    for _ in range(_MAX_PARTS):
        file.seek(start)
        head = file.read(16)
        if len(head) < 8:
            return start + 8 if head else start
        length = length_of(head)
        if length < 8:  # 0: to the end of the file
            return size
        start += length
        if start >= size:
            return start
    return size
