"""FFV1 (RFC 9043): how depth is packed best, whether slices of an image are as they were written, and where they lie.

FFmpeg replaces a damaged slice by that of the image before without telling anyone; for measurements that is a lie.
Slices are coded each for itself, so that of an image that stands for itself a part can be decoded alone.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from av import VideoCodecContext

_SIZE, _SUM = 3, 4
_FOOTER = _SIZE + 1 + _SUM
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_MASK = 0xFFFFFFFF
_CUSTOM_TABLE = 2
_LEAST_SLICED_PX = 64
_TABLES, _SLICES = ("greater8bit", "8bit"), (4, 6)
_MORE_SLICES_COST = 1.0025

Part: TypeAlias = tuple[int, int, int, int]
"""A part of an image: left, top, right, bottom in pixels, without the last column and row."""


def choices(width_px: int, height_px: int) -> list[dict[str, str]]:
    """FFmpeg's options for images that stand for themselves and are known by their sums, fewest slices first."""
    slices = _SLICES if min(width_px, height_px) >= _LEAST_SLICED_PX else (1,)
    return [
        {"level": "3", "slicecrc": "1", "slices": str(n), "qtable": table}
        for n in slices
        for table in _TABLES
    ]


def suited(image: NDArray[np.uint16]) -> dict[str, str]:
    """The choice that packs an image best; more slices are worth a quarter of a percent."""
    options = choices(image.shape[1], image.shape[0])

    def size(one: dict[str, str]) -> float:
        return len(_packed(image, one)[0]) / (
            _MORE_SLICES_COST if one["slices"] > options[0]["slices"] else 1
        )

    return min(options, key=size)


def encoder(width_px: int, height_px: int, unit: Fraction, options: dict[str, str]) -> VideoCodecContext:
    """What packs images (height, width) whose times are in ``unit`` seconds, each for itself."""
    from av import VideoCodecContext

    made = VideoCodecContext.create("ffv1", "w")
    made.width, made.height, made.pix_fmt = width_px, height_px, "gray16le"
    made.time_base, made.options, made.gop_size, made.thread_count = unit, options, 1, 1
    return made


def _packed(image: NDArray[np.uint16], options: dict[str, str]) -> tuple[bytes, bytes]:
    """An image (height, width) as a packet, and the configuration record that it takes to decode it."""
    from av import VideoFrame

    packer = encoder(image.shape[1], image.shape[0], Fraction(1, 1000), options)
    frame = VideoFrame.from_ndarray(np.ascontiguousarray(image, "<u2"), format="gray16le")
    packets = [*packer.encode(frame), *packer.encode(None)]
    return b"".join(map(bytes, packets)), bytes(packer.extradata or b"")


def slices_of(packet: bytes) -> list[tuple[int, int]]:
    """Where in ``packet`` its slices begin and end: each ends in its length, a status and a sum that is right (§4.9).

    Empty where one is damaged, or was written without sums.
    """
    found: list[tuple[int, int]] = []
    end = len(packet)
    while end > 0:
        if end < _FOOTER:
            return []
        start = end - _FOOTER - int.from_bytes(packet[end - _FOOTER : end - _FOOTER + _SIZE], "big")
        if start < 0 or _remainder(packet[start:end]) != 0:
            return []
        found.append((start, end))
        end = start
    return found[::-1]


def _remainder(data: bytes) -> int:
    """CRC-32 with the highest bit first and nothing inverted: zlib's of the bytes with their bits reversed."""
    return zlib.crc32(data.translate(_REVERSED), _MASK) ^ _MASK


class SliceGuard:
    """Looks at the packets of a stream one after the other.  A stream has sums if any of its packets has right ones."""

    def __init__(self) -> None:
        self._has_sums = False
        self._failed = False

    def damaged(self, packet: bytes) -> bool:
        """Whether this packet, or one before that could not be told yet, is damaged."""
        if not packet:
            return False
        if slices_of(packet):
            self._has_sums = True
        else:
            self._failed = True
        return self._has_sums and self._failed


