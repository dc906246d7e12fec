"""Sessions as plain Parquet files that pandas, Polars, DuckDB, R or Hugging Face ``datasets`` open without ecat.

    README.md            what it is: a dataset card, with a configuration for each file
    moments.parquet      a row for each moment of each episode: state and action by the names of their columns
    windows.parquet      stretches of moments of equal length, each with the label of its episode
    tables/<name>.parquet the tables of all sessions as they are, with the session's name in front

A part, which is private, holds the same as Arrow streams in one file: most sessions are small, and a small Parquet file
takes ten times as long to write and to read (:mod:`ecat.formats.datasets.streams`).

What it cannot carry: images, which stay in the sessions (``torch``, ``webdataset`` and ``lerobot`` have them).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ecat.errors import InputError
from ecat.formats.datasets.card import CARD, card
from ecat.formats.datasets.streams import StreamsReader, StreamsWriter
from ecat.formats.episode_plan import Plan
from ecat.formats.episodes import IMAGE_KINDS, Episode, EpisodeOptions, clock_method
from ecat.formats.format import Format, Part
from ecat.formats.options import option
from ecat.progress import Progress
from ecat.stages.resample import NS
from ecat.store import Session, files, write_new_file
from ecat.tables import TABLES

MOMENTS, WINDOWS = "moments.parquet", "windows.parquet"
_SESSION = pa.field("session", pa.string(), metadata={"meaning": "the session's folder"})
_FRAMES_AT_ONCE = 1 << 15
_GATHERED_BYTES = 1 << 25
_BATCHES_AT_ONCE = 64
_MOMENT = [
    _SESSION,
    pa.field("episode", pa.int64(), metadata={"meaning": "position of the episode in its session"}),
    pa.field("moment", pa.int64(), metadata={"meaning": "position of the moment in its episode"}),
    pa.field("t_ns", pa.int64(), metadata={"meaning": "time since the session's start", "unit": "ns"}),
    pa.field("event", pa.string(), metadata={"meaning": "id of the episode's event"}),
    pa.field("task", pa.string(), metadata={"meaning": "text of the event, else its type"}),
    pa.field("label", pa.string(), metadata={"meaning": "type of the event, else its text"}),
    pa.field("performer", pa.string(), metadata={"meaning": "who acts; empty if that is not known"}),
]
_WINDOW = pa.schema(
    [
        _SESSION,
        _MOMENT[1],
        pa.field("window", pa.int64(), metadata={"meaning": "position of the window in its episode"}),
        pa.field("first_moment", pa.int64(), metadata={"meaning": "moment that it begins with"}),
        pa.field("moments", pa.int64(), metadata={"meaning": "how many moments it has"}),
        pa.field("start_ns", pa.int64(), metadata={"meaning": "time of the first moment", "unit": "ns"}),
        pa.field("end_ns", pa.int64(), metadata={"meaning": "time after the last moment", "unit": "ns"}),
        *_MOMENT[4:],
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TidyOptions(EpisodeOptions):
    """Options of the format, besides those of episodes."""

    window_s: float = option(1.0, "length of a window", least=0.001, most=86400)
    stride_s: float = option(0.5, "from the start of a window to that of the next", least=0.001, most=86400)
    tables: bool = option(True, "also the tables of the sessions as they are")


def write_part(
    session: Session, label: str, dest: Path, options: TidyOptions, progress: Progress
) -> tuple[str, ...]:
    """Write one session to the file ``dest``."""
    with StreamsWriter(dest) as out:
        if options.tables:
            for name in session.tables:
                _write_table(session, name, label, out)
        try:
            plan = Plan(session, label, options)
        except InputError as error:
            if not options.tables:
                raise
            why = f"no moments: {(error.where or error.what).removeprefix(f'{label}: ')}"
            return (why, *_unseen(session))
        short = _write_moments(plan, out, label, options, progress)
    if short:
        said = f"{short:,} of {len(plan):,} episodes are shorter than a window and have none"
        return (*plan.findings, said, *_unseen(session))
    return (*plan.findings, *_unseen(session))


def _unseen(session: Session) -> Iterator[str]:
    if streams := [
        s.name for s in session.manifest.streams if s.present and s.kind in (*IMAGE_KINDS, "audio")
    ]:
        yield f"streams left behind: {', '.join(streams)}"


def _write_table(session: Session, name: str, label: str, out: StreamsWriter) -> None:
    schema = plain_schema(name)
    with out.stream(f"tables/{name}.parquet", schema) as stream:
        for rows in _rows(session, name):
            columns: list[Any] = [pa.repeat(label, rows.num_rows)]
            columns += [_plain(rows[field.name], field.type) for field in list(schema)[1:]]
            stream.write_table(pa.table(columns, schema=schema))


def _rows(session: Session, name: str) -> Iterator[pa.Table]:
    """The rows of a table, some at a time where they have frames."""
    view = session.table(name)
    left, start = view.num_rows, 0
    if left < _FRAMES_AT_ONCE or "frame" not in TABLES[name].arrow.names:
        yield view.to_arrow()
        return
    while left > 0 and start < 1 << 31:
        rows = session.table(name, start_frame=start, end_frame=start + _FRAMES_AT_ONCE).to_arrow()
        if rows.num_rows:
            yield rows
        left, start = left - rows.num_rows, start + _FRAMES_AT_ONCE


def plain_schema(name: str) -> pa.Schema:
    """A table's schema in types that every reader knows, the session in front."""
    return pa.schema([_SESSION, *(field.with_type(_plain_type(field.type)) for field in TABLES[name].arrow)])


