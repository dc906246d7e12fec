"""How long work tells how far it is, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many units are done, and how many there are (0 when unknown)."""


def beginning(head: str, progress: Progress) -> Progress:
    """The same, with ``head`` in front of what is being done."""
    return lambda what, done, total: progress(f"{head}: {what}", done, total)


def silent(what: str, done: int, total: int) -> None:
    """Say nothing."""
    del what, done, total
