"""Moments as arrays that :class:`ecat.datasets.Windows` maps into memory.

    dataset.json        names of the columns, labels, how the clock was made, the options
    episodes.parquet    a row per episode: session, event, task, label, performer, rows of the arrays
    t_ns.npy            (n,) int64, time since the session's start
    state.npy           (n, S) float32, NaN where nothing is known
    action.npy          (n, A) float32
    label.npy           (n,) int16, the episode's label
    part.npy            (n,) int16, label of the innermost part of the event at this moment, -1 without one
    images/<stream>.bin images one after the other, JPEG or raw; <stream>.npy (n + 1,) uint64, where each begins

What it cannot carry: relations, shapes, depth images, and what happens between the moments.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.formats.datasets.arrays import ArrayFile, mapped
from ecat.formats.datasets.images import EpisodeImages
from ecat.formats.datasets.options import DatasetOptions
from ecat.formats.episode_plan import Plan
from ecat.formats.episodes import Episode, clock_method, left_behind
from ecat.formats.format import Format, Part
from ecat.formats.stream_names import plain_name, require_unlike
from ecat.progress import Progress
from ecat.stages.resample import ROUNDED_NS
from ecat.store import Session, files, write_new_file

ABOUT = "dataset.json"
EPISODES = "episodes.parquet"
VERSION = 1
ROWS: Mapping[str, str] = {"t_ns": "<i8", "label": "<i2", "part": "<i2"}
"""Arrays with one number a row."""
MATRICES = ("state", "action")
_EPISODE = pa.schema(
    [
        pa.field("episode", pa.int64()),
        pa.field("session", pa.string()),
        pa.field("event", pa.string()),
        pa.field("task", pa.string()),
        pa.field("label", pa.string()),
        pa.field("performer", pa.string()),
        pa.field("moved", pa.string()),
        pa.field("start_ns", pa.int64()),
        pa.field("end_ns", pa.int64()),
        pa.field("first_row", pa.int64()),
        pa.field("rows", pa.int64()),
    ]
)
_ROWS_AT_ONCE = 1 << 16


@dataclass
class _Dataset:
    """What ``dataset.json`` says."""

    names: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    labels: list[str] = field(default_factory=list[str])
    parts: list[str] = field(default_factory=list[str])
    streams: list[str] = field(default_factory=list[str])
    rows: int = 0
    episodes: int = 0

    def note(self, kind: str, names: Iterable[str]) -> None:
        """Add names that are not among those of a kind yet, in the order in which they come."""
        known = self.names.setdefault(kind, [])
        known += [name for name in names if name not in known]


def write_part(
    session: Session, label: str, dest: Path, options: DatasetOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the episodes of one session to the folder ``dest``.

    Raises
    ------
    InputError : there is no episode, or no clock; or two streams would have the same name.
    """
    plan = Plan(session, label, options)
    files.make_folders(dest / "images")
    rows: list[dict[str, Any]] = []
    about = _Dataset()
    with EpisodeImages(session, options) as images, ExitStack() as stack:
        writer: _Writer | None = None
        for number, episode in enumerate(plan.episodes()):
            progress(label, number, len(plan))
            if writer is None:
                about.note("state", episode.state_names)
                about.note("action", episode.action_names)
                about.streams = list(images.names)
                writer = stack.enter_context(_Writer(dest, about))
            rows.append(_row(episode, about.rows))
            writer.add(episode, images)
    if not rows:
        raise InputError(
            f"cannot export {label}",
            where="there is no episode in it",
            fix="ecat formats NAME explains the options",
        )
    _finish(dest, about, rows, options)
    return (*plan.findings, *left_behind(session, plan.layer, "the data set", about.streams))


