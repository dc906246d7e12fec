"""The soft shadow of a box on the table."""

from __future__ import annotations

import cv2
import numpy as np

from ecat.geometry.transforms import Floats
from ecat.sample.pixels.layers import Layer
from ecat.sample.pixels.view import View

DARK = 0.42
"""Share of the light that a shadow takes where it is deepest."""
_COARSE = 4


def shadow_layer(view: View, corners: Floats, lamp: Floats) -> Layer | None:
    """Darkness on the table behind a box with ``corners`` (n, 3); the higher the box, the softer."""
    fallen = corners - np.maximum(corners[:, 2:], 0) / lamp[2] * lamp * 0.6
    fallen[:, 2] = 0
    softness = 0.012 + 0.3 * max(0.0, float(corners[:, 2].min()))
    rect = view.rect(fallen, 3 * softness, 4)
    if rect is None:
        return None
    rows, columns = -(-rect.shape[0] // _COARSE), -(-rect.shape[1] // _COARSE)
    outline = (view.pixels(fallen) - [rect.left, rect.top] + 0.5) / _COARSE - 0.5
    mask = np.zeros((rows, columns), np.uint8)
    hull = cv2.convexHull(np.rint(outline * 16).astype(np.int32))
    cv2.fillConvexPoly(mask, hull, 255, cv2.LINE_AA, 4)
    scale = view.camera.fx / float(view.from_table.apply(fallen.mean(0))[2])
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), max(0.3, softness * scale / _COARSE))
    full = cv2.resize(soft, (columns * _COARSE, rows * _COARSE))[: rect.shape[0], : rect.shape[1]]
    cover = full * np.float32(DARK / 255)
    # a hair above the table, so that the table does not hide it
    inverse = view.inverse_depth(rect, np.array([0.0, 0.0, 1.0]), np.zeros(3)) * np.float32(1 + 1e-5)
    return Layer(rect, np.zeros((*rect.shape, 3), np.float32), cover, inverse, np.zeros(rect.shape, bool))
