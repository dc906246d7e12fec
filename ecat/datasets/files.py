"""What ``--format torch`` wrote, mapped into memory."""

from __future__ import annotations

import json
import mmap
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.errors import CorruptError, NotFoundError, UsageError
from ecat.formats.datasets.arrays import mapped
from ecat.formats.datasets.images import decode_image
from ecat.formats.datasets.torch_format import ABOUT, EPISODES, MATRICES, ROWS, VERSION
from ecat.formats.stream_names import plain_name
from ecat.store import remote

_MOST_BYTES = 16 << 20


class Stored:
    """An open data set.  Handed to another process, it is opened there anew: what it holds is never copied."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.about: dict[str, Any] = _about(folder)
        self.episodes = folder / EPISODES
        self.arrays: dict[str, NDArray[Any]] = {
            name: mapped(folder / f"{name}.npy") for name in (*ROWS, *MATRICES)
        }
        self._offsets: dict[str, NDArray[Any]] = {}
        self._blobs: dict[str, mmap.mmap] = {}
        _require(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Stored, (self.folder,))

    def image(self, stream: str, row: int) -> NDArray[np.uint8]:
        """The image (3, H, W) of a moment, red, green, blue, perhaps a view; black where the stream has none.

        Raises
        ------
        CorruptError : it is not an image.
        """
        if stream not in self._blobs:
            self._open(stream)
        offsets = self._offsets[stream]
        start, end = int(offsets[row]), int(offsets[row + 1])
        if start == end:
            return np.zeros(self._shape(stream), np.uint8)
        data = np.frombuffer(self._blobs[stream], np.uint8, end - start, start)
        image = decode_image(data)
        if image is None:
            raise CorruptError(
                f"cannot read image {row:,} of {stream}",
                where=f"{self.folder}: bytes {start:,} to {end:,} of images/{stream}.bin are no image",
                consequence="the sample was not made",
                fix="export the data set again",
            )
        return image

    def _open(self, stream: str) -> None:
        stem = plain_name(stream)
        offsets = mapped(self.folder / "images" / f"{stem}.npy")
        try:
            with (self.folder / "images" / f"{stem}.bin").open("rb") as file:
                size = file.seek(0, 2)
                # nothing cannot be mapped
                blob = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if size else mmap.mmap(-1, 1)
        except OSError as error:
            raise _corrupt(self.folder, f"images/{stem}.bin: {error}") from None
        steps = np.diff(offsets.astype(np.int64))
        if len(steps) != self.about["rows"] or int(offsets[-1]) > size or np.any(steps < 0):
            raise _corrupt(self.folder, f"images/{stem}.npy does not fit the images")
        self._offsets[stream], self._blobs[stream] = offsets, blob

    def _shape(self, stream: str) -> tuple[int, int, int]:
        """Of the first image there is."""
        offsets = self._offsets[stream]
        filled = np.flatnonzero(np.diff(offsets.astype(np.int64)))
        return self.image(stream, int(filled[0])).shape if len(filled) else (3, 1, 1)  # type: ignore[return-value]


def open_stored(place: Path | str) -> Stored:
    """The data set in the folder ``place``.

    Raises
    ------
    UsageError : it is a URL.
    NotFoundError : there is none.
    CorruptError : it is damaged, or of a later version.
    """
    if remote.is_url(place):
        raise UsageError(
            f"cannot open {place}",
            where="a data set is mapped into memory, which only files of this machine can be",
            fix="copy it to a folder here, and open that",
        )
    folder = Path(place)
    if not (folder / ABOUT).is_file():
        raise NotFoundError(
            f"cannot open {folder}",
            where=f"there is no {ABOUT} in it",
            fix=f"ecat export my_project {folder} --format torch makes one",
        )
    return Stored(folder)


def _about(folder: Path) -> dict[str, Any]:
    try:
        with (folder / ABOUT).open("rb") as file:
            about: Any = json.loads(file.read(_MOST_BYTES))
    except (OSError, ValueError) as error:
        raise _corrupt(folder, f"{ABOUT}: {error}") from None
    lists = ("state", "action", "labels", "parts", "streams")
    if (
        not isinstance(about, dict)
        or about.get("version") != VERSION
        or not isinstance(about.get("rows"), int)
        or not all(isinstance(about.get(name), list) for name in lists)
    ):
        raise _corrupt(folder, f"{ABOUT}: not what version {VERSION} of this format says")
    return about


def _require(stored: Stored) -> None:
    about, arrays = stored.about, stored.arrays
    rows = about["rows"]
    wanted = dict.fromkeys(ROWS, (rows,)) | {name: (rows, len(about[name])) for name in MATRICES}
    for name, shape in wanted.items():
        if arrays[name].shape != shape or arrays[name].dtype.kind not in "if":
            raise _corrupt(
                stored.folder, f"{name}.npy: expected an array {shape}, found {arrays[name].shape}"
            )
    try:
        episodes = pq.read_table(stored.episodes, columns=["first_row", "rows"])
    except (OSError, ValueError) as error:
        raise _corrupt(stored.folder, f"{EPISODES}: {error}") from None
    first, n = np.asarray(episodes["first_row"]), np.asarray(episodes["rows"])
    if np.any(first < 0) or np.any(n < 1) or np.any(first + n > rows):
        raise _corrupt(stored.folder, f"{EPISODES}: rows beyond those of the arrays")


def _corrupt(folder: Path, where: str) -> CorruptError:
    return CorruptError(
        f"cannot open {folder}", where=where, consequence="nothing was read", fix="export the data set again"
    )
