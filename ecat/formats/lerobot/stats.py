"""What LeRobot says of each feature: moments and quantiles, of an episode and of all, never all rows in memory at once.

Quantiles of everything are read off histograms of the whole range in :data:`BINS` bins, as lerobot does, so that they
are right to a five-thousandth of the range; those of an episode are exact, and so are those of images, whose values are
few enough to have a bin each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
KEYS = ("min", "max", "mean", "std", "count", *QUANTILES)
BINS = 5000

Stats: TypeAlias = Mapping[str, NDArray[Any]]
"""By the names of :data:`KEYS`; ``count`` (1,), the others (k,), of images (channels, 1, 1)."""


def of_rows(values: NDArray[Any]) -> Stats:
    """Of numbers (n, k); the least and the greatest keep the type of whole numbers."""
    numbers = values.astype(np.float64)
    whole = np.issubdtype(values.dtype, np.integer)
    stats: dict[str, NDArray[Any]] = {
        "min": values.min(axis=0) if whole else numbers.min(axis=0),
        "max": values.max(axis=0) if whole else numbers.max(axis=0),
        "mean": numbers.mean(axis=0),
        "std": numbers.std(axis=0),
        "count": np.array([len(values)]),
    }
    return stats | dict(zip(QUANTILES, np.quantile(numbers, list(QUANTILES.values()), axis=0), strict=True))


def of_histogram(counts: NDArray[np.int64], values: Floats, n_images: int) -> Stats:
    """Of images, from how often (channels, k) each of the ``values`` (k,), ascending, occurs in so many of them."""
    total = np.maximum(counts.sum(axis=1, keepdims=True), 1)
    cumulated = np.cumsum(counts, axis=1)
    mean = (counts @ values)[:, None] / total
    square = (counts * (values - mean) ** 2).sum(axis=1, keepdims=True) / total
    there = counts > 0
    stats: dict[str, Floats] = {
        "min": values[there.argmax(axis=1)][:, None],
        "max": values[::-1][there[:, ::-1].argmax(axis=1)][:, None],
        "mean": mean,
        "std": np.sqrt(square),
    }
    for name, share in QUANTILES.items():
        stats[name] = values[(cumulated < share * total).sum(axis=1).clip(max=len(values) - 1)][:, None]
    shaped: dict[str, NDArray[Any]] = {key: value[:, :, None] for key, value in stats.items()}
    return shaped | {"count": np.array([n_images])}


@dataclass
class Moments:
    """Of rows (n, k) that come in turn; the same rows in the same order give the same bits."""

    count: int = 0
    mean: Floats = field(default_factory=lambda: np.zeros(0))
    square: Floats = field(default_factory=lambda: np.zeros(0))
    least: NDArray[Any] = field(default_factory=lambda: np.zeros(0))
    greatest: NDArray[Any] = field(default_factory=lambda: np.zeros(0))

    def add(self, stats: Stats) -> None:
        """Take in the rows of which these are the statistics (Chan, Golub and LeVeque 1983, eq. 2.1)."""
        n = int(stats["count"][0])
        if not self.count:
            self.mean, self.square = np.zeros(stats["mean"].shape), np.zeros(stats["mean"].shape)
            self.least, self.greatest = stats["min"], stats["max"]
        delta = stats["mean"] - self.mean
        self.square = (
            self.square + stats["std"] ** 2 * n + delta**2 * (self.count * n / max(self.count + n, 1))
        )
        self.count += n
        self.mean = self.mean + delta * (n / max(self.count, 1))
        self.least = np.minimum(self.least, stats["min"])
        self.greatest = np.maximum(self.greatest, stats["max"])


class Histogram:
    """Of rows (n, k) between bounds (k,) that are known, for quantiles."""

    def __init__(self, least: NDArray[Any], greatest: NDArray[Any]) -> None:
        self._least = least.astype(np.float64)
        self._width = np.maximum(greatest.astype(np.float64) - self._least, 0.0) / BINS
        self._counts = np.zeros((len(least), BINS), np.int64)

    def add(self, values: NDArray[Any]) -> None:
        """Count the rows (n, k)."""
        k = len(self._least)
        steps = (values.astype(np.float64) - self._least) / np.where(self._width > 0, self._width, 1.0)
        bins = np.clip(steps.astype(np.int64), 0, BINS - 1) + np.arange(k) * BINS
        self._counts += np.bincount(bins.ravel(), minlength=k * BINS).reshape(k, BINS)

    def quantiles(self) -> Iterator[tuple[str, Floats]]:
        """Each of :data:`QUANTILES` (k,), on a line between the edges of the bin that it lies in."""
        cumulated = np.cumsum(self._counts, axis=1)
        rows = np.arange(len(self._least))
        for name, share in QUANTILES.items():
            wanted = share * cumulated[:, -1]
            at = (cumulated < wanted[:, None]).sum(axis=1).clip(max=BINS - 1)
            inside = np.maximum(self._counts[rows, at], 1)
            part = (wanted - (cumulated[rows, at] - self._counts[rows, at])) / inside
            yield name, self._least + (at + np.clip(part, 0, 1)) * self._width


def as_json(stats: Stats) -> dict[str, Any]:
    """Lists, in the order of :data:`KEYS`."""
    return {key: np.asarray(stats[key]).tolist() for key in KEYS}
