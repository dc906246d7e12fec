"""Marker faces of all objects of a session as rows of ``markers_2d`` and ``markers_3d``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.formats.ecat2018.marks import CodeBook, FaceColumns, Faces
from ecat.model import Clock
from ecat.tables import MARKERS_2D, MARKERS_3D, ROW_GROUP_ROWS


def mark_batches(
    groups: Sequence[Faces], book: CodeBook, clock: Clock, n_frames: int
) -> Iterator[pa.RecordBatch]:
    """The rows of one of the two tables, sorted by frame, object and order, a row group at a time.

    Parameters
    ----------
    groups : at least one object's faces, all of the same number of dimensions.
    """
    rows = _Rows(groups, [group.columns() for group in groups], book, clock, n_frames)
    frames = np.concatenate([columns.frames for columns in rows.columns])
    lengths = [len(group) for group in groups]
    owner = np.repeat(np.arange(len(groups), dtype=np.int32), lengths)
    starts = np.cumsum([0, *lengths[:-1]])
    # within an object the file's order is by frame and face already: a stable sort keeps it
    order = np.lexsort((owner, frames))
    for begin in range(0, len(order), ROW_GROUP_ROWS):
        chosen = order[begin : begin + ROW_GROUP_ROWS]
        yield rows.batch(owner[chosen], chosen - starts[owner[chosen]])


@dataclass(frozen=True, slots=True)
class _Rows:
    groups: Sequence[Faces]
    columns: Sequence[FaceColumns]
    book: CodeBook
    clock: Clock
    n_frames: int

    def batch(self, owner: NDArray[np.int32], index: NDArray[np.intp]) -> pa.RecordBatch:
        """Rows ``index`` of the objects ``owner``, as many as there are."""
        n, width = len(owner), self.groups[0].width
        empty = np.empty(n, np.int32)
        all_rows = FaceColumns(empty, empty.copy(), empty.copy(), empty.copy(), np.empty((n, width)))
        present = np.ones(n, bool)
        texts: list[str | None] = [None] * n
        for i, (group, columns) in enumerate(zip(self.groups, self.columns, strict=True)):
            mine = np.flatnonzero(owner == i)
            found = columns.take(index[mine])
            for name in FaceColumns.__slots__:
                getattr(all_rows, name)[mine] = getattr(found, name)
            if group.absent or group.corner_texts:
                for row, at in zip(mine.tolist(), index[mine].tolist(), strict=True):
                    present[row] = at not in group.absent
                    texts[row] = group.corner_texts.get(at)
        return self._arrow(owner, all_rows, present, texts)

    def _arrow(
        self, owner: NDArray[np.int32], rows: FaceColumns, present: NDArray[np.bool_], texts: list[str | None]
    ) -> pa.RecordBatch:
        codes = rows.codes
        schema = MARKERS_2D if self.groups[0].dimensions == 2 else MARKERS_3D
        columns: list[Any] = [
            _times(rows.frames, self.clock, self.n_frames),
            pa.array(rows.frames),
            _dictionary(owner, [group.object_id for group in self.groups]),
            pa.array(rows.orders.astype(np.int16), mask=rows.orders < 0),
            pa.array(present),
            pa.array(rows.sizes.astype(np.int16), mask=rows.sizes <= 0),
            _dictionary(codes, self.book.codes),
            _dictionary(codes, self.book.texts).dictionary_decode(),
            pa.array(texts, pa.string()),
            *_numbers(rows.corners),
        ]
        return pa.RecordBatch.from_arrays(columns, schema=schema.arrow)


def _numbers(rows: NDArray[np.float64]) -> Iterator[pa.Array[Any]]:
    """The columns of (n, columns), NaN as null; Arrow's own way from NumPy takes twice the time."""
    columns = np.ascontiguousarray(rows.T)
    there = np.packbits(~np.isnan(columns), axis=1, bitorder="little")
    for values, valid in zip(columns, there, strict=True):
        buffers: list[Any] = [pa.py_buffer(part.tobytes()) for part in (valid, values)]
        yield pa.Array.from_buffers(pa.float64(), len(values), buffers)


def _dictionary(numbers: NDArray[np.int32], values: Sequence[str | None]) -> Any:
    return pa.DictionaryArray.from_arrays(
        pa.array(numbers, pa.int32(), mask=numbers < 0), pa.array(values, pa.string())
    )


def _times(frames: NDArray[np.int32], clock: Clock, n_frames: int) -> Any:
    distinct, back = np.unique(frames, return_inverse=True)
    times: Any = pa.array(clock.times_ns(distinct.tolist(), n_frames), pa.int64())
    return times.take(pa.array(back))
