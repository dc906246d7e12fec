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
    refine,
    resting_start,
    solid_start,
)
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model.prototype import BoxPrototype


@dataclass(frozen=True)
class Doubt:
    """When a box is not believed to rest on the table, and when a frame is not believed at all.

    ``doubtful_px`` is the reprojection error from which a free pose is tried at all; it is taken if it
    lowers the robust cost by ``gain`` (in variances; three more degrees of freedom alone lower it by about
    three), lifts or tilts the box visibly, and does not push it through the table.  A face counts as seen
    while it is at most ``face_px`` off (root mean square per coordinate); a frame where no face is, has no
    pose.
    """

    doubtful_px: float = 1.2
    gain: float = 60.0
    lift_m: float = 0.008
    tilt: float = 0.05
    sunk_m: float = 0.015
    face_px: float = 3.0


@dataclass(frozen=True)
class BoxPoses:
    """Poses table-from-box with their quality, all (n,) but the pose.

    ``free``: six degrees of freedom were solved; ``n_faces`` faces that agree with the pose, zero where
    nothing does; ``residual_px`` RMS over the coordinates of their 2-D corners; ``sigma_m``, ``sigma_rad``
    standard deviations per axis.
    """

    pose: Rigid
    free: NDArray[np.bool_]
    n_faces: NDArray[np.int64]
    residual_px: Floats
    sigma_m: Floats
    sigma_rad: Floats


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
) -> BoxPoses:
    """Poses of one box in n frames, each from its own corners only."""
    noise, doubt = noise or Noise(), doubt or Doubt()
    scene = scene_of(prototype, camera, table)
    best = resting_fit(seen, scene, noise)
    free = np.zeros(len(seen), bool)
    doubtful = np.flatnonzero(_worst_face(best) > doubt.doubtful_px)
    if doubtful.size:
        lifted = free_fit(seen[doubtful], scene, prototype, best[doubtful].pose, noise)
        take = _believable(lifted, best[doubtful], prototype, doubt)
        free[doubtful[take]] = True
        best = _replaced(best, doubtful[take], lifted[take])
    return _judged(best, free, noise, doubt)


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
    moved = np.abs(pose.translation - found.pose.translation).max(-1, initial=0.0) > 0
    # what agreed before still counts, so the residual grows by what the move costs
    residual = _judged(fit, found.free, noise, Doubt(face_px=np.inf)).residual_px
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


def free_fit(seen: Sightings, scene: Scene, prototype: BoxPrototype, rest: Rigid, noise: Noise) -> Fit:
    """Fits with six degrees of freedom, the best from the resting pose, the 3-D corners, and both poses of
    each face.
    """
    best = refine(seen, scene, rest, noise, freedom=FREE, steps=30)
    rows = np.flatnonzero(np.isfinite(seen.points).all(-1).sum((1, 2)) >= 3)
    if rows.size:
        start = solid_start(seen[rows], scene)
        best = _replaced_if_better(
            best, rows, refine(seen[rows], scene, start, noise, freedom=FREE, steps=30)
        )
    for i, face in enumerate(prototype.faces):
        rows = np.flatnonzero(np.isfinite(seen.pixels[:, i]).all((1, 2)))
        if not rows.size:
            continue
        marker = Rigid(matrix_from_quaternion(np.array(face.quaternion)), np.array(face.centre)).inverse()
        table = scene.table.inverse()
        for pose in square_poses(seen.pixels[rows, i], np.full(len(rows), face.side_m), scene.camera):
            fit = refine(seen[rows], scene, table @ pose @ marker, noise, freedom=FREE, steps=30)
            best = _replaced_if_better(best, rows, fit)
    return best


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


def _believable(free: Fit, rest: Fit, prototype: BoxPrototype, doubt: Doubt) -> NDArray[np.bool_]:
    half = np.array(prototype.size_m) / 2
    lowest = free.pose.translation[:, 2] - np.abs(free.pose.rotation[:, 2]) @ half
    tilt = np.arccos(np.clip(free.pose.rotation[:, 2, 2], -1, 1))
    moved = (lowest > doubt.lift_m) | (tilt > doubt.tilt)
    return (rest.cost - free.cost > doubt.gain) & moved & (lowest > -doubt.sunk_m)


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
        widen(fit.covariance, other.covariance),
        widen(fit.weights, other.weights),
        widen(fit.errors_px, other.errors_px),
    )


def _replaced_if_better(fit: Fit, rows: NDArray[np.intp], other: Fit) -> Fit:
    better = other.cost < fit.cost[rows]
    return _replaced(fit, rows[better], other[better])


def _judged(fit: Fit, free: NDArray[np.bool_], noise: Noise, doubt: Doubt) -> BoxPoses:
    errors = _face_errors(fit)
    flat = np.isfinite(errors)
    agrees = np.where(flat, errors <= doubt.face_px, (fit.weights > 0.2).sum(-1) >= 3)
    squares = np.where((flat & agrees)[..., None], fit.errors_px**2, 0.0)
    corners = 4 * (flat & agrees).sum(1)
    residual = np.sqrt(squares.sum((1, 2)) / np.maximum(2 * corners, 1))
    # a frame that fits worse than the noise model expects is also known less well
    worse = np.maximum(1.0, residual / noise.sigma_px)
    variance = np.einsum("nii->ni", fit.covariance)
    held = np.where(free, 3, 2), np.where(free, 3, 1)
    sigma_m = worse * np.sqrt(variance[:, :3].sum(1) / held[0])
    sigma_rad = worse * np.sqrt(variance[:, 3:].sum(1) / held[1])
    return BoxPoses(
        fit.pose, free, agrees.sum(1), np.where(corners > 0, residual, np.nan), sigma_m, sigma_rad
    )
