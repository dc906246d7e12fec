"""Images for stages: made when they are asked for, as a video decodes its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera


@dataclass
class Stills:
    """``n`` images of a stream; ``asked`` collects the indices that were read."""

    make: Callable[[int], NDArray[Any]]
    n: int
    camera: Camera | None = None
    unit_m: float = 0.001
    t_ns: NDArray[np.int64] | None = None
    asked: list[int] = field(default_factory=list[int])

    @property
    def frame(self) -> NDArray[np.int64]:
        return np.arange(self.n)

    def __len__(self) -> int:
        return self.n

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return self.read(range(self.n))

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        assert list(indices) == sorted(indices), "images are read in order"
        for index in indices:
            self.asked.append(index)
            yield self.make(index)
