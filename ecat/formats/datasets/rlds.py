"""Episodes as RLDS, the layout of Open X-Embodiment: TFRecord files that ``tensorflow_datasets`` reads.

    dataset_info.json, features.json                  what tensorflow_datasets wants to know
    ecat.json                                         names of the columns, how the clock was made, the options
    <name>-train.tfrecord-00000-of-00001              an episode per record:
      steps/observation/state        (n, S) float32   the last known number where nothing is known, and
      steps/observation/state_known  (n, S) bool      whether it is known
      steps/observation/<stream>     n JPEG images    likewise the last one, and
      steps/observation/<stream>_known  (n,) bool
      steps/action, steps/action_known                (n, A) as for the state
      steps/language_instruction, steps/subtask       the event's text, and the innermost part of it at each moment
      steps/is_first, is_last, is_terminal, reward, discount, t_ns
      episode_metadata/session, event, task, label, performer, moved, start_ns, end_ns

No reward was recorded: it is 1 at the last moment of each episode and 0 before, as usual for demonstrations.

What it cannot carry: relations, shapes, depth images, and what happens between the moments.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from ecat.formats.datasets import torch_format
from ecat.formats.datasets.made import Columns, Made
from ecat.formats.datasets.options import PackedOptions
from ecat.formats.datasets.tfrecord import RECORD, Blobs, Value, example_size, write_example
from ecat.formats.episodes import clock_method
from ecat.formats.format import Format, Part
from ecat.formats.options import option
from ecat.progress import Progress
from ecat.stages.resample import filled
from ecat.store import files, write_new_file

_VERSION = "1.0.0"
_MEGABYTE = 1 << 20
_MOST_BYTES = (1 << 31) - 1
"""Of a protobuf message."""
_TEXTS = ("session", "event", "task", "label", "performer", "moved")
_FEATURES = "tensorflow_datasets.core.features."


@dataclass(frozen=True, slots=True, kw_only=True)
class RldsOptions(PackedOptions):
    """Options of the format, besides those of data sets."""

    name: str = option("ecat", "of the data set: small letters, digits and _, a letter first")
    shard_mb: int = option(256, "size of a TFRecord file at most; a larger episode has one alone", least=1)
    taken_names: ClassVar[tuple[str, ...]] = ("state", "state_known")

    def stream_names(self, stream: str) -> tuple[str, ...]:
        """Of the images, and of whether there is one."""
        return (_safe(stream), f"{_safe(stream)}_known")


@dataclass
class Shapes:
    """Of the images of each stream: height and width, or -1 for what differs; how many moments have none."""

    sizes: dict[str, tuple[int, int]] = field(default_factory=dict[str, tuple[int, int]])
    held: int = 0

    def note(self, stream: str, size: tuple[int, int]) -> None:
        """One more size of images of this stream."""
        known = self.sizes.setdefault(stream, size)
        height, width = (a if a == b else -1 for a, b in zip(known, size, strict=True))
        self.sizes[stream] = height, width


class _Shards(AbstractContextManager["_Shards"]):
    """TFRecord files; their names say how many there are, which is known in the end."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        self._file: BinaryIO | None = None
        self._size = 0
        self.lengths: list[int] = []
        self.n_bytes = 0

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def add(self, features: Mapping[str, Value], size: int) -> None:
        """Append a record of so many bytes."""
        if self._file is None or self._size + size + RECORD > self._most_bytes:
            self._close()
            self._file = self._path(len(self.lengths)).open("wb")
            self.lengths.append(0)
            self._size = 0
        self.n_bytes += write_example(self._file, features)
        self._size += size + RECORD
        self.lengths[-1] += 1

    def finish(self, name: str) -> None:
        """Give the files their names."""
        self._close()
        n = len(self.lengths)
        for i in range(n):
            files.rename(self._path(i), self._folder / f"{name}-train.tfrecord-{i:05d}-of-{n:05d}")

    def _path(self, number: int) -> Path:
        return self._folder / f"{number:05d}.tfrecord"

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def merge(parts: Sequence[Part], dest: Path, options: RldsOptions, progress: Progress) -> tuple[str, ...]:
    """Pack the episodes of sessions into records: columns by their names, images as they are.

    Raises
    ------
    UsageError : a name that tensorflow_datasets does not allow.
    InputError : an episode that is too large for a record; or two streams would have the same name.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", options.name):
        raise UsageError(
            f"rlds cannot be told name={options.name}",
            where="name: expected small letters, digits and _, a letter first",
            fix="name=my_recordings",
        )
    columns, shapes = Columns.of(parts, options), Shapes()
    files.make_folders(dest)
    for part in parts:
        with Made(part, columns) as made:
            _note_sizes(made, shapes)
    with _Shards(dest, options.shard_mb * _MEGABYTE) as shards:
        for done, part in enumerate(parts):
            progress("joining", done, len(parts))
            with Made(part, columns) as made:
                for episode in made.episodes:
                    features = _record(made, part.label, episode, columns, shapes)
                    shards.add(features, _require_small(features, part.label, episode))
        shards.finish(options.name)
    _write_about(dest, columns, shapes, shards, options)
    return tuple(left_out(columns, shapes))


def left_out(columns: Columns, shapes: Shapes) -> Iterator[str]:
    """What the records do not have, or not everywhere; a line each."""
    if shapes.held:
        yield f"{shapes.held:,} moments have no image of a stream: another image, or black, and <stream>_known says so"
    for stream in columns.streams:
        if stream not in shapes.sizes:
            yield f"no image of stream {stream} is shown: it was left out"
    for name in torch_format.MATRICES:
        if not getattr(columns, name):
            yield f"there is no {name}: it was left out"


def _note_sizes(made: Made, shapes: Shapes) -> None:
    """The size of a stream's first image is that of all of its images in a session."""
    for stream in made.streams:
        for episode in made.episodes:
            start = episode["first_row"]
            there = np.flatnonzero(made.sizes(stream, start, start + episode["rows"]))
            if len(there):
                shapes.note(stream, _image_size(made.jpeg(stream, start + int(there[0]))))
                break


