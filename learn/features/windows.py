"""Features of windows of twenty frames: how two boxes and two hands lie and move on the table.

The frames are those of :mod:`learn.features.points`, and what they show is a :class:`learn.features.scene.Scene`.
What is told are means of four frames, five to a window; the first box is told of as if it were the one that moves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from learn.features.scene import (
    KNOTS,
    NEAREST_M,
    Floats,
    Scene,
    Table,
    cross,
    knots,
    norm,
    scene_of,
    unit,
    wrapped,
)
from learn.features.travel import travel_features

__all__ = ["HOP", "KNOTS", "LENGTH", "VERSION", "Features", "Floats", "Table"]

Features = NDArray[np.float32]

VERSION = "windows-4"
"""Changes whenever a feature does: a model knows what it was trained with."""
LENGTH, HOP = 20, 5
"""Frames of a window, and from one window to the next (thesis chapter 4)."""

_MIRROR = np.r_[0, 7:13, 1:7, 14, 13, 16, 15, 18, 17, 20, 19]
_TIPS = [5, 11]
_CHUNK = 512


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
    known = corners[np.isfinite(corners).all(axis=1) & (corners[:, 2] > NEAREST_M)]
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


def window_features(windows: Floats, table: Table) -> Features:
    """Features of windows (w, 20, 21, 3): (w, n).

    Points that are not known (NaN, or the export's -1) take the nearest known of their window, and 0 if there is none.
    """
    return np.concatenate([_features(scene_of(chunk, table)) for chunk in chunks_of(windows)])


def either_way(windows: Floats, table: Table) -> tuple[Features, Features]:
    """What :func:`window_features` gives of windows (w, 20, 21, 3), and of the same with the boxes exchanged."""
    scene = scene_of(windows, table)
    return _features(scene), _features(scene.exchanged)


def chunks_of(windows: Floats) -> list[Floats]:
    """Windows in parts of which all that is computed stays in the cache; one part if there are none."""
    return [windows[start : start + _CHUNK] for start in range(0, len(windows), _CHUNK)] or [windows]


def session_features(features: Features, counts: Sequence[int]) -> Features:
    """Features (s, 2 n) of whole sessions: means and deviations of those (w, n) of their windows, of which each has
    ``counts``, one at least.
    """
    starts, size = np.cumsum([0, *counts])[:-1], np.array(counts)[:, None]
    if not len(starts):
        return np.zeros((0, 2 * features.shape[1]), np.float32)
    mean = np.add.reduceat(features, starts, axis=0, dtype=np.float64) / size
    off = features - np.repeat(mean, counts, axis=0)
    deviation = np.sqrt(np.add.reduceat(off * off, starts, axis=0) / size)
    return np.concatenate([mean, deviation], axis=1).astype(np.float32)


# --- from places to features


def _features(scene: Scene) -> Features:
    boxes = scene.boxes
    body, places, hand_places = knots(scene.body), knots(boxes), knots(scene.hands)
    parts = [
        *_of_boxes(boxes, places, body),
        *_between(places),
        *_of_hands(hand_places, knots(scene.joints[:, :, _TIPS]), places, body),
        *(feature for box in (0, 1) for feature in _of_handling(box, hand_places, places)),
        *_of_markers(scene),
        *travel_features(scene, places, hand_places, body),
    ]
    n = len(boxes)
    return np.concatenate([part.reshape(n, -1) for part in parts], axis=1).astype(np.float32)


def _of_boxes(boxes: Floats, places: Floats, body: Floats) -> list[Floats]:
    """Where each box is and how it moves."""
    steps, total = np.diff(places, axis=1), places[:, -1] - places[:, 0]
    lengths, by_frame = norm(steps), norm(np.diff(boxes, axis=1))
    return [
        places - body[:, 2:3, None, :2],
        places[:, ::2],
        body[:, 2],
        body[:, -1] - body[:, 0],
        steps,
        lengths,
        lengths[..., 0] - lengths[..., 1],
        total,
        norm(total),
        by_frame.sum(axis=1),
        np.sort(by_frame, axis=1)[:, -4],
        norm(boxes[:, :, 1] - boxes[:, :, 0]).min(axis=1),
        *(_towards_body(total[:, box], body[:, 2, :2] - places[:, 0, box]) for box in (0, 1)),
    ]


def _between(places: Floats) -> list[Floats]:
    """How the boxes lie and move with respect to each other, on the line between them and along their movement."""
    apart = places[:, :, 1] - places[:, :, 0]
    distance = norm(apart)
    towards = apart / np.maximum(distance, 0.02)[..., None]
    halfway = (towards[:, 1:] + towards[:, :-1]) / 2
    steps, total = np.diff(places, axis=1), places[:, -1] - places[:, 0]
    found = [apart, distance, np.diff(distance, axis=1), distance[:, -1] - distance[:, 0]]
    for box, sign in ((0, 1.0), (1, -1.0)):
        nearer = sign * (steps[:, :, box] * halfway).sum(axis=-1)
        aside = sign * cross(steps[:, :, box], halfway)
        heading = unit(total[:, box])
        found += [nearer, nearer.sum(axis=1), aside, aside.sum(axis=1), np.abs(aside).sum(axis=1)]
        found += [
            sign * (apart * heading[:, None]).sum(axis=-1),
            np.abs(cross(apart, heading[:, None]))[:, ::2],
        ]
        found += [sign * (heading * towards[:, knot]).sum(axis=-1) for knot in (0, -1)]
    return found


def _of_hands(hands: Floats, tips: Floats, places: Floats, body: Floats) -> list[Floats]:
    """Where the hands are, and how far from the boxes."""
    offsets = hands[:, :, :, None, :2] - places[:, :, None]
    distance = norm(offsets)
    return [
        hands - body[:, 2:3, None],
        tips[..., 2],
        distance,
        distance.min(axis=2),
        distance.min(axis=(1, 2)),
        distance[..., 0] - distance[..., 1],
        norm(tips[:, :, :, None, :2] - places[:, :, None]).min(axis=2),
        offsets[:, ::2],
    ]


def _of_handling(box: int, hands: Floats, places: Floats) -> list[Floats]:
    """How the hand that is nearer to a box moves with it: before it or behind it, beside it, above the table."""
    offsets = hands[..., :2] - places[:, :, box, None]
    nearer = norm(offsets).mean(axis=1).argmin(axis=1)[:, None, None, None]
    hand = np.take_along_axis(hands, nearer, axis=2)[:, :, 0]
    offset = np.take_along_axis(offsets, nearer, axis=2)[:, :, 0]
    hand_steps, steps = np.diff(hand[..., :2], axis=1), np.diff(places[:, :, box], axis=1)
    heading = unit(places[:, -1, box] - places[:, 0, box])[:, None]
    return [
        norm(hand_steps - steps),
        (hand_steps * steps).sum(axis=-1),
        norm(hand_steps),
        (offset * heading).sum(axis=-1),
        np.abs(cross(offset, heading)),
        hand[..., 2],
    ]


def _of_markers(scene: Scene) -> list[Floats]:
    """How markers look and how that changes: a box that rolls turns them, one that slides does not."""
    shape = scene.shape
    first = (shape[..., 1, :] - shape[..., 0, :] + shape[..., 2, :] - shape[..., 3, :]) / 2
    second = (shape[..., 3, :] - shape[..., 0, :] + shape[..., 2, :] - shape[..., 1, :]) / 2
    area, lengths = cross(first, second), np.stack([norm(first), norm(second)], axis=-1)
    shapes, sides = knots(shape), knots(lengths)
    change = np.sqrt((np.diff(shape, axis=1) ** 2).sum(axis=(-1, -2)))
    angles = [np.arctan2(edge[..., 1], edge[..., 0]) for edge in (first, second)]
    turns = [np.abs(wrapped(np.diff(angle, axis=1))).sum(axis=1) for angle in angles]
    return [
        knots(np.concatenate([first, second], axis=-1))[:, ::2],
        sides[..., 0] / np.maximum(sides[..., 1], 0.01),
        knots(area),
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
        knots(scene.depth)[:, ::2],
        knots(scene.height),
    ]


def _towards_body(movement: Floats, body: Floats) -> Floats:
    return (unit(movement) * body).sum(axis=-1) / np.maximum(norm(body), 0.05)
