"""Tables as Parquet files: written in row groups of bounded size, read in slices.
 The same rows give the same bytes, however they were cut into batches.  A slice reads the file's footer and
the row groups whose statistics say that they may hold wanted rows.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ecat.errors import SchemaError
from ecat.store.files import NewFile
from ecat.tables import ROW_GROUP_ROWS, TABLES

_BUFFER = 1 << 20
_MANY_ROWS = 1 << 15
"""Fewer are read sooner than their columns can be handed to other threads."""


@dataclass(frozen=True, kw_only=True)
class TableData:
    """What is to become one table of a session.

    Parameters
    ----------
    data : rows that fit the table's schema in :data:`ecat.tables.TABLES`, sorted by its ``order``; an
        iterable of
        batches is written as it comes, in bounded memory.
    stage, stage_version, parameters : what made the rows; empty for what was imported.
    inputs : name of each table or layer that went in, and its sha256.
    """

    data: pa.Table | Iterable[pa.RecordBatch]
    stage: str = ""
    stage_version: str = ""
    parameters: dict[str, object] = field(default_factory=dict[str, object])
    inputs: dict[str, str] = field(default_factory=dict[str, str])

    def metadata(self) -> dict[bytes, bytes]:
        """Where the rows come from, as the file's metadata.

        Raises
        ------
        SchemaError : a parameter is not JSON.
        """
        try:
            facts = {
                "ecat.stage": self.stage,
                "ecat.stage_version": self.stage_version,
                "ecat.parameters": json.dumps(self.parameters, allow_nan=False),
                "ecat.inputs": json.dumps(self.inputs),
            }
        except (TypeError, ValueError) as error:
            what, fix = "cannot note what made a table", "give parameters that JSON can hold"
            raise SchemaError(what, problems=(f"parameters: {error}",), fix=fix) from None
        return {key.encode(): value.encode() for key, value in facts.items()}


@dataclass(frozen=True, slots=True)
class Bound:
    """Rows whose ``column`` is at least ``low`` and below ``high``; with ``nulls``, also where it is null."""

    column: str
    low: int | None = None
    high: int | None = None
    nulls: bool = False

    def may_hold(self, statistics: Any, rows: int) -> bool:
        """Whether a row group with these statistics of the column may have such rows."""
        if statistics is None or not statistics.has_null_count:
            return True
        if self.nulls and statistics.null_count:
            return True
        if not statistics.has_min_max:
            return statistics.null_count < rows
        above = self.low is None or statistics.max >= self.low
        return above and (self.high is None or statistics.min < self.high)

    def mask(self, table: pa.Table) -> Any:
        """For every row, whether it is one."""
        column = table[self.column]
        tests = [pc.is_valid(column)]
        if self.low is not None:
            tests.append(pc.greater_equal(column, pa.scalar(self.low)))
        if self.high is not None:
            tests.append(pc.less(column, pa.scalar(self.high)))
        mask = tests[0]
        for test in tests[1:]:
            mask = pc.and_kleene(mask, test)
        return pc.or_kleene(mask, pc.is_null(column)) if self.nulls else mask


def write_table(file: NewFile, name: str, table: TableData) -> int:
    """Write ``table`` to ``file`` as the table called ``name``, and return its number of rows.

    Raises
    ------
    SchemaError : the rows do not fit the table's schema.
    """
    known = _known(name)
    schema = known.with_metadata({**(known.metadata or {}), **table.metadata()})
    rows = 0
    sink = pa.BufferedOutputStream(pa.PythonFile(file, mode="w"), _BUFFER)
    with sink, pq.ParquetWriter(sink, schema, **_options(name)) as writer:
        for group in _row_groups(name, table.data, schema):
            writer.write_table(group, ROW_GROUP_ROWS)
            rows += group.num_rows
    return rows


@cache
def _known(name: str) -> pa.Schema:
    # looked up by name: a table's declaration takes longer to hash than its rows may take to write
    return TABLES[name].arrow


@cache
def _options(name: str) -> dict[str, Any]:
    schema = TABLES[name].arrow
    return {
        "compression": "zstd",
        "compression_level": 3,
        "use_dictionary": [f.name for f in schema if pa.types.is_dictionary(f.type)],
        # the bytes of one place of all numbers together: an eighth smaller, and faster, on poses; but points
        # mapped through depth repeat whole from frame to frame, and then cost twice as much
        "use_byte_stream_split": name != "markers_3d"
        and [f.name for f in schema if pa.types.is_floating(f.type)],
        "write_page_checksum": True,
    }


def _row_groups(
    name: str, data: pa.Table | Iterable[pa.RecordBatch], schema: pa.Schema
) -> Iterator[pa.Table]:
    batches = data.to_batches(max_chunksize=ROW_GROUP_ROWS) if isinstance(data, pa.Table) else data
    waiting: list[pa.RecordBatch] = []
    rows = 0
    for batch in batches:
        waiting.append(batch)
        rows += batch.num_rows
        while rows >= ROW_GROUP_ROWS:
            whole = _fit(name, waiting, schema)
            yield _settled(whole.slice(0, ROW_GROUP_ROWS))
            waiting, rows = whole.slice(ROW_GROUP_ROWS).to_batches(), rows - ROW_GROUP_ROWS
    if rows:
        yield _settled(_fit(name, waiting, schema))


def _fit(name: str, batches: Sequence[pa.RecordBatch], schema: pa.Schema) -> pa.Table:
    try:
        table = pa.Table.from_batches(batches)
        problems = [
            f"{column}: no such column" for column in table.column_names if column not in schema.names
        ]
        if not problems:
            return table.select(schema.names).cast(schema)
    except (KeyError, ValueError, pa.ArrowException) as error:
        problems = [str(error)]
    raise SchemaError(
        f"cannot write table {name}",
        problems=tuple(problems),
        consequence="nothing was changed",
        fix=f"give it the columns and types of schemas/tables/{name}.json",
    )


def _settled(table: pa.Table) -> pa.Table:
    # dictionaries in the order of first use and without unused words, as if the rows had come in one piece
    columns = [
        column.cast(column.type.value_type).combine_chunks().dictionary_encode().cast(column.type)
        if pa.types.is_dictionary(column.type)
        else column
        for column in table.columns
    ]
    return pa.Table.from_arrays(columns, schema=table.schema)


def read_groups(file: pq.ParquetFile, bounds: Sequence[Bound], columns: Sequence[str] | None) -> pa.Table:
    """The rows within all ``bounds``, of them the ``columns`` (all if ``None``), in the order of the file."""
    groups = [i for i in range(file.num_row_groups) if _wanted(file.metadata.row_group(i), bounds)]
    needed = None if columns is None else [*columns, *(b.column for b in bounds if b.column not in columns)]
    many = file.metadata.num_rows >= _MANY_ROWS
    if groups and needed != []:
        # one after the other: all at once they take twice the memory of the rows, and no less time
        parts = (file.read_row_groups([i], columns=needed, use_threads=many) for i in groups)
        table = pa.concat_tables(_within(part, bounds) for part in parts)
    else:  # tables without a column, put together, would have no rows
        table = _within(file.read_row_groups(groups, columns=needed), bounds)
    table = table.unify_dictionaries()
    return table if columns is None else table.select(list(columns))


def _within(table: pa.Table, bounds: Sequence[Bound]) -> pa.Table:
    for bound in bounds:
        table = table.filter(bound.mask(table))
    return table


def _wanted(group: Any, bounds: Sequence[Bound]) -> bool:
    columns = [group.column(i) for i in range(group.num_columns)] if bounds else []
    statistics = {column.path_in_schema: column.statistics for column in columns}
    return all(bound.may_hold(statistics[bound.column], group.num_rows) for bound in bounds)
