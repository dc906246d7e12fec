"""Which objects of two annotators are the same thing."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ecat.model import AnnotatedObject
from ecat.model.shapes import shape_at

Box = tuple[float, float, float, float]
LEAST_IOU = 0.5


def match_objects(
    first: Sequence[AnnotatedObject], second: Sequence[AnnotatedObject], *, least_iou: float = LEAST_IOU
) -> dict[str, tuple[str, float]]:
    """Ids of ``second`` by those of ``first``, each with how well the two agree, from 0 to 1.

    What both drew is the same thing if the boxes around it overlap by ``least_iou`` on average over the frames that
    either of the two has a key frame at; what neither drew (marked boxes, skeletons: their marks are in tables) is the
    same if it has the same id, or else the same name, and agrees by 1.  Names of drawn things do not count: what one
    calls ``box`` is the other's ``chocolate``.
    """
    gain = np.zeros((len(first), len(second)))
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            gain[i, j] = _alike(a, b)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    return {
        first[i].id: (second[j].id, min(float(gain[i, j]), 1.0))
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
        if gain[i, j] >= least_iou
    }


def _alike(first: AnnotatedObject, second: AnnotatedObject) -> float:
    drawn = bool(first.key_frames), bool(second.key_frames)
    if all(drawn):
        return mean_iou(first, second)
    if any(drawn) or first.kind != second.kind:
        return 0.0
    # an equal id is better than an equal name
    if first.id == second.id:
        return 1.5
    return 1.0 if first.name and first.name.casefold() == second.name.casefold() else 0.0


def mean_iou(first: AnnotatedObject, second: AnnotatedObject) -> float:
    """Intersection over union of the boxes around two drawn objects, over the frames at which either has a key.

    A frame in which only one of them is there counts as 0, one in which neither is does not count.
    """
    frames = sorted({max(key.frame, 0) for thing in (first, second) for key in thing.key_frames})
    found: list[float] = []
    for frame in frames:
        a, b = box_at(first, frame), box_at(second, frame)
        if a is not None or b is not None:
            found.append(_iou(a, b) if a is not None and b is not None else 0.0)
    return float(np.mean(found)) if found else 0.0


def box_at(thing: AnnotatedObject, frame: int) -> Box | None:
    """Left, top, right and bottom of the object in the image ``frame``, in pixels; None where it is not."""
    shape = shape_at(thing, frame)
    return None if shape is None else _bounds(shape, thing.kind)


def _iou(first: Box, second: Box) -> float:
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    common = max(width, 0.0) * max(height, 0.0)
    either = _area(first) + _area(second) - common
    return common / either if either > 0 else 0.0


def _area(box: Box) -> float:
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)


def _bounds(coordinates: Sequence[float], kind: str) -> Box | None:
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
