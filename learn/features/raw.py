"""Joints and markers of windows as a network sees them: every point on the table, frame by frame.

No relation, distance or angle is computed here; what is told is where things are, in a frame that is easier to learn in
than the camera's.  A marker's depth jumps by decimetres in a tenth of all frames while the direction in which it is
seen does not; so a corner is where its ray meets the table, and its depth is told beside that, as how far it is off.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from learn.features.scene import FLATTEST, Floats, Table, filled, lost, steady

Channels = NDArray[np.float32]

VERSION = "raw-3"
"""Changes whenever a channel does, or what a network makes of them: a model knows what it was trained with."""
PLANE = slice(0, 42)
"""Of channels, x and y on the table of 13 joints and 8 corners, about the middle of both boxes in the window."""
SHAPE = slice(42, 58)
"""x and y of the 8 corners about the middle of their marker, across the line of sight."""
HEIGHT = slice(58, 71)
"""Of 13 joints above the table."""
DEPTH = slice(71, 75)
"""Of both markers, by depth: height above the table, and how much farther than the table."""
N_CHANNELS = 75

_DEEPEST_M = 0.3


def raw_channels(windows: Floats, table: Table) -> Channels:
    """What a network sees of windows (w, t, 21, 3) in the Kinect's camera space: (w, t, 75) metres.

    Points that are not known (NaN, or the export's -1) take the nearest known of their window, and 0 if there is none,
    as does a marker that was lost; corners are medians of three frames of the window.
    """
    n = windows.shape[:2]
    steep = np.hypot(1.0, table.slope)
    x, y, z = np.moveaxis(filled(windows[:, :, :13]), -1, 0)
    joints = np.stack([x, (table.slope * y + z) / steep], axis=-1)
    heights = (y - table.slope * z - table.height) / steep
    seen = windows[:, :, 13:]
    seen = np.where(lost(seen)[..., None], np.nan, seen)
    rays = steady(filled(seen[..., :2] / seen[..., 2:]))
    far = table.height / np.minimum(rays[..., 1] - table.slope, FLATTEST)
    corners = np.stack([rays[..., 0] * far, far * (table.slope * rays[..., 1] + 1) / steep], axis=-1)
    by_box = rays.reshape(*n, 2, 4, 2)
    distance = far.reshape(*n, 2, 4).mean(axis=-1)
    shape = (by_box - by_box.mean(axis=3, keepdims=True)) * distance[..., None, None]
    middle = np.median(filled(seen).reshape(*n, 2, 4, 3), axis=3)
    above = (middle[..., 1] - table.slope * middle[..., 2] - table.height) / steep
    origin = corners.mean(axis=(1, 2), keepdims=True)
    parts = [
        np.concatenate([joints, corners], axis=2) - origin,
        shape,
        heights,
        np.stack([above, middle[..., 2] - distance], axis=-1).clip(-_DEEPEST_M, _DEEPEST_M),
    ]
    # there may be no windows
    flat = [part.reshape(*n, math.prod(part.shape[2:])) for part in parts]
    return np.concatenate(flat, axis=-1).astype(np.float32)


def _exchanges() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Places of channels when the boxes are exchanged, when seen in a mirror, and then their signs."""
    swapped, mirrored = np.r_[0:13, 17:21, 13:17], np.r_[0, 7:13, 1:7, 14, 13, 16, 15, 18, 17, 20, 19]

    def pairs(order: NDArray[np.int64]) -> NDArray[np.int64]:
        return (2 * order[:, None] + [0, 1]).ravel()

    def places(order: NDArray[np.int64], depth: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.r_[pairs(order), 42 + pairs(order[13:] - 13), 58 + order[:13], depth]

    signs = np.ones(N_CHANNELS, np.float32)
    signs[0:58:2] = -1
    return places(swapped, np.r_[73, 74, 71, 72]), places(mirrored, np.r_[71:75]), signs


SWAP_CHANNELS, MIRROR_CHANNELS, MIRROR_SIGNS = _exchanges()
"""``channels[..., SWAP_CHANNELS]``, ``channels[..., MIRROR_CHANNELS] * MIRROR_SIGNS``."""
