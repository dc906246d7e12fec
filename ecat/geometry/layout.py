"""Which marker is where on a box, found from images alone: markers seen together tell how their faces are
turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ecat.geometry.boxes import square_poses
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, known, quaternion_from_matrix
from ecat.model.prototype import FACES, BoxPrototype, FaceName, MarkerFace, Triple, face_normal

MIN_VOTES = 5
"""Fewer joint sightings do not tell how two faces stand to each other."""


def _axis_rotations() -> Floats:
    """The 24 rotations (24, 3, 3) that map axes to axes."""
    found = [
        np.diag(signs)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.array([m for m in found if np.linalg.det(m) > 0])


AXIS_ROTATIONS: Floats = _axis_rotations()
# two faces of a convex box that are seen at once never look the same or the opposite way
_NEIGHBOURS: Floats = AXIS_ROTATIONS[AXIS_ROTATIONS[:, 2, 2] == 0]


@dataclass(frozen=True)
class Layout:
    """Rotations (faces, 3, 3) to the first-seen face's marker axes from each marker, NaN where never seen
    together with others; ``up`` (3,) the axis of that frame which points up most of the time.
    """

    turns: Floats
    up: Floats


def find_layout(pixels: Floats, camera: Camera, up_hint: Floats, side_m: float = 0.1) -> Layout:
    """How the markers of one box are turned against each other.

    Parameters
    ----------
    pixels : (n, faces, 4, 2) in the marker's own order, NaN where not seen.
    up_hint : (3,) or (n, 3), up in the camera's reference frame, good to about 30 degrees.
    side_m : any marker size, rotations do not depend on it.
    """
    faces = pixels.shape[1]
    seen = known(pixels, 2)
    turns = np.full((faces, 3, 3), np.nan)
    base = int(seen.sum(0).argmax())
    turns[base] = np.eye(3)
    votes = {
        (i, j): _votes(pixels[seen[:, i] & seen[:, j]], i, j, camera=camera, side_m=side_m)
        for i in range(faces)
        for j in range(faces)
        if i != j
    }
    while True:
        # the best supported link from a face that is placed to one that is not
        links = [
            (v.max(), i, j)
            for (i, j), v in votes.items()
            if np.isfinite(turns[i, 0, 0]) and np.isnan(turns[j, 0, 0])
        ]
        if not links or max(links)[0] < MIN_VOTES:
            break
        _, i, j = max(links)
        turns[j] = turns[i] @ _NEIGHBOURS[votes[i, j].argmax()]
    return Layout(
        turns, _up(pixels, turns, np.broadcast_to(up_hint, (len(pixels), 3)), camera=camera, side_m=side_m)
    )


def _face_rotations(pixels: Floats, camera: Camera, side_m: float) -> Floats:
    """Both rotations reference-from-marker (n, 2, 3, 3)."""
    poses = square_poses(pixels, np.full(len(pixels), side_m), camera)
    return np.stack([pose.rotation for pose in poses], 1)


def _votes(pixels: Floats, i: int, j: int, *, camera: Camera, side_m: float) -> Floats:
    """How many frames speak for each rotation i-from-j of _NEIGHBOURS; a frame errs by less than 20
    degrees.
    """
    if not len(pixels):
        return np.zeros(len(_NEIGHBOURS))
    a, b = (_face_rotations(pixels[:, k], camera, side_m) for k in (i, j))
    between = np.einsum("nsji,ntjk->nstik", a, b)
    match = np.einsum("nstik,mik->nmst", between, _NEIGHBOURS).max((2, 3))
    clear = match.max(1) > 1 + 2 * np.cos(np.radians(20))
    return np.bincount(match.argmax(1)[clear], minlength=len(_NEIGHBOURS)).astype(float)


def _up(pixels: Floats, turns: Floats, hint: Floats, *, camera: Camera, side_m: float) -> Floats:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    score = np.zeros(6)
    for i in np.flatnonzero(np.isfinite(turns[:, 0, 0])):
        rows = known(pixels[:, i], 2)
        if not rows.any():
            continue
        base = _face_rotations(pixels[rows, i], camera, side_m) @ turns[i].T
        along = np.einsum("nsij,aj,ni->nsa", base, axes, hint[rows])
        # of the two rotations of a marker, the one in which some axis points up is the right one more often
        better = along.max(-1).argmax(1)
        score += np.take_along_axis(along, better[:, None, None], 1).sum((0, 1))
    return axes[score.argmax()]


def laid_out(
    name: str, size_m: Triple, codes: Sequence[str], layout: Layout, *, side_m: float
) -> BoxPrototype:
    """A prototype with the markers in the middle of their faces.

    +z is the face that points up most of the time; -y is the marked side whose neighbour clockwise, seen from
    above, has no marker (the first code in order, if there are several), so that the axes do not depend on
    how often a side was seen.
    """
    placed = [int(i) for i in np.flatnonzero(np.isfinite(layout.turns[:, 0, 0]))]
    normals = layout.turns[:, :, 2].round()
    sides = [int(i) for i in placed if abs(normals[i] @ layout.up) < 0.5]

    def clockwise(i: int) -> bool:
        before = -np.cross(layout.up, normals[i])
        return any(np.allclose(normals[j], before) for j in sides)

    first = sorted((i for i in sides), key=lambda i: (clockwise(i), codes[i]))
    front = normals[first[0]] if first else np.roll(layout.up, 1)
    to_box = np.stack([np.cross(-front, layout.up), -front, layout.up])
    faces: list[MarkerFace] = []
    for i in placed:
        turn = to_box @ layout.turns[i]
        face: FaceName = next(f for f in FACES if np.allclose(face_normal(f), turn[:, 2].round()))
        x, y, z = (n * edge / 2 for n, edge in zip(face_normal(face), size_m, strict=True))
        qx, qy, qz, qw = (float(c) for c in quaternion_from_matrix(turn))
        faces.append(MarkerFace(face, codes[i], side_m, (x, y, z), (qx, qy, qz, qw)))
    return BoxPrototype(name, size_m, tuple(sorted(faces, key=lambda f: FACES.index(f.face))))
