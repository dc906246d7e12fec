"""TFRecord files of ``tf.train.Example`` messages, written without TensorFlow.

https://www.tensorflow.org/tutorials/load_data/tfrecord: a record is the length of its data (8 bytes, little endian), a
masked CRC-32C of these 8 bytes, the data, and a masked CRC-32C of the data.  An Example is a map of lists of numbers or
bytes in protobuf's wire format: https://protobuf.dev/programming-guides/encoding.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint32]

RECORD = 16
"""Bytes that a record has besides its data."""
_POLYNOMIAL = 0x82F63B78
"""Castagnoli's, bits reversed."""
_ALL = 0xFFFFFFFF
_LANE = 128
"""Bytes that one lane of the vectorised CRC goes through."""
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Blobs:
    """Texts of bytes that are made when they are written; how long each is, is known before."""

    lengths: Sequence[int]
    each: Iterable[bytes]


Value = NDArray[np.float32] | NDArray[np.int64] | NDArray[np.bool_] | Sequence[bytes] | Blobs


def write_example(file: BinaryIO, features: Mapping[str, Value]) -> int:
    """Append a record, piece by piece; how long its data are."""
    entries = [_entry(name, features[name]) for name in sorted(features)]
    inside = sum(1 + len(_varint(size)) + size for size, _ in entries)
    head = b"\x0a" + _varint(inside)
    length = struct.pack("<Q", len(head) + inside)
    file.write(length + _masked(crc32c(length)))
    crc = 0
    for chunk in _chunks(_pieces(head, entries)):
        crc = crc32c(chunk, crc)
        file.write(chunk)
    file.write(_masked(crc))
    return len(head) + inside


def example_size(features: Mapping[str, Value]) -> int:
    """How long the data of a record will be."""
    inside = sum(1 + len(_varint(size)) + size for size, _ in (_entry(*item) for item in features.items()))
    return 1 + len(_varint(inside)) + inside


def _masked(crc: int) -> bytes:
    """A CRC of data that have CRCs in them is weak; so these are turned and moved."""
    return struct.pack("<I", (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & _ALL)


# ------------------------------------------------------------------------------------------------ messages


def _entry(name: str, value: Value) -> tuple[int, Iterator[bytes]]:
    """An entry of the map: how long it is, and its pieces."""
    key = _delimited(1, name.encode())
    kind, size, pieces = _list(value)
    before = bytes([kind << 3 | 2]) + _varint(size)
    feature = b"\x12" + _varint(len(before) + size)
    head = key + feature + before
    return len(head) + size, _after(head, pieces)


def _list(value: Value) -> tuple[int, int, Iterator[bytes]]:
    """Field of the list in a Feature, how long the list is, and its pieces."""
    if isinstance(value, np.ndarray):
        kind, data = (2, value.astype("<f4").tobytes()) if value.dtype.kind == "f" else (3, _varints(value))
        packed = _delimited(1, data)
        return kind, len(packed), iter((packed,))
    lengths = value.lengths if isinstance(value, Blobs) else [len(item) for item in value]
    each = value.each if isinstance(value, Blobs) else value
    size = sum(1 + len(_varint(length)) + length for length in lengths)
    return 1, size, (_delimited(1, item) for item in each)


def _after(head: bytes, pieces: Iterable[bytes]) -> Iterator[bytes]:
    yield head
    yield from pieces


def _pieces(head: bytes, entries: Sequence[tuple[int, Iterator[bytes]]]) -> Iterator[bytes]:
    yield head
    for size, pieces in entries:
        yield b"\x0a" + _varint(size)
        yield from pieces


def _chunks(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes in pieces that are worth a call."""
    held: list[bytes] = []
    size = 0
    for piece in pieces:
        held.append(piece)
        size += len(piece)
        if size >= _CHUNK:
            yield b"".join(held)
            held, size = [], 0
    yield b"".join(held)


def _delimited(number: int, data: bytes) -> bytes:
    return bytes([number << 3 | 2]) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first; negative numbers as in two's complement of 64 bits."""
    value &= 0xFFFF_FFFF_FFFF_FFFF
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _varints(values: NDArray[np.generic]) -> bytes:
    flat = values.ravel().astype(np.int64)
    if not len(flat) or (flat.min() >= 0 and flat.max() <= 0x7F):
        return flat.astype(np.uint8).tobytes()
    return b"".join(_varint(int(value)) for value in flat)


# ------------------------------------------------------------------------------------------------ CRC-32C


def crc32c(data: bytes, crc: int = 0) -> int:
    """CRC-32C (RFC 3720, B.4) of ``data``, or of what ``crc`` is of and ``data`` after it.

    A CRC is linear over GF(2): data are cut into lanes that NumPy goes through side by side, and the lanes' CRCs are
    moved to where they belong and added.
    """
    state = _moved(np.array([crc ^ _ALL], np.uint32), len(data))[0]
    return int(state ^ _plain(np.frombuffer(data, np.uint8))) ^ _ALL


def _plain(data: NDArray[np.uint8]) -> int:
    """CRC that begins with zero: zeros in front change nothing."""
    n_lanes = 1
    while n_lanes * _LANE < len(data):
        n_lanes *= 2
    lane = min(_LANE, len(data))
    padded = np.zeros(n_lanes * lane, np.uint8)
    padded[len(padded) - len(data) :] = data
    table, states = _tables(0)[0], np.zeros(n_lanes, np.uint32)
    for column in np.ascontiguousarray(padded.reshape(n_lanes, lane).T):
        states = table[(states ^ column) & np.uint32(0xFF)] ^ (states >> np.uint32(8))
    while len(states) > 1:
        states = _moved(states[0::2], lane) ^ states[1::2]
        lane *= 2
    return int(states[0])


def _moved(states: Words, n_bytes: int) -> Words:
    """States after so many zero bytes."""
    power = 0
    while n_bytes:
        if n_bytes & 1:
            states = _through(_tables(power), states)
        n_bytes, power = n_bytes >> 1, power + 1
    return states


def _through(tables: tuple[Words, ...], states: Words) -> Words:
    a, b, c, d = ((states >> np.uint32(8 * i)) & np.uint32(0xFF) for i in range(4))
    return tables[0][a] ^ tables[1][b] ^ tables[2][c] ^ tables[3][d]


@cache
def _tables(power: int) -> tuple[Words, ...]:
    """What each byte of a state becomes after 2 ** power zero bytes."""
    bits = np.arange(256, dtype=np.uint32)
    if power:
        half = _tables(power - 1)
        return tuple(_through(half, _through(half, bits << np.uint32(8 * i))) for i in range(4))
    found: list[Words] = []
    for i in range(4):
        states = bits << np.uint32(8 * i)
        for _ in range(8):
            states = (states >> np.uint32(1)) ^ np.where(
                states & np.uint32(1), np.uint32(_POLYNOMIAL), np.uint32(0)
            )
        found.append(states)
    return tuple(found)
