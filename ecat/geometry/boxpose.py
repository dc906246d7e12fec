"""The pose of a box in each frame: resting on the table where that explains what is seen, free where it does
not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners, square_poses
from ecat.geometry.boxfit import (
    FREE,
    RESTING,
    Fit,
    Noise,
    Scene,
    Sightings,
    place,
    refine,
    resting_start,
    solid_start,
)
from ecat.geometry.cameras import Camera
from ecat.geometry.poseerror import SteadyErrors, pose_covariance
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model.prototype import BoxPrototype

USUAL_PX = 0.4
_PLANE_GAP = 3.0


@dataclass(frozen=True)
class Doubt:
    """When a box is not believed to rest on the table, and when a frame is not believed at all.

    For corners that are ``USUAL_PX`` off; ``doubtful_px``, ``lift_m`` and ``tilt`` shrink and grow with that.
    ``doubtful_px`` is the reprojection error from which a free pose is tried at all; it is taken if it lowers the
    robust cost enough (``Noise.gain``), lifts or tilts the box visibly, and does not push it through the table.
    A face counts as seen while it is at most ``face_px`` off (root mean square per coordinate); a frame where no
    face is, has no pose.  Of two poses that are more than ``apart_rad`` from each other, the worse one is kept as
    long as its cost is no more than ``close`` greater.
    """

    doubtful_px: float = 1.2
    lift_m: float = 0.008
    tilt: float = 0.05
    sunk_m: float = 0.015
    face_px: float = 3.0
    apart_rad: float = 0.1
    close: float = 12.0

    def at(self, sigma_px: float) -> Doubt:
        """The same for corners that are ``sigma_px`` off."""
        share = sigma_px / USUAL_PX
        return replace(
            self,
            doubtful_px=share * self.doubtful_px,
            lift_m=share * self.lift_m,
            tilt=share * self.tilt,
        )


@dataclass(frozen=True)
class BoxPoses:
    """Poses table-from-box with their quality, all (n,) but the poses.

    ``free``: six degrees of freedom were solved; ``n_faces`` faces that agree with the pose, zero where
    nothing does; ``residual_px`` RMS over the coordinates of their 2-D corners; ``covariance`` (n, 6, 6) of x, y, z
    and the turns about the table's axes; ``other``: the pose that explains the frame nearly as well, NaN where there is
    none.
    """

    pose: Rigid
    free: NDArray[np.bool_]
    n_faces: NDArray[np.int64]
    residual_px: Floats
    covariance: Floats
    other: Rigid

    @property
    def sigma_m(self) -> Floats:
        """Standard deviation (n,) of the position per axis."""
        return np.sqrt(np.einsum("nii->n", self.covariance[:, :3, :3]) / 3)

    @property
    def sigma_rad(self) -> Floats:
        """Standard deviation (n,) of the rotation per axis."""
        return np.sqrt(np.einsum("nii->n", self.covariance[:, 3:, 3:]) / 3)


def scene_of(prototype: BoxPrototype, camera: Camera, table: Rigid) -> Scene:
    """The scene of one box; it rests on its -z face."""
    return Scene(camera, table, box_corners(prototype), prototype.size_m[2] / 2)


def box_poses(
    seen: Sightings,
    prototype: BoxPrototype,
    camera: Camera,
    table: Rigid,
    *,
    noise: Noise | None = None,
    doubt: Doubt | None = None,
    steady: SteadyErrors | None = None,
) -> BoxPoses:
    """Poses of one box in n frames, each from its own corners, and the depth inside its faces, only.

    ``noise`` is that of the corners as detected; the errors of the prototype (``steady``) are added.
    """
    detector, steady = noise or Noise(), steady or SteadyErrors()
    scene = scene_of(prototype, camera, table)
    noise = replace(detector, sigma_px=steady.image_noise(detector, prototype, scene))
    doubt = (doubt or Doubt()).at(noise.sigma_px)
    best = resting_fit(seen, scene, noise)
    free = np.zeros(len(seen), bool)
    other = Rigid(np.full((len(seen), 3, 3), np.nan), np.full((len(seen), 3), np.nan))
    doubtful = np.flatnonzero(
        (_worst_face(best) > doubt.doubtful_px) | (_plane_gap(seen, scene, best) > _PLANE_GAP)
    )
    if doubtful.size:
        lifted, second = free_fit(
            seen[doubtful], scene, prototype, best[doubtful].pose, noise=noise, doubt=doubt
        )
        take = _believable(lifted, best[doubtful], prototype, noise, doubt)
        rows = doubtful[take]
        free[rows] = True
        best = _replaced(best, rows, lifted[take])
        other.rotation[rows], other.translation[rows] = second.rotation[take], second.translation[take]
    resting = np.flatnonzero(~free)
    if not noise.held and resting.size:
        fit = refine(seen[resting], scene, best[resting].pose, noise, freedom=FREE, rest=steady.upright)
        best = _replaced(best, resting, fit)
    covariance = pose_covariance(
        seen,
        scene,
        best.pose,
        free,
        noise,
        random=(detector.sigma_px / noise.sigma_px) ** 2,
        markers_m=steady.displaced(prototype),
        steady=steady,
    )
    n_faces, residual = _agreement(best, doubt)
    # a frame that fits worse than the noise model expects is also known less well
    worse = np.maximum(1.0, np.nan_to_num(residual) / noise.sigma_px) ** 2
    return BoxPoses(best.pose, free, n_faces, residual, worse[:, None, None] * covariance, other)


def _plane_gap(seen: Sightings, scene: Scene, fit: Fit) -> Floats:
    """How far (n,) a face's corners are from the plane that depth shows, in standard deviations, root mean square;
    that of the worst face, 0 without depth.
    """
    if seen.planes is None:
        return np.zeros(len(seen))
    points = scene.table.apply(place(fit.pose, scene.corners))
    normal, offset, sigma = np.split(seen.planes[:, :, None], (3, 4), -1)
    away = ((points * normal).sum(-1) + offset[..., 0]) / sigma[..., 0]
    return np.sqrt(np.nan_to_num(away**2).mean(-1)).max(1)


def moved_to(
    found: BoxPoses,
    pose: Rigid,
    seen: Sightings,
    scene: Scene,
    *,
    noise: Noise,
) -> BoxPoses:
    """The same frames at other poses: the residual says how well those agree with what is seen."""
    fit = refine(seen, scene, pose, noise, freedom=RESTING, steps=0)
    moved = np.abs(pose.rotation - found.pose.rotation).max((1, 2), initial=0.0) > 0
    moved |= np.abs(pose.translation - found.pose.translation).max(1, initial=0.0) > 0
    # what agreed before still counts, so the residual grows by what the move costs
    residual = _agreement(fit, Doubt(face_px=np.inf))[1]
    return replace(found, pose=pose, residual_px=np.where(moved, residual, found.residual_px))


def resting_fit(seen: Sightings, scene: Scene, noise: Noise) -> Fit:
    """Fits of boxes on the table; where faces disagree, the start from one face alone may win."""
    best = refine(seen, scene, resting_start(seen, scene), noise, freedom=RESTING)
    for face in range(seen.pixels.shape[1]):
        shown = np.isfinite(seen.pixels[:, face]).all((1, 2)) & (_worst_face(best) > 2 * noise.sigma_px)
        several = np.isfinite(seen.pixels).all((2, 3)).sum(1) > 1
        rows = np.flatnonzero(shown & several)
        if rows.size:
            start = resting_start(seen[rows].only_face(face), scene)
            best = _replaced_if_better(best, rows, refine(seen[rows], scene, start, noise, freedom=RESTING))
    return best


def free_fit(
    seen: Sightings, scene: Scene, prototype: BoxPrototype, rest: Rigid, *, noise: Noise, doubt: Doubt
) -> tuple[Fit, Rigid]:
    """Fits with six degrees of freedom, the best from the resting pose, the 3-D corners, and both poses of each face;
    and the poses that explain the frames nearly as well but are turned otherwise, NaN where there are none.
    """
    best = refine(seen, scene, rest, noise, freedom=FREE, steps=30)
    tried = [(np.arange(len(seen)), best)]
    rows = np.flatnonzero(np.isfinite(seen.points).all(-1).sum((1, 2)) >= 3)
    if rows.size:
        start = solid_start(seen[rows], scene)
        tried.append((rows, refine(seen[rows], scene, start, noise, freedom=FREE, steps=30)))
    for i, face in enumerate(prototype.faces):
        rows = np.flatnonzero(np.isfinite(seen.pixels[:, i]).all((1, 2)))
        if not rows.size:
            continue
        marker = Rigid(matrix_from_quaternion(np.array(face.quaternion)), np.array(face.centre)).inverse()
        table = scene.table.inverse()
        for pose in square_poses(seen.pixels[rows, i], np.full(len(rows), face.side_m), scene.camera):
            start = table @ pose @ marker
            tried.append((rows, refine(seen[rows], scene, start, noise, freedom=FREE, steps=30)))
    for rows, fit in tried[1:]:
        best = _replaced_if_better(best, rows, fit)
    return best, _second(best, tried, prototype, doubt)


def _second(
    best: Fit, tried: list[tuple[NDArray[np.intp], Fit]], prototype: BoxPrototype, doubt: Doubt
) -> Rigid:
    """Of the fits that were tried, the best that is turned otherwise, above the table, and hardly worse."""
    cost = best.cost + doubt.close
    pose = Rigid(np.full(best.pose.rotation.shape, np.nan), np.full(best.pose.translation.shape, np.nan))
    for rows, fit in tried:
        same = np.einsum("nij,nij->n", best.pose.rotation[rows], fit.pose.rotation)
        apart = np.arccos(np.clip((same - 1) / 2, -1, 1)) > doubt.apart_rad
        take = apart & (fit.cost < cost[rows]) & (_lowest(fit.pose, prototype) > -doubt.sunk_m)
        cost[rows[take]] = fit.cost[take]
        pose.rotation[rows[take]], pose.translation[rows[take]] = (
            fit.pose.rotation[take],
            fit.pose.translation[take],
        )
    return pose


def _lowest(pose: Rigid, prototype: BoxPrototype) -> Floats:
    """Height (n,) of a box's lowest point over the table."""
    return pose.translation[:, 2] - np.abs(pose.rotation[:, 2]) @ (np.array(prototype.size_m) / 2)