def _image_size(jpeg: bytes) -> tuple[int, int]:
    import cv2

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.shape[0], image.shape[1]


def _record(
    made: Made, label: str, episode: dict[str, Any], columns: Columns, shapes: Shapes
) -> dict[str, Value]:
    start, n = episode["first_row"], episode["rows"]
    end = start + n
    at = np.arange(n)
    features: dict[str, Value] = {
        "steps/is_first": at == 0,
        "steps/is_last": at == n - 1,
        "steps/is_terminal": at == n - 1,
        "steps/reward": (at == n - 1).astype(np.float32),
        "steps/discount": np.ones(n, np.float32),
        "steps/t_ns": made.times_ns(start, end),
        "steps/language_instruction": [episode["task"].encode()] * n,
        "steps/subtask": [text.encode() for text in made.subtasks(start, end)],
        **{f"episode_metadata/{name}": [episode[name].encode()] for name in _TEXTS},
        "episode_metadata/session": [label.encode()],
        **{
            f"episode_metadata/{name}": np.array([episode[name]], np.int64) for name in ("start_ns", "end_ns")
        },
    }
    for name, key in (("state", "steps/observation/state"), ("action", "steps/action")):
        if getattr(columns, name):
            values = made.numbers(name, start, end)
            features[key] = filled(values).astype(np.float32, copy=False)
            features[f"{key}_known"] = np.isfinite(values)
    for stream, size in shapes.sizes.items():
        key = f"steps/observation/{_safe(stream)}"
        features[key], known = _images(made, stream, start, end, size)
        features[f"{key}_known"] = known
        shapes.held += n - int(np.count_nonzero(known))
    return features


def _images(
    made: Made, stream: str, start: int, end: int, size: tuple[int, int]
) -> tuple[Blobs, NDArray[np.bool_]]:
    """An image for each moment: the last one, else the first one, else a black one."""
    sizes = made.sizes(stream, start, end) if stream in made.streams else np.zeros(end - start, np.int64)
    known = sizes > 0
    if not known.any():
        black = _black(size)
        return Blobs(lengths=[len(black)] * len(known), each=(black for _ in known)), known
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    shown = np.where(last < 0, int(np.argmax(known)), last)
    each = (made.jpeg(stream, start + int(i)) for i in shown)
    return Blobs(lengths=sizes[shown].tolist(), each=each), known


def _black(size: tuple[int, int]) -> bytes:
    import cv2

    # where sizes differ, one is as good as another
    shape = tuple(max(side, 16) for side in size)
    return cv2.imencode(".jpg", np.zeros((*shape, 3), np.uint8))[1].tobytes()


