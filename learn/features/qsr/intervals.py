"""Qualitative tracks as relations of ecat: what holds of which objects, and from when to when."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Any

import pyarrow as pa

from ecat.model import Relation
from ecat.model.annotation import Argument
from ecat.process.inputs import clock_table
from ecat.store import Session

AUTHOR = "ecat learn qsr"
LEAST = 5
"""Frames that a value has to hold: shorter ones are noise more often than not, and many."""


def author_of(relation: str) -> str:
    """Who proposes relations of this name."""
    return f"{AUTHOR} {relation}"


def relations_of(session: Session, track: pa.Table, *, least: int = LEAST) -> tuple[Relation, ...]:
    """Stretches of equal values of a qualitative track, as proposed relations ordered by time.

    Parameters
    ----------
    track : of :func:`learn.features.qsr.qualitative_tracks` of the session, frame by frame (no chains).
    least : how many frames a value has to hold.

    Returns
    -------
    The predicate is name and value (``cardir=ne``), the arguments are the objects in their order.  What holds on both
    sides of frames that are not in the track holds twice.
    """
    times: list[int | None] = clock_table(session)["t_ns"].to_pylist()
    found = [
        relation
        for _, rows in groupby(track.to_pylist(), lambda row: (row["relation"], row["a"], row["b"], row["c"]))
        for relation in _held(list(rows), least, times)
    ]
    return tuple(sorted(found, key=lambda one: (one.start_frame, one.predicate, one.targets)))


def _held(rows: list[dict[str, Any]], least: int, times: list[int | None]) -> Iterator[Relation]:
    def at(frame: int) -> int | None:
        return times[frame] if frame < len(times) else None

    numbered = enumerate(rows)
    for (value, _), stretch in groupby(numbered, lambda each: (each[1]["value"], each[1]["frame"] - each[0])):
        frames = [row["frame"] for _, row in stretch]
        if value is None or len(frames) < least:
            continue
        row, start, end = rows[0], at(frames[0]), at(frames[-1] + 1)
        if start is not None and end is not None and end <= start:  # the clock goes back
            start = end = None
        yield Relation(
            predicate=f"{row['relation']}={value}",
            start_frame=frames[0],
            end_frame=frames[-1] + 1,
            start_ns=start,
            end_ns=end,
            source="computed",
            status="proposed",
            author=author_of(row["relation"]),
            arguments=tuple(Argument(target=row[key]) for key in "abc" if row[key] is not None),
        )
