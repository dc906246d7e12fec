"""Exported sessions as data for training.

``Windows`` needs PyTorch (``pip install 'ecat[learn]'``), which is imported with it and not before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecat.datasets.windows import Windows

__all__ = ["Windows"]


def __getattr__(name: str) -> Any:
    if name == "Windows":
        from ecat.datasets.windows import Windows

        return Windows
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
