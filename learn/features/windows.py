"""Features of windows of twenty frames: how two boxes and two hands lie and move on the table.

The frames are those of :mod:`learn.features.points`.  The depth of a marker's corner jumps by decimetres now and then,
while the direction in which a corner is seen does not; so places of boxes are where the rays through their corners meet
the table, and the shape of a marker is the one in the image.  Within a window, corners are medians of three frames, and
what is told are means of four frames, five to a window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError

Floats = NDArray[np.float64]
Features = NDArray[np.float32]

VERSION = "windows-1"
"""Changes whenever a feature does: a model knows what it was trained with."""
LENGTH, HOP = 20, 5
"""Frames of a window, and from one window to the next (thesis chapter 4)."""
KNOTS = 5
CONTEXT = 60
"""Frames around the middle of a window that its nearer context consists of."""

_MIRROR = np.r_[0, 7:13, 1:7, 14, 13, 16, 15, 18, 17, 20, 19]
_NEVER_SEEN = -1.0
_NEAREST_M = 0.3
"""What is nearer to the camera is no marker, but a point that was not seen."""
_FLATTEST = -0.15
"""Rays that fall less than this per metre, relative to the table, meet it too far away to say where."""
_SHOULDERS, _TIPS, _HANDS = [1, 7], [5, 11], ([3, 4, 5], [9, 10, 11])


@dataclass(frozen=True)
class Table:
    """The table in camera space: y = slope z + height, level from side to side."""

    slope: float
    height: float


@dataclass(frozen=True)
class _Scene:
    """What features are made of, each (windows, frames, ...), in metres along x, along the table, above it."""

    corners: Floats  # (w, t, box, 4, 2) on the table
    shape: Floats  # (w, t, box, 4, 2) about the middle, across the line of sight
    height: Floats  # (w, t, box) above the table by depth
    depth: Floats  # (w, t, box) how much farther than the table by depth
    joints: Floats  # (w, t, 13, 3)


def mirror(points: Floats) -> Floats:
    """The points (..., 21, 3) seen in a mirror: left is right, and corners keep their sense of rotation."""
    return points[..., _MIRROR, :] * [-1.0, 1.0, 1.0]


def fit_table(points: Floats) -> Table:
    """The table under the markers in frames (n, 21, 3), fitted to the sessions that a recogniser is trained on.

    Raises
    ------
    InputError : fewer than three corners are known.
    """
    corners = points[:, 13:].reshape(-1, 3)
    known = corners[np.isfinite(corners).all(axis=1) & (corners[:, 2] > _NEAREST_M)]
    if len(known) < 3:
        raise InputError(
            "cannot find the table",
            where=f"{len(known)} of {len(corners)} corners of markers are known",
            fix="give sessions whose markers were seen",
        )
    across = np.c_[known[:, 2], np.ones(len(known))]
    line = np.linalg.lstsq(across, known[:, 1], rcond=None)[0]
    for _ in range(20):  # glitches of depth are a tenth of all, far off, and to one side
        off = np.abs(known[:, 1] - across @ line)
        used = off <= 2 * np.median(off)
        line = np.linalg.lstsq(across[used], known[used, 1], rcond=None)[0]
    return Table(float(line[0]), float(line[1]))


def n_windows(n_frames: int) -> int:
    """How many windows a session of so many frames has."""
    return max(0, (n_frames - LENGTH) // HOP + 1)


def windows_of(points: Floats) -> Floats:
    """The windows (w, 20, 21, 3) of a session (n, 21, 3); window i is frames 5 i to 5 i + 19."""
    starts = HOP * np.arange(n_windows(len(points)))
    return points[starts[:, None] + np.arange(LENGTH)]


def surroundings_of(points: Floats) -> tuple[Floats, Floats]:
    """Of a session (n, 21, 3), sixty frames around each of its windows, and the session, twenty frames of each.

    Returns
    -------
    near : (w, 20, 21, 3)
    whole : (1, 20, 21, 3)
    """
    steps = np.arange(LENGTH)
    middle = HOP * np.arange(n_windows(len(points)))[:, None] + (LENGTH - 1) / 2
    near = np.round(middle + (steps - (LENGTH - 1) / 2) * CONTEXT / LENGTH).astype(np.int64)
    whole = np.round(np.linspace(0, len(points) - 1, LENGTH)).astype(np.int64)
    return points[near.clip(0, len(points) - 1)], points[None, whole]


def window_features(windows: Floats, table: Table) -> Features:
    """Features of windows (w, 20, 21, 3): (w, n).

    Points that are not known (NaN, or the export's -1) take the nearest known of their window, and 0 if there is none.
    """
    chunks = [windows[start : start + 1024] for start in range(0, len(windows), 1024)] or [windows]
    return np.concatenate([_features(_scene(chunk, table)) for chunk in chunks])


# --- from points to places


def _scene(windows: Floats, table: Table) -> _Scene:
    n = windows.shape[:2]
    steep = np.hypot(1.0, table.slope)
    x, y, z = np.moveaxis(_filled(windows[:, :, :13]), -1, 0)
    joints = np.stack(
        [x, (table.slope * y + z) / steep, (y - table.slope * z - table.height) / steep], axis=-1
    )
    seen = windows[:, :, 13:]
    lost = (seen == _NEVER_SEEN).all(axis=-1) | ~np.isfinite(seen).all(axis=-1) | (seen[..., 2] < _NEAREST_M)
    seen = np.where(lost[..., None], np.nan, seen)
    right, up = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    far = table.height / np.minimum(up - table.slope, _FLATTEST)
    corners = np.stack([right * far, far * (table.slope * up + 1) / steep], axis=-1)
    rays = _steady(_filled(np.stack([right, up], axis=-1))).reshape(*n, 2, 4, 2)
    distance = _steady(_filled(far)).reshape(*n, 2, 4).mean(axis=-1)
    by_depth = _filled(seen).reshape(*n, 2, 4, 3)
    y, z = np.median(by_depth[..., 1], axis=-1), np.median(by_depth[..., 2], axis=-1)
    return _Scene(
        corners=_steady(_filled(corners)).reshape(*n, 2, 4, 2),
        shape=(rays - rays.mean(axis=3, keepdims=True)) * distance[..., None, None],
        height=(y - table.slope * z - table.height) / steep,
        depth=z - distance,
        joints=joints,
    )


def _filled(values: Floats) -> Floats:
    """(w, t, ...) with the nearest earlier value, or else the next, where one is NaN; 0 where all are."""
    n, t = values.shape[:2]
    flat = values.reshape(n, t, -1)
    known = np.isfinite(flat)
    if known.all():
        return values
    frame = np.arange(t)[:, None]
    before = np.maximum.accumulate(np.where(known, frame, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, frame, t)[:, ::-1], axis=1)[:, ::-1]
    source = np.where(before >= 0, before, after % t)
    return np.nan_to_num(np.take_along_axis(flat, source, axis=1)).reshape(values.shape)


def _steady(values: Floats) -> Floats:
    """Medians of three frames of (w, t, ...)."""
    padded = np.concatenate([values[:, :1], values, values[:, -1:]], axis=1)
    a, b, c = padded[:, :-2], padded[:, 1:-1], padded[:, 2:]
    return np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))


def _knots(values: Floats) -> Floats:
    """Means of four frames of (w, 20, ...): (w, 5, ...)."""
    n, t = values.shape[:2]
    return values.reshape(n, KNOTS, t // KNOTS, *values.shape[2:]).mean(axis=2)


# --- from places to features


def _features(scene: _Scene) -> Features:
    boxes = scene.corners.mean(axis=3)
    hands = np.stack([scene.joints[:, :, of].mean(axis=2) for of in _HANDS], axis=2)
    body = _knots(scene.joints[:, :, _SHOULDERS].mean(axis=2))
    places, hand_places = _knots(boxes), _knots(hands)
    parts = [
        *_of_boxes(boxes, places, body),
        *_between(places),
        *_of_hands(hand_places, _knots(scene.joints[:, :, _TIPS]), places, body),
        *(feature for box in (0, 1) for feature in _of_handling(box, hand_places, places)),
        *_of_markers(scene),
    ]
    n = len(boxes)
    return np.concatenate([part.reshape(n, -1) for part in parts], axis=1).astype(np.float32)


def _of_boxes(boxes: Floats, places: Floats, body: Floats) -> list[Floats]:
    """Where each box is and how it moves."""
    steps, total = np.diff(places, axis=1), places[:, -1] - places[:, 0]
    lengths, by_frame = _norm(steps), _norm(np.diff(boxes, axis=1))
    return [
        places - body[:, 2:3, None, :2],
        places[:, ::2],
        body[:, 2],
        body[:, -1] - body[:, 0],
        steps,
        lengths,
        lengths[..., 0] - lengths[..., 1],
        total,
        _norm(total),
        by_frame.sum(axis=1),
        np.sort(by_frame, axis=1)[:, -4],
        _norm(boxes[:, :, 1] - boxes[:, :, 0]).min(axis=1),
        *(_towards_body(total[:, box], body[:, 2, :2] - places[:, 0, box]) for box in (0, 1)),
    ]


def _between(places: Floats) -> list[Floats]:
    """How the boxes lie and move with respect to each other, on the line between them and along their movement."""
    apart = places[:, :, 1] - places[:, :, 0]
    distance = _norm(apart)
    towards = apart / np.maximum(distance, 0.02)[..., None]
    halfway = (towards[:, 1:] + towards[:, :-1]) / 2
    steps, total = np.diff(places, axis=1), places[:, -1] - places[:, 0]
    found = [apart, distance, np.diff(distance, axis=1), distance[:, -1] - distance[:, 0]]
    for box, sign in ((0, 1.0), (1, -1.0)):
        nearer = sign * (steps[:, :, box] * halfway).sum(axis=-1)
        aside = sign * _cross(steps[:, :, box], halfway)
        heading = _unit(total[:, box])
        found += [nearer, nearer.sum(axis=1), aside, aside.sum(axis=1), np.abs(aside).sum(axis=1)]
        found += [
            sign * (apart * heading[:, None]).sum(axis=-1),
            np.abs(_cross(apart, heading[:, None]))[:, ::2],
        ]
        found += [sign * (heading * towards[:, knot]).sum(axis=-1) for knot in (0, -1)]
    return found


def _of_hands(hands: Floats, tips: Floats, places: Floats, body: Floats) -> list[Floats]:
    """Where the hands are, and how far from the boxes."""
    offsets = hands[:, :, :, None, :2] - places[:, :, None]
    distance = _norm(offsets)
    return [
        hands - body[:, 2:3, None],
        tips[..., 2],
        distance,
        distance.min(axis=2),
        distance.min(axis=(1, 2)),
        distance[..., 0] - distance[..., 1],
        _norm(tips[:, :, :, None, :2] - places[:, :, None]).min(axis=2),
        offsets[:, ::2],
    ]


def _of_handling(box: int, hands: Floats, places: Floats) -> list[Floats]:
    """How the hand that is nearer to a box moves with it: before it or behind it, beside it, above the table."""
    offsets = hands[..., :2] - places[:, :, box, None]
    nearer = _norm(offsets).mean(axis=1).argmin(axis=1)[:, None, None, None]
    hand = np.take_along_axis(hands, nearer, axis=2)[:, :, 0]
    offset = np.take_along_axis(offsets, nearer, axis=2)[:, :, 0]
    hand_steps, steps = np.diff(hand[..., :2], axis=1), np.diff(places[:, :, box], axis=1)
    heading = _unit(places[:, -1, box] - places[:, 0, box])[:, None]
    return [
        _norm(hand_steps - steps),
        (hand_steps * steps).sum(axis=-1),
        _norm(hand_steps),
        (offset * heading).sum(axis=-1),
        np.abs(_cross(offset, heading)),
        hand[..., 2],
    ]


def _of_markers(scene: _Scene) -> list[Floats]:
    """How markers look and how that changes: a box that rolls turns them, one that slides does not."""
    shape = scene.shape
    first = (shape[..., 1, :] - shape[..., 0, :] + shape[..., 2, :] - shape[..., 3, :]) / 2
    second = (shape[..., 3, :] - shape[..., 0, :] + shape[..., 2, :] - shape[..., 1, :]) / 2
    area, lengths = _cross(first, second), np.stack([_norm(first), _norm(second)], axis=-1)
    shapes, sides = _knots(shape), _knots(lengths)
    change = np.sqrt((np.diff(shape, axis=1) ** 2).sum(axis=(-1, -2)))
    angles = [np.arctan2(edge[..., 1], edge[..., 0]) for edge in (first, second)]
    turns = [np.abs(_wrapped(np.diff(angle, axis=1))).sum(axis=1) for angle in angles]
    return [
        _knots(np.concatenate([first, second], axis=-1))[:, ::2],
        sides[..., 0] / np.maximum(sides[..., 1], 0.01),
        _knots(area),
        sides[:, [0, -1]],
        sides[:, -1] - sides[:, 0],
        lengths.std(axis=1),
        area.std(axis=1),
        np.sqrt((np.diff(shapes, axis=1) ** 2).sum(axis=(-1, -2))),
        np.sqrt(((shapes[:, -1] - shapes[:, 0]) ** 2).sum(axis=(-1, -2))),
        change.sum(axis=1),
        np.sort(change, axis=1)[:, [9, 14, 16, 18]],
        (change > 0.04).sum(axis=1),
        *turns,
        _knots(scene.depth)[:, ::2],
        _knots(scene.height),
    ]


def _towards_body(movement: Floats, body: Floats) -> Floats:
    return (_unit(movement) * body).sum(axis=-1) / np.maximum(_norm(body), 0.05)


def _unit(vectors: Floats) -> Floats:
    """Of length 1, or shorter for movements that are hardly any."""
    return vectors / np.maximum(_norm(vectors), 0.02)[..., None]


def _norm(vectors: Floats) -> Floats:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def _cross(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _wrapped(angles: Floats) -> Floats:
    return (angles + np.pi) % (2 * np.pi) - np.pi
