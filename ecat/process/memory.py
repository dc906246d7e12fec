"""What a stage has freed, given back to the system."""

from __future__ import annotations

import ctypes
import sys

import pyarrow as pa


def give_back() -> None:
    """Give back what is free: allocators keep it for what comes next, which after an hour of video is hundreds of MB.

    Arrow's allocator is asked and, on Linux, that of the C library.
    """
    pa.default_memory_pool().release_unused()
    # musl has no such function, and keeps little
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
