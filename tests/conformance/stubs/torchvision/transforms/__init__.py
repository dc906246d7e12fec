"""Turning an image into a tensor."""

from __future__ import annotations

from typing import Any

from . import v2

__all__ = ["ToTensor", "v2"]


class ToTensor:
    """Of an image of the library Pillow: (channels, height, width), of 8 bits from 0 to 1."""

    def __call__(self, image: Any) -> Any:
        """Convert."""
        import numpy as np
        import torch

        pixels = np.atleast_3d(np.asarray(image)).transpose(2, 0, 1)
        tensor = torch.from_numpy(np.ascontiguousarray(pixels))
        return tensor / 255 if pixels.dtype == np.uint8 else tensor
