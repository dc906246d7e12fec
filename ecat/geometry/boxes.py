"""Boxes with square markers: recognising the faces, their corners, and the pose of one square.

A detector reports a marker's corners clockwise on the screen and its cells row by row, cell (0, 0) belonging
to the leftmost corner (ECAT 2018 file format §0.4).  Everything here is turned into the marker's own order:
top left, top right, bottom right, bottom left of the print, seen by a person in front of it.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model.prototype import BoxPrototype

# a unit square's corners in marker axes (x right, y up): top left, top right, bottom right, bottom left
SQUARE: Floats = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])


def box_corners(prototype: BoxPrototype) -> Floats:
    """Marker corners (faces, 4, 3) in box axes, metres, in the marker's own order."""
    side = np.array([f.side_m for f in prototype.faces])
    turn = matrix_from_quaternion(np.array([f.quaternion for f in prototype.faces]))
    centre = np.array([f.centre for f in prototype.faces])
    return np.einsum("fij,kj->fki", turn, SQUARE) * side[:, None, None] + centre[:, None]


@lru_cache(1 << 14)
def identify(code: str, printed: str, *, mirrored: bool) -> int | None:
    """Quarter turns by which a code as read is rotated against the printed pattern, or None if it is another
    one.

    The answer k says that the print's corner j is the read corner ``(leftmost, clockwise ...)[order[j]]``
    with ``order = corner_order(k, mirrored)``.
    """
    n = math.isqrt(len(printed))
    if len(code) != n * n:
        return None
    read = np.array(list(code)).reshape(n, n)
    seen = np.fliplr(read) if mirrored else read
    want = np.array(list(printed)).reshape(n, n)
    return next((k for k in range(4) if np.array_equal(np.rot90(seen, k), want)), None)


def corner_order(quarter_turns: int, *, mirrored: bool) -> NDArray[np.intp]:
    """Which clockwise-on-screen corner, counted from the leftmost, is the print's corner j (4,)."""
    # seen from the front, a mirrored image's clockwise ring runs the other way round
    ring = np.array([1, 0, 3, 2] if mirrored else [0, 1, 2, 3])
    return np.roll(ring, -quarter_turns)


def from_leftmost(pixels: Floats) -> NDArray[np.intp]:
    """Indices (n, 4) that start each ring (n, 4, 2) at its leftmost corner, the upper one on a tie."""
    # lexicographic in one number: detections are pixels, far below 1e6
    first = np.argmin(pixels[..., 0] * 1e6 + pixels[..., 1], axis=-1)
    return (first[:, None] + np.arange(4)) % 4


def plausible(rings: Floats) -> NDArray[np.bool_]:
    """Which rings of pixels (n, 4, 2) a square could look like: convex, no corner nearly straight or pointed."""
    side = np.roll(rings, -1, 1) - rings
    last = np.roll(side, 1, 1)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        length = np.linalg.norm(side, axis=-1)
        bend = (last[..., 0] * side[..., 1] - last[..., 1] * side[..., 0]) / (length * np.roll(length, 1, 1))
    convex = (bend > 0.02).all(1) | (bend < -0.02).all(1)
    return np.asarray(convex & (length > 1).all(1) & (np.abs(rings) < 1e5).all((1, 2)), np.bool_)


def pair_corners(pixels: Floats, points: Floats, camera: Camera) -> NDArray[np.intp]:
    """Indices (n, 4) into each ring of 3-D corners that pair it with the ring of 2-D corners.

    The two lists were rotated independently (ECAT 2018 file format §0.3), so the cyclic shift that reprojects
    best is taken.  ``pixels`` (n, 4, 2), ``points`` (n, 4, 3) in the camera's reference frame, NaN = missing.
    """
    projected = camera.project(points)
    shifts = (np.arange(4)[:, None] + np.arange(4)) % 4
    gap = np.linalg.norm(projected[:, shifts] - pixels[:, None], axis=-1)
    cost = np.where(np.isfinite(gap), np.minimum(gap, 100.0), 50.0).sum(-1)
    return shifts[np.argmin(cost, axis=1)]


def project_ring(points: Floats, camera: Camera) -> Floats:
    """Pixels (n, 4, 2) of rings of 3-D corners; one missing corner is completed as a parallelogram's."""
    missing = ~np.isfinite(points).all(-1)
    k = (np.argmax(missing, 1)[:, None] + np.arange(1, 4)) % 4
    a, b, c = (np.take_along_axis(points, k[:, i, None, None], 1)[:, 0] for i in range(3))
    complete = np.where((missing & (missing.sum(1) == 1)[:, None])[..., None], (a - b + c)[:, None], points)
    return camera.project(complete)


def _homography(flat: Floats, seen: Floats) -> Floats:
    """Homographies (n, 3, 3), last entry 1, from four plane points (n, 4, 2) to four points (n, 4, 2)."""
    x, y = flat[..., 0], flat[..., 1]
    u, v = seen[..., 0], seen[..., 1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    top = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], -1)
    low = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], -1)
    h = np.linalg.solve(np.concatenate([top, low], 1), np.concatenate([u, v], 1)[..., None])[..., 0]
    whole = np.asarray(np.concatenate([h, np.ones_like(h[:, :1])], 1), np.float64)
    return whole.reshape(-1, 3, 3)