class _Writer(ExitStack):
    """The arrays of one session, episode by episode."""

    def __init__(self, folder: Path, about: _Dataset) -> None:
        super().__init__()
        self._about = about
        self._files = _array_files(self, folder, about)
        self._images = {name: _Blobs(self, folder / "images", name) for name in about.streams}

    def add(self, episode: Episode, images: EpisodeImages) -> None:
        """Append an episode."""
        about, n = self._about, len(episode)
        self._files["t_ns"].write(episode.times_ns)
        self._files["state"].write(_by_name(episode.state, episode.state_names, about.names["state"]))
        self._files["action"].write(_by_name(episode.action, episode.action_names, about.names["action"]))
        self._files["label"].write(np.full(n, _index(about.labels, _label(episode))))
        self._files["part"].write(_parts(episode, about.parts))
        for name, blobs in self._images.items():
            for image in images.encoded(episode, name):
                blobs.write(image)
        about.rows += n
        about.episodes += 1


class _Blobs:
    """Images one after the other, and where each begins."""

    def __init__(self, stack: ExitStack, folder: Path, name: str) -> None:
        stem = plain_name(name)
        self._file = stack.enter_context((folder / f"{stem}.bin").open("wb"))
        self._offsets = stack.enter_context(ArrayFile(folder / f"{stem}.npy", (), "<u8"))
        self._end = 0
        self._offsets.write(np.zeros(1, np.uint64))

    def write(self, blob: bytes) -> None:
        self._file.write(blob)
        self._end += len(blob)
        self._offsets.write(np.array([self._end], np.uint64))

    def append(self, folder: Path, name: str) -> None:
        """All images of another data set, as they are."""
        stem = plain_name(name)
        with (folder / f"{stem}.bin").open("rb") as source:
            shutil.copyfileobj(source, self._file, 1 << 20)
        offsets: NDArray[Any] = mapped(folder / f"{stem}.npy")
        for start in range(1, len(offsets), _ROWS_AT_ONCE):
            self._offsets.write(offsets[start : start + _ROWS_AT_ONCE] + np.uint64(self._end))
        self._end += int(offsets[-1])

    def skip(self, n: int) -> None:
        """No image for so many moments."""
        self._offsets.write(np.full(n, self._end, np.uint64))


def _array_files(stack: ExitStack, folder: Path, about: _Dataset) -> dict[str, ArrayFile]:
    shapes = {name: ((), dtype) for name, dtype in ROWS.items()} | {
        name: ((len(about.names.get(name, [])),), "<f4") for name in MATRICES
    }
    return {
        name: stack.enter_context(ArrayFile(folder / f"{name}.npy", shape, dtype))
        for name, (shape, dtype) in shapes.items()
    }


def _label(episode: Episode) -> str:
    return episode.type or episode.task


def _index(known: list[str], name: str) -> int:
    if name not in known:
        known.append(name)
    return known.index(name)


def _parts(episode: Episode, known: list[str]) -> NDArray[np.int16]:
    """The innermost part at each moment; of two as deep, the later one."""
    found = np.full(len(episode), -1, np.int16)
    for part in sorted(episode.subtasks, key=lambda part: (part.level, part.start_ns)):
        late = episode.times_ns + ROUNDED_NS
        inside = (late >= part.start_ns) & (late < part.end_ns)
        found[inside] = _index(known, part.type or part.text)
    return found


def _by_name(values: NDArray[np.float32], names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.float32]:
    """Columns by name; NaN where there is no such column."""
    if list(names) == list(wanted):
        return values
    found = np.full((len(values), len(wanted)), np.nan, np.float32)
    place = {name: i for i, name in enumerate(wanted)}
    for i, name in enumerate(names):
        if name in place:
            found[:, place[name]] = values[:, i]
    return found


def _row(episode: Episode, first_row: int) -> dict[str, Any]:
    return {
        "session": episode.session,
        "event": episode.event,
        "task": episode.task,
        "label": _label(episode),
        "performer": episode.performer,
        "moved": episode.moved,
        "start_ns": episode.start_ns,
        "end_ns": episode.end_ns,
        "first_row": first_row,
        "rows": len(episode),
    }


