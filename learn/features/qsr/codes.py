"""Values of relations as small integers, and the shapes that every relation takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from ecat.errors import InputError, UsageError

Codes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Columns = list[Floats]
"""The coordinates of one object, each a flat array."""

MISSING = 255
"""The code where a coordinate is not finite, and so nothing is known; null in tables."""
CHUNK = 4096
"""Rows done at a time: the dozen arrays of a relation (32 KB each) then stay in the cache of the core."""


# what is infinite becomes missing, which is no reason to warn
_QUIET = np.errstate(invalid="ignore", over="ignore")


def to_arrow(codes: Codes, values: Sequence[str]) -> pa.Array[Any]:
    """Codes as an Arrow array of names, null where missing; the names are stored once."""
    flat = np.ascontiguousarray(codes).reshape(-1)
    missing = flat == MISSING
    indices: Any = pa.array(flat, pa.uint8(), mask=missing if missing.any() else None)
    return pa.DictionaryArray.from_arrays(indices, pa.array(values, pa.string()))


def to_names(codes: Codes, values: Sequence[str]) -> list[str | None]:
    """Codes, flattened, as a list of names, None where missing."""
    table = [*values, *[None] * (MISSING + 1 - len(values))]
    return [table[code] for code in codes.reshape(-1).tolist()]


def columns_of(*objects: ArrayLike) -> tuple[tuple[int, ...], list[Columns]]:
    """The frames' common shape, and for every object its coordinates, each as a flat array.

    Parameters
    ----------
    objects : (..., 2) points, (..., 3) points in space, or (..., 4) boxes as centre and size (x, y, w, h).

    Raises
    ------
    UsageError : the last axis has another length, or the shapes do not fit each other.
    """
    arrays = [np.asarray(each, np.float64) for each in objects]
    for array in arrays:
        if array.ndim == 0 or array.shape[-1] not in {2, 3, 4}:
            raise UsageError(
                "cannot compute a relation",
                where=f"an object has the shape {array.shape}",
                fix="give (..., 2) points, (..., 3) points in space or (..., 4) boxes: x, y, w, h",
            )
    try:
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = " and ".join(str(array.shape) for array in arrays)
        raise UsageError(
            "cannot compute a relation", where=f"objects have the shapes {shapes}", fix="give equal shapes"
        ) from None
    flat = [
        np.broadcast_to(array, (*shape, array.shape[-1])).reshape(-1, array.shape[-1]) for array in arrays
    ]
    return shape, [list(array.T) for array in flat]


@_QUIET
def frame_by_frame(
    kernel: Callable[..., Codes], *objects: ArrayLike, keep: Callable[[Columns], Columns]
) -> Codes:
    """Codes of a relation of one frame; ``keep`` chooses the coordinates of an object that ``kernel`` gets."""
    shape, split = columns_of(*objects)
    codes = np.empty(math.prod(shape), np.uint8)
    for start in range(0, len(codes), CHUNK):
        rows = slice(start, start + CHUNK)
        codes[rows] = kernel(*(keep([column[rows] for column in each]) for each in split))
    return codes.reshape(shape)


@_QUIET
def step_by_step(kernel: Callable[..., Codes], *objects: ArrayLike) -> Codes:
    """Codes (..., t-1) of a relation of two consecutive frames of points (..., t, 2+)."""
    shape, split = columns_of(*objects)
    if not shape:
        raise UsageError(
            "cannot compute a relation of movement",
            where="an object has one position",
            fix="give tracks: (..., frames, 2)",
        )
    codes = np.empty(math.prod(shape), np.uint8)
    # the rows of all tracks in one run; what ends one track and begins the next is computed, and dropped
    for start in range(1, len(codes), CHUNK):
        rows = slice(start - 1, min(start + CHUNK, len(codes)))
        codes[start : rows.stop] = kernel(*([column[rows] for column in each[:2]] for each in split))
    return codes.reshape(shape)[..., 1:]


def points(object_: Columns) -> Columns:
    """Coordinates x and y of an object."""
    return object_[:2]


def edges(object_: Columns) -> Columns:
    """Left, right, lower and upper edge of an object; one without size is a point.

    Raises
    ------
    InputError : a size is negative.
    """
    if len(object_) != 4:
        x, y = object_[:2]
        return [x, x, y, y]
    x, y, w, h = object_
    return [*_interval(x, w), *_interval(y, h)]


def _interval(middle: Floats, size: Floats) -> tuple[Floats, Floats]:
    if (size < 0).any():
        raise InputError(
            "cannot compute a relation of boxes",
            where=f"a size is {size.min():g}",
            consequence="nothing was computed",
            fix="give sizes of 0 or more; NaN where there is none",
        )
    half = np.where(np.isnan(size), 0.0, size / 2)
    return middle - half, middle + half


def length_of(name: str, value: float) -> float:
    """A parameter that must be finite and not negative.

    Raises
    ------
    UsageError : it is neither.
    """
    if not (math.isfinite(value) and value >= 0):
        raise UsageError(
            f"cannot compute with a {name} of {value:g}",
            where=f"{name}: expected a number of 0 or more",
            fix=f"choose another {name}",
        )
    return float(value)
