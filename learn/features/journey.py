"""The way of a box through a session: at each window, how far it has come of what it will have come at the end."""

from __future__ import annotations

import numpy as np

from learn.features.scene import Floats, Table, cross, norm, scene_of
from learn.features.windows import HOP, LENGTH, Features, n_windows

_STEADY = 5
"""Frames whose mean a place is; also those in which a way begins and ends."""
_STILL_M, _AWAY_M, _HARDLY_M = 0.002, 0.03, 0.02
"""Less in a frame is no step; farther from the beginning is on its way; shorter than this, no way has a direction."""
_MOMENTS = np.array([0, LENGTH // 2, LENGTH - 1])
_PER_DECISECOND = 10.0  # frames; only to keep numbers small


def journey_features(points: Floats, table: Table) -> tuple[Features, Features]:
    """For either box as the one that moves, features (w, f) of the windows of a session of points (n, 21, 3).

    Metres, and shares of the session or of the way: when and how far the box has gone since the beginning, along the
    line to where it ends, where it is relative to the other box, now, at its nearest, and at both ends.
    """
    scene = scene_of(points[None], table)
    boxes, hands = _steadied(scene.boxes[0]), _steadied(scene.hands[0])
    return _journey(boxes, hands, 0), _journey(boxes, hands, 1)


def _journey(boxes: Floats, hands: Floats, box: int) -> Features:
    place, other = boxes[:, box], boxes[:, 1 - box]
    n_frames, count = len(place), n_windows(len(place))
    step = norm(np.diff(place, axis=0, prepend=place[:1]))
    path = np.cumsum(np.where(step < _STILL_M, 0.0, step))
    gone = place - place[:_STEADY].mean(axis=0)
    end = gone[-_STEADY:].mean(axis=0)
    reach = max(float(norm(end)), _HARDLY_M)
    ahead = end / reach
    along, apart = gone @ ahead, norm(place - other)
    nearest, whole = int(apart.argmin()), max(float(path[-1]), _HARDLY_M / 20)
    left_at = np.flatnonzero(norm(gone) > _AWAY_M)
    begun = int(left_at[0]) if len(left_at) else n_frames
    hand = norm(hands[..., :2] - place[:, None]).min(axis=1)

    number = np.arange(count)
    frames = np.minimum(number[:, None] * HOP + _MOMENTS, n_frames - 1)  # (w, moment)
    middle = frames[:, 1]
    session = [begun / n_frames, whole, reach, apart[0], apart[-1], apart[nearest], nearest / n_frames]
    told = [
        np.stack([number / count, np.full(count, count), number, count - number], axis=1),
        np.tile(session, (count, 1)),
        np.stack([middle - begun, middle - nearest], axis=1) / _PER_DECISECOND,
        path[frames] / whole, path[frames], norm(gone)[frames], along[frames] / reach, along[frames],
        apart[frames], apart[frames] - apart[nearest], apart[frames] - apart[0], apart[frames] - apart[-1],
        ((place - other) @ ahead)[frames], cross(ahead, place - other)[frames], hand[frames],
    ]  # fmt: skip
    series = (path, along, apart, (place - other) @ ahead)
    told += [(value[frames[:, 2]] - value[frames[:, 0]])[:, None] for value in series]
    return np.concatenate(told, axis=1).astype(np.float32)


def _steadied(values: Floats) -> Floats:
    """Means of some frames of (n, ...), as many at both ends."""
    edge = _STEADY // 2
    padded = np.concatenate([values[:1]] * edge + [values] + [values[-1:]] * edge)
    return np.lib.stride_tricks.sliding_window_view(padded, _STEADY, axis=0).mean(axis=-1)