def _plain_type(kind: Any) -> pa.DataType:
    if pa.types.is_dictionary(kind):
        return kind.value_type
    if pa.types.is_fixed_size_list(kind):
        return pa.list_(kind.value_type)
    if pa.types.is_map(kind):
        return pa.list_(pa.struct([("key", kind.key_type), ("value", kind.item_type)]))
    return kind


def _plain(column: Any, kind: pa.DataType) -> Any:
    if pa.types.is_map(column.type):
        rows = [
            None if row is None else [{"key": k, "value": v} for k, v in row] for row in column.to_pylist()
        ]
        return pa.array(rows, kind)
    return column.cast(kind)


def _write_moments(
    plan: Plan, out: StreamsWriter, label: str, options: TidyOptions, progress: Progress
) -> int:
    """Write moments and windows; how many episodes are shorter than a window."""
    windows: list[pa.Table] = []
    with ExitStack() as stack:
        moments: Any = None
        for number, episode in enumerate(plan.episodes()):
            progress(label, number, len(plan))
            table = _moments(episode)
            if moments is None:
                moments = stack.enter_context(out.stream(MOMENTS, table.schema))
            moments.write_table(table)
            windows.append(_windows(episode, options))
    with out.stream(WINDOWS, _WINDOW) as stream:
        for table in windows:
            stream.write_table(table)
    return sum(table.num_rows == 0 for table in windows)


def _about(episode: Episode, n: int) -> list[Any]:
    said = (episode.event, episode.task, episode.type or episode.task, episode.performer)
    return [pa.array([text] * n, pa.string()) for text in said]


def _moments(episode: Episode) -> pa.Table:
    n = len(episode)
    numbers = {f"state.{name}": episode.state[:, i] for i, name in enumerate(episode.state_names)} | {
        f"action.{name}": episode.action[:, i] for i, name in enumerate(episode.action_names)
    }
    columns = [
        pa.array([episode.session] * n, pa.string()),
        pa.array(np.full(n, episode.index, np.int64)),
        pa.array(np.arange(n, dtype=np.int64)),
        pa.array(episode.times_ns),
        *_about(episode, n),
        # what is not known is null, as in the sessions
        *(pa.array(values, pa.float32(), from_pandas=True) for values in numbers.values()),
    ]
    return pa.table(
        columns, schema=pa.schema([*_MOMENT, *(pa.field(name, pa.float32()) for name in numbers)])
    )


