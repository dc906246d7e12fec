"""Whether an MP4 or MOV file claims to hold more than it can, told before a player makes room for it.

A box of ISO base media (ISO/IEC 14496-12) may say in a dozen bytes that a hundred million samples of the same size, or
items, or keys follow.  FFmpeg then takes memory for each, gigabytes for a file of a kilobyte.  No entry is smaller than
a byte of the file, so a file that claims more of them than it has bytes is not whole, or made to do harm.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from ecat.errors import LimitError
from ecat.store import files

MAX_HEADER_BYTES = 128 << 20
"""Of one box that describes samples; the tables of ten hours of video are 20 MiB."""
MAX_BOXES = 2_000_000
_MAX_DEPTH = 12
_MAX_SEARCHED_BYTES = 256 << 10
_MAX_UNPACKED_BYTES = 16 << 20
_FOREIGN = (b"\x1aE\xdf\xa3", b"RIFF", b"OggS", b"fLaC", b"FLV\x01")
_OUTERMOST = frozenset({b"ftyp", b"styp", b"moov", b"moof", b"mdat", b"meta", b"wide", b"pnot", b"udta"})
_CONTAINERS = frozenset(
    {
        b"moov",
        b"trak",
        b"mdia",
        b"minf",
        b"stbl",
        b"dinf",
        b"edts",
        b"mvex",
        b"moof",
        b"traf",
        b"mfra",
        b"udta",
    }
    | {
        b"ilst",
        b"iprp",
        b"ipco",
        b"tref",
        b"wave",
        b"sinf",
        b"schi",
        b"ipro",
        b"vexu",
        b"eyes",
        b"grpl",
        b"rmra",
    }
)
_LEAVES = frozenset(
    {
        b"mdat",
        b"stco",
        b"co64",
        b"stts",
        b"ctts",
        b"stsc",
        b"stss",
        b"stps",
        b"sdtp",
        b"sbgp",
        b"sgpd",
        b"saiz",
    }
    | {b"saio", b"senc", b"elst", b"sidx", b"tfra", b"hdlr", b"data", b"covr", b"skip", b"free"}
)
_COUNTED = (b"stsz", b"stz2", b"trun", b"keys", b"iinf", b"iloc")
"""The boxes that say how many entries follow, and for which room is made at once."""
_FAR_TOO_MANY = 1 << 62

Box = tuple[bytes, int, int]
"""What it is, where its content begins, and where it ends."""


def refuse_hollow(path: Path, what: str) -> None:
    """Return unless a media file is an MP4 or MOV that claims more entries than it has bytes.

    Raises
    ------
    LimitError : it is; or what describes its samples is larger than is read.
    StoreError : it cannot be read.
    """
    with files.typed_errors(what, path), files.open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if file.read(4).startswith(_FOREIGN):
            return
        boxes = list(_outermost(file, size, path, what))
        if not any(kind in _OUTERMOST for kind, _, _ in boxes):
            return
        claimed = 0
        for kind, start, end in boxes:
            if not _is_looked_into(kind, end - start):
                continue
            if end - start > MAX_HEADER_BYTES:
                raise _refusal(path, what, f"its part {kind.decode('latin-1')} has {end - start:,} bytes")
            file.seek(start)
            claimed += sum(_claims(file.read(end - start), (kind, 0, end - start), 0))
            if claimed > size:
                raise _refusal(path, what, f"it has {size:,} bytes, and claims more samples than that")


def _refusal(path: Path, what: str, why: str) -> LimitError:
    return LimitError(what, where=f"{path.name}: {why}")


def _outermost(file: BinaryIO, size: int, path: Path, what: str) -> Iterator[Box]:
    """The parts that follow each other in a file."""
    start = 0
    for _ in range(MAX_BOXES):
        file.seek(start)
        found = _box(file.read(24), 0, size - start)
        if found is None:
            return
        kind, body, end = found
        yield kind, start + body, start + end
        start += end
    raise _refusal(path, what, f"more than {MAX_BOXES:,} parts")


def _box(data: bytes, start: int, end: int) -> Box | None:
    """The box at ``start`` of what ends at ``end``; one that says that it is longer ends there too."""
    if start + 8 > min(end, len(data)):
        return None
    size, kind = struct.unpack_from(">I4s", data, start)
    body = start + 8
    if size == 1 and start + 16 <= min(end, len(data)):
        size, body = struct.unpack_from(">Q", data, body)[0], start + 16
    if size and start + size < body:
        return None
    if kind in {b"free", b"hoov"} and data[body + 4 : body + 8] in {b"mvhd", b"cmov"}:
        kind = b"moov"  # hidden from players that are not told; FFmpeg looks
    return kind, body, min(start + size, end) if size else end


def _is_looked_into(kind: bytes, n_bytes: int) -> bool:
    """Whether a box can have counted ones in it; what is not known to is searched if it is small."""
    known = kind in _CONTAINERS or kind in _COUNTED or kind in {b"meta", b"stsd", b"cmov"}
    return known or (kind not in _LEAVES and n_bytes <= _MAX_SEARCHED_BYTES)


def _claims(data: bytes, box: Box, depth: int) -> Iterator[int]:
    """How many entries a box, and whatever is in it, says that it has."""
    kind, start, end = box
    if depth > _MAX_DEPTH or not _is_looked_into(kind, end - start):
        return
    if kind in _COUNTED:
        yield _entries(data, box)
    elif kind in _CONTAINERS:
        yield from _inside(data, start, end, depth)
    elif kind == b"meta":
        # some write it with a version, some without
        first = data.find(b"hdlr", start, end)
        yield from _inside(data, max(start, first - 4), end, depth)
    elif kind == b"cmov":
        moov = _unpacked(data[start:end])
        yield from [_FAR_TOO_MANY] if moov is None else _inside(moov, 0, len(moov), depth + 1)
    else:
        for counted in _COUNTED:
            at = data.find(counted, start, end)
            while at >= 0:
                yield _entries(data, (counted, at + 4, end))
                at = data.find(counted, at + 4, end)


def _inside(data: bytes, start: int, end: int, depth: int) -> Iterator[int]:
    while (found := _box(data, start, end)) is not None:
        yield from _claims(data, found, depth + 1)
        start = found[2]


def _entries(data: bytes, box: Box) -> int:
    """The number of entries that a box declares; 0 where it breaks off before."""
    kind, start, end = box
    version = data[start] if start < end else 0
    at, form = start + {b"stsz": 8, b"stz2": 8, b"iloc": 6}.get(kind, 4), ">I"
    if (kind == b"iinf" and version == 0) or (kind == b"iloc" and version < 2):
        form = ">H"
    return struct.unpack_from(form, data, at)[0] if at + struct.calcsize(form) <= end else 0


def _unpacked(cmov: bytes) -> bytes | None:
    """The ``moov`` box that a ``cmov`` box holds compressed (QuickTime), or ``None`` if it is too large."""
    at = cmov.find(b"cmvd")
    unzip = zlib.decompressobj()
    try:
        moov = unzip.decompress(cmov[at + 8 :], _MAX_UNPACKED_BYTES) if at >= 0 else b""
    except zlib.error:
        return b""  # nobody can read it
    return None if unzip.unconsumed_tail else moov
