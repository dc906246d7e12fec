"""Columns of numbers as bytes that a page reads without parsing.

uint32 (little-endian): length of the header; the header, JSON ``{"rows", "columns": [{"name", "type", "offset",
"values"?}]}`` padded with blanks so that what follows it begins at a multiple of 8; then the arrays, each at its
``offset`` from there.  Types: ``f4``, ``f8`` (NaN = null), ``i4`` (-1 = null) and ``dict``: i4 codes of the texts in
``values`` (-1 = null).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic_core import to_json

from ecat.errors import UsageError

NULL = -1


@dataclass(frozen=True)
class Words:
    """Texts (n,) as int32 codes of ``values``."""

    codes: NDArray[np.int32]
    values: list[str]


Array: TypeAlias = NDArray[np.float32] | NDArray[np.float64] | NDArray[np.int32] | Words


def pack(columns: Mapping[str, Array]) -> bytes:
    """The columns, all of one length, as bytes."""
    parts: list[bytes] = []
    described: list[dict[str, Any]] = []
    offset = rows = 0
    for name, array in columns.items():
        numbers = array.codes if isinstance(array, Words) else array
        kind = "dict" if isinstance(array, Words) else f"{numbers.dtype.kind}{numbers.dtype.itemsize}"
        data = np.ascontiguousarray(numbers, numbers.dtype.newbyteorder("<")).tobytes()
        described.append({"name": name, "type": kind, "offset": offset})
        if isinstance(array, Words):
            described[-1]["values"] = array.values
        parts += [data, bytes(-len(data) % 8)]
        offset += len(data) + -len(data) % 8
        rows = len(numbers)
    header = to_json({"rows": rows, "columns": described})
    header += b" " * (-(4 + len(header)) % 8)
    return b"".join([struct.pack("<I", len(header)), header, *parts])


def wanted(schema: pa.Schema, names: Sequence[str]) -> list[str]:
    """The columns of a table that were asked for, by their names here or there; all that can be sent by default.

    Raises
    ------
    UsageError : there is no such column, or it holds lists.
    """
    sendable = [field.name for field in schema if not pa.types.is_nested(field.type)]
    known = {sent_name(name): name for name in sendable} | {name: name for name in sendable}
    if unknown := [name for name in names if name not in known]:
        raise UsageError(
            f"cannot send {', '.join(unknown)[:200]}",
            where=f"the columns that can be sent: {', '.join(sent_name(name) for name in sendable)}",
            fix="choose from these",
        )
    return list(dict.fromkeys(known[name] for name in names)) or sendable


def sent_name(name: str) -> str:
    """Times leave as seconds: ``t_ns`` is sent as ``t_s``."""
    return name[:-3] + "_s" if name.endswith("_ns") else name


def columns_of(table: pa.Table) -> dict[str, Array]:
    """Every column of an Arrow table in one of the types there are."""
    return {sent_name(field.name): _array(table.column(i), field) for i, field in enumerate(table.schema)}


def _array(column: Any, field: pa.Field[Any]) -> Array:
    kind = field.type
    if pa.types.is_dictionary(kind) or pa.types.is_string(kind):
        return _words(column)
    if field.name.endswith("_ns"):
        return np.asarray(pc.divide(column.cast(pa.float64(), safe=False), 1e9).to_numpy(), np.float64)
    if pa.types.is_floating(kind):
        return np.asarray(column.to_numpy(), np.float32)
    return np.asarray(column.cast(pa.int32()).fill_null(NULL).to_numpy(), np.int32)


def _words(column: Any) -> Words:
    if not pa.types.is_dictionary(column.type):
        column = column.dictionary_encode()
    whole = column.unify_dictionaries().combine_chunks()
    if isinstance(whole, pa.ChunkedArray):  # without rows there is nothing to combine
        return Words(np.empty(0, np.int32), [])
    codes = np.asarray(whole.indices.fill_null(NULL).to_numpy(zero_copy_only=False), np.int32)
    return Words(codes, [str(value) for value in whole.dictionary.to_pylist()])
