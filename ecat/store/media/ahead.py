"""Work that a thread does ahead of its use; libav lets others run while it decodes."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

T = TypeVar("T")

AHEAD = 4
"""How many images are decoded before they are asked for."""


def ahead(items: Iterable[T], most: int = AHEAD) -> Generator[T]:
    """The same items, up to ``most`` of which a thread makes before they are asked for.

    What goes wrong in making an item is raised where it would have come.
    """
    coming, end = iter(items), object()
    maker = ThreadPoolExecutor(1)
    try:
        waiting = deque(maker.submit(next, coming, end) for _ in range(most))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(maker.submit(next, coming, end))
            yield cast("T", item)
    finally:
        maker.shutdown(cancel_futures=True)
