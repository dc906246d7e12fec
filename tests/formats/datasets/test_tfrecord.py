"""TFRecord files, read by protobuf, and CRCs against what others compute."""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.datasets.tfrecord import Blobs, Value, crc32c, example_size, write_example
from tests.formats.datasets.examples import read_records


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        (b"", 0),
        (b"123456789", 0xE3069283),
        # RFC 3720, B.4
        (bytes(32), 0x8A9136AA),
        (b"\xff" * 32, 0x62A8AB43),
        (bytes(range(32)), 0x46DD794E),
        (bytes(reversed(range(32))), 0x113FDB5C),
    ],
)
def test_crcs_are_those_of_the_standard(data: bytes, crc: int) -> None:
    assert crc32c(data) == crc


def bit_by_bit(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


@given(st.integers(0, 3000), st.integers(0, 3000), st.integers(0, 1 << 32))
def test_crcs_of_any_length_can_be_continued(first: int, second: int, seed: int) -> None:
    data = np.random.default_rng(seed).bytes(first + second)
    assert crc32c(data[first:], crc32c(data[:first])) == bit_by_bit(data)


values: st.SearchStrategy[Any] = st.one_of(
    st.lists(st.binary(max_size=300), max_size=5),
    st.lists(st.floats(width=32, allow_nan=False), max_size=9).map(lambda x: np.array(x, np.float32)),
    st.lists(st.integers(-(1 << 63), (1 << 63) - 1), max_size=9).map(lambda x: np.array(x, np.int64)),
    st.lists(st.booleans(), max_size=9).map(lambda x: np.array(x, np.bool_)),
)


@given(st.dictionaries(st.text(max_size=20), values, max_size=4))
def test_what_is_written_comes_back(features: dict[str, Any]) -> None:
    file = io.BytesIO()
    size = write_example(file, features)
    assert size == example_size(features) == len(file.getvalue()) - 16
    (found,) = read_records(file.getvalue())
    assert found.keys() == features.keys()
    for name, value in features.items():
        assert found[name] == list(value)


def test_records_follow_one_another() -> None:
    file = io.BytesIO()
    written: list[dict[str, Value]] = [{"a": np.arange(i, dtype=np.int64)} for i in range(3)]
    for features in written:
        write_example(file, features)
    assert [record["a"] for record in read_records(file.getvalue())] == [[], [0], [0, 1]]


def test_large_texts_are_asked_for_when_they_are_written() -> None:
    held: list[int] = []

    def each() -> Any:
        for i in range(5):
            held.append(file.tell())
            yield bytes([i]) * (1 << 20)

    file = io.BytesIO()
    write_example(file, {"images": Blobs(lengths=[1 << 20] * 5, each=each())})
    # each was written before the next but one was made
    assert held[-1] > 3 << 20
    (found,) = read_records(file.getvalue())
    assert [text[:1] for text in found["images"]] == [bytes([i]) for i in range(5)]


def test_a_damaged_record_is_noticed() -> None:
    file = io.BytesIO()
    write_example(file, {"a": [b"text"]})
    data = bytearray(file.getvalue())
    data[20] ^= 1
    with pytest.raises(AssertionError, match="CRC"):
        list(read_records(bytes(data)))
    assert struct.unpack_from("<Q", data)[0] == len(data) - 16