def _require_small(features: Mapping[str, Value], label: str, episode: Mapping[str, Any]) -> int:
    size = example_size(features)
    if size <= _MOST_BYTES:
        return size
    raise InputError(
        f"cannot write episode {episode['episode']:,} of {label}",
        where=f"its record would have {size / 1e9:.1f} GB; one of TFRecord's examples has 2.1 GB at most",
        consequence="nothing was written",
        fix="episodes=event makes shorter ones, height=120 or images=none smaller ones",
    )


def _safe(text: str) -> str:
    """As a feature may be called: a slash would begin a group of features."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)


# -------------------------------------------------------------------------------------------- descriptions


def _write_about(
    folder: Path, columns: Columns, shapes: Shapes, shards: _Shards, options: RldsOptions
) -> None:
    split = {
        "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
        "name": "train",
        "numBytes": str(shards.n_bytes),
        "shardLengths": [str(length) for length in shards.lengths],
    }
    info = {
        "description": "People handling objects, recorded with RGB-D cameras; ecat.json names the columns.",
        "fileFormat": "tfrecord",
        "name": options.name,
        "splits": [split],
        "version": _VERSION,
    }
    said = {
        "format": "ecat-rlds",
        "version": 1,
        **asdict(columns),
        "clock": clock_method(options),
        "filled": "where nothing is known: the last known before, else the first after, else zero; see *_known",
        "options": asdict(options),
    }
    features = _features(columns, shapes)
    for name, content in (("dataset_info", info), ("features", features), ("ecat", said)):
        write_new_file(folder / f"{name}.json", [json.dumps(content, indent=1).encode()])


def _features(columns: Columns, shapes: Shapes) -> dict[str, Any]:
    """What ``features.json`` says."""
    observation = _of_columns("state", len(columns.state))
    for stream, size in shapes.sizes.items():
        observation[_safe(stream)] = _image(size)
        observation[f"{_safe(stream)}_known"] = _scalar("bool")
    step = {
        "observation": _dict(observation),
        **_of_columns("action", len(columns.action)),
        "language_instruction": _text(),
        "subtask": _text(),
        **{name: _scalar("bool") for name in ("is_first", "is_last", "is_terminal")},
        **{name: _scalar("float32") for name in ("reward", "discount")},
        "t_ns": _scalar("int64"),
    }
    steps = {
        "pythonClassName": f"{_FEATURES}dataset_feature.Dataset",
        "sequence": {"feature": _dict(step), "length": "-1"},
    }
    episode = {name: _text() for name in _TEXTS} | {name: _scalar("int64") for name in ("start_ns", "end_ns")}
    return _dict({"episode_metadata": _dict(episode), "steps": steps})


def _dict(features: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "pythonClassName": f"{_FEATURES}features_dict.FeaturesDict",
        "featuresDict": {"features": dict(sorted(features.items()))},
    }


def _of_columns(name: str, n: int) -> dict[str, Any]:
    shape = {"dimensions": [str(n)]}
    return {
        key: {
            "pythonClassName": f"{_FEATURES}tensor_feature.Tensor",
            "tensor": {"dtype": dtype, "encoding": "none", "shape": shape},
        }
        for key, dtype in ((name, "float32"), (f"{name}_known", "bool"))
        if n
    }


def _scalar(dtype: str) -> dict[str, Any]:
    return {
        "pythonClassName": f"{_FEATURES}scalar.Scalar",
        "tensor": {"dtype": dtype, "encoding": "none", "shape": {}},
    }


def _text() -> dict[str, Any]:
    return {"pythonClassName": f"{_FEATURES}text_feature.Text", "text": {}}


def _image(size: tuple[int, int]) -> dict[str, Any]:
    dimensions = [str(side) for side in (*size, 3)]
    return {
        "pythonClassName": f"{_FEATURES}image_feature.Image",
        "image": {"dtype": "uint8", "encodingFormat": "jpeg", "shape": {"dimensions": dimensions}},
    }


FORMAT = Format(
    name="rlds",
    description="episodes as TFRecord files in the RLDS layout, for tensorflow_datasets",
    part=torch_format.write_part,
    merge=merge,
    options=RldsOptions,
    version=f"{torch_format.FORMAT.version}.1",
)
