"""Tables of which only some frames are in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray


class Rows(Protocol):
    """A long table with the column ``frame``, read some frames after the others."""

    def select(self, columns: Sequence[str]) -> pa.Table:
        """All rows, of these columns."""
        ...

    def between(self, first: int, end: int) -> pa.Table:
        """All columns of the rows whose frame is at least ``first`` and below ``end``."""
        ...


@dataclass(frozen=True)
class InMemory:
    """A table that is there as a whole."""

    table: pa.Table

    def select(self, columns: Sequence[str]) -> pa.Table:
        """All rows, of these columns."""
        return self.table.select(list(columns))

    def between(self, first: int, end: int) -> pa.Table:
        """The rows of some frames."""
        return self.table.filter((pc.field("frame") >= first) & (pc.field("frame") < end))


Given: TypeAlias = pa.Table | Rows
"""A table, as a whole or some frames at a time."""


def rows_of(given: Given) -> Rows:
    """The table, to be read some frames at a time."""
    return InMemory(given) if isinstance(given, pa.Table) else given


def frames_of(rows: Rows) -> NDArray[np.int64]:
    """The frame (n,) of every row."""
    return np.asarray(rows.select(("frame",))["frame"].to_numpy(), np.int64)


def stretches(rows: Rows, n_frames: int) -> Iterator[pa.Table]:
    """All rows, those of so many frames at a time; where there are none, however long, nothing is read."""
    for first in (np.unique(frames_of(rows) // n_frames) * n_frames).tolist():
        yield rows.between(first, first + n_frames)
