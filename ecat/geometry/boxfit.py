"""Poses of marked boxes from what is seen of their corners, for all frames at once.

A batched, robust Levenberg-Marquardt with closed-form derivatives: every frame is solved from its own corners
only.  The pose is that of the box in the ``table`` frame; a box that rests on the table has three degrees of
freedom, one in a hand has six.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, known, matrix_about_z, matrix_from_rotvec, skew

RESTING: tuple[int, ...] = (0, 1, 5)  # of x, y, z, and turns about the table's x, y, z
FREE: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
UPRIGHT: tuple[int, ...] = (2, 3, 4)
Rows: TypeAlias = NDArray[np.integer] | NDArray[np.bool_] | slice


@dataclass(frozen=True)
class Noise:
    """What an error of a corner looks like: standard deviations per coordinate, and where the loss gives up.

    A detector that takes the outermost pixel of a blob for a corner (ECAT 2018 file format §2.1) knows it well along
    the corner's bisector, ``sigma_px``, and ``across`` times worse across it: where blocks stood still, corners
    of 40 to 130 degrees spread by 0.14-0.24 px and 0.23-0.45 px.
    A detector that fits lines to the edges knows all directions alike: see :data:`SUBPIXEL`.
    ``sigma_point_m`` is how well depth repeats itself; its steady error is larger.  The loss is Cauchy's: a corner
    ``cauchy`` standard deviations off counts half.  ``gain``: by how many variances a pose with three more degrees of
    freedom has to explain the corners better to be believed; by chance it does by about three, but errors may have
    long tails.  ``held``: a box that rests is held to the table exactly, since its corners tell its height worse than
    the table does.
    """

    sigma_px: float = 0.4
    sigma_point_m: float = 0.003
    across: float = 1.8
    cauchy: float = 3.0
    gain: float = 60.0
    held: bool = True


OUTERMOST = Noise()
"""Corners that are the outermost pixels of a blob (ECAT 2018 file format §2.1)."""
SUBPIXEL = Noise(sigma_px=0.12, across=1.0, gain=25.0, held=False)
"""Corners where lines fitted to the edges meet, as the stage ``track`` measures them."""


@dataclass(frozen=True)
class Sightings:
    """Corners of one box in n frames, in the marker's own order, NaN where not seen.

    ``pixels`` (n, faces, 4, 2); ``points`` (n, faces, 4, 3) in the camera's reference frame, metres;
    ``sharpness`` (n, faces, 4, 2, 2) turns a pixel error into one of equal spread in all directions; ``planes``
    (n, faces, 5) are unit normal, offset and sigma in metres of the planes that depth shows, in the reference frame.
    """

    pixels: Floats
    points: Floats
    sharpness: Floats
    planes: Floats | None = None

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, rows: Rows) -> Sightings:
        planes = None if self.planes is None else self.planes[rows]
        return Sightings(self.pixels[rows], self.points[rows], self.sharpness[rows], planes)

    @classmethod
    def joined(cls, parts: Sequence[Sightings]) -> Sightings:
        """The frames of all, one after the other; all of them have planes, or none."""
        planes = [part.planes for part in parts if part.planes is not None]
        return cls(
            np.concatenate([part.pixels for part in parts]),
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.sharpness for part in parts]),
            np.concatenate(planes) if planes else None,
        )

    def only_face(self, face: int) -> Sightings:
        """The same with every other face hidden."""
        hide = np.arange(self.pixels.shape[1]) != face
        shown = [None if a is None else a.copy() for a in (self.pixels, self.points, self.planes)]
        for array in shown:
            if array is not None:
                array[:, hide] = np.nan
        assert shown[0] is not None
        assert shown[1] is not None
        return Sightings(shown[0], shown[1], self.sharpness, shown[2])


@dataclass(frozen=True)
class Scene:
    """What stands still during a session: the camera, the table (camera-from-table), a box's marker corners
    (faces, 4, 3) in box axes, and the height of its centre when it rests.

    Frames of several sessions are solved together where ``table`` is an array of them, (n, 1, 1) for n frames.
    """

    camera: Camera
    table: Rigid
    corners: Floats
    rest_height_m: float

    def __getitem__(self, rows: Rows) -> Scene:
        """The scene of some of the frames."""
        table = self.table
        if table.rotation.ndim == 2:
            return self
        return replace(self, table=Rigid(table.rotation[rows], table.translation[rows]))

    def off_rest(self, pose: Rigid) -> Floats:
        """Height over where it rests and turns about the table's x and y (n, 3) by which it is not upright."""
        up = pose.rotation[..., 2]
        return np.stack([pose.translation[..., 2] - self.rest_height_m, -up[..., 1], up[..., 0]], -1)


