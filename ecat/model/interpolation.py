"""Where a drawn object is between its key frames (ECAT 2018 file format §2.11)."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

from ecat.model.annotation import AnnotatedObject, KeyFrame


def shape_at(thing: AnnotatedObject, frame: int) -> tuple[float, ...] | None:
    """The coordinates of ``thing`` in the image ``frame``; None where it is absent or not drawn yet.

    Between two key frames of as many coordinates they are blended in proportion, unless the object says
    ``hold``; after the last one, and before one of another shape or an absence, the earlier one holds.
    """
    return shape_between(thing.key_frames, frame, linear=thing.interpolation == "linear")


def shape_between(keys: Sequence[KeyFrame], frame: int, *, linear: bool) -> tuple[float, ...] | None:
    """The same for key frames in ascending order."""
    after = bisect_right(keys, frame, key=lambda key: key.frame)
    if not after or not keys[after - 1].present:
        return None
    first = keys[after - 1]
    if not linear or first.frame == frame or after == len(keys):
        return first.coordinates
    last = keys[after]
    if not last.present or len(last.coordinates) != len(first.coordinates):
        return first.coordinates
    share = (frame - first.frame) / (last.frame - first.frame)
    return tuple(a + share * (b - a) for a, b in zip(first.coordinates, last.coordinates, strict=True))


def bounds(coordinates: Sequence[float], kind: str) -> tuple[float, float, float, float] | None:
    """Left, top, right and bottom of a shape, in pixels; None of one without extent."""
    if kind == "rectangle":
        if len(coordinates) != 4:
            return None
        u, v, width, height = coordinates
        box = (u, v, u + width, v + height)
    else:
        if len(coordinates) < 6:
            return None
        us, vs = coordinates[0::2], coordinates[1::2]
        box = (min(us), min(vs), max(us), max(vs))
    return box if all(map(math.isfinite, box)) else None
