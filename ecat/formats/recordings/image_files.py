"""Image files one by one: their size is known before anything is decoded, and depth comes as it was stored."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, LimitError
from ecat.formats.recordings.common import Images
from ecat.store import files
from ecat.store.media.container import MAX_PIXELS

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".pnm", ".bmp", ".tif", ".tiff"})
MAX_FILE_BYTES = 256 << 20
_HEAD_BYTES = 1 << 18
_MOST_PX_PER_BYTE = 8 * 1032
"""Deflate makes 1032 bytes of one, each of 8 pixels at most; JPEG spends a bit on 256 pixels."""
_PNM = re.compile(rb"P([56])" + rb"(?:\s|#[^\n]{0,1000}\n){1,100}(\d{1,6})" * 3 + rb"\s")
_JPEG_SIZES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES = 256, 257, 258, 277


@dataclass(frozen=True, slots=True)
class Header:
    """What the first bytes of an image file say: the size, and whether it is one channel of 16 bits."""

    width_px: int
    height_px: int
    is_deep: bool = False


def is_image(path: Path) -> bool:
    """Whether the file is named as images are."""
    return path.suffix.lower() in SUFFIXES


def read_header(path: Path, what: str) -> Header:
    """The header of an image file.

    Raises
    ------
    FormatError : not an image of the kinds that are known, or it says that it has no pixels.
    LimitError : more than :data:`ecat.store.media.container.MAX_PIXELS`.
    StoreError : the file cannot be opened.
    """
    with files.typed_errors(what, path), files.open_regular(path) as file:
        data = file.read(_HEAD_BYTES)
        header = parse_header(data)
        if header is None and len(data) == _HEAD_BYTES:
            header = parse_header(data + file.read(MAX_FILE_BYTES - _HEAD_BYTES))
    return checked(header, what, path.name)


def checked(header: Header | None, what: str, name: str) -> Header:
    """The header, if it is one, and of an image that is not too large; errors as in :func:`read_header`."""
    if header is None:
        raise FormatError(what, where=f"{name}: not an image (PNG, JPEG, PNM, BMP, TIFF), or not complete")
    size = f"{header.width_px} x {header.height_px}"
    if header.width_px <= 0 or header.height_px <= 0:
        raise FormatError(what, where=f"{name}: an image of {size} pixels")
    if header.width_px * header.height_px > MAX_PIXELS:
        raise LimitError(
            what, where=f"{name}: {size} pixels, more than {MAX_PIXELS:,}", fix="reduce the images"
        )
    return header


def parse_header(data: bytes) -> Header | None:
    """The header in the first bytes of a file; None where it is not an image or not all of it is there."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            width, height, bits, kind = struct.unpack_from(">IIBB", data, 16)
            return Header(width, height, bits == 16 and kind == 0)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if found := _PNM.match(data):
            return Header(int(found[2]), int(found[3]), found[1] == b"5" and int(found[4]) > 255)
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return Header(width, abs(height))
        if data[:4] in {b"II*\0", b"MM\0*"}:
            return _tiff(data)
    except struct.error:
        pass
    return None


def _jpeg(data: bytes) -> Header | None:
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return Header(width, height)
        at += 1 if marker == 0xFF else 2 + max(length, 2)
    return None


def _tiff(data: bytes) -> Header | None:
    order = "<" if data[:1] == b"I" else ">"
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (n,) = struct.unpack_from(f"{order}H", data, at)
    tags = {_TIFF_BITS: 1, _TIFF_SAMPLES: 1}
    for i in range(n):
        tag, kind, count = struct.unpack_from(f"{order}HHI", data, at + 2 + 12 * i)
        if count == 1 and kind in (3, 4):
            (tags[tag],) = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, at + 10 + 12 * i)
    if _TIFF_WIDTH not in tags or _TIFF_HEIGHT not in tags:
        return None
    is_deep = tags[_TIFF_BITS] == 16 and tags[_TIFF_SAMPLES] == 1
    return Header(tags[_TIFF_WIDTH], tags[_TIFF_HEIGHT], is_deep)


