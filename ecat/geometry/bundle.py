"""Bundle adjustment: the table plane, the boxes' sizes and the markers' places on them that explain all
frames.

Every frame has its own pose (resting on the table), which is eliminated frame by frame (Schur complement), so
that only a few dozen shared unknowns remain, however long the recording.

Images show neither the scale of the whole nor the height at which a box ends below its markers: a box that
is 1 % taller and nearer looks the same.  Depth decides that: the 3-D corners, the polygons, and how well the
boxes' sizes are known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import SQUARE
from ecat.geometry.boxfit import (
    RESTING,
    Noise,
    Rows,
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
_SIZE = 1  # of a box: relative growth of its edges, after its faces
_AT_ONCE = 512  # frames whose derivatives, of a quarter of a megabyte each, are in memory at once


@dataclass(frozen=True)
class Track:
    """What recordings show of one box: ``table`` and ``box`` are indices into planes and prototypes.

    ``table`` is that of all frames, or one for each (n,), equal ones side by side.  To solve for the frames of many
    short recordings at once takes a third of the time.
    """

    table: int | NDArray[np.intp]
    box: int
    seen: Sightings

    def __len__(self) -> int:
        return len(self.seen)

    def __getitem__(self, rows: Rows) -> Track:
        """Some of its frames."""
        table = self.table if isinstance(self.table, int) else self.table[rows]
        return Track(table, self.box, self.seen[rows])

    @classmethod
    def joined(cls, tracks: Sequence[Track]) -> list[Track]:
        """The same frames in a track for each box, or in more where they would take much memory."""
        by_box: dict[tuple[int, bool], list[Track]] = {}
        for track in tracks:
            by_box.setdefault((track.box, track.seen.planes is None), []).append(track)
        found: list[Track] = []
        for (box, _), some in by_box.items():
            table = np.concatenate([np.broadcast_to(track.table, len(track)) for track in some])
            whole = cls(table, box, Sightings.joined([track.seen for track in some]))
            found += [whole[i : i + _AT_ONCE] for i in range(0, len(whole), _AT_ONCE)]
        return found

    def scene(self, tables: Sequence[Rigid], corners: Floats, rest_height_m: float, camera: Camera) -> Scene:
        """Where its frames are seen, of a box with these corners (faces, 4, 3)."""
        if isinstance(self.table, int):
            return Scene(camera, tables[self.table], corners, rest_height_m)
        rotation = np.array([table.rotation for table in tables])[self.table]
        translation = np.array([table.translation for table in tables])[self.table]
        # room for the faces and corners of a frame
        each = Rigid(rotation[:, None, None], translation[:, None, None])
        return Scene(camera, each, corners, rest_height_m)


@dataclass(frozen=True)
class Priors:
    """How far things may be from what is assumed; standard deviations in metres and radians.

    A marker lies flat on its face, whose distance from the box's centre is half the edge: that fixes the
    box's axes.  ``marker_shift_m``: it is glued near the face's middle; ``size_m``: how well the edges are
    known; together they settle the scale, to which images are blind.  ``point_m``: depth errs by centimetres
    alike on a whole face, so 3-D corners count little here.  ``samples_per_view``: consecutive frames
    repeat each other's errors, so that many count as one.
    """

    size_m: float = 0.002
    face_distance_m: float = 0.0007
    face_tilt: float = 0.012
    marker_shift_m: float = 0.002
    side_m: float = 0.005
    polygon_m: float = 0.01
    point_m: float = 0.03
    samples_per_view: float = 20.0


@dataclass(frozen=True)
class Bundle:
    """Tables (camera-from-table) and prototypes that fit best, with what is left in the corners (NaN: none fits)."""

    tables: tuple[Rigid, ...]
    prototypes: tuple[BoxPrototype, ...]
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
    noise = replace(noise, sigma_point_m=priors.point_m)
    now, boxes = list(tables), [_Geometry.of(p) for p in prototypes]
    start = [_Geometry.of(p) for p in prototypes]
    poses = [resting_start(t.seen, _scene(t, now, boxes, camera)) for t in tracks]
    hessian = np.eye(1)
    for _ in range(rounds):
        system = _System(len(now), boxes)
        for i, track in enumerate(tracks):
            scene = _scene(track, now, boxes, camera)
            poses[i] = refine(
                track.seen, scene, _at_rest(poses[i], scene), noise, freedom=RESTING, steps=3
            ).pose
            system.add_track(track, scene, poses[i], noise, priors.samples_per_view)
        for i, points in enumerate(polygons):
            system.add_polygon(i, now[i].inverse().apply(points), priors.polygon_m)
        for i in range(len(boxes)):
            system.add_priors(i, start[i], priors)
        step, hessian = system.solve(planes_only=fixed_prototypes)
        now = [_tilted(t, step[_PLANE * i : _PLANE * (i + 1)]) for i, t in enumerate(now)]
        boxes = [box.moved(step[system.first(i) :]) for i, box in enumerate(boxes)]
        if np.abs(step).max() < 1e-6:
            break
    covariance = np.asarray(np.linalg.pinv(hessian, hermitian=True), np.float64)
    firsts = _firsts(len(now), boxes)
    made = tuple(box.prototype(p, covariance, f) for box, p, f in zip(boxes, prototypes, firsts, strict=True))
    left = np.concatenate(
        [_errors(t, _scene(t, now, boxes, camera), p, noise) for t, p in zip(tracks, poses, strict=True)]
    )
    return Bundle(tuple(now), made, float(np.median(left)) if len(left) else np.nan)


def _errors(track: Track, scene: Scene, pose: Rigid, noise: Noise) -> Floats:
    errors = refine(track.seen, scene, _at_rest(pose, scene), noise, freedom=RESTING, steps=3).errors_px
    return errors[np.isfinite(errors)]


@dataclass(frozen=True)
class _Geometry:
    """The unknowns of a box as arrays, (faces, 3), (faces, 3, 3), (faces,), and its growth; what it grew
    from.
    """

    centre: Floats
    turn: Floats
    side: Floats
    growth: float
    normal: Floats
    nominal_distance: Floats
    nominal_height: float

    @property
    def rest_height(self) -> float:
        return self.nominal_height / 2 * (1 + self.growth)

    @classmethod
    def of(cls, p: BoxPrototype) -> _Geometry:
        normal = np.array([face_normal(f.face) for f in p.faces])
        return cls(
            np.array([f.centre for f in p.faces]),
            Rigid.from_quaternion(np.array([f.quaternion for f in p.faces]), np.zeros(3)).rotation,
            np.array([f.side_m for f in p.faces]),
            0.0,
            normal,
            np.abs(normal @ np.array(p.size_m)) / 2,
            p.size_m[2],
        )

    @property
    def corners(self) -> Floats:
        return np.einsum("fij,kj->fki", self.turn, SQUARE) * self.side[:, None, None] + self.centre[:, None]

    def moved(self, step: Floats) -> _Geometry:
        by_face = step[: _FACE * len(self.side)].reshape(-1, _FACE)
        turn = matrix_from_rotvec(by_face[:, 3:6]) @ self.turn
        growth = self.growth + float(step[_FACE * len(self.side)])
        return replace(
            self,
            centre=self.centre + by_face[:, :3],
            turn=turn,
            side=self.side + by_face[:, 6],
            growth=growth,
        )

    def prototype(self, p: BoxPrototype, covariance: Floats, first: int) -> BoxPrototype:
        faces: list[MarkerFace] = []
        for i, face in enumerate(p.faces):
            at = first + _FACE * i
            sigma = (
                float(np.sqrt(np.trace(covariance[at : at + 3, at : at + 3])))
                if at < len(covariance)
                else None
            )
            x, y, z = (float(c) for c in self.centre[i])
            qx, qy, qz, qw = (float(c) for c in quaternion_from_matrix(self.turn[i]))
            faces.append(
                MarkerFace(
                    face.face,
                    face.code,
                    float(self.side[i]),
                    (x, y, z),
                    (qx, qy, qz, qw),
                    sigma or face.sigma_m,
                )
            )
        x, y, z = (edge * (1 + self.growth) for edge in p.size_m)
        return BoxPrototype(p.name, (x, y, z), tuple(faces))


def _scene(track: Track, tables: Sequence[Rigid], boxes: Sequence[_Geometry], camera: Camera) -> Scene:
    box = boxes[track.box]
    return track.scene(tables, box.corners, box.rest_height, camera)


def _firsts(tables: int, boxes: Sequence[_Geometry]) -> list[int]:
    sizes = [_unknowns(b) for b in boxes]
    return [_PLANE * tables + sum(sizes[:i]) for i in range(len(boxes))]


def _unknowns(box: _Geometry) -> int:
    return _FACE * len(box.side) + _SIZE


def _at_rest(pose: Rigid, scene: Scene) -> Rigid:
    height = np.full((len(pose.translation), 1), scene.rest_height_m)
    return Rigid(pose.rotation, np.concatenate([pose.translation[:, :2], height], 1))


def _tilted(table: Rigid, step: Floats) -> Rigid:
    turn = matrix_from_rotvec(np.array([step[0], step[1], 0.0]))
    return Rigid(table.rotation @ turn, table.apply(np.array([0.0, 0.0, step[2]])))


class _System:
    """Normal equations of the shared unknowns: planes first, then the faces of each box."""

    def __init__(self, tables: int, boxes: Sequence[_Geometry]) -> None:
        self._boxes, self._firsts = boxes, _firsts(tables, boxes)
        self._planes = _PLANE * tables
        size = self._planes + sum(_unknowns(b) for b in boxes)
        self._hessian, self._gradient = np.zeros((size, size)), np.zeros(size)

    def first(self, box: int) -> int:
        return self._firsts[box]

    def add_track(
        self, track: Track, scene: Scene, pose: Rigid, noise: Noise, samples_per_view: float
    ) -> None:
        box = self._boxes[track.box]
        placed = place(pose, scene.corners)
        parts = linearise(track.seen, scene, placed, noise)
        moves, shared_moves = motion(placed, pose, RESTING), _by_shared(placed, box, pose)
        n, m, k = len(track.seen), moves.shape[-1], shared_moves.shape[-1]
        own, cross, shared = np.zeros((n, m, m)), np.zeros((n, m, k)), np.zeros((n, k, k))
        pull, shared_pull = np.zeros((n, m, 1)), np.zeros((n, k, 1))
        for part in parts:
            a = (part.by_point @ moves).reshape(n, -1, m)
            b = (part.by_point @ shared_moves).reshape(n, -1, k)
            gap = part.gap.reshape(n, -1, 1)
            weight = np.repeat(part.weights.reshape(n, -1), part.gap.shape[-1], axis=1)[..., None]
            left, right = np.swapaxes(a * weight, 1, 2), np.swapaxes(b * weight, 1, 2)
            own, cross, shared = own + left @ a, cross + left @ b, shared + right @ b
            pull, shared_pull = pull + left @ gap, shared_pull + right @ gap
        back = np.swapaxes(cross, 1, 2) @ np.linalg.inv(own + 1e-6 * np.eye(m))
        hessian = (shared - back @ cross) / samples_per_view
        gradient = (shared_pull - back @ pull)[..., 0] / samples_per_view
        for table, rows in _by_table(track):
            self._add(table, track.box, hessian[rows].sum(0), gradient[rows].sum(0))

    def _add(self, table: int, box: int, hessian: Floats, gradient: Floats) -> None:
        """Add what frames of a box on a table say of the table's and the box's unknowns."""
        first = self._firsts[box]
        whole = (
            slice(_PLANE * table, _PLANE * (table + 1)),
            slice(first, first + _unknowns(self._boxes[box])),
        )
        part = (slice(_PLANE), slice(_PLANE, None))
        for to_row, row in zip(whole, part, strict=True):
            self._gradient[to_row] += gradient[row]
            for to_column, column in zip(whole, part, strict=True):
                self._hessian[to_row, to_column] += hessian[row, column]

    def add_polygon(self, table: int, points: Floats, sigma: float) -> None:
        points = points[np.isfinite(points).all(-1)]
        gap = -points[:, 2] / sigma
        weight = 1 / (1 + gap**2)
        # a table turned about x by a lowers a point at y by a*y, in the table's own axes
        rows = np.stack([-points[:, 1], points[:, 0], -np.ones(len(points))], 1) / sigma
        at = slice(_PLANE * table, _PLANE * (table + 1))
        self._hessian[at, at] += (rows * weight[:, None]).T @ rows
        self._gradient[at] += rows.T @ (weight * gap)

    def add_priors(self, index: int, start: _Geometry, priors: Priors) -> None:
        first, box = self._firsts[index], self._boxes[index]
        size = first + _FACE * len(box.side)
        edges = 2 * box.nominal_distance.max()
        self._add_row({size: np.ones(1)}, -box.growth, priors.size_m / edges)
        for i, normal in enumerate(box.normal):
            at, distance = first + _FACE * i, box.nominal_distance[i]
            beyond = distance * (1 + box.growth) - normal @ box.centre[i]
            self._add_row({at: normal, size: np.array([-distance])}, beyond, priors.face_distance_m)
            # markers do not lean; the other axes of the face are free to shift, and its turn to turn
            lean = np.cross(box.turn[i, :, 2], normal)
            for axis in np.eye(3)[np.abs(normal) < 0.5]:
                self._add_row({at: axis}, -axis @ box.centre[i], priors.marker_shift_m)
                self._add_row({at + 3: axis}, axis @ lean, priors.face_tilt)
            self._add_row({at + 6: np.ones(1)}, start.side[i] - box.side[i], priors.side_m)

    def _add_row(self, row: dict[int, Floats], gap: float, sigma: float) -> None:
        """One more residual ``gap - row @ step`` of standard deviation ``sigma``."""
        at = np.concatenate([np.arange(first, first + len(values)) for first, values in row.items()])
        full = np.concatenate(list(row.values()))
        self._hessian[np.ix_(at, at)] += np.outer(full, full) / sigma**2
        self._gradient[at] += full * gap / sigma**2

    def solve(self, *, planes_only: bool) -> tuple[Floats, Floats]:
        n = self._planes if planes_only else len(self._gradient)
        hessian = self._hessian[:n, :n] + 1e-6 * np.eye(n)
        step = np.zeros(len(self._gradient))
        step[:n] = np.linalg.solve(hessian, self._gradient[:n])
        return step, hessian


def _by_table(track: Track) -> Iterator[tuple[int, slice]]:
    """The tables of a track, each with its frames."""
    if isinstance(track.table, int):
        yield track.table, slice(None)
        return
    ends = [*(np.flatnonzero(np.diff(track.table)) + 1).tolist(), len(track)]
    for start, end in pairwise([0, *ends]):
        yield int(track.table[start]), slice(start, end)


def _by_shared(placed: Floats, box: _Geometry, pose: Rigid) -> Floats:
    """Derivatives (n, faces, 4, 3, unknowns) of placed corners by the plane, the faces and the box's
    growth.
    """
    faces = placed.shape[1]
    out = np.zeros((*placed.shape, _PLANE + _unknowns(box)))
    out[..., 0], out[..., 1] = np.cross(np.eye(3)[0], placed), np.cross(np.eye(3)[1], placed)
    out[..., 2, 2] = 1
    arms = box.corners - box.centre[:, None]
    for f in range(faces):
        at = _PLANE + _FACE * f
        out[:, f, :, :, at : at + 3] = pose.rotation[:, None]
        out[:, f, :, :, at + 3 : at + 6] = pose.rotation[:, None] @ -skew(arms[f])
        out[:, f, :, :, at + 6] = np.einsum("nij,kj->nki", pose.rotation, arms[f] / box.side[f])
    out[..., 2, -1] = box.nominal_height / 2
    return out
