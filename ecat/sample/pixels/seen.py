"""What of the markers is to be seen in an image: the truth that a detector is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ecat.geometry.transforms import Floats
from ecat.sample.pixels.layers import Layer, Quad, quad_layer, transmissions
from ecat.sample.pixels.view import Pixels, View

_WHITE = np.full((64, 64, 4), 255, np.uint8)


@dataclass(frozen=True, eq=False)
class SeenFaces:
    """The markers of all boxes in one image.

    Parameters
    ----------
    pixels : (boxes, faces, 4, 2) corners in the marker's own order, px; NaN behind the camera.
    side_px : (boxes, faces) shortest side.
    tilt_rad : (boxes, faces) between the marker's normal and the way to the camera; more than pi / 2: turned away.
    visible : (boxes, faces) share of the marker's area in the image that is neither turned away, nor beyond the
        image's edge, nor behind a box, an arm or a hand.
    """

    pixels: Floats
    side_px: Floats
    tilt_rad: Floats
    visible: Floats


def seen_faces(view: View, rings: Sequence[Floats], layers: Mapping[str, Layer | None]) -> SeenFaces:
    """Measure the markers with corners ``rings`` (faces, 4, 3), ``table`` frame, on boxes ``layers["box 0"]`` ..."""
    corners = np.stack(rings)
    pixels = view.pixels(corners)
    sides = np.sqrt(((np.roll(pixels, -1, -2) - pixels) ** 2).sum(-1))
    normal = np.cross(corners[..., 3, :] - corners[..., 0, :], corners[..., 1, :] - corners[..., 0, :])
    to_eye = view.eye - corners.mean(-2)
    cosine = (normal * to_eye).sum(-1) / np.sqrt((normal**2).sum(-1) * (to_eye**2).sum(-1))
    names = [name for name, layer in layers.items() if layer is not None]
    known = [layer for layer in layers.values() if layer is not None]
    passed = dict(zip(names, zip(known, transmissions(known), strict=True), strict=True))
    visible = np.zeros(cosine.shape)
    for box, face in zip(*np.nonzero(cosine > 0), strict=True):
        if f"box {box}" in passed:
            visible[box, face] = _share(view, corners[box, face], pixels[box, face], *passed[f"box {box}"])
    return SeenFaces(pixels, sides.min(-1), np.arccos(np.clip(cosine, -1, 1)), visible)


def _share(view: View, ring: Floats, pixels: Floats, box: Layer, passed: Pixels) -> float:
    """Share of one marker's area whose light arrives."""
    quad = Quad(ring[0], ring[1] - ring[0], ring[3] - ring[0], _WHITE)
    seen = quad_layer(view, quad, 1.0)
    shared = None if seen is None else seen.rect.common(box.rect)
    if seen is None or shared is None:
        return 0.0
    light = seen.cover[shared.within(seen.rect)] * passed[shared.within(box.rect)]
    x, y = pixels.T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    return min(1.0, float(light.sum()) / area)
