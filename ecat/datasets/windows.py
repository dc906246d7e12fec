"""Windows of equal length from exported episodes, for PyTorch's loaders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.datasets.files import Stored, open_stored
from ecat.errors import MissingExtraError, UsageError

try:
    import torch
    from torch.utils.data import Dataset
except ImportError:
    raise MissingExtraError(
        "cannot use ecat.datasets.Windows", where="PyTorch is not installed", fix="pip install 'ecat[learn]'"
    ) from None

Sample = dict[str, Any]


class Windows(Dataset[Sample]):
    """Stretches of ``length`` moments, every ``stride``-th, none across the end of an episode.

    The folder is what ``ecat export PATH FOLDER --format torch`` wrote.  It is mapped into memory: opening takes no
    time, all workers of a loader share one copy, and only what is asked for is read.

    A sample is a dictionary; L is ``length``:

    ==================  ==============================================================================
    ``state``           (L, S) float32, columns ``state_names``; metres, radians, in the frame ``table``
    ``action``          (L, A) float32, columns ``action_names``
    ``state_known``     (L, S) bool: false where nothing is known; the number is 0 there
    ``action_known``    (L, A) bool
    ``valid``           (L,) bool: false for moments after the episode's end, with ``short="pad"``
    ``time_s``          (L,) float32 since the episode's start
    ``label``           int64, position in ``labels``
    ``part``            (L,) int64, position in ``parts``, -1 where the event has no part
    ``episode``         int64, row of ``episodes``
    ``images.<stream>`` (L or 1, 3, H, W) uint8, red, green, blue; only of streams that were asked for
    ==================  ==============================================================================

    Images are as large as they were exported.  Where sessions had cameras of different shapes, batches need a
    ``transform`` that makes them equal, or a ``where`` that keeps those of one camera.

    Parameters
    ----------
    folder : the data set. length, stride : in moments.
    short : what becomes of episodes that are shorter than ``length``, and of the rest at the end of others: left out
        (``drop``), or filled up with the last moment (``pad``).
    images : streams whose images are decoded. frames : images of which moments: ``last`` or ``all``.
    where : keeps an episode if it returns true of its row (a dictionary: session, task, label, performer, ...).
    transform : called with each sample.

    Raises
    ------
    NotFoundError, CorruptError : there is no such data set, or it is damaged.
    UsageError : a URL; a stream that is not in it; a length or stride that is no whole number from one on.
    """

    def __init__(
        self,
        folder: Path | str,
        *,
        length: int = 30,
        stride: int = 1,
        short: str = "drop",
        images: Sequence[str] = (),
        frames: str = "last",
        where: Callable[[dict[str, Any]], bool] | None = None,
        transform: Callable[[Sample], Sample] | None = None,
    ) -> None:
        self._stored: Stored = open_stored(folder)
        _require(self._stored, images, length=length, stride=stride, short=short, frames=frames)
        self.length, self.stride = length, stride
        self._images, self._all_frames = tuple(images), frames == "all"
        self._transform = transform
        self.state_names: tuple[str, ...] = tuple(self._stored.about["state"])
        self.action_names: tuple[str, ...] = tuple(self._stored.about["action"])
        self.labels: tuple[str, ...] = tuple(self._stored.about["labels"])
        self.parts: tuple[str, ...] = tuple(self._stored.about["parts"])
        self.episodes: list[dict[str, Any]] = pq.read_table(self._stored.episodes).to_pylist()
        kept = [i for i, row in enumerate(self.episodes) if where is None or where(row)]
        rows = np.array([self.episodes[i]["rows"] for i in kept], np.int64)
        counts = _windows(rows, length, stride, pad=short == "pad")
        self._kept = np.array(kept, np.int64)
        self._ends = np.cumsum(counts)
        self._first = np.array([row["first_row"] for row in self.episodes], np.int64)
        self._rows = np.array([row["rows"] for row in self.episodes], np.int64)

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, index: int) -> Sample:
        """The window at ``index``; negative ones count from the end.

        Raises
        ------
        IndexError : there are not so many.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"there are {len(self):,} windows, no number {index:,}")
        index %= len(self)
        place = int(np.searchsorted(self._ends, index, "right"))
        before = int(self._ends[place - 1]) if place else 0
        sample = self._sample(int(self._kept[place]), (index - before) * self.stride)
        return sample if self._transform is None else self._transform(sample)

    def _sample(self, episode: int, offset: int) -> Sample:
        first = int(self._first[episode])
        left = int(self._rows[episode]) - offset
        n = min(self.length, left)
        rows = slice(first + offset, first + offset + n)
        arrays, missing = self._stored.arrays, self.length - n
        times = arrays["t_ns"][rows] - arrays["t_ns"][first]
        sample: Sample = {
            "time_s": torch.from_numpy(_filled(times.astype(np.float64) * 1e-9, missing).astype(np.float32)),
            "part": torch.from_numpy(_filled(arrays["part"][rows], missing).astype(np.int64)),
            "label": torch.tensor(int(arrays["label"][first])),
            "episode": torch.tensor(episode),
            "valid": torch.arange(self.length) < n,
        }
        for name in ("state", "action"):
            values = _filled(np.array(arrays[name][rows]), missing)
            known = np.isfinite(values)
            sample[name] = torch.from_numpy(np.where(known, values, np.float32(0)))
            sample[f"{name}_known"] = torch.from_numpy(known)
        for stream in self._images:
            shown = range(rows.start, rows.stop) if self._all_frames else (rows.stop - 1,)
            sample[f"images.{stream}"] = self._decoded(stream, shown, missing if self._all_frames else 0)
        return sample

    def _decoded(self, stream: str, shown: Sequence[int], missing: int) -> torch.Tensor:
        images = [self._stored.image(stream, row) for row in shown]
        images += [images[-1]] * missing
        return torch.from_numpy(np.stack(images))


def _windows(rows: NDArray[np.int64], length: int, stride: int, *, pad: bool) -> NDArray[np.int64]:
    """How many windows begin in episodes of so many moments."""
    if pad:
        return -(-rows // stride)
    return np.maximum((rows - length) // stride + 1, 0)


def _filled(values: NDArray[Any], missing: int) -> NDArray[Any]:
    """The last row again, ``missing`` times."""
    return np.concatenate([values, np.repeat(values[-1:], missing, axis=0)]) if missing else values


def _is_count(number: object) -> bool:
    """Any whole number from one on, NumPy's too; that True is one is an accident."""
    return isinstance(number, SupportsIndex) and not isinstance(number, bool) and number.__index__() >= 1


def _require(
    stored: Stored, images: Sequence[str], *, length: int, stride: int, short: str, frames: str
) -> None:
    known = stored.about["streams"]
    unknown = [] if isinstance(images, str) else [name for name in images if name not in known]
    faults = {
        f"length is {length!r}, expected a whole number, at least 1": not _is_count(length),
        f"stride is {stride!r}, expected a whole number, at least 1": not _is_count(stride),
        f"short is {short!r}, expected 'drop' or 'pad'": short not in {"drop", "pad"},
        f"frames is {frames!r}, expected 'last' or 'all'": frames not in {"last", "all"},
        f"images is {images!r}, expected a list of names": isinstance(images, str),
        f"images names {', '.join(unknown)}; there are: {', '.join(known) or 'none'}": bool(unknown),
    }
    if found := [fault for fault, there in faults.items() if there]:
        raise UsageError(
            f"cannot make windows of {stored.folder}",
            where=tuple(found),
            fix="see help(ecat.datasets.Windows)",
        )
