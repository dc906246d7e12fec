"""Short videos and sessions with pixels, whose every image is known."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.model import Clock, Manifest, Stream
from ecat.store import Draft, Session, TableData, create_session
from ecat.store.media import ColorWriter, DepthWriter
from ecat.tables import FRAMES

PERIOD_NS = 33_366_700
_BITS = 6


def depth_image(i: int, height: int = 24, width: int = 34) -> NDArray[np.uint16]:
    """Noise that is another one for every ``i``, with everything that 16 bits can say."""
    return np.random.default_rng(i).integers(0, 65536, (height, width), dtype=np.uint16)


def color_image(i: int, height: int = 48, width: int = 64) -> NDArray[np.uint8]:
    """An image whose middle tells ``i`` (below 64) by dark and bright blocks, with coloured bands above and below."""
    image = np.empty((height, width, 3), np.uint8)
    bright = (i >> (np.arange(width) * _BITS // width)) & 1
    image[:] = np.where(bright, 210, 30)[None, :, None]
    image[: height // 4] = (200, 30, 60)
    image[-height // 4 :] = (20, 160, 220)
    return image


def number_of(image: NDArray[Any]) -> int:
    """Which :func:`color_image` an image is, after all that was done to it."""
    height, width = image.shape[:2]
    row = (
        image[height // 3 : -height // 3].reshape(-1, width, image.size // height // width).mean(axis=(0, 2))
    )
    return sum(1 << bit for bit in range(_BITS) if row[(2 * bit + 1) * width // (2 * _BITS)] > 120)


def color_clip(path: Path, n: int = 40, times: Sequence[int] | None = None) -> Path:
    """A colour video of ``n`` images."""
    with ColorWriter(path, 64, 48) as writer:
        for i in range(n):
            writer.write(color_image(i), times[i] if times is not None else i * PERIOD_NS)
    return path


def depth_clip(path: Path, n: int = 40) -> Path:
    """A depth video of ``n`` images."""
    with DepthWriter(path, 34, 24) as writer:
        for i in range(n):
            writer.write(depth_image(i), i * PERIOD_NS)
    return path


def frames_table(times: Mapping[str, Sequence[int]]) -> TableData:
    """The recorded times of streams."""
    rows = sorted((t, name, i) for name, ts in times.items() for i, t in enumerate(ts))
    table = pa.table(
        {
            "t_ns": pa.array(array("q", [t for t, _, _ in rows])),
            "frame": pa.array([i for _, _, i in rows], pa.int32()),
            "stream": pa.array([name for _, name, _ in rows], pa.string()).dictionary_encode(),
        },
        schema=FRAMES.arrow,
    )
    return TableData(data=table)


def session_of(
    path: Path,
    streams: Sequence[Stream],
    media: Mapping[str, Callable[[Path], object]],
    times: Mapping[str, Sequence[int]] | None = None,
    n_frames: int = 40,
) -> Session:
    """A session with these streams, whose files the functions write."""

    def silent(write: Callable[[Path], object]) -> Callable[[Path], None]:
        def run(file: Path) -> None:
            write(file)

        return run

    clock = Clock(rule="recorded") if times else Clock()
    manifest = Manifest(
        name="s", created="2020-01-01T00:00:00", n_frames=n_frames, clock=clock, streams=tuple(streams)
    )
    return create_session(
        path,
        Draft(
            manifest=manifest,
            tables={"frames": frames_table(times)} if times else {},
            media={name: silent(write) for name, write in media.items()},
        ),
    )


COLOR = Stream(name="color", kind="color", file="media/color.mp4")
DEPTH = Stream(name="depth", kind="depth", file="media/depth.mkv", depth_unit_m=0.00025)
