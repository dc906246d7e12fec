"""How little memory stages keep: an hour takes little more than a minute."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Generator
from contextlib import contextmanager

import pyarrow as pa


@contextmanager
def sparing() -> Generator[None]:
    """Take Arrow's memory from the C library meanwhile: its own allocators keep more of what is free, in pieces."""
    before = pa.default_memory_pool()
    pa.set_memory_pool(pa.system_memory_pool())
    try:
        yield
    finally:
        pa.set_memory_pool(before)


def give_back() -> None:
    """Give back what is free: allocators keep it for what comes next, which after an hour of video is hundreds of MB.

    Arrow's allocator is asked and, on Linux, that of the C library.
    """
    pa.default_memory_pool().release_unused()
    # musl has no such function, and keeps little
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