def _windows(episode: Episode, options: TidyOptions) -> pa.Table:
    length = max(round(options.window_s * options.fps), 1)
    stride = max(round(options.stride_s * options.fps), 1)
    n = max((len(episode) - length) // stride + 1, 0)
    first = np.arange(n, dtype=np.int64) * stride
    start = episode.times_ns[first] if n else np.zeros(0, np.int64)
    columns = [
        pa.array([episode.session] * n, pa.string()),
        pa.array(np.full(n, episode.index, np.int64)),
        pa.array(np.arange(n, dtype=np.int64)),
        pa.array(first),
        pa.array(np.full(n, length, np.int64)),
        pa.array(start),
        pa.array(start + length * NS // options.fps),
        *_about(episode, n),
    ]
    return pa.table(columns, schema=_WINDOW)


def merge(parts: Sequence[Part], dest: Path, options: TidyOptions, progress: Progress) -> tuple[str, ...]:
    """Join the streams of all sessions, a row group of many at a time; moments by the names of their columns.

    Every part is read as soon as it is there.  What is gathered of all files together is bounded: a limit for each
    would let the memory grow until the one with the fewest rows of a session has reached it.  Moments are read once
    more when all are, if columns have come after the first row group was written.
    """
    files.make_folders(dest / "tables")
    schemas = {f"tables/{name}.parquet": plain_schema(name) for name in TABLES} | {WINDOWS: _WINDOW}
    outs: dict[str, _Joined] = {}
    with ExitStack() as stack:
        for part in parts:
            with StreamsReader(part.path) as streams:
                for name in streams.names:
                    schema = streams.schema(name) if name == MOMENTS else schemas[name]
                    if name not in outs:
                        outs[name] = stack.enter_context(_Joined(dest / name, schema))
                    outs[name].widen(schema)
                    for rows in streams.batches(name):
                        outs[name].extend(rows)
                        _write_the_largest(outs)
        if MOMENTS in outs and outs[MOMENTS].outgrown:
            outs[MOMENTS].finish()
            outs[MOMENTS] = stack.enter_context(_Joined(dest / MOMENTS, outs[MOMENTS].schema))
            _read_again(parts, outs, progress)
        for out in outs.values():
            out.finish()
    rows = {name: outs[name].rows for name in (MOMENTS, WINDOWS, *schemas) if name in outs}
    text = card(rows, len(parts), clock_method(options), asdict(options))
    write_new_file(dest / CARD, [text.encode()])
    return ()


def _read_again(parts: Sequence[Part], outs: Mapping[str, _Joined], progress: Progress) -> None:
    """Gather the moments of all parts once more, now that their columns are known."""
    moments = outs[MOMENTS]
    for done, part in enumerate(parts):
        progress("joining", done, len(parts))
        with StreamsReader(part.path) as streams:
            for rows in streams.batches(MOMENTS) if MOMENTS in streams.names else ():
                moments.extend(rows)
                _write_the_largest(outs)


def _write_the_largest(outs: Mapping[str, _Joined]) -> None:
    """If all that is gathered is too much, write that of the file of which it is the most: a row group."""
    if sum(out.gathered_bytes for out in outs.values()) >= _GATHERED_BYTES:
        max(outs.values(), key=lambda out: out.gathered_bytes).write()


class _Joined(AbstractContextManager["_Joined"]):
    """A Parquet file with row groups of many small batches, and the columns of any of those in the first row group."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.schema, self.rows, self.gathered_bytes = schema, 0, 0
        self.outgrown = False
        """Columns have come later: the file is worth nothing, but ``schema`` has all that there are."""
        self._path = path
        self._out: pq.ParquetWriter | None = None
        self._gathered: list[pa.RecordBatch] = []
        self._combined = 0

    def widen(self, schema: pa.Schema) -> None:
        """Take the columns of ``schema`` that are new behind those that there are."""
        known = set(self.schema.names)
        columns = [] if schema is self.schema else [field for field in schema if field.name not in known]
        if not columns:
            return
        self.schema = pa.schema([*self.schema, *columns])
        if self._out is not None:
            self.outgrown = True
            self._forget()
        self._gathered = [_with_columns(rows, self.schema) for rows in self._gathered]
        self.gathered_bytes = sum(rows.nbytes for rows in self._gathered)

    def extend(self, rows: pa.RecordBatch) -> None:
        """Put these rows behind the others; what columns they have is known."""
        if self.outgrown:
            return
        # nulls take room as well
        self._gathered.append(_with_columns(rows, self.schema))
        self.rows += rows.num_rows
        self.gathered_bytes += self._gathered[-1].nbytes
        if len(self._gathered) - self._combined >= _BATCHES_AT_ONCE:
            # a batch of a few rows takes kilobytes
            self._gathered[self._combined :] = self._since(self._combined).combine_chunks().to_batches()
            self._combined = len(self._gathered)

    def write(self) -> None:
        """Write what is gathered."""
        if self._out is None:
            self._out = pq.ParquetWriter(self._path, self.schema, compression="zstd")
        if self._gathered:
            self._out.write_table(self._since(0))
        self._forget()

    def finish(self) -> None:
        """Write what is left."""
        self.write()
        self._close()

    def _since(self, first: int) -> pa.Table:
        return pa.Table.from_batches(self._gathered[first:], self.schema)

    def _forget(self) -> None:
        self._gathered.clear()
        self._combined = self.gathered_bytes = 0

    def _close(self) -> None:
        if self._out is not None:
            self._out.close()

    def __exit__(self, *failure: object) -> None:
        self._close()


def _with_columns(rows: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    """The same rows, with nulls in the columns of ``schema`` that they do not have."""
    names = rows.schema.names
    if names == schema.names:
        return rows
    there = set(names)
    columns = [
        rows[field.name] if field.name in there else pa.nulls(rows.num_rows, field.type) for field in schema
    ]
    return pa.record_batch(columns, schema=schema)


FORMAT = Format(
    name="parquet",
    description="all tables, moments of episodes and windows as Parquet files with a dataset card",
    part=write_part,
    merge=merge,
    options=TidyOptions,
    version="4",
)