@dataclass(frozen=True)
class Fit:
    """Poses table-from-box of n frames with their quality.

    ``cost`` (n,) robust, in units of variance; ``weights`` (n, faces, 4) between 0 (unseen, or far off) and 1;
    ``errors_px`` (n, faces, 4) of the 2-D corners, NaN where not seen.
    """

    pose: Rigid
    cost: Floats
    weights: Floats
    errors_px: Floats

    def __getitem__(self, rows: Rows) -> Fit:
        pose = Rigid(self.pose.rotation[rows], self.pose.translation[rows])
        return Fit(pose, self.cost[rows], self.weights[rows], self.errors_px[rows])


@dataclass(frozen=True)
class Linear:
    """Whitened residuals with derivatives at a pose; a 2-D corner has two rows, a 3-D corner three, a corner that
    should lie in a plane one.

    ``gap`` (n, k, 4, d): measured minus predicted; ``by_point`` (n, k, 4, d, 3): derivative of the
    prediction by the corner's place in the table frame; ``weights`` (n, k, 4); ``cost`` (n,).
    """

    gap: Floats
    by_point: Floats
    weights: Floats
    cost: Floats

    def __getitem__(self, rows: Rows) -> Linear:
        return Linear(self.gap[rows], self.by_point[rows], self.weights[rows], self.cost[rows])


Parts: TypeAlias = tuple[Linear, ...]


def corner_sharpness(pixels: Floats, noise: Noise) -> Floats:
    """``Sightings.sharpness`` (..., 4, 2, 2) of quadrilaterals (..., 4, 2)."""
    to_next, to_last = np.roll(pixels, -1, -2) - pixels, np.roll(pixels, 1, -2) - pixels
    to_next = to_next / np.linalg.norm(to_next, axis=-1, keepdims=True)
    to_last = to_last / np.linalg.norm(to_last, axis=-1, keepdims=True)
    across = to_next - to_last
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.eye(2) - (1 - 1 / noise.across) * across[..., :, None] * across[..., None, :]


def place(pose: Rigid, corners: Floats) -> Floats:
    """Corners (n, faces, 4, 3) in the table frame."""
    return np.einsum("nij,fkj->nfki", pose.rotation, corners) + pose.translation[:, None, None]


def linearise(seen: Sightings, scene: Scene, placed: Floats, noise: Noise) -> Parts:
    """Residuals of the 2-D and the 3-D corners, and of the planes that depth shows, at corners placed in the table
    frame (n, faces, 4, 3).
    """
    camera_points = scene.table.apply(placed)
    expected, by_point = scene.camera.project_jacobian(camera_points)
    gap = np.einsum("...ij,...j->...i", seen.sharpness, seen.pixels - expected)
    flat = _weigh(gap, seen.sharpness @ (by_point @ scene.table.rotation), noise.sigma_px, noise.cauchy)
    turn = np.broadcast_to(scene.table.rotation, (*placed.shape[:-1], 3, 3))
    solid = _weigh(seen.points - camera_points, turn, noise.sigma_point_m, noise.cauchy)
    if seen.planes is None:
        return flat, solid
    normal, offset, sigma = np.split(seen.planes[:, :, None], (3, 4), -1)
    away = -((camera_points * normal).sum(-1, keepdims=True) + offset) / sigma
    slope = normal[..., None, :] @ scene.table.rotation / sigma[..., None]
    slope = np.broadcast_to(slope, (*placed.shape[:-1], 1, 3))
    return flat, solid, _weigh(away, slope, 1.0, noise.cauchy)


