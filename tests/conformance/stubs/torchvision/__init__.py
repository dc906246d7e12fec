"""As much of torchvision as lerobot's data sets use: a reader of videos on PyAV, and names of transforms."""

from __future__ import annotations

from . import io, transforms

__all__ = ["io", "set_video_backend", "transforms"]


def set_video_backend(backend: str) -> None:
    """There is only one."""