class _RangeDecoder:
    """Reads numbers that are coded by §3.8.1."""

    def __init__(self, data: bytes, table: list[int]) -> None:
        self._data, self._at = data, 2
        self._low, self._range = int.from_bytes(data[:2], "big"), 0xFF00
        self._table = table
        self._states = [128] * 32

    def bit(self, state: int = 0) -> int:
        """A bit, and the state of its kind after it."""
        of_one = self._range * self._states[state] >> 8
        rest = self._range - of_one
        bit = int(self._low >= rest)
        if bit:
            self._low -= rest
            self._states[state] = self._table[self._states[state]]
        else:
            self._states[state] = 256 - self._table[256 - self._states[state]]
        self._range = of_one if bit else rest
        while self._range < 0x100:
            self._range <<= 8
            self._low = self._low << 8 | self._data[self._at]
            self._at += 1
        return bit

    def number(self, *, signed: bool = False) -> int:
        """A number (§3.8.1.2)."""
        if self.bit(0):
            return 0
        exponent = 0
        while self.bit(1 + min(exponent, 9)):
            exponent += 1
        value = 1
        for i in reversed(range(exponent)):
            value = 2 * value + self.bit(22 + min(i, 9))
        return -value if signed and self.bit(11 + min(exponent, 10)) else value

    def next_by(self, table: list[int]) -> None:
        """Go on with other transitions, all states at their start."""
        self._table, self._states = table, [128] * 32


def _usual_table() -> list[int]:
    """What follows a one from each state (§3.8.1.5)."""
    one, most, table = 1 << 32, 248, [0] * 256
    factor, chance, last = one // 20, one // 2, 0

    def later(p: int) -> int:
        return p + ((one - p) * factor + one // 2 >> 32)

    for _ in range(128):
        state = max(256 * chance + one // 2 >> 32, last + 1)
        if last and state <= most:
            table[last] = state
        chance, last = later(chance), state
    for i in range(256 - most, most + 1):
        if not table[i]:
            table[i] = min(max(256 * later(i * one + 128 >> 8) + one // 2 >> 32, i + 1), most)
    return table


class Slicing:
    """How the images of a stream are divided into slices.

    Parameters
    ----------
    configuration : the stream's configuration record (§4.3). width_px, height_px : of its images.

    Raises
    ------
    ValueError : the record is of a version without slices, or none at all.
    """

    def __init__(self, configuration: bytes, width_px: int, height_px: int) -> None:
        self._size = width_px, height_px
        self._usual = _usual_table()
        try:
            read = _RangeDecoder(configuration, self._usual)
            version, _, coder = read.number(), read.number(), read.number()
            changes = [read.number(signed=True) if coder == _CUSTOM_TABLE else 0 for _ in range(255)]
            _colors, _bits, _chroma = read.number(), read.number(), read.bit()
            _h_shift, _v_shift, _alpha = read.number(), read.number(), read.bit()
            self._grid = read.number() + 1, read.number() + 1
        except IndexError as error:
            raise ValueError("the configuration record breaks off") from error
        if version != 3:
            raise ValueError(f"version {version} of FFV1")
        self._table = [0, *(a + b for a, b in zip(self._usual[1:], changes, strict=True))]
        self._blank = self._blank_slice(configuration)

    def _blank_slice(self, configuration: bytes) -> bytes:
        """A first slice in which there is nothing, which takes next to no time; empty if others wrote the stream."""
        width, height = self._size
        for options in choices(width, height):
            packet, its = _packed(np.zeros((height, width), np.uint16), options)
            if its == configuration:
                return packet[slice(*slices_of(packet)[0])]
        return b""

    def place(self, slice_: bytes, *, is_first: bool) -> Part:
        """Which part of the image a slice is (§4.6); before the first of a packet comes whether it is a key frame."""
        read = _RangeDecoder(slice_, self._usual)
        if is_first:
            read.bit()
        read.next_by(self._table)
        x, y = read.number(), read.number()
        right, bottom = x + read.number() + 1, y + read.number() + 1
        (width, height), (columns, rows) = self._size, self._grid
        return (
            x * width // columns,
            y * height // rows,
            right * width // columns,
            bottom * height // rows,
        )

    def cut(self, packet: bytes, parts: Iterable[Part]) -> tuple[bytes, list[Part]]:
        """The packet of an image that stands for itself without slices in which no ``parts`` lie, and what is left.

        There has to be a first slice, as it says what the packet is.  A packet without sums stays whole.
        """
        slices, wanted = slices_of(packet), list(parts)
        try:
            places = [self.place(packet[start:end], is_first=not start) for start, end in slices]
        except IndexError:
            places = []
        if not places:
            return packet, [(0, 0, *self._size)]
        kept = [i for i, place in enumerate(places) if any(_meet(place, part) for part in wanted)]
        if 0 not in kept and not self._blank:
            kept.insert(0, 0)
        start = b"" if 0 in kept else self._blank
        return start + b"".join(packet[slice(*slices[i])] for i in kept), [places[i] for i in kept]


def _meet(a: Part, b: Part) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