def _weigh(gap: Floats, by_point: Floats, sigma: float, cauchy: float) -> Linear:
    seen = known(gap)
    gap = np.where(seen[..., None], gap, 0.0) / sigma
    squared = (gap**2).sum(-1) / cauchy**2
    by_point = np.where(seen[..., None, None], by_point, 0.0) / sigma
    return Linear(gap, by_point, seen / (1 + squared), cauchy**2 * np.log1p(squared).sum((1, 2)))


def motion(placed: Floats, pose: Rigid, freedom: Sequence[int]) -> Floats:
    """Derivatives (n, faces, 4, 3, m) of placed corners by the degrees of freedom of the pose."""
    out = np.zeros((*placed.shape, 6))
    out[..., :, :3] = np.eye(3)
    out[..., :, 3:] = -skew(placed - pose.translation[:, None, None])
    return out[..., list(freedom)]


def normal_equations(parts: Parts, moves: Floats) -> tuple[Floats, Floats]:
    """Hessians (n, m, m) and gradients (n, m) of the weighted least squares."""
    n, m = len(moves), moves.shape[-1]
    hessian, gradient = np.zeros((n, m, m)), np.zeros((n, m))
    for part in parts:
        rows = (part.by_point @ moves).reshape(n, -1, m)
        weight = np.repeat(part.weights.reshape(n, -1), part.gap.shape[-1], axis=1)
        weighted = np.swapaxes(rows * weight[..., None], 1, 2)
        hessian += weighted @ rows
        gradient += (weighted @ part.gap.reshape(n, -1, 1))[..., 0]
    return hessian, gradient


def refine(
    seen: Sightings,
    scene: Scene,
    start: Rigid,
    noise: Noise,
    *,
    freedom: Sequence[int],
    steps: int = 12,
    rest: Floats | None = None,
) -> Fit:
    """Move poses table-from-box (n) downhill to the nearest minimum of the robust cost.

    Levenberg-Marquardt, each frame with its own damping, until it no longer moves.  ``rest`` (3,), with all six degrees
    of freedom: standard deviations of :meth:`Scene.off_rest`.
    """
    held = list(freedom)
    pull = None if rest is None else 1 / rest**2
    pose = Rigid(start.rotation.copy(), start.translation.copy())
    rows, here, around, now = np.arange(len(seen)), seen, scene, pose
    damping = np.full(len(seen), 1e-3)
    placed = place(now, scene.corners)
    parts = linearise(here, around, placed, noise)
    for _ in range(steps):
        hessian, gradient = normal_equations(parts, motion(placed, now, held))
        if pull is not None:
            hessian[:, UPRIGHT, UPRIGHT] += pull
            gradient[:, UPRIGHT] -= pull * scene.off_rest(now)
        step = _damped_step(hessian, gradient, damping, held)
        trial = Rigid(matrix_from_rotvec(step[:, 3:]) @ now.rotation, now.translation + step[:, :3])
        trial_placed = place(trial, scene.corners)
        trial_parts = linearise(here, around, trial_placed, noise)
        before, after = _cost(parts), _cost(trial_parts)
        if pull is not None:
            before, after = (
                cost + scene.off_rest(pose) ** 2 @ pull for cost, pose in ((before, now), (after, trial))
            )
        better = after <= before
        now, placed = _pick_pose(better, trial, now), _pick(better, trial_placed, placed)
        parts = tuple(_pick_linear(better, a, b) for a, b in zip(trial_parts, parts, strict=True))
        damping = np.clip(np.where(better, damping * 0.1, damping * 10), 1e-9, 1e6)
        pose.rotation[rows], pose.translation[rows] = now.rotation, now.translation
        moving = np.flatnonzero(~better | (np.abs(step).max(1) > 1e-6))
        if not moving.size:
            break
        rows, here, around = rows[moving], here[moving], around[moving]
        damping, placed = damping[moving], placed[moving]
        now = Rigid(now.rotation[moving], now.translation[moving])
        parts = tuple(part[moving] for part in parts)
    return _fit(seen, scene, pose, noise)


def _cost(parts: Parts) -> Floats:
    return np.asarray(sum(part.cost for part in parts), np.float64)