def _finish(folder: Path, about: _Dataset, rows: list[dict[str, Any]], options: DatasetOptions) -> None:
    table = pa.Table.from_pylist([{"episode": i, **row} for i, row in enumerate(rows)], schema=_EPISODE)
    pq.write_table(table, folder / EPISODES, compression="zstd")
    _write_about(folder, about, options)


def _write_about(folder: Path, about: _Dataset, options: DatasetOptions) -> None:
    said = {
        "format": "ecat-torch",
        "version": VERSION,
        "rows": about.rows,
        "episodes": about.episodes,
        "state": about.names.get("state", []),
        "action": about.names.get("action", []),
        "labels": about.labels,
        "parts": about.parts,
        "streams": about.streams,
        "clock": clock_method(options),
        "options": asdict(options),
    }
    write_new_file(folder / ABOUT, [json.dumps(said, indent=1).encode()])


def merge(parts: Sequence[Part], dest: Path, options: DatasetOptions, progress: Progress) -> tuple[str, ...]:
    """Join the data sets of sessions: columns by their names, labels anew, images as they are.

    Raises
    ------
    InputError : two streams of different sessions would have the same name.
    """
    about, abouts = _Dataset(), [_read_about(part.path) for part in parts]
    for said in abouts:
        for kind in MATRICES:
            about.note(kind, said[kind])
        about.streams += [name for name in said["streams"] if name not in about.streams]
    require_unlike(about.streams, options.stream_names, taken=options.taken_names)
    files.make_folders(dest / "images")
    with ExitStack() as stack:
        arrays = _array_files(stack, dest, about)
        blobs = {name: _Blobs(stack, dest / "images", name) for name in about.streams}
        episodes = stack.enter_context(pq.ParquetWriter(dest / EPISODES, _EPISODE, compression="zstd"))
        for done, (part, said) in enumerate(zip(parts, abouts, strict=True)):
            progress("joining", done, len(parts))
            _append(part.path, said, about, arrays)
            for name, out in blobs.items():
                if name in said["streams"]:
                    out.append(part.path / "images", name)
                else:
                    out.skip(said["rows"])
            episodes.write_table(_shifted(pq.read_table(part.path / EPISODES), part.label, about))
            about.rows += said["rows"]
            about.episodes += said["episodes"]
    _write_about(dest, about, options)
    return ()


def _append(folder: Path, said: dict[str, Any], about: _Dataset, arrays: dict[str, ArrayFile]) -> None:
    label = np.array([_index(about.labels, name) for name in said["labels"]], np.int16)
    part = np.array([*(_index(about.parts, name) for name in said["parts"]), -1], np.int16)
    for name, out in arrays.items():
        rows = mapped(folder / f"{name}.npy")
        for start in range(0, len(rows), _ROWS_AT_ONCE):
            some: NDArray[Any] = rows[start : start + _ROWS_AT_ONCE]
            if name == "label":
                some = label[some]
            elif name == "part":
                some = part[some]
            elif name in MATRICES:
                some = _by_name(some, said[name], about.names[name])
            out.write(some)


def _shifted(rows: pa.Table, label: str, about: _Dataset) -> pa.Table:
    numbers = pa.array(range(about.episodes, about.episodes + rows.num_rows), pa.int64())
    first = pa.array(np.asarray(rows["first_row"]) + about.rows, pa.int64())
    names = pa.array([label] * rows.num_rows, pa.string())
    for name, column in (("episode", numbers), ("session", names), ("first_row", first)):
        rows = rows.set_column(rows.schema.get_field_index(name), _EPISODE.field(name), column)
    return rows


def _read_about(folder: Path) -> dict[str, Any]:
    return json.loads((folder / ABOUT).read_bytes())


FORMAT = Format(
    name="torch",
    description="moments of episodes as arrays for ecat.datasets.Windows: states, actions, labels, images",
    part=write_part,
    merge=merge,
    options=DatasetOptions,
)