def _face_errors(fit: Fit) -> Floats:
    """RMS error per coordinate (n, faces) of the 2-D corners, NaN where the face is not seen."""
    squares = fit.errors_px**2
    seen = np.isfinite(squares)
    mean = np.where(seen, squares, 0.0).sum(-1) / np.maximum(seen.sum(-1), 1)
    return np.where(seen.any(-1), np.sqrt(mean / 2), np.nan)


def _worst_face(fit: Fit) -> Floats:
    """The largest of a frame's face errors (n,); infinite where only 3-D corners are known."""
    errors = _face_errors(fit)
    worst = np.where(np.isfinite(errors), errors, -1.0).max(1)
    return np.where(worst < 0, np.inf, worst)


def _believable(
    free: Fit, rest: Fit, prototype: BoxPrototype, noise: Noise, doubt: Doubt
) -> NDArray[np.bool_]:
    lowest = _lowest(free.pose, prototype)
    tilt = np.arccos(np.clip(free.pose.rotation[:, 2, 2], -1, 1))
    moved = (lowest > doubt.lift_m) | (tilt > doubt.tilt)
    return (rest.cost - free.cost > noise.gain) & moved & (lowest > -doubt.sunk_m)


def _replaced(fit: Fit, rows: NDArray[np.intp], other: Fit) -> Fit:
    choose = np.zeros(len(fit.cost), bool)
    choose[rows] = True

    def widen(a: Floats, b: Floats) -> Floats:
        out = a.copy()
        out[rows] = b
        return out

    pose = Rigid(
        widen(fit.pose.rotation, other.pose.rotation), widen(fit.pose.translation, other.pose.translation)
    )
    return Fit(
        pose,
        widen(fit.cost, other.cost),
        widen(fit.weights, other.weights),
        widen(fit.errors_px, other.errors_px),
    )


def _replaced_if_better(fit: Fit, rows: NDArray[np.intp], other: Fit) -> Fit:
    better = other.cost < fit.cost[rows]
    return _replaced(fit, rows[better], other[better])


def _agreement(fit: Fit, doubt: Doubt) -> tuple[NDArray[np.int64], Floats]:
    """How many faces agree (n,), and the RMS error of their 2-D corners (n,), NaN without any."""
    errors = _face_errors(fit)
    flat = np.isfinite(errors)
    agrees = np.where(flat, errors <= doubt.face_px, (fit.weights > 0.2).sum(-1) >= 3)
    squares = np.where((flat & agrees)[..., None], fit.errors_px**2, 0.0)
    corners = 4 * (flat & agrees).sum(1)
    residual = np.sqrt(squares.sum((1, 2)) / np.maximum(2 * corners, 1))
    return agrees.sum(1), np.where(corners > 0, residual, np.nan)