def _fit(seen: Sightings, scene: Scene, pose: Rigid, noise: Noise) -> Fit:
    placed = place(pose, scene.corners)
    parts = linearise(seen, scene, placed, noise)
    errors = np.linalg.norm(seen.pixels - scene.camera.project(scene.table.apply(placed)), axis=-1)
    weights = np.where(known(seen.pixels), parts[0].weights, parts[1].weights)
    return Fit(pose, _cost(parts), weights, errors)


def _damped_step(hessian: Floats, gradient: Floats, damping: Floats, held: list[int]) -> Floats:
    """Steps (n, 6), zero where held, small enough for the derivatives to mean something."""
    scale = damping * (np.einsum("nii->ni", hessian).mean(1) + 1e-9)
    step = np.zeros((len(gradient), 6))
    step[:, held] = np.linalg.solve(hessian + scale[:, None, None] * np.eye(len(held)), gradient[..., None])[
        ..., 0
    ]
    return np.clip(step, -0.2, 0.2)


def _pick(choose: NDArray[np.bool_], a: Floats, b: Floats) -> Floats:
    return np.where(choose.reshape(-1, *([1] * (a.ndim - 1))), a, b)


def _pick_pose(choose: NDArray[np.bool_], a: Rigid, b: Rigid) -> Rigid:
    return Rigid(_pick(choose, a.rotation, b.rotation), _pick(choose, a.translation, b.translation))


def _pick_linear(choose: NDArray[np.bool_], a: Linear, b: Linear) -> Linear:
    return Linear(
        _pick(choose, a.gap, b.gap),
        _pick(choose, a.by_point, b.by_point),
        _pick(choose, a.weights, b.weights),
        _pick(choose, a.cost, b.cost),
    )


def resting_start(seen: Sightings, scene: Scene) -> Rigid:
    """Closed-form poses table-from-box (n) of boxes taken to rest on the table.

    The height of every corner is then known, so its viewing ray meets its height in one point of the table;
    position and turn follow by Procrustes' method in the plane.  3-D corners stand in for unseen 2-D ones.
    """
    level = scene.corners[..., 2] + scene.rest_height_m
    view = scene.table.inverse() @ scene.camera.from_reference.inverse()
    rays = np.einsum("...ij,...j->...i", view.rotation, scene.camera.unproject(seen.pixels))
    hit = view.translation + ((level - view.translation[..., 2]) / rays[..., 2])[..., None] * rays
    solid = scene.table.inverse().apply(seen.points)
    flat = np.where(np.isfinite(hit), hit, solid)[..., :2].reshape(len(seen), -1, 2)
    model = np.broadcast_to(scene.corners[..., :2].reshape(-1, 2), flat.shape)
    a, b, middle, middle_model = _centred(flat, model)
    yaw = np.arctan2((a[..., 1] * b[..., 0] - a[..., 0] * b[..., 1]).sum(1), (a * b).sum((1, 2)))
    turn = matrix_about_z(yaw)
    xy = middle - np.einsum("nij,nj->ni", turn[:, :2, :2], middle_model)
    return Rigid(turn, np.concatenate([xy, np.full((len(seen), 1), scene.rest_height_m)], 1))


def solid_start(seen: Sightings, scene: Scene) -> Rigid:
    """Poses table-from-box (n) by Procrustes' method in space on the 3-D corners; at least three make
    sense.
    """
    points = seen.points.reshape(len(seen), -1, 3)
    model = np.broadcast_to(scene.corners.reshape(-1, 3), points.shape)
    a, b, middle, middle_model = _centred(points, model)
    u, _, vt = np.linalg.svd(np.swapaxes(a, 1, 2) @ b)
    u[..., 2] *= np.linalg.det(u @ vt)[:, None]
    turn = u @ vt
    return scene.table.inverse() @ Rigid(turn, middle - np.einsum("nij,nj->ni", turn, middle_model))


def _centred(found: Floats, model: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Point sets (n, k, d) about their means over the finite points of the first, zero elsewhere; the
    means.
    """
    use = known(found)[..., None]
    count = np.maximum(use.sum(1), 1)
    middle = np.where(use, found, 0.0).sum(1) / count
    middle_model = np.where(use, model, 0.0).sum(1) / count
    about = np.where(use, found - middle[:, None], 0.0)
    return about, np.where(use, model - middle_model[:, None], 0.0), middle, middle_model
