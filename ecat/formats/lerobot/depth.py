"""Depth as LeRobot keeps it (since 0.6): 12 bits, finer near the camera.

A depth z in metres becomes the number ``4095 * (log(z + 3.5) - log(0.01 + 3.5)) / (log(10 + 3.5) - log(0.01 + 3.5))``,
rounded; nearer than 1 cm counts as 1 cm, further than 10 m as 10 m.  At 1 m a step is 1.5 mm.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats
from ecat.store.media import MILLIMETRE

MOST = 4095
NEAREST_M, FURTHEST_M, SHIFT_M = 0.01, 10.0, 3.5
MM = 1000.0


def codes(unit_m: float) -> NDArray[np.uint16]:
    """The number (65536,) for each value of a depth image whose unit is ``unit_m`` metres."""
    scale = (
        MM if unit_m == MILLIMETRE else 1.0
    )  # lerobot computes in the unit of what it is given, to the last bit
    depth = np.arange(1 << 16, dtype=np.float32) * np.float32(1.0 if unit_m == MILLIMETRE else unit_m)
    shift = np.float32(SHIFT_M * scale)
    low, high = (math.log(float(np.float32(z * scale) + shift)) for z in (NEAREST_M, FURTHEST_M))
    share = (np.log(depth + shift) - low) / (high - low)
    return np.rint(share * MOST).clip(0, MOST).astype(np.uint16)


def depths_mm() -> Floats:
    """The depth (4096,) that each number stands for, in millimetres."""
    low, high = math.log(NEAREST_M + SHIFT_M), math.log(FURTHEST_M + SHIFT_M)
    return (np.exp(low + np.arange(MOST + 1) * ((high - low) / MOST)) - SHIFT_M) * MM


def facts() -> dict[str, object]:
    """What a reader has to know, under the keys of a feature's ``info``."""
    return {
        "video.depth_min": NEAREST_M,
        "video.depth_max": FURTHEST_M,
        "video.shift": SHIFT_M,
        "video.use_log": True,
        "is_depth_map": True,
        "depth_unit": "mm",
    }
