"""Writes a LeRobot data set, episode after episode; memory does not grow with their number."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.formats.lerobot import language, layout, stats
from ecat.formats.lerobot.depth import depths_mm
from ecat.formats.lerobot.language import Entry
from ecat.formats.lerobot.layout import CHUNK_SIZE, DATA_MB, VIDEO_MB, Layout, file_name
from ecat.formats.lerobot.video import Clip, Kind, Place, VideoFiles
from ecat.store import files, write_new_file

MB = 1 << 20
PRIVATE = "meta/part"
"""Where it is kept what joining parts needs and a LeRobot data set does not have."""
_EPISODES_AT_ONCE = 100


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """How often values occur in images (:class:`ecat.formats.lerobot.video.Sampler`), and in how many of them."""

    counts: NDArray[np.int64]
    n_images: int


@dataclass(frozen=True, kw_only=True)
class Facts:
    """Where an episode comes from; columns of ``meta/episodes`` that LeRobot itself does not have."""

    session: str
    event: str
    performer: str
    start_ns: int
    end_ns: int


@dataclass(frozen=True, kw_only=True)
class Record:
    """One episode as it is to be written.

    ``vectors``: (n, k) for each of :attr:`Layout.vectors`.  ``clips``: by video key; where a clip has no sampler,
    ``sampled`` has what one counted.
    """

    task: str
    n: int
    vectors: Mapping[str, NDArray[Any]]
    said: Sequence[Entry]
    clips: Mapping[str, Clip]
    facts: Facts
    sampled: Mapping[str, Sampled] = field(default_factory=dict[str, Sampled])


class ParquetFiles(AbstractContextManager["ParquetFiles"]):
    """``folder/chunk-000/file-000.parquet`` and so on, none much larger than ``most_bytes``; a table is a row group."""

    def __init__(self, root: Path, folder: str, schema: pa.Schema, *, most_bytes: int) -> None:
        self._root, self._folder, self._schema, self._most_bytes = root, folder, schema, most_bytes
        self.number = -1
        self._file: BinaryIO | None = None
        self._writer: pq.ParquetWriter | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def make_room(self, n_bytes: int) -> tuple[int, int]:
        """Begin a new file if so much more would be too much for this one; returns its chunk and number."""
        if self._file is None or (self._file.tell() > 0 and self._file.tell() + n_bytes > self._most_bytes):
            self.close()
            self.number += 1
            path = self._root / file_name(self._folder, self.number)
            files.make_folders(path.parent)
            files.step("write", path)
            self._file = path.open("wb")
            self._writer = pq.ParquetWriter(
                self._file, self._schema, compression="snappy", use_dictionary=True
            )
        return divmod(self.number, CHUNK_SIZE)

    def write(self, table: pa.Table) -> None:
        """Append a row group, in the file that there is room in."""
        assert self._writer is not None
        self._writer.write_table(table, row_group_size=max(table.num_rows, 1))

    def close(self) -> None:
        """Write the footer of the last file."""
        if self._writer is not None and self._file is not None:
            self._writer.close()
            self._file.close()
        self._file = self._writer = None


class DatasetWriter(AbstractContextManager["DatasetWriter"]):
    """Writes into the folder ``root``, which is made; :meth:`finish` completes it.

    ``private`` also keeps what joining needs.
    """

    def __init__(self, root: Path, shape: Layout, *, private: bool) -> None:
        self._root, self._layout = root, shape
        self._schema = shape.schema()
        self.tasks: dict[str, int] = {}
        self.subtasks: dict[str, int] = {}
        self.n_frames = self.n_episodes = 0
        self._moments = {key: stats.Moments() for key in shape.numbers}
        self._images: dict[str, Sampled] = {}
        files.make_folders(root / "meta")
        with ExitStack() as stack:
            self._data = stack.enter_context(
                ParquetFiles(root, "data", self._schema, most_bytes=DATA_MB * MB)
            )
            self._videos = {
                key: stack.enter_context(
                    VideoFiles(
                        root / "videos" / key, shape.fps, most_bytes=VIDEO_MB * MB, chunk_size=CHUNK_SIZE
                    )
                )
                for key in shape.views
            }
            self._episodes = stack.enter_context(_Rows(root, "meta/episodes", DATA_MB * MB))
            self._private = stack.enter_context(_Rows(root, PRIVATE, DATA_MB * MB)) if private else None
            self._stack = stack.pop_all()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def add(self, record: Record) -> None:
        """Append an episode."""
        columns = self._columns(record)
        table = self._table(columns, record)
        chunk, number = self._data.make_room(table.nbytes)
        self._data.write(table)
        said = {key: stats.of_rows(values) for key, values in columns.items()}
        places: dict[str, Place] = {}
        for key, files_of in self._videos.items():
            places[key] = files_of.add(record.clips[key])
            seen = _sampled(record, key)
            said[key] = image_stats(self._layout.views[key].kind, seen)
            self._count(key, seen)
        for key, moments in self._moments.items():
            moments.add(said[key])
        self._episodes.add(self._row(record, (chunk, number), places, said))
        if self._private is not None:
            self._private.add(_private_row(record, places))
        self.n_frames += record.n
        self.n_episodes += 1

    def finish(self, splits: Mapping[str, str]) -> None:
        """Write what is known only in the end."""
        self._stack.close()
        shape = self._layout
        _write_names(self._root / "meta/tasks.parquet", self.tasks, "task", "task_index")
        if shape.language == "index":
            _write_names(self._root / "meta/subtasks.parquet", self.subtasks, "subtask", "subtask_index")
        info = {
            "codebase_version": layout.VERSION,
            "robot_type": "human",
            "total_episodes": self.n_episodes,
            "total_frames": self.n_frames,
            "total_tasks": len(self.tasks),
            "chunks_size": CHUNK_SIZE,
            "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "fps": shape.fps,
            "splits": dict(splits),
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
            if shape.views
            else None,
            "features": shape.features(),
        }
        write_json(self._root / "meta/stats.json", self._global_stats())
        write_json(self._root / "meta/info.json", info)

    # ------------------------------------------------------------------------------------- one episode

    def _columns(self, record: Record) -> dict[str, NDArray[Any]]:
        """The numbers (n, k) of an episode, by column."""
        n, rows = record.n, np.arange(record.n)
        columns: dict[str, NDArray[Any]] = {key: record.vectors[key] for key in self._layout.vectors}
        ours: dict[str, NDArray[Any]] = {
            "timestamp": (rows / self._layout.fps).astype(np.float32),
            "frame_index": rows,
            "episode_index": np.full(n, self.n_episodes),
            "index": self.n_frames + rows,
            "task_index": np.full(n, self.tasks.setdefault(record.task, len(self.tasks))),
        }
        if self._layout.language == "index":
            names = language.subtasks(record.said, n)
            ours[layout.SUBTASK] = np.array(
                [self.subtasks.setdefault(name, len(self.subtasks)) for name in names]
            )
        return columns | {key: values.reshape(n, 1) for key, values in ours.items()}

    def _table(self, columns: Mapping[str, NDArray[Any]], record: Record) -> pa.Table:
        arrays: list[pa.Array[Any]] = []
        for column in self._schema:
            if column.name == language.PERSISTENT:
                times = columns["timestamp"].ravel()
                arrays.append(language.persistent_column(record.said, times, record.facts.session))
            elif column.name == language.EVENTS:
                arrays.append(language.events_column(record.n))
            else:
                arrays.append(layout.arrow_column(columns[column.name], column.type))
        return pa.Table.from_arrays(arrays, schema=self._schema)

    def _row(
        self,
        record: Record,
        data: tuple[int, int],
        places: Mapping[str, Place],
        said: Mapping[str, stats.Stats],
    ) -> dict[str, Any]:
        """The episode in ``meta/episodes``, with the columns of lerobot 0.4.4 in its order, and then ours."""
        row: dict[str, Any] = {
            "episode_index": self.n_episodes,
            "tasks": [record.task],
            "length": record.n,
            "data/chunk_index": data[0],
            "data/file_index": data[1],
            "dataset_from_index": self.n_frames,
            "dataset_to_index": self.n_frames + record.n,
        }
        for key, place in places.items():
            row |= {
                f"videos/{key}/chunk_index": place.chunk,
                f"videos/{key}/file_index": place.file,
                f"videos/{key}/from_timestamp": place.from_s,
                f"videos/{key}/to_timestamp": place.to_s,
            }
        order = [key for key in self._layout.features() if key in said]
        for key in order:
            row |= {f"stats/{key}/{name}": value for name, value in stats.as_json(said[key]).items()}
        facts = record.facts
        return row | {
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "session": facts.session,
            "event": facts.event,
            "performer": facts.performer,
            "start_ns": facts.start_ns,
            "end_ns": facts.end_ns,
        }

    def _count(self, key: str, seen: Sampled) -> None:
        before = self._images.get(key)
        self._images[key] = (
            seen
            if before is None
            else Sampled(counts=before.counts + seen.counts, n_images=before.n_images + seen.n_images)
        )

    # -------------------------------------------------------------------------------------- everything

    def _global_stats(self) -> dict[str, Any]:
        histograms = {
            key: stats.Histogram(moments.least, moments.greatest) for key, moments in self._moments.items()
        }
        for group in self._written():
            for key, histogram in histograms.items():
                column: Any = group[key].combine_chunks()
                values = column.flatten() if pa.types.is_fixed_size_list(column.type) else column
                histogram.add(values.to_numpy(zero_copy_only=False).reshape(group.num_rows, -1))
        found: dict[str, Any] = {}
        for key in self._layout.features():
            if key in self._images:
                found[key] = stats.as_json(image_stats(self._layout.views[key].kind, self._images[key]))
            elif key in self._moments:
                moments = self._moments[key]
                whole: dict[str, NDArray[Any]] = {
                    "min": moments.least,
                    "max": moments.greatest,
                    "mean": moments.mean,
                    "std": np.sqrt(moments.square / moments.count),
                    "count": np.array([moments.count]),
                }
                found[key] = stats.as_json(whole | dict(histograms[key].quantiles()))
        return found

    def _written(self) -> Iterator[pa.Table]:
        """The rows written, an episode at a time."""
        for number in range(self._data.number + 1):
            with pq.ParquetFile(self._root / file_name("data", number)) as file:
                for group in range(file.num_row_groups):
                    yield file.read_row_group(group, columns=list(self._moments))


class _Rows(AbstractContextManager["_Rows"]):
    """Rows that come one by one, in Parquet files; the first ones tell the columns."""

    def __init__(self, root: Path, folder: str, most_bytes: int) -> None:
        self._root, self._folder, self._most_bytes = root, folder, most_bytes
        self._waiting: list[dict[str, Any]] = []
        self._files: ParquetFiles | None = None
        self._schema: pa.Schema | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._flush()
        if self._files is not None:
            self._files.close()

    def add(self, row: dict[str, Any]) -> None:
        """Append a row, sooner or later."""
        self._waiting.append(row)
        if len(self._waiting) >= _EPISODES_AT_ONCE:
            self._flush()

    def _flush(self) -> None:
        if not self._waiting:
            return
        table = pa.Table.from_pylist(self._waiting, schema=self._schema)
        if self._files is None:
            self._schema = table.schema
            self._files = ParquetFiles(self._root, self._folder, table.schema, most_bytes=self._most_bytes)
        chunk, number = self._files.make_room(table.nbytes)
        for name, value in (("meta/episodes/chunk_index", chunk), ("meta/episodes/file_index", number)):
            if name in table.column_names:
                filled: Any = pa.array(np.full(table.num_rows, value))
                table = table.set_column(table.schema.get_field_index(name), name, filled)
        self._files.write(table)
        self._waiting.clear()


def image_stats(kind: Kind, seen: Sampled) -> stats.Stats:
    """Of colour images from 0 to 1, of depth in millimetres."""
    values = np.arange(256) / 255 if kind == "color" else depths_mm()
    return stats.of_histogram(seen.counts, values, seen.n_images)


def _sampled(record: Record, key: str) -> Sampled:
    sampler = record.clips[key].sampler
    if sampler is None:
        return record.sampled[key]
    return Sampled(counts=sampler.counts, n_images=sampler.n_images)


def _private_row(record: Record, places: Mapping[str, Place]) -> dict[str, Any]:
    said = [[entry.row, entry.style, entry.content] for entry in record.said]
    row: dict[str, Any] = {"said": json.dumps(said)}
    for key, place in places.items():
        seen = _sampled(record, key)
        row |= {
            f"{key}/bytes": place.n_bytes,
            f"{key}/images": seen.n_images,
            f"{key}/counts": seen.counts.ravel().tolist(),
        }
    return row


def _write_names(path: Path, names: Mapping[str, int], index: str, column: str) -> None:
    """As pandas writes a table whose index is the names: lerobot reads it with pandas."""
    import pandas as pd

    frame = pd.DataFrame(
        {column: list(names.values())}, index=pd.Index(list(names), name=index, dtype=object)
    )
    files.step("write", path)
    frame.to_parquet(path)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """As lerobot writes it."""
    write_new_file(path, [json.dumps(content, indent=4, ensure_ascii=False).encode()])
