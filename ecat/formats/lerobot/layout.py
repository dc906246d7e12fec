"""Which columns, videos and files a LeRobot data set of ours has (format v3.0, as lerobot 0.4.4 writes it)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from ecat.formats.lerobot import language
from ecat.formats.lerobot.depth import facts
from ecat.formats.lerobot.video import Kind
from ecat.formats.stream_names import plain_name, require_unlike

VERSION = "v3.0"
CHUNK_SIZE = 1000
DATA_MB, VIDEO_MB = 100, 200
STATE, ACTION = "observation.state", "action"
STATE_KNOWN, ACTION_KNOWN = "state_known", "action_known"
VECTORS = (STATE, ACTION, STATE_KNOWN, ACTION_KNOWN)
SUBTASK = "subtask_index"
_INDICES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
_ARROW = {"float32": pa.float32(), "int64": pa.int64()}


def file_name(folder: str, number: int, suffix: str = ".parquet") -> str:
    """The path of the file with this number, from zero."""
    chunk, number = divmod(number, CHUNK_SIZE)
    return f"{folder}/chunk-{chunk:03d}/file-{number:03d}{suffix}"


def video_key(stream: str) -> str:
    """The feature that the images of a stream are."""
    return f"observation.images.{plain_name(stream)}"


def require_unlike_videos(streams: Iterable[str]) -> None:
    """Return if each of the streams has a feature of its own.

    Raises
    ------
    InputError : two have the same one.
    """
    require_unlike(streams, lambda stream: (video_key(stream),), option="cameras")


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The images of one camera."""

    kind: Kind
    width: int
    height: int

    def feature(self, fps: int) -> dict[str, Any]:
        """As ``info.json`` tells it."""
        color = self.kind == "color"
        return {
            "dtype": "video",
            "shape": [self.height, self.width, 3 if color else 1],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": self.height,
                "video.width": self.width,
                "video.codec": "h264" if color else "hevc",
                "video.pix_fmt": "yuv420p" if color else "gray12le",
                "video.is_depth_map": not color,
                "video.fps": fps,
                "video.channels": 3 if color else 1,
                "has_audio": False,
                **({} if color else facts()),
            },
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """What every episode of a data set has."""

    fps: int
    state: tuple[str, ...]
    action: tuple[str, ...]
    views: Mapping[str, View]
    language: Literal["columns", "index", "none"]

    @property
    def vectors(self) -> dict[str, tuple[str, tuple[str, ...]]]:
        """Type and names of each column that is a vector."""
        wanted = {
            STATE: ("float32", self.state),
            ACTION: ("float32", self.action),
            STATE_KNOWN: ("float32", self.state),  # Rerun's reader leaves out columns of bool
            ACTION_KNOWN: ("float32", self.action),
        }
        return {key: (dtype, names) for key, (dtype, names) in wanted.items() if names}

    @property
    def numbers(self) -> dict[str, int]:
        """The columns that have statistics, and how many numbers each has in a row."""
        return {
            **{key: len(names) for key, (_, names) in self.vectors.items()},
            **dict.fromkeys(_INDICES, 1),
            **({SUBTASK: 1} if self.language == "index" else {}),
        }

    def features(self) -> dict[str, dict[str, Any]]:
        """``features`` of ``info.json``."""
        vectors = {
            key: {"dtype": dtype, "shape": [len(names)], "names": list(names)}
            for key, (dtype, names) in self.vectors.items()
        }
        indices = dict(_INDICES) | ({SUBTASK: "int64"} if self.language == "index" else {})
        said = (language.PERSISTENT, language.EVENTS) if self.language == "columns" else ()
        return {
            **vectors,
            **{key: view.feature(self.fps) for key, view in self.views.items()},
            **{key: {"dtype": dtype, "shape": [1], "names": None} for key, dtype in indices.items()},
            **{key: {"dtype": "language", "shape": [1], "names": None} for key in said},
        }

    def schema(self) -> pa.Schema:
        """The columns of ``data/``, with what Hugging Face's ``datasets`` wants to know about them."""
        fields: list[pa.Field[Any]] = []
        described: dict[str, Any] = {}
        for key, feature in self.features().items():
            if feature["dtype"] == "video":
                continue
            if feature["dtype"] == "language":
                kind = language.PERSISTENT_TYPE if key == language.PERSISTENT else language.EVENTS_TYPE
                fields.append(pa.field(key, kind))
                described[key] = _described(kind)
                continue
            value, n = _ARROW[feature["dtype"]], feature["shape"][0]
            fields.append(pa.field(key, value if n == 1 else pa.list_(value, n)))
            one = {"dtype": feature["dtype"], "_type": "Value"}
            described[key] = one if n == 1 else {"feature": one, "length": n, "_type": "List"}
        known = json.dumps({"info": {"features": described}})
        return pa.schema(fields, {"huggingface": known})


def _described(kind: Any) -> dict[str, Any]:
    if pa.types.is_list(kind):
        return {"feature": _described(kind.value_type), "_type": "List"}
    if pa.types.is_struct(kind):
        return {field.name: _described(field.type) for field in kind}
    return {
        "dtype": str(kind).replace("float", "float32") if kind == pa.float32() else str(kind),
        "_type": "Value",
    }


def arrow_column(values: np.ndarray[Any, Any], kind: pa.DataType) -> pa.Array[Any]:
    """Values (n, k) as a column of this type."""
    if pa.types.is_fixed_size_list(kind):
        flat = pa.array(np.ascontiguousarray(values).ravel(), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(flat, kind.list_size)
    return pa.array(values.reshape(len(values)), kind)
