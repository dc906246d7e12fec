"""Samples in TAR files, for loaders that read from one end to the other: https://github.com/webdataset/webdataset.

    dataset.json                 names of the columns, labels, how the clock was made, the options
    data-000000.tar              samples, each a row of files with the same key
      <key>.json                 session, event, task, label, performer, times, names of the columns
      <key>.state.npy            (n, S) float32, NaN where nothing is known
      <key>.action.npy           (n, A) float32
      <key>.<stream>.<i>.jpg     the image of moment i; no file where the stream has none

What it cannot carry: relations, shapes, depth images, and what happens between the moments.
"""

from __future__ import annotations

import io
import json
import re
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.formats.datasets import torch_format
from ecat.formats.datasets.made import Columns, Made
from ecat.formats.datasets.options import PackedOptions
from ecat.formats.episodes import clock_method
from ecat.formats.format import Format, Part
from ecat.formats.options import option
from ecat.progress import Progress
from ecat.store import files, write_new_file

_MEGABYTE = 1 << 20
_BLOCK = tarfile.BLOCKSIZE
_NAME = 48
"""Characters of a session's label in a key: with the rest, fewer than the hundred that a TAR file has for a name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WebDatasetOptions(PackedOptions):
    """Options of the format, besides those of data sets."""

    samples: Literal["window", "episode"] = option("window", "what becomes one sample")
    window_s: float = option(1.0, "length of a window", least=0.001, most=86400)
    stride_s: float = option(0.5, "from the start of a window to that of the next", least=0.001, most=86400)
    shard_mb: int = option(256, "size of a TAR file at most; a larger sample has one alone", least=1)

    def stream_names(self, stream: str) -> tuple[str, ...]:
        """Of the images' files."""
        return (_safe(stream),)


@dataclass(frozen=True)
class _Sample:
    """Rows ``[start, end)`` of an episode's session."""

    key: str
    start: int
    end: int
    about: dict[str, Any]


class _Shards(AbstractContextManager["_Shards"]):
    """``data-000000.tar`` and so on; a sample is never in two."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        self.number, self.samples, self._size = 0, 0, 0
        self._tar: tarfile.TarFile | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def begin(self, n_bytes: int) -> None:
        """Make place for a sample of so many bytes, with its headers."""
        if self._tar is None or self._size + n_bytes > self._most_bytes:
            self._close()
            path = self._folder / f"data-{self.number:06d}.tar"
            self._tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115 - closed by _close
            # two empty blocks are at the end, and the rest of a record
            self.number, self._size = self.number + 1, tarfile.RECORDSIZE
        self.samples, self._size = self.samples + 1, self._size + n_bytes

    def add(self, name: str, data: bytes) -> None:
        """Append a file; whose it is and when it was made is left out, so that the same data are the same bytes."""
        assert self._tar is not None
        member = tarfile.TarInfo(name)
        member.size = len(data)
        self._tar.addfile(member, io.BytesIO(data))

    def _close(self) -> None:
        if self._tar is not None:
            self._tar.close()
            self._tar = None


def merge(
    parts: Sequence[Part], dest: Path, options: WebDatasetOptions, progress: Progress
) -> tuple[str, ...]:
    """Pack the moments of sessions into TAR files: columns by their names, images as they are.

    Raises
    ------
    InputError : no episode is as long as a window; or two streams would have the same name.
    """
    columns = Columns.of(parts, options)
    files.make_folders(dest)
    short = 0
    with _Shards(dest, options.shard_mb * _MEGABYTE) as shards:
        for done, part in enumerate(parts):
            progress("joining", done, len(parts))
            with Made(part, columns) as made:
                for episode in made.episodes:
                    samples = list(_samples(part.label, done, episode, options))
                    short += not samples
                    for sample in samples:
                        _write(shards, made, sample, columns)
        if not shards.samples:
            raise InputError(
                "cannot make samples",
                where=f"none of {columns.episodes:,} episodes is as long as a window of {options.window_s:g} s",
                consequence="nothing was written",
                fix="window_s=0.2 makes shorter ones, samples=episode has no windows",
            )
        _write_about(dest, columns, shards, options)
    if short:
        return (f"{short:,} of {columns.episodes:,} episodes are shorter than a window and have no sample",)
    return ()


def _samples(
    label: str, number: int, episode: dict[str, Any], options: WebDatasetOptions
) -> Iterator[_Sample]:
    rows, first = episode["rows"], episode["first_row"]
    length = stride = rows
    if options.samples == "window":
        length = max(round(options.window_s * options.fps), 1)
        stride = max(round(options.stride_s * options.fps), 1)
    # labels may differ in what a key cannot have: the number tells them apart
    name = f"{number:06d}_{_safe(label)[:_NAME]}_{episode['episode']:06d}"
    about = {
        key: episode[key] for key in ("event", "task", "label", "performer", "moved", "start_ns", "end_ns")
    }
    for window, offset in enumerate(range(0, rows - length + 1, stride)):
        places = {"session": label, "episode": episode["episode"], "window": window, "first_moment": offset}
        start = first + offset
        yield _Sample(f"{name}_{window:06d}", start, start + length, places | about)


def _safe(text: str) -> str:
    """Without dots, which end a key, and whatever else file systems and shells read into names."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", text)


def _write(shards: _Shards, made: Made, sample: _Sample, columns: Columns) -> None:
    start, end = sample.start, sample.end
    about = sample.about | {
        "t_ns": made.times_ns(start, end).tolist(),
        "subtasks": made.subtasks(start, end),
        "state_names": columns.state,
        "action_names": columns.action,
    }
    members = {
        "json": json.dumps(about).encode(),
        "state.npy": _npy(made.numbers("state", start, end)),
        "action.npy": _npy(made.numbers("action", start, end)),
    }
    sizes = [len(data) for data in members.values()]
    for stream in made.streams:
        sizes += [int(size) for size in made.sizes(stream, start, end) if size]
    shards.begin(sum(_BLOCK + -(-size // _BLOCK) * _BLOCK for size in sizes))
    for name, data in members.items():
        shards.add(f"{sample.key}.{name}", data)
    for stream in made.streams:
        for i in range(end - start):
            if jpeg := made.jpeg(stream, start + i):
                shards.add(f"{sample.key}.{_safe(stream)}.{i:06d}.jpg", jpeg)


def _npy(values: NDArray[np.float32]) -> bytes:
    file = io.BytesIO()
    np.save(file, values.astype("<f4", copy=False), allow_pickle=False)
    return file.getvalue()


def _write_about(folder: Path, columns: Columns, shards: _Shards, options: WebDatasetOptions) -> None:
    said = {
        "format": "ecat-webdataset",
        "version": 1,
        "samples": shards.samples,
        "shards": shards.number,
        **asdict(columns),
        "clock": clock_method(options),
        "options": asdict(options),
    }
    write_new_file(folder / torch_format.ABOUT, [json.dumps(said, indent=1).encode()])


FORMAT = Format(
    name="webdataset",
    description="windows or episodes as samples in TAR files, for webdataset and other sequential loaders",
    part=torch_format.write_part,
    merge=merge,
    options=WebDatasetOptions,
    version=f"{torch_format.FORMAT.version}.1",
)
