"""Boxes are solid: two that rest on one table do not stand in each other."""

from __future__ import annotations

import numpy as np

from ecat.geometry.transforms import Floats, Rigid


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
    sigmas_m: tuple[Floats, Floats],
    tolerance_m: float,
) -> tuple[Rigid, Rigid]:
    """The poses moved apart until none overlap by more than the tolerance, each by its share of the variance.

    That is the most likely place of both, given where each was seen and that solids do not overlap further than
    both may be misplaced.  ``sigmas_m`` (n,) standard deviations of the positions.
    """
    depth, axis = overlap(first, second, *sizes)
    variances = [sigma**2 for sigma in sigmas_m]
    share = variances[0] / (variances[0] + variances[1])
    out = np.zeros((len(depth), 3))
    out[:, :2] = axis * np.maximum(depth - tolerance_m, 0.0)[:, None]
    return (
        Rigid(first.rotation, first.translation - share[:, None] * out),
        Rigid(second.rotation, second.translation + (1 - share)[:, None] * out),
    )
