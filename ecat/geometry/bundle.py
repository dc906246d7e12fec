"""Bundle adjustment: the table plane and the markers' places on the boxes that explain all frames together.

Every frame has its own pose (resting on the table), which is eliminated frame by frame (Schur complement), so
that only a few dozen shared unknowns remain, however long the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecat.geometry.boxes import SQUARE
from ecat.geometry.boxfit import (
    RESTING,
    Linear,
    Noise,
    Scene,
    Sightings,
    linearise,
    motion,
    place,
    refine,
    resting_start,
)
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec, quaternion_from_matrix, skew
from ecat.model.prototype import BoxPrototype, MarkerFace, face_normal

_PLANE = 3  # turns about the table's x and y, shift along its z
_FACE = 7  # centre, turn, side


@dataclass(frozen=True)
class Track:
    """What one recording shows of one box: ``table`` and ``box`` are indices into planes and prototypes."""

    table: int
    box: int
    seen: Sightings


@dataclass(frozen=True)
class Priors:
    """How far things may be from what is assumed; standard deviations in metres and radians.

    A marker lies flat on its face, whose distance from the box's centre is half the edge: that fixes the scale,
    which images alone do not show, and the box's axes.  ``samples_per_view``: consecutive frames repeat each
    other's errors, so that many count as one.
    """

    face_distance_m: float = 0.0007
    face_tilt: float = 0.012
    marker_shift_m: float = 0.01
    side_m: float = 0.005
    polygon_m: float = 0.01
    samples_per_view: float = 20.0


@dataclass(frozen=True)
class Bundle:
    """Tables (camera-from-table) and prototypes that fit best, with what is left in the corners."""

    tables: tuple[Rigid, ...]
    prototypes: tuple[BoxPrototype, ...]
    plane_covariance: Floats
    residual_px: float


def adjust(
    tracks: Sequence[Track],
    tables: Sequence[Rigid],
    prototypes: Sequence[BoxPrototype],
    camera: Camera,
    noise: Noise,
    *,
    polygons: Sequence[Floats] = (),
    priors: Priors | None = None,
    fixed_prototypes: bool = False,
    rounds: int = 10,
) -> Bundle:
    """Gauss-Newton over planes, and unless ``fixed_prototypes`` over the markers' places, turns and sizes.

    ``polygons[i]`` (n, 3): points marked on table i, camera's reference frame, NaN = missing.
    """
    priors = priors or Priors()
    now, boxes = list(tables), [_Geometry.of(p) for p in prototypes]
    start = [_Geometry.of(p) for p in prototypes]
    poses = [resting_start(t.seen, _scene(t, now, boxes, camera)) for t in tracks]
    hessian = np.eye(1)
    for _ in range(rounds):
        system = _System(len(now), boxes)
        for i, track in enumerate(tracks):
            scene = _scene(track, now, boxes, camera)
            poses[i] = refine(track.seen, scene, poses[i], noise, freedom=RESTING, steps=3).pose
            system.add_track(track, scene, boxes[track.box], poses[i], noise, priors.samples_per_view)
        for i, points in enumerate(polygons):
            system.add_polygon(i, now[i].inverse().apply(points), priors.polygon_m)
        for i, box in enumerate(boxes):
            system.add_priors(i, box, start[i], priors)
        step, hessian = system.solve(fixed_prototypes)
        now = [_tilted(t, step[_PLANE * i : _PLANE * (i + 1)]) for i, t in enumerate(now)]
        boxes = [box.moved(step[system.first(i) :]) for i, box in enumerate(boxes)]
        if np.abs(step).max() < 1e-6:
            break
    covariance = np.linalg.pinv(hessian, hermitian=True)
    errors = [
        refine(t.seen, _scene(t, now, boxes, camera), p, noise, freedom=RESTING, steps=3).errors_px
        for t, p in zip(tracks, poses, strict=True)
    ]
    made = tuple(
        box.prototype(p, covariance, system_first)
        for box, p, system_first in zip(boxes, prototypes, _firsts(len(now), boxes), strict=True)
    )
    planes = np.stack([covariance[_PLANE * i :][:_PLANE, _PLANE * i : _PLANE * (i + 1)] for i in range(len(now))])
    left = np.concatenate([e[np.isfinite(e)] for e in errors])
    return Bundle(tuple(now), made, planes, float(np.median(left)) if left.size else float("nan"))


@dataclass(frozen=True)
class _Geometry:
    """The unknowns of a box as arrays: (faces, 3), (faces, 3, 3), (faces,), and half its height."""

    centre: Floats
    turn: Floats
    side: Floats
    normal: Floats
    distance: Floats
    rest_height: float

    @classmethod
    def of(cls, p: BoxPrototype) -> _Geometry:
        normal = np.array([face_normal(f.face) for f in p.faces])
        return cls(
            np.array([f.centre for f in p.faces]),
            Rigid.from_quaternion(np.array([f.quaternion for f in p.faces]), np.zeros(3)).rotation,
            np.array([f.side_m for f in p.faces]),
            normal,
            np.abs(normal @ np.array(p.size_m)) / 2,
            p.size_m[2] / 2,
        )

    @property
    def corners(self) -> Floats:
        return np.einsum("fij,kj->fki", self.turn, SQUARE) * self.side[:, None, None] + self.centre[:, None]

    def moved(self, step: Floats) -> _Geometry:
        by_face = step[: _FACE * len(self.side)].reshape(-1, _FACE)
        turn = matrix_from_rotvec(by_face[:, 3:6]) @ self.turn
        rest = (self.normal, self.distance, self.rest_height)
        return _Geometry(self.centre + by_face[:, :3], turn, self.side + by_face[:, 6], *rest)

    def prototype(self, p: BoxPrototype, covariance: Floats, first: int) -> BoxPrototype:
        faces: list[MarkerFace] = []
        for i, face in enumerate(p.faces):
            at = first + _FACE * i
            sigma = float(np.sqrt(np.trace(covariance[at : at + 3, at : at + 3]))) if at < len(covariance) else None
            x, y, z = (float(c) for c in self.centre[i])
            qx, qy, qz, qw = (float(c) for c in quaternion_from_matrix(self.turn[i]))
            faces.append(
                MarkerFace(face.face, face.code, float(self.side[i]), (x, y, z), (qx, qy, qz, qw), sigma or face.sigma_m)
            )
        return BoxPrototype(p.name, p.size_m, tuple(faces))


def _scene(track: Track, tables: Sequence[Rigid], boxes: Sequence[_Geometry], camera: Camera) -> Scene:
    box = boxes[track.box]
    return Scene(camera, tables[track.table], box.corners, box.rest_height)


def _firsts(tables: int, boxes: Sequence[_Geometry]) -> list[int]:
    sizes = [_FACE * len(b.side) for b in boxes]
    return [_PLANE * tables + sum(sizes[:i]) for i in range(len(boxes))]


def _tilted(table: Rigid, step: Floats) -> Rigid:
    turn = matrix_from_rotvec(np.array([step[0], step[1], 0.0]))
    return Rigid(table.rotation @ turn, table.apply(np.array([0.0, 0.0, step[2]])))


class _System:
    """Normal equations of the shared unknowns: planes first, then the faces of each box."""

    def __init__(self, tables: int, boxes: Sequence[_Geometry]) -> None:
        self._firsts = _firsts(tables, boxes)
        self._planes = _PLANE * tables
        size = self._planes + _FACE * sum(len(b.side) for b in boxes)
        self._hessian, self._gradient = np.zeros((size, size)), np.zeros(size)

    def first(self, box: int) -> int:
        return self._firsts[box]

    def add_track(
        self, track: Track, scene: Scene, box: _Geometry, pose: Rigid, noise: Noise, samples_per_view: float
    ) -> None:
        placed = place(pose, scene.corners)
        flat, _ = linearise(track.seen, scene, placed, noise)
        n = len(track.seen)
        own = (flat.by_point @ motion(placed, pose, RESTING)).reshape(n, -1, len(RESTING))
        shared = _by_shared(flat, placed, box, pose)
        weight = np.repeat(flat.weights.reshape(n, -1), 2, axis=1)[..., None]
        gap = flat.gap.reshape(n, -1, 1)
        left = np.swapaxes(own * weight, 1, 2)
        inverse = np.linalg.inv(left @ own + 1e-6 * np.eye(len(RESTING)))
        cross, pull = left @ shared, left @ gap
        both = np.swapaxes(shared * weight, 1, 2)
        back = np.swapaxes(cross, 1, 2) @ inverse
        where = self._columns(track, box)
        self._hessian[np.ix_(where, where)] += (both @ shared - back @ cross).sum(0) / samples_per_view
        self._gradient[where] += (both @ gap - back @ pull).sum(0)[:, 0] / samples_per_view

    def _columns(self, track: Track, box: _Geometry) -> list[int]:
        plane = range(_PLANE * track.table, _PLANE * (track.table + 1))
        first = self._firsts[track.box]
        return [*plane, *range(first, first + _FACE * len(box.side))]

    def add_polygon(self, table: int, points: Floats, sigma: float) -> None:
        points = points[np.isfinite(points).all(-1)]
        gap = -points[:, 2] / sigma
        weight = 1 / (1 + gap**2)
        # a table turned about x by a lowers a point at y by a*y, in the table's own axes
        rows = np.stack([-points[:, 1], points[:, 0], -np.ones(len(points))], 1) / sigma
        at = slice(_PLANE * table, _PLANE * (table + 1))
        self._hessian[at, at] += (rows * weight[:, None]).T @ rows
        self._gradient[at] += rows.T @ (weight * gap)

    def add_priors(self, index: int, box: _Geometry, start: _Geometry, priors: Priors) -> None:
        for i in range(len(box.side)):
            at = self._firsts[index] + _FACE * i
            along = np.outer(box.normal[i], box.normal[i])
            aside = np.eye(3) - along
            target = box.normal[i] * box.distance[i]
            hold = along / priors.face_distance_m**2 + aside / priors.marker_shift_m**2
            self._add(at, hold, hold @ (target - box.centre[i]))
            tilt = aside / priors.face_tilt**2 + along * 1e-6
            self._add(at + 3, tilt, tilt @ np.cross(box.turn[i, :, 2], box.normal[i]))
            side = np.eye(1) / priors.side_m**2
            self._add(at + 6, side, side @ (start.side[i : i + 1] - box.side[i : i + 1]))

    def _add(self, at: int, hessian: Floats, gradient: Floats) -> None:
        n = len(gradient)
        self._hessian[at : at + n, at : at + n] += hessian
        self._gradient[at : at + n] += gradient

    def solve(self, planes_only: bool) -> tuple[Floats, Floats]:
        n = self._planes if planes_only else len(self._gradient)
        hessian = self._hessian[:n, :n] + 1e-6 * np.eye(n)
        step = np.zeros(len(self._gradient))
        step[:n] = np.linalg.solve(hessian, self._gradient[:n])
        return step, hessian


def _by_shared(flat: Linear, placed: Floats, box: _Geometry, pose: Rigid) -> Floats:
    """Derivatives (n, rows, 3 + 7 faces) of the predicted pixels by the plane and the faces."""
    n, faces = placed.shape[:2]
    out = np.zeros((n, faces, 4, 2, _PLANE + _FACE * faces))
    lift = np.zeros((*placed.shape, _PLANE))
    lift[..., 0], lift[..., 1] = np.cross(np.eye(3)[0], placed), np.cross(np.eye(3)[1], placed)
    lift[..., 2, 2] = 1
    out[..., :_PLANE] = flat.by_point @ lift
    by_corner = flat.by_point @ pose.rotation[:, None, None]
    arms = box.corners - box.centre[:, None]
    for f in range(faces):
        at = _PLANE + _FACE * f
        out[:, f, ..., at : at + 3] = by_corner[:, f]
        out[:, f, ..., at + 3 : at + 6] = by_corner[:, f] @ -skew(arms[f])
        out[:, f, ..., at + 6] = np.einsum("nkij,kj->nki", by_corner[:, f], arms[f] / box.side[f])
    return out.reshape(n, faces * 8, -1)