def square_poses(pixels: Floats, sides: Floats, camera: Camera) -> tuple[Rigid, Rigid]:
    """Both poses reference-from-marker of square markers: the two that explain the corners' affine part
    alike.

    Infinitesimal plane-based pose estimation (Collins and Bartoli, IJCV 2014).

    Parameters
    ----------
    pixels : (n, 4, 2) in the marker's own order, finite, not degenerate.
    sides : (n,) metres.
    """
    rays = camera.unproject(pixels)[..., :2]
    flat = SQUARE[:, :2] * np.asarray(sides, float)[:, None, None]
    h = _homography(flat, rays)
    p, q = h[:, 0, 2], h[:, 1, 2]
    jacobian = h[:, :2, :2] - h[:, :2, 2, None] * h[:, 2, None, :2]
    # rotate the viewing ray of the marker's centre onto the optical axis
    ray = np.stack([p, q, np.ones_like(p)], -1)
    length = np.linalg.norm(ray, axis=-1)
    axis = ray / length[:, None]
    view = _rotation_from_z(axis)
    to_plane = np.broadcast_to(np.eye(2), (len(p), 2, 2))
    b = (np.concatenate([to_plane, -ray[:, :2, None]], -1) @ view)[:, :, :2]
    a = np.linalg.solve(b, jacobian)
    gram = a @ np.swapaxes(a, 1, 2)
    trace, determinant = gram[:, 0, 0] + gram[:, 1, 1], np.linalg.det(gram)
    largest = np.sqrt(0.5 * (trace + np.sqrt(np.maximum(trace**2 - 4 * determinant, 0))))
    r22 = a / largest[:, None, None]
    rest = np.eye(2) - np.swapaxes(r22, 1, 2) @ r22
    r0 = np.sqrt(np.maximum(rest[:, 0, 0], 0))
    r1 = np.sqrt(np.maximum(rest[:, 1, 1], 0)) * np.where(rest[:, 0, 1] < 0, -1, 1)
    poses: list[Rigid] = []
    for sign in (1.0, -1.0):
        low = sign * np.stack([r0, r1], -1)[:, None, :]
        left = np.concatenate([r22, low], 1)
        turn = view @ np.concatenate([left, np.cross(left[..., 0], left[..., 1])[..., None]], -1)
        poses.append(camera.from_reference.inverse() @ Rigid(turn, _translation(turn, flat, rays)))
    return poses[0], poses[1]


def _rotation_from_z(axis: Floats) -> Floats:
    """Rotations (n, 3, 3) that take +z to unit vectors (n, 3) by the shortest way."""
    x, y, z = axis[:, 0], axis[:, 1], axis[:, 2]
    k = 1 / (1 + z)
    return np.stack(
        [1 - x * x * k, -x * y * k, x, -x * y * k, 1 - y * y * k, y, -x, -y, z],
        -1,
    ).reshape(-1, 3, 3)


def _translation(turn: Floats, flat: Floats, rays: Floats) -> Floats:
    """Least-squares translations (n, 3) given rotations, plane points (n, 4, 2) and normalised image
    points.
    """
    moved = np.einsum("nij,nkj->nki", turn[:, :, :2], flat)
    n = len(turn)
    rows = np.zeros((n, 4, 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1
    rows[..., :, 2] = -rays
    right = rays * moved[..., 2:] - moved[..., :2]
    a, b = rows.reshape(n, 8, 3), right.reshape(n, 8, 1)
    at = np.swapaxes(a, 1, 2)
    return np.linalg.solve(at @ a, at @ b)[..., 0]


def match_codes(
    codes: Sequence[str], prototypes: Sequence[BoxPrototype], *, mirrored: bool
) -> dict[str, tuple[int, int, int]]:
    """For each code that some prototype carries: (prototype index, face index, quarter turns); the first
    match.
    """
    found: dict[str, tuple[int, int, int]] = {}
    for code in dict.fromkeys(codes):
        for p, prototype in enumerate(prototypes):
            for f, face in enumerate(prototype.faces):
                turns = identify(code, face.code, mirrored=mirrored)
                if turns is not None and code not in found:
                    found[code] = (p, f, turns)
    return found


def boxes_by_codes(
    counts: Mapping[tuple[str, str], int], prototypes: Sequence[BoxPrototype], *, mirrored: bool
) -> dict[str, BoxPrototype]:
    """The box that each object is: the prototype that most of its codes belong to; objects in their order.

    ``counts`` says how often each code was seen on each object; objects of whose codes none is known are left out.
    """
    known = match_codes([code for _, code in counts], prototypes, mirrored=mirrored)
    votes: dict[str, Counter[int]] = defaultdict(Counter)
    for (object_id, code), count in counts.items():
        if code in known:
            votes[object_id][known[code][0]] += count
    return {object_id: prototypes[vote.most_common(1)[0][0]] for object_id, vote in sorted(votes.items())}
