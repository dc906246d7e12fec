"""How long work tells how far it is, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many units are done, and how many there are (0 when unknown)."""


def beginning(head: str, progress: Progress) -> Progress:
    """The same, with ``head`` in front of what is being done."""
    return lambda what, done, total: progress(f"{head}: {what}", done, total)


def together(what: str, total: int, progress: Progress) -> Progress:
    """One that works share which go on side by side: how much of ``total`` all of them have done so far."""
    units: dict[str, int] = {}
    lock = Lock()

    def tell(part: str, done: int, of: int) -> None:
        del of
        with lock:
            units[part] = done
            progress(what, sum(units.values()), total)

    return tell


def silent(what: str, done: int, total: int) -> None:
    """Say nothing."""
    del what, done, total
