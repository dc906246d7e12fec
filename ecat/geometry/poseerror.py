"""How far the pose of a marked box may be off: noise of the corners, and errors that no frame shows.

Markers are not quite where the prototype says, and a box that is taken to rest on the table may stand a little off
it.  Such errors stay the same from frame to frame, so that residuals do not tell them; they are carried through to the
pose without being estimated (consider covariance; Schmidt 1966).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxfit import (
    FREE,
    RESTING,
    UPRIGHT,
    Noise,
    Scene,
    Sightings,
    linearise,
    motion,
    normal_equations,
    place,
)
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype

_IN_PLACE = 0.5
"""By how much a corner is off since its marker is larger or turned, relative to how far the marker is off per axis."""


@dataclass(frozen=True)
class SteadyErrors:
    """Standard deviations of what stays the same from frame to frame.

    Parameters
    ----------
    marker_m : along each axis, of a marker's place on a box that was never measured.
    measured : share of what is not known about a measured marker that puts poses off: the rest is the size of the
        box and the place of its axes, which all markers have in common.  Rendered boxes that were turned in view on
        purpose are off by less than so much, those that were measured while they were handled by more.
    rest_m, rest_rad : height and tilt of a box that rests on the table, whose plane has errors of its own.
    table_m, table_rad : the same where corners are so well known that they may say otherwise.
    prior : how many residuals the assumed noise of the corners is worth against those of the frame itself.
    """

    marker_m: float = 0.002
    measured: float = 0.6
    rest_m: float = 0.0005
    rest_rad: float = 0.002
    table_m: float = 0.001
    table_rad: float = 0.003
    prior: float = 4.0

    @property
    def upright(self) -> Floats:
        """Standard deviations (3,) of :meth:`ecat.geometry.boxfit.Scene.off_rest`."""
        return np.array([self.table_m, self.table_rad, self.table_rad])

    def markers(self, prototype: BoxPrototype) -> Floats:
        """Of every face (faces,), per axis.

        A calibrated box knows them for all axes together; half of that is how large the box is, which all markers have
        in common.
        """
        share = 1 / (2 * np.sqrt(3))
        known = [self.marker_m if f.sigma_m is None else share * f.sigma_m for f in prototype.faces]
        return np.array(known)

    def displaced(self, prototype: BoxPrototype) -> Floats:
        """What poses are off by because of every marker (faces,), per axis."""
        measured = [face.sigma_m is not None for face in prototype.faces]
        return np.where(measured, self.measured, 1.0) * self.markers(prototype)

    def image_noise(self, noise: Noise, prototype: BoxPrototype, scene: Scene) -> float:
        """Pixels by which corners are off at the table's distance: by detection or geometry, whichever is more."""
        focal = (scene.camera.fx + scene.camera.fy) / 2
        away = float(np.linalg.norm(scene.table.translation))
        shift = float(np.sqrt((self.markers(prototype) ** 2).mean())) * focal / max(away, 1e-6)
        return max(noise.sigma_px, shift)


def pose_covariance(
    seen: Sightings,
    scene: Scene,
    pose: Rigid,
    free: NDArray[np.bool_],
    noise: Noise,
    *,
    random: float,
    markers_m: Floats,
    steady: SteadyErrors,
) -> Floats:
    """Covariance (n, 6, 6) of x, y, z and the turns about the table's axes, of poses table-from-box (n).

    Parameters
    ----------
    free : (n,) all six degrees of freedom were solved; otherwise the box was held to the table.
    noise : that the poses were fitted with; ``random`` is the share of its variance that the detector makes, the
        rest is geometry.
    markers_m : (faces,) standard deviations of the markers' places, per axis.
    """
    found = np.zeros((len(seen), 6, 6))
    resting = RESTING if noise.held else FREE
    for rows, solved, upright in (
        (np.flatnonzero(free), FREE, False),
        (np.flatnonzero(~free), resting, not noise.held),
    ):
        if rows.size:
            place_of = Rigid(pose.rotation[rows], pose.translation[rows])
            found[rows] = _covariance(
                seen[rows],
                scene,
                place_of,
                noise,
                solved=solved,
                random=random,
                markers_m=markers_m,
                steady=steady,
                upright=upright,
            )
    return found


def _marker_modes(placed: Floats) -> Floats:
    """How corners (n, faces, 4, 3) move (n, faces, 4, 3, 5) with their marker, relative to its error along an axis."""
    arms = placed - placed.mean(2, keepdims=True)
    outwards = arms / np.linalg.norm(arms, axis=-1, keepdims=True)
    along = np.roll(placed, -1, 2) - np.roll(placed, 1, 2)
    around = along / np.linalg.norm(along, axis=-1, keepdims=True)
    shift = np.broadcast_to(np.eye(3), (*placed.shape, 3))
    return np.concatenate([shift, _IN_PLACE * np.stack([outwards, around], -1)], -1)


def _covariance(
    seen: Sightings,
    scene: Scene,
    pose: Rigid,
    noise: Noise,
    *,
    solved: tuple[int, ...],
    random: float,
    markers_m: Floats,
    steady: SteadyErrors,
    upright: bool,
) -> Floats:
    placed = place(pose, scene.corners)
    parts = linearise(seen, scene, placed, noise)
    moves = motion(placed, pose, FREE)
    hessian, _ = normal_equations(parts, moves)
    s, h = list(solved), [axis for axis in FREE if axis not in solved]
    prior = np.zeros((6, 6))
    if upright:
        prior[UPRIGHT, UPRIGHT] = 1 / steady.upright**2
    inverse = np.linalg.pinv(hessian[:, s][:, :, s] + prior[np.ix_(s, s)], hermitian=True)
    # what moves with each marker: all its rows together, along each axis, and as it grows and turns on its face
    modes = _marker_modes(placed) * markers_m[:, None, None, None]
    pull = np.zeros((len(seen), 6, 6))
    square, dof = np.zeros(len(seen)), np.full(len(seen), -float(len(s)))
    for part in parts:
        rows = part.by_point @ moves
        weighted = rows * part.weights[..., None, None]
        by_marker = np.einsum("nkcdm,nkcdi->nkmi", weighted, part.by_point @ modes)
        pull += np.einsum("nkmi,nkli->nml", by_marker, by_marker)
        square += (part.weights[..., None] * part.gap**2).sum((1, 2, 3))
        dof += part.weights.sum((1, 2)) * part.gap.shape[-1]
    scale = (steady.prior * random + square) / (steady.prior + np.maximum(dof, 0.0))
    inner = scale[:, None, None] * hessian[:, s][:, :, s] + pull[:, s][:, :, s] + prior[np.ix_(s, s)]
    out = np.zeros((len(seen), 6, 6))
    if h:
        held = np.diag([steady.rest_m**2 if axis < 3 else steady.rest_rad**2 for axis in h])
        cross = hessian[:, s][:, :, h] @ held
        inner = inner + cross @ np.swapaxes(hessian[:, s][:, :, h], 1, 2)
        out[:, np.array(h)[:, None], h] = held
        across = -inverse @ cross
        out[:, np.array(s)[:, None], h] = across
        out[:, np.array(h)[:, None], s] = np.swapaxes(across, 1, 2)
    out[:, np.array(s)[:, None], s] = inverse @ inner @ inverse
    return out
