"""Arrays that are written as they come and mapped into memory when they are read: NumPy's ``.npy`` files."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ecat.errors import CorruptError

_HEADER = 128
"""Bytes; more than any header of ours takes, and a multiple of 64, so that rows are aligned."""


class ArrayFile(AbstractContextManager["ArrayFile"]):
    """A ``.npy`` file of rows of ``shape``, whose number is known when it is closed."""

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: str) -> None:
        self._shape, self._dtype = shape, np.dtype(dtype).newbyteorder("<")
        self._rows = 0
        self._file = path.open("wb")
        self._file.write(b"\0" * _HEADER)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._file.seek(0)
            self._file.write(self._header())
        self._file.close()

    def write(self, rows: NDArray[np.generic]) -> None:
        """Append rows (n, ...)."""
        rows = np.ascontiguousarray(rows, self._dtype)
        if rows.shape[1:] != self._shape:
            raise ValueError(f"expected rows of {self._shape}, found {rows.shape[1:]}")
        self._rows += len(rows)
        self._file.write(rows.tobytes())

    def _header(self) -> bytes:
        about = {
            "descr": npy.dtype_to_descr(self._dtype),
            "fortran_order": False,
            "shape": (self._rows, *self._shape),
        }
        text = repr(about).encode("latin-1")
        length = _HEADER - 10
        return npy.magic(1, 0) + length.to_bytes(2, "little") + text.ljust(length - 1) + b"\n"


def mapped(path: Path) -> NDArray[np.generic]:
    """The array in a ``.npy`` file, mapped into memory; nothing is read before it is looked at.

    Raises
    ------
    CorruptError : there is no such array in the file.
    """
    try:
        # an array of nothing cannot be mapped
        empty = path.stat().st_size <= _HEADER
        return np.load(path, mmap_mode=None if empty else "r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise CorruptError(
            f"cannot read {path.name}",
            where=f"{path}: {error}",
            consequence="the data set was not opened",
            fix="export it again",
        ) from None
