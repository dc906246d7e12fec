"""Sub-events in words: LeRobot's language columns (since 0.6), or an index of subtasks (0.4).

``language_persistent`` holds, on every row of an episode, everything that is said over its course: each entry says
from which moment on it is true, until another of its style is.  ``subtask`` is what lies directly below the episode,
``motion`` what lies below that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import LimitError
from ecat.formats.episodes import Episode, Subtask

Gaps: TypeAlias = Literal["hold", "task", "none"]
PERSISTENT, EVENTS = "language_persistent", "language_events"
MAX_ENTRIES = 2_000_000
"""Of one episode, over all its rows: every row repeats all entries."""

_COMMON = (("role", False), ("content", True), ("style", True))
_CAMERA = pa.field("camera", pa.string())
_TOOLS = pa.field("tool_calls", pa.list_(pa.string()))


def _words() -> list[pa.Field[Any]]:
    return [pa.field(name, pa.string(), nullable=nullable) for name, nullable in _COMMON]


PERSISTENT_TYPE = pa.list_(
    pa.struct([*_words(), pa.field("timestamp", pa.float32(), nullable=False), _CAMERA, _TOOLS])
)
EVENTS_TYPE = pa.list_(pa.struct([*_words(), _CAMERA, _TOOLS]))


@dataclass(frozen=True, slots=True)
class Entry:
    """From row ``row`` of the episode on this is so; ``content`` None says that nothing is any more."""

    row: int
    style: Literal["subtask", "motion"]
    content: str | None


def entries(episode: Episode, gaps: Gaps) -> tuple[Entry, ...]:
    """What is said in an episode: exactly one subtask at each moment, unless there is none at all."""
    level = 1 if episode.event else 0
    direct = [part for part in episode.subtasks if part.level == level]
    deeper = [part for part in episode.subtasks if part.level > level]
    said = [
        *_entries("subtask", direct, episode, gaps),
        *_entries("motion", deeper, episode, "none"),
    ]
    return tuple(sorted(said, key=lambda entry: (entry.row, entry.style == "motion")))


def unheard(episode: Episode) -> int:
    """How many parts of an episode are over before a moment comes."""
    ends = np.searchsorted(episode.times_ns, [part.end_ns for part in episode.subtasks])
    starts = np.searchsorted(episode.times_ns, [part.start_ns for part in episode.subtasks])
    return int((starts == ends).sum())


def _entries(
    style: Literal["subtask", "motion"], parts: Sequence[Subtask], episode: Episode, gaps: Gaps
) -> list[Entry]:
    active = active_parts(parts, episode.times_ns)
    if not (active >= 0).any():
        return []
    if gaps == "hold":
        known = np.flatnonzero(active >= 0)
        before = np.searchsorted(known, np.arange(len(active)), side="right") - 1
        active = active[known[np.maximum(before, 0)]]
    missing = episode.task if gaps == "task" else None
    changes = np.flatnonzero(np.diff(active, prepend=-2))
    found = [
        Entry(int(row), style, parts[active[row]].text if active[row] >= 0 else missing) for row in changes
    ]
    return found[1:] if style == "motion" and found[0].content is None else found


def active_parts(parts: Sequence[Subtask], times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which part is under way at each moment (n,): of several the one that began last, or ends first; -1: none."""
    active = np.full(len(times_ns), -1)
    for number in sorted(range(len(parts)), key=lambda i: (parts[i].start_ns, -parts[i].end_ns, i)):
        start, end = np.searchsorted(times_ns, (parts[number].start_ns, parts[number].end_ns))
        active[start:end] = number
    return active


def subtasks(said: Sequence[Entry], n: int) -> list[str]:
    """The subtask of each of n rows; empty where there is none."""
    found = [""] * n
    rows = [entry for entry in said if entry.style == "subtask"]
    for number, entry in enumerate(rows):
        end = rows[number + 1].row if number + 1 < len(rows) else n
        found[entry.row : end] = [entry.content or ""] * (end - entry.row)
    return found


def persistent_column(said: Sequence[Entry], timestamps: NDArray[np.float32], label: str) -> pa.Array[Any]:
    """The column ``language_persistent`` of an episode, whose rows have these timestamps (n,).

    Raises
    ------
    LimitError : it would have more than :data:`MAX_ENTRIES` entries.
    """
    n, k = len(timestamps), len(said)
    if n * k > MAX_ENTRIES:
        raise LimitError(
            f"cannot write the sub-events of {label}",
            where=f"{k:,} of them, each repeated on {n:,} rows; at most {MAX_ENTRIES:,} entries are written",
            fix="make episodes of events (episodes=event), or language=index",
        )
    once = pa.array(
        [
            {
                "role": "assistant",
                "content": entry.content,
                "style": entry.style,
                "timestamp": float(timestamps[entry.row]),
                "camera": None,
                "tool_calls": None,
            }
            for entry in said
        ],
        PERSISTENT_TYPE.value_type,
    )
    repeated = once.take(np.tile(np.arange(k), n))
    return pa.ListArray.from_arrays(pa.array(np.arange(n + 1) * k, pa.int32()), repeated).cast(
        PERSISTENT_TYPE
    )


def events_column(n: int) -> pa.Array[Any]:
    """The column ``language_events`` of n rows: nothing that people annotate lasts for one moment."""
    return pa.array([[]] * n, EVENTS_TYPE)