def decode(data: bytes, what: str, name: str, *, deep: bool) -> NDArray[Any]:
    """An image in memory.

    Parameters
    ----------
    deep : depth or infrared, (height, width) uint16 as stored; else colour, (height, width, 3) uint8, blue first,
        whatever way the file asks viewers to turn it.

    Raises
    ------
    FormatError : it cannot be decoded, is not complete, or not of 16 bits though it should be.
    LimitError : too many pixels; said before any is decoded.
    """
    import cv2

    header = checked(parse_header(data), what, name)
    if not _is_whole(data) or header.width_px * header.height_px > _MOST_PX_PER_BYTE * len(data):
        raise FormatError(what, where=f"{name}: the image is not complete")
    if deep and data.startswith(b"P5"):
        return _pgm(data, header, what, name)
    wanted = cv2.IMREAD_UNCHANGED if deep else cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image: Any = cv2.imdecode(np.frombuffer(data, np.uint8), wanted)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (header.height_px, header.width_px):
        raise FormatError(what, where=f"{name}: the image cannot be decoded")
    if deep and (image.dtype != np.uint16 or image.ndim != 2):
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise FormatError(
            what,
            where=f"{name}: {channels} channels of {image.dtype}; depth is one of uint16",
            fix="save depth as 16-bit PNG",
        )
    return np.asarray(image)


def _pgm(data: bytes, header: Header, what: str, name: str) -> NDArray[np.uint16]:
    found = _PNM.match(data)
    assert found
    n = header.width_px * header.height_px
    if not header.is_deep or len(data) - found.end() < 2 * n:
        raise FormatError(what, where=f"{name}: not {n} pixels of 16 bits")
    pixels = np.frombuffer(data, ">u2", n, found.end())
    return pixels.astype(np.uint16).reshape(header.height_px, header.width_px)


def _is_whole(data: bytes) -> bool:
    """Whether the end of the image is there, as decoders fill up what is missing without a word."""
    if data.startswith(b"\x89PNG"):
        return _png_ends(data)
    if data.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in data[-1024:]
    if found := _PNM.match(data):
        channels, depth = (3 if found[1] == b"6" else 1), (2 if int(found[4]) > 255 else 1)
        return len(data) - found.end() >= int(found[2]) * int(found[3]) * channels * depth
    return True


def _png_ends(data: bytes) -> bool:
    """Whether the chunks of a PNG are sound, hold an image and lead to its end.

    OpenCV takes memory for whatever length a chunk claims, and goes on after damaged ones.
    """
    at, shown = 8, False
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4])
        if int.from_bytes(data[end : end + 4]) != zlib.crc32(data[at + 4 : end]):
            return False
        kind = data[at + 4 : at + 8]
        shown = shown or kind == b"IDAT"
        if kind == b"IEND":
            return shown
        at = end + 4
    return False


def read_image(path: Path, what: str, *, deep: bool) -> NDArray[Any]:
    """The image in a file, as :func:`decode` gives it; errors as there, and StoreError."""
    with files.typed_errors(what, path):
        data = files.read_bytes(path, MAX_FILE_BYTES)
    return decode(data, what, path.name, deep=deep)


def image_source(
    paths: Sequence[Path],
    times_ns: Sequence[int],
    what: str,
    *,
    deep: bool,
    note: Callable[[str], None],
    convert: Callable[[NDArray[Any]], NDArray[Any]] | None = None,
    lost: set[int] | None = None,
    blank: NDArray[Any] | None = None,
) -> Images:
    """The images of files, for a track; what cannot be read is left out and told to ``note``.

    Parameters
    ----------
    times_ns : of each file. convert : what to make of each image. lost : places to pass over, to which those that
        cannot be read are added. blank : what to give in the place of an image that cannot be read, which then is kept.
    """

    def images() -> Iterator[tuple[int, NDArray[Any]]]:
        bad: list[str] = []
        for i, (path, t_ns) in enumerate(zip(paths, times_ns, strict=True)):
            if lost is not None and i in lost:
                continue
            try:
                image = read_image(path, what, deep=deep)
            except LimitError:
                raise
            except FormatError as error:
                bad.append(error.where)
                if blank is not None:
                    yield t_ns, blank
                elif lost is not None:
                    lost.add(i)
                continue
            yield t_ns, convert(image) if convert is not None else image
        if bad:
            instead = "are missing" if blank is None else "count as not measured"
            note(f"{len(bad)} of {len(paths)} images could not be read and {instead}: {bad[0]}")

    return images
