"""Sessions as plain Parquet files that pandas, Polars, DuckDB, R or Hugging Face ``datasets`` open without ecat.

    README.md            what it is: a dataset card, with a configuration for each file
    moments.parquet      a row for each moment of each episode: state and action by the names of their columns
    windows.parquet      stretches of moments of equal length, each with the label of its episode
    tables/<name>.parquet the tables of all sessions as they are, with the session's name in front

Parts, which are private, hold the same as Arrow files: most sessions are small, and a small Parquet file takes ten
times as long to write and to read.

What it cannot carry: images, which stay in the sessions (``torch``, ``webdataset`` and ``lerobot`` have them).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ecat.errors import InputError
from ecat.formats.datasets.card import CARD, card
from ecat.formats.episode_plan import Plan
from ecat.formats.episodes import IMAGE_KINDS, Episode, EpisodeOptions, clock_method
from ecat.formats.format import Format, Part
from ecat.formats.options import option
from ecat.progress import Progress
from ecat.stages.resample import NS
from ecat.store import Session, files, write_new_file
from ecat.tables import TABLES

MOMENTS, WINDOWS = "moments.parquet", "windows.parquet"
_ABOUT = "about.json"
_SESSION = pa.field("session", pa.string(), metadata={"meaning": "the session's folder"})
_FRAMES_AT_ONCE = 1 << 15
_ROWS_OF_GROUP = 1 << 16
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
    """Write one session to the folder ``dest``."""
    files.make_folders(dest / "tables")
    if options.tables:
        for name in session.tables:
            _write_table(session, name, label, dest / "tables" / f"{name}.arrow")
    try:
        plan = Plan(session, label, options)
    except InputError as error:
        if not options.tables:
            raise
        write_new_file(dest / _ABOUT, [json.dumps({"columns": []}).encode()])
        return (f"no moments: {(error.where or error.what).removeprefix(f'{label}: ')}", *_unseen(session))
    columns = _write_moments(plan, dest, label, options, progress)
    write_new_file(dest / _ABOUT, [json.dumps({"columns": columns}).encode()])
    return (*plan.findings, *_unseen(session))


def _unseen(session: Session) -> Iterator[str]:
    if streams := [
        s.name for s in session.manifest.streams if s.present and s.kind in (*IMAGE_KINDS, "audio")
    ]:
        yield f"streams left behind: {', '.join(streams)}"


def _write_table(session: Session, name: str, label: str, path: Path) -> None:
    schema = plain_schema(name)
    with _part_writer(path, schema) as out:
        for rows in _rows(session, name):
            columns: list[Any] = [pa.array([label] * rows.num_rows, pa.string())]
            columns += [_plain(rows[field.name], field.type) for field in list(schema)[1:]]
            out.write_table(pa.table(columns, schema=schema))


def _part_writer(path: Path, schema: pa.Schema) -> Any:
    return pa.ipc.new_file(str(path), schema, options=pa.ipc.IpcWriteOptions(compression="lz4"))


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


def _write_moments(plan: Plan, dest: Path, label: str, options: TidyOptions, progress: Progress) -> list[str]:
    columns: list[str] = []
    moments: Any = None
    with _part_writer((dest / WINDOWS).with_suffix(".arrow"), _WINDOW) as windows:
        try:
            for number, episode in enumerate(plan.episodes()):
                progress(label, number, len(plan))
                table = _moments(episode)
                if moments is None:
                    columns = table.schema.names[len(_MOMENT) :]
                    moments = _part_writer((dest / MOMENTS).with_suffix(".arrow"), table.schema)
                moments.write_table(table)
                windows.write_table(_windows(episode, options))
        finally:
            if moments is not None:
                moments.close()
    return columns


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
    """Join the files of all sessions, a row group of many at a time; moments by the names of their columns."""
    files.make_folders(dest / "tables")
    columns: list[str] = []
    for part in parts:
        said = json.loads((part.path / _ABOUT).read_bytes())["columns"]
        columns += [name for name in said if name not in columns]
    moments = pa.schema([*_MOMENT, *(pa.field(name, pa.float32()) for name in columns)])
    schemas = {MOMENTS: moments, WINDOWS: _WINDOW} | {
        f"tables/{name}.parquet": plain_schema(name) for name in TABLES
    }
    rows: dict[str, int] = {}
    for done, (name, schema) in enumerate(schemas.items()):
        progress("joining", done, len(schemas))
        found = [path for part in parts if (path := (part.path / name).with_suffix(".arrow")).exists()]
        if found:
            rows[name] = _join(found, dest / name, schema)
    text = card(rows, len(parts), clock_method(options), asdict(options))
    write_new_file(dest / CARD, [text.encode()])
    return ()


def _join(sources: Sequence[Path], dest: Path, schema: pa.Schema) -> int:
    n_rows = 0
    gathered: list[pa.Table] = []
    with pq.ParquetWriter(dest, schema, compression="zstd") as out:
        for rows in _batches(sources):
            columns = [
                rows[field.name] if field.name in rows.schema.names else pa.nulls(rows.num_rows, field.type)
                for field in schema
            ]
            gathered.append(pa.table(columns, schema=schema))
            n_rows += rows.num_rows
            if sum(table.num_rows for table in gathered) >= _ROWS_OF_GROUP:
                out.write_table(pa.concat_tables(gathered))
                gathered.clear()
        if gathered:
            out.write_table(pa.concat_tables(gathered))
    return n_rows


def _batches(sources: Sequence[Path]) -> Iterator[pa.RecordBatch]:
    for source in sources:
        # not mapped: what was read is kept after the file is closed
        with pa.OSFile(str(source), "rb") as opened, pa.ipc.open_file(opened) as file:
            for i in range(file.num_record_batches):
                yield file.get_batch(i)


FORMAT = Format(
    name="parquet",
    description="all tables, moments of episodes and windows as Parquet files with a dataset card",
    part=write_part,
    merge=merge,
    options=TidyOptions,
    version="2",
)
