"""Parts of a long text as an Arrow array, without copying them."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

_EVERY_OTHER = 0b01010101

Number = TypeVar("Number", np.int32, np.float64)


def spans(data: bytes, starts: NDArray[np.intp], ends: NDArray[np.intp], kind: pa.DataType) -> pa.Array[Any]:
    """``data[starts[i]:ends[i]]`` as element ``2 i``; what is between two of them is null.

    Arrow's texts follow each other without gaps, so a gap has to be an element too; where it is null, nothing
    is made of it.

    Parameters
    ----------
    data : less than 2 GiB.
    starts, ends : integers, at least one each, in the order of ``data``; spans do not overlap.
    kind : ``pa.binary()`` or ``pa.string()``.
    """
    bounds = np.stack([starts, ends], axis=1).astype(np.int32)
    n = bounds.size - 1
    valid = np.full((n + 7) // 8, _EVERY_OTHER, np.uint8)
    buffers: list[Any] = [pa.py_buffer(part) for part in (valid.tobytes(), bounds.tobytes(), data)]
    return pa.Array.from_buffers(kind, n, buffers)


def values_of(made: pa.Array[Any], kind: type[Number]) -> NDArray[Number]:
    """What a kernel ``made`` of spans, one number of this ``kind`` each."""
    buffer: Any = made.buffers()[1]
    return np.frombuffer(buffer, kind, len(made))[::2].copy()
