"""Reads TFRecord files with protobuf and google-crc32c, neither of which ecat writes them with."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest


@cache
def _message() -> Any:
    """``tf.train.Example``, declared by hand."""
    pytest.importorskip("google.protobuf")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    kinds = {"BytesList": 12, "FloatList": 2, "Int64List": 3}
    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="tf", syntax="proto3")
    for name, kind in kinds.items():
        file.message_type.add(name=name).field.add(name="value", number=1, label=3, type=kind)
    feature = file.message_type.add(name="Feature")
    feature.oneof_decl.add(name="kind")
    for number, name in enumerate(kinds, 1):
        feature.field.add(
            name=name[:-4].lower(), number=number, label=1, type=11, type_name=f".tf.{name}", oneof_index=0
        )
    features = file.message_type.add(name="Features")
    entry = features.nested_type.add(name="FeatureEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, label=1, type=9)
    entry.field.add(name="value", number=2, label=1, type=11, type_name=".tf.Feature")
    features.field.add(name="feature", number=1, label=3, type=11, type_name=".tf.Features.FeatureEntry")
    example = file.message_type.add(name="Example")
    example.field.add(name="features", number=1, label=1, type=11, type_name=".tf.Features")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tf.Example"))


def _unmasked(crc: int) -> int:
    turned = (crc - 0xA282EAD8) & 0xFFFFFFFF
    return (turned >> 17 | turned << 15) & 0xFFFFFFFF


def read_records(data: bytes) -> Iterator[dict[str, list[Any]]]:
    """The features of each record."""
    crc32c = pytest.importorskip("google_crc32c", exc_type=ImportError)
    place = 0
    while place < len(data):
        (length,) = struct.unpack_from("<Q", data, place)
        for start, n in ((place, 8), (place + 12, length)):
            (crc,) = struct.unpack_from("<I", data, start + n)
            assert _unmasked(crc) == crc32c.value(data[start : start + n]), "CRC"
        example = _message().FromString(data[place + 12 : place + 12 + length])
        yield {
            name: list(getattr(feature, feature.WhichOneof("kind")).value)
            for name, feature in example.features.feature.items()
        }
        place += length + 16
