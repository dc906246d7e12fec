"""Recordings of two boxes, and a recogniser that says what it is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from learn.features.recordings import Recording
from learn.features.windows import Floats, Table, n_windows
from learn.recognize.model import Recognized
from tests.learn.recognize import made

VOCABULARY = np.array([[0, 0, 0, 0, 0], [1, 2, 0, 1, 0], [1, 2, 3, 1, 3]], np.int8)
"""Nothing; the performer pushes box 1; to box 2."""


@dataclass
class Says:
    """A recogniser that says what it is told, window by window, and remembers what it was shown."""

    labels: Sequence[int]
    seen: list[Floats] = field(default_factory=list[Floats])
    tables: list[Table] = field(default_factory=list[Table])

    def on_table(self, table: Table) -> Says:
        self.tables.append(table)
        return self

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        self.seen += sessions
        n = sum(n_windows(len(points)) for points in sessions)
        probabilities = np.full((n, 3), 0.1)
        probabilities[np.arange(n), (list(self.labels) * n)[:n]] = 0.8
        return Recognized(VOCABULARY, probabilities, probabilities)


def recording(points: Floats, fps: float | None = 30.0) -> Recording:
    t_s = None if fps is None else np.arange(len(points)) / fps
    return Recording("s", points, None, t_s, ("o1", "o2"))


def long(*moves: tuple[int, int], n: int = 600) -> Floats:
    """Box 1 goes 0.3 m to the right from each first frame to each last, and stands still otherwise."""
    points = np.repeat(made.scene(1)[:1], n, axis=0)
    x = np.zeros(n)
    for start, end in moves:
        x += 0.3 * np.clip((np.arange(n) - start) / (end - start), 0, 1)
    points[:, 13:17, 0] += x[:, None]
    return points
