"""One table of a session, or a slice of it, for Arrow and pandas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import pyarrow as pa

from ecat.errors import UsageError
from ecat.model import Clock, TableRecord
from ecat.store.parquet import Bound, read_groups
from ecat.store.snapshot import Snapshot
from ecat.tables import TABLES

if TYPE_CHECKING:
    import pandas as pd
    from pandas.api.extensions import ExtensionDtype

_FAR = 2**62


class TableView:
    """A table, or some rows and columns of it; the file is read when rows are first asked for, once."""

    def __init__(
        self, snapshot: Snapshot, record: TableRecord, bounds: Sequence[Bound], columns: Sequence[str] | None
    ) -> None:
        names = TABLES[record.name].arrow.names
        if columns is not None and (unknown := [name for name in columns if name not in names]):
            raise UsageError(
                f"cannot read {', '.join(unknown)} of table {record.name}",
                where=f"its columns: {', '.join(names)}",
                fix="choose from these",
            )
        self._snapshot = snapshot
        self._record = record
        self._bounds = tuple(bounds)
        self._columns = None if columns is None else list(columns)

    def __repr__(self) -> str:
        return f"TableView({self.name!r}, session={str(self._snapshot.path)!r})"

    @property
    def name(self) -> str:
        """The table's name."""
        return self._record.name

    @property
    def schema(self) -> pa.Schema:
        """Columns with type, meaning, unit and frame of reference."""
        schema = TABLES[self.name].arrow
        return schema if self._columns is None else pa.schema([schema.field(name) for name in self._columns])

    @property
    def num_rows(self) -> int:
        """The number of rows; known without reading unless the view is a slice."""
        return self._rows.num_rows if self._bounds else self._record.rows

    def to_arrow(self) -> pa.Table:
        """The rows as an Arrow table.

        Raises
        ------
        StaleError : another process has replaced the table since the session was opened or refreshed.
            CorruptError, NotFoundError : the file is damaged, missing, or was made from layers that were
            edited since.
        """
        return self._rows

    def to_pandas(self) -> pd.DataFrame:
        """The rows as a DataFrame: names are categories, nullable integers are ``Int64`` and its kin."""
        import pandas as pd

        masked: dict[pa.DataType, ExtensionDtype] = {
            pa.int8(): pd.Int8Dtype(),
            pa.int16(): pd.Int16Dtype(),
            pa.int32(): pd.Int32Dtype(),
            pa.int64(): pd.Int64Dtype(),
        }
        frame = self._rows.to_pandas()
        for column in self.schema:
            if column.nullable and column.type in masked:
                frame[column.name] = self._rows[column.name].to_pandas(types_mapper=masked.get)
        return frame

    @cached_property
    def _rows(self) -> pa.Table:
        rows = self._snapshot.read_table(
            self._record, lambda file: read_groups(file, self._bounds, self._columns)
        )
        self._snapshot.confirm_layers(self._record)
        return rows


def bounds_of(
    record: TableRecord,
    clock: Clock,
    *,
    start: float | None,
    end: float | None,
    start_frame: int | None,
    end_frame: int | None,
) -> tuple[Bound, ...]:
    """The rows of a slice: see :meth:`ecat.store.Session.table`."""
    if (start, end) != (None, None) and clock.rule == "unknown":
        raise UsageError(
            f"cannot slice table {record.name} by time",
            where="the session has no clock",
            fix="start_frame, end_frame",
        )
    for low, high in ((start, end), (start_frame, end_frame)):
        if low is not None and high is not None and low > high:
            raise UsageError(
                f"cannot slice table {record.name} from {low} to {high}",
                where="the end is before the start",
                fix="exchange the two",
            )
    return (
        *_bounds(record, ("t_ns", "start_ns", "end_ns"), _nanoseconds(start), _nanoseconds(end)),
        *_bounds(record, ("frame", "start_frame", "end_frame"), start_frame, end_frame),
    )


def _nanoseconds(seconds: float | None) -> int | None:
    if seconds is None:
        return None
    if not math.isfinite(seconds):
        raise UsageError(f"cannot slice at {seconds} s", where="not a finite time", fix="leave out the bound")
    return round(seconds * 1e9)


def _bounds(
    record: TableRecord, columns: tuple[str, str, str], low: int | None, high: int | None
) -> list[Bound]:
    if low is None and high is None:
        return []
    low, high = (None if limit is None else min(max(limit, -_FAR), _FAR) for limit in (low, high))
    point, first, last = columns
    names = TABLES[record.name].arrow.names
    if point in names:
        return [Bound(point, low, high)]
    if first not in names:
        raise UsageError(
            f"cannot slice table {record.name}",
            where=f"it has neither times nor frames; its columns: {', '.join(names)}",
            fix="read it whole",
        )
    # an interval overlaps when it begins before the slice ends, and ends after the slice begins
    overlap = [Bound(first, None, high)] if high is not None else []
    return overlap + ([Bound(last, low + 1, None, nulls=True)] if low is not None else [])
