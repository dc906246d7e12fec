"""Shapes of an object between its key frames (ECAT 2018 file format §2.11)."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ecat.model.annotation import AnnotatedObject, KeyFrame, ObjectKind

MOST_NUMBERS = 10_000
"""Of one shape."""
_MOST_COORDINATE = 1e9


def shape_at(thing: AnnotatedObject, frame: int, dimensions: int = 2) -> tuple[float, ...] | None:
    """The coordinates of an object at ``frame``; ``None`` where it has no shape: before its first key frame, or absent.

    Shapes are blended number by number where the object says ``linear`` and both key frames have as many numbers;
    elsewhere, and before an absence, the earlier one holds.
    """
    keys: Sequence[KeyFrame] = thing.key_frames if dimensions == 2 else thing.key_frames_3d
    before = max((key for key in keys if key.frame <= frame), key=lambda key: key.frame, default=None)
    if before is None or not before.present:
        return None
    after = min((key for key in keys if key.frame > frame), key=lambda key: key.frame, default=None)
    blended = after is not None and after.present and len(after.coordinates) == len(before.coordinates)
    if after is None or not blended or thing.interpolation == "hold" or before.frame == frame:
        return before.coordinates
    share = (frame - before.frame) / (after.frame - before.frame)
    return tuple(a + share * (b - a) for a, b in zip(before.coordinates, after.coordinates, strict=True))


def shape_problem(kind: ObjectKind, coordinates: Sequence[float], dimensions: int) -> str:
    """What is wrong with the coordinates of a shape of this kind, or nothing."""
    n = len(coordinates)
    if n > MOST_NUMBERS:
        return f"{n} numbers, at most {MOST_NUMBERS} are a shape"
    if not all(math.isfinite(x) and abs(x) <= _MOST_COORDINATE for x in coordinates):
        return "a coordinate that is no place"
    if dimensions == 3:
        return "" if n and n % 3 == 0 else f"{n} numbers, expected x, y, z of every vertex"
    if kind == "rectangle":
        if n != 4:
            return f"{n} numbers, expected u, v, width, height"
        return "" if coordinates[2] > 0 and coordinates[3] > 0 else "its width and height are not positive"
    if kind == "point":
        return "" if n == 2 else f"{n} numbers, expected u, v"
    if kind in {"marker_box", "rig"}:
        return "its places are in tables, not drawn"
    return "" if n and n % 2 == 0 else f"{n} numbers, expected u, v of every vertex"
