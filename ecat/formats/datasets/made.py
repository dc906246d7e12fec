"""What ``--format torch`` makes of one session, read again for data sets that pack the same moments differently."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.formats.datasets.arrays import mapped
from ecat.formats.datasets.options import DatasetOptions
from ecat.formats.datasets.torch_format import ABOUT, EPISODES, MATRICES, ROWS
from ecat.formats.format import Part
from ecat.formats.stream_names import plain_name, require_unlike


@dataclass
class Columns:
    """What all parts have between them, in the order in which it comes: names of columns, streams and labels."""

    state: list[str] = field(default_factory=list[str])
    action: list[str] = field(default_factory=list[str])
    streams: list[str] = field(default_factory=list[str])
    labels: list[str] = field(default_factory=list[str])
    episodes: int = 0

    @classmethod
    def of(cls, parts: Sequence[Part], options: DatasetOptions) -> Columns:
        """The columns of a data set that is made of these parts.

        Raises
        ------
        InputError : two streams of different sessions would have the same name.
        """
        found = cls()
        for part in parts:
            about = _read_about(part)
            for name in (*MATRICES, "streams", "labels"):
                _add(getattr(found, name), about[name])
            found.episodes += about["episodes"]
        require_unlike(found.streams, options.stream_names, taken=options.taken_names)
        return found


class Made(ExitStack):
    """The moments of one session; arrays are mapped into memory, images are read one at a time."""

    def __init__(self, part: Part, columns: Columns) -> None:
        super().__init__()
        about = _read_about(part)
        self.episodes: list[dict[str, Any]] = pq.read_table(part.path / EPISODES).to_pylist()
        self.streams: list[str] = about["streams"]
        self._arrays: dict[str, NDArray[Any]] = {
            name: mapped(part.path / f"{name}.npy") for name in (*ROWS, *MATRICES)
        }
        self._places = {name: _places(about[name], getattr(columns, name)) for name in MATRICES}
        self._labels = np.array([*about["parts"], ""], object)
        stems = {name: part.path / "images" / plain_name(name) for name in self.streams}
        self._offsets: dict[str, NDArray[Any]] = {
            name: mapped(stem.with_name(f"{stem.name}.npy")) for name, stem in stems.items()
        }
        self._files = {
            name: self.enter_context(stem.with_name(f"{stem.name}.bin").open("rb"))
            for name, stem in stems.items()
        }

    def times_ns(self, start: int, end: int) -> NDArray[np.int64]:
        """Times (end - start,) of these rows since the session's start."""
        return np.array(self._arrays["t_ns"][start:end])

    def numbers(self, name: str, start: int, end: int) -> NDArray[np.float32]:
        """``state`` or ``action`` (end - start, k) of these rows, all columns of the data set; NaN where unknown."""
        rows = self._arrays[name][start:end]
        # the last column, which -1 means, is that of names which this session does not have
        padded = np.concatenate([rows, np.full((len(rows), 1), np.nan, np.float32)], axis=1)
        return np.ascontiguousarray(padded[:, self._places[name]], np.float32)

    def subtasks(self, start: int, end: int) -> list[str]:
        """The innermost part of the event at each of these rows; empty where there is none."""
        return list(self._labels[self._arrays["part"][start:end]])

    def sizes(self, stream: str, start: int, end: int) -> NDArray[np.int64]:
        """Bytes (end - start,) of the images of these rows, 0 where there is none."""
        return np.diff(self._offsets[stream][start : end + 1].astype(np.int64))

    def jpeg(self, stream: str, row: int) -> bytes:
        """The image of a row; nothing where there is none."""
        start, end = (int(offset) for offset in self._offsets[stream][row : row + 2])
        file = self._files[stream]
        file.seek(start)
        return file.read(end - start)


def _read_about(part: Part) -> dict[str, Any]:
    return json.loads((part.path / ABOUT).read_bytes())


def _add(known: list[str], names: Iterable[str]) -> None:
    known += [name for name in names if name not in known]


def _places(names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.intp]:
    place = {name: i for i, name in enumerate(names)}
    return np.array([place.get(name, -1) for name in wanted], np.intp)
