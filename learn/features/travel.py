"""Features in the frame of a box that moves, which do not depend on where the table is, and of how faces turn.

The frame lies in the first box, where the window begins, and points where the box gets to, or along x if it rests.
The face that a marker is on turns about the axis across the heading while its box rolls, and does not while it slides;
where it faces follows from the rays to its corners alone, because a marker is a square.
"""

from __future__ import annotations

import numpy as np

from learn.features.scene import KNOTS, Floats, Scene, cross, knots, norm


def travel_features(scene: Scene, places: Floats, hands: Floats, body: Floats) -> list[Floats]:
    """Features, each (w, ...), of a scene, and of its boxes (w, 5, 2, 2), hands (w, 5, 2, 3), body (w, 5, 3)."""
    way = places[:, -1, 0] - places[:, 0, 0]
    heading = _direction(np.where(norm(way)[:, None] > 1e-6, way, [1.0, 0.0]))[:, None]
    return [
        *_around(places, hands, body, heading),
        *_passing(scene.boxes, places),
        *_of_faces(scene, heading),
    ]


def _around(places: Floats, hands: Floats, body: Floats, heading: Floats) -> list[Floats]:
    """Where the other box, the nearer hand and the body are, seen from the first box along its heading."""
    first = places[:, :, 0]
    other = places[:, :, 1] - first
    offsets = hands[..., :2] - first[:, :, None]
    nearer = norm(offsets).mean(axis=1).argmin(axis=1)[:, None, None, None]
    hand = np.take_along_axis(offsets, nearer, axis=2)[:, :, 0]
    to_body = body[..., :2] - first
    bearing = other / np.maximum(norm(other), 0.02)[..., None]
    return [
        _along(first - first[:, :1], heading)[:, 1:],
        _along(other[:, ::2], heading),
        _along(bearing[:, [0, -1]], heading),
        _along(hand, heading),
        norm(hand),
        _along(to_body[:, [0, -1]], heading),
        _along(_direction(to_body[:, [0, -1]]), heading),
        heading,
    ]


def _passing(boxes: Floats, places: Floats) -> list[Floats]:
    """How fast both boxes are, ten times in a window, and when and how near the first comes to the other."""
    fine = boxes.reshape(len(boxes), 2 * KNOTS, -1, 2, 2).mean(axis=2)
    speed = norm(np.diff(fine, axis=1))
    apart = places[:, :, 1] - places[:, :, 0]
    last = places[:, -1, 0] - places[:, -2, 0]
    ahead = (apart[:, -1] * last).sum(axis=-1) / np.maximum((last**2).sum(axis=-1), 1e-4)
    ahead = ahead.clip(-50, 50)
    distance, knot = norm(boxes[:, :, 1] - boxes[:, :, 0]), norm(apart)
    return [
        *(speed, speed.max(axis=1), speed.min(axis=1), speed.argmax(axis=1).astype(np.float64)),
        norm(np.diff(boxes, axis=1)).mean(axis=1),
        ahead,
        norm(apart[:, -1] - ahead[:, None] * last).clip(0, 5),
        knot[:, -1] / np.maximum(knot[:, 0], 0.02),
        *(part.astype(np.float64) for part in (distance.argmin(axis=1), distance.argmax(axis=1))),
        *(distance.min(axis=1) - distance[:, 0], distance.max(axis=1) - distance[:, -1]),
        distance[:, -4:].mean(axis=1),
    ]


def _of_faces(scene: Scene, heading: Floats) -> list[Floats]:
    """Where the faces with the markers look, and how they and their edges turn."""
    first, second, sizes = _edges(scene)
    face = _direction(np.cross(first, second))
    middle = np.concatenate([scene.rays.mean(axis=3), np.ones((*face.shape[:-1], 1))], axis=-1)
    face = np.where((face * middle).sum(axis=-1, keepdims=True) > 0, -face, face)
    upright = scene.level(face)
    turn, mean = _angle(upright[:, 1:], upright[:, :-1]), _direction(knots(upright))
    ahead, aside = heading[:, :, None], np.stack([heading[..., 1], -heading[..., 0]], axis=-1)[:, :, None]
    distance = np.log(np.maximum(knots(1 / np.sqrt(sizes[..., 0] * sizes[..., 1])), 1e-3))
    skewed = knots(np.abs((first * second).sum(axis=-1)))
    return [
        mean[..., 2],
        mean[:, ::2, :, :2],
        *((mean[..., :2] * axis).sum(axis=-1) for axis in (ahead, aside)),
        *(_angle(mean[:, 1:], mean[:, :-1]), _angle(mean[:, -1], mean[:, 0])),
        turn.sum(axis=1),
        np.sort(turn, axis=1)[:, [9, 14, 16, 17, 18]],
        *((turn > angle).sum(axis=1) for angle in (0.2, 0.6)),
        *(upright[..., 2].std(axis=1), np.ptp(upright[..., 2], axis=1)),
        np.abs(np.diff(upright[..., 2], axis=1)).sum(axis=1),
        *(part for edge in (first, second) for part in _turning(scene.level(edge))),
        *(distance, distance[:, -1] - distance[:, 0]),
        *(knots(np.log(sizes[..., 0] / sizes[..., 1]))[:, ::2], skewed[:, ::2]),
    ]


def _edges(scene: Scene) -> tuple[Floats, Floats, Floats]:
    """Directions (w, t, box, 3) in camera space of two edges of each marker, and how long both (w, t, box, 2) are
    for their distance, from the projective map of a square to its corners (Heckbert 1989).
    """
    x, y = scene.rays[..., 0], scene.rays[..., 1]
    across = scene.rays[..., [1, 3], :] - scene.rays[..., [2], :]
    excess = scene.rays[..., 0, :] - scene.rays[..., 1, :] + scene.rays[..., 2, :] - scene.rays[..., 3, :]
    area = cross(across[..., 0, :], across[..., 1, :])
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    near = [cross(excess, across[..., 1, :]) / area, cross(across[..., 0, :], excess) / area]
    edges = [
        np.stack([x[..., to] * (1 + h) - x[..., 0], y[..., to] * (1 + h) - y[..., 0], h], axis=-1)
        for to, h in zip((1, 3), near, strict=True)
    ]
    sizes = np.maximum(np.stack([norm(edge) for edge in edges], axis=-1), 1e-6)
    return _direction(edges[0]), _direction(edges[1]), sizes


def _turning(edge: Floats) -> list[Floats]:
    mean = _direction(knots(edge))
    return [
        norm(np.diff(mean, axis=1)),
        norm(mean[:, -1] - mean[:, 0]),
        norm(np.diff(edge, axis=1)).sum(axis=1),
    ]


def _along(vectors: Floats, heading: Floats) -> Floats:
    """Vectors (w, k, 2) by how far they go ahead, and to the left."""
    return np.stack([(vectors * heading).sum(axis=-1), cross(heading, vectors)], axis=-1)


def _direction(vectors: Floats) -> Floats:
    return vectors / np.maximum(norm(vectors), 1e-9)[..., None]


def _angle(a: Floats, b: Floats) -> Floats:
    """Between unit vectors."""
    return np.arccos(np.clip((a * b).sum(axis=-1), -1, 1))
