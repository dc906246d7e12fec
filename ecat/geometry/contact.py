"""Boxes are solid: two that rest on one table do not stand in each other."""

from __future__ import annotations

import numpy as np

from ecat.geometry.transforms import Floats, Rigid, matrix_about_z


def overlap(first: Rigid, second: Rigid, first_size: Floats, second_size: Floats) -> tuple[Floats, Floats]:
    """How deep upright boxes stand in each other, and the way out.

    Separating axes of two rectangles: the four directions of their sides.

    Parameters
    ----------
    first, second : (n,) poses table-from-box of boxes that rest on the table.
    first_size, second_size : (3,) edges, metres.

    Returns
    -------
    depth : (n,) metres, negative where they stand apart by that much.
    axis : (n, 2) unit vector in the table plane from the first box to the second along which the depth is least.
    """
    between = (second.translation - first.translation)[:, :2]
    sides = [np.swapaxes(pose.rotation[:, :2, :2], 1, 2) for pose in (first, second)]
    axes = np.concatenate(sides, 1)
    axes = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    reach = sum(
        (np.abs(np.einsum("nad,nsd->nas", axes, side)) * (size[:2] / 2)).sum(-1)
        for side, size in zip(sides, (first_size, second_size), strict=True)
    )
    along = np.einsum("nad,nd->na", axes, between)
    depth = reach - np.abs(along)
    least = depth.argmin(1)[:, None]
    axis = np.take_along_axis(axes, least[..., None], 1)[:, 0]
    towards = np.sign(np.take_along_axis(along, least, 1))
    return np.take_along_axis(depth, least, 1)[:, 0], axis * np.where(towards == 0, 1.0, towards)


def parted(
    first: Rigid,
    second: Rigid,
    sizes: tuple[Floats, Floats],
    covariances: tuple[Floats, Floats],
    tolerance_m: float,
) -> tuple[Rigid, Rigid]:
    """The poses moved apart until none overlap by more than the tolerance, the way that is least unlikely.

    Both boxes slide and turn on the table by what their uncertainties make cheapest (constrained least squares,
    linearised anew at each step), so that a box seen from one side gives way where that side says least, and one
    seen from three stays.

    Parameters
    ----------
    covariances : (n, 3, 3) of x, y and the turn about the table's z, metres and radians.
    """
    poses = [first, second]
    for turns in (1.0, 1.0, 1.0, 0.0):
        spreads = [c * np.outer([1, 1, turns], [1, 1, turns]) for c in covariances]
        depth, axis = overlap(poses[0], poses[1], *sizes)
        excess = np.maximum(depth - tolerance_m, 0.0)
        slopes = _slopes(poses, sizes, axis)
        pulls = [np.einsum("nij,nj->ni", c, s) for c, s in zip(spreads, slopes, strict=True)]
        variance = sum((p * s).sum(1) for p, s in zip(pulls, slopes, strict=True))
        if turns:
            # a turn is trusted as far as errors go; what is left is more than an error, and is slid away
            excess = np.minimum(excess, 3 * np.sqrt(variance))
        share = -excess / np.maximum(variance, 1e-18)
        poses = [_moved(pose, share[:, None] * p) for pose, p in zip(poses, pulls, strict=True)]
    return poses[0], poses[1]


def _slopes(poses: list[Rigid], sizes: tuple[Floats, Floats], axis: Floats) -> list[Floats]:
    """Derivatives (n, 3) of the depth of overlap along ``axis`` by x, y and turn of each of two boxes."""
    found: list[Floats] = []
    small = np.array([0.0, 0.0, 1e-6])
    for k, sign in enumerate((1, -1)):
        depths: list[Floats] = []
        for step in (small, -small):
            turned = list(poses)
            turned[k] = _moved(poses[k], np.broadcast_to(step, (len(axis), 3)))
            depths.append(overlap(turned[0], turned[1], *sizes)[0])
        found.append(np.column_stack([sign * axis, (depths[0] - depths[1]) / (2 * small[2])]))
    return found


def _moved(pose: Rigid, step: Floats) -> Rigid:
    """The pose after a step (n, 3) of x, y and turn about the table's z."""
    shift = np.concatenate([step[:, :2], np.zeros((len(step), 1))], 1)
    return Rigid(matrix_about_z(step[:, 2]) @ pose.rotation, pose.translation + shift)
