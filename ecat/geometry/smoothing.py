"""Smoothing of a track over a fixed interval: no lag, and abrupt moves stay abrupt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from ecat.geometry.transforms import Floats


@dataclass(frozen=True)
class Smoothness:
    """How a hand moves things, per coordinate.

    ``acceleration``: scale of the usual accelerations (unit/s^2) of a thing that stands or slides evenly;
    ``tails``: degrees of freedom of the Student t distribution of accelerations: the fewer, the more readily
    a sudden push is believed; ``outliers``: the same for measurement errors.
    """

    acceleration: float
    tails: float = 1.0
    outliers: float = 100.0


def smooth_track(
    t_s: Floats, values: Floats, sigma: Floats, smoothness: Smoothness, *, rounds: int = 12
) -> tuple[Floats, Floats]:
    """Most probable track given all measurements, those before and those after: the fixed-interval smoother
    of an integrated random walk (what Rauch, Tung and Striebel's recursion computes), with Student t errors
    on both sides by iterative reweighting.

    Parameters
    ----------
    t_s : (n,) increasing times, seconds.
    values : (n, d) measurements; rows with NaN are not measured, and filled in.
    sigma : (n,) standard deviations per coordinate; ignored where not measured.

    Returns
    -------
    The track (n, d) and its standard deviations per coordinate (n,), which grow where nothing is measured.
    """
    measured = np.isfinite(values).all(1) & np.isfinite(sigma)
    n, d = values.shape
    if n < 3 or measured.sum() < 3:
        return np.where(measured[:, None], values, np.nan), np.where(measured, sigma, np.nan)
    target = np.where(measured[:, None], values, 0.0)
    precision = np.where(measured, 1 / np.where(measured, sigma, 1.0) ** 2, 0.0)
    bend = _second_differences(t_s)
    trust, calm = np.ones(n), np.full(n - 2, 1.0)
    track, factor = target, np.empty((3, n))
    for _ in range(rounds):
        factor = cholesky_banded(_normal_matrix(bend, precision * trust, calm / smoothness.acceleration**2))
        track = cho_solve_banded((factor, False), (precision * trust)[:, None] * target)
        error = ((track - target) ** 2).sum(1) * precision
        trust = (smoothness.outliers + d) / (smoothness.outliers + error)
        force = (_apply(bend, track) ** 2).sum(1) / smoothness.acceleration**2
        calm = (smoothness.tails + d) / (smoothness.tails + force)
    return track, np.sqrt(_inverse_diagonal(factor))


def _second_differences(t_s: Floats) -> Floats:
    """Coefficients (n-2, 3) of the acceleration at the inner times, for uneven times."""
    before, after = np.diff(t_s)[:-1], np.diff(t_s)[1:]
    middle = (before + after) / 2
    return np.stack([1 / (before * middle), -(1 / before + 1 / after) / middle, 1 / (after * middle)], -1)


def _apply(bend: Floats, track: Floats) -> Floats:
    return sum((bend[:, k, None] * track[k : len(track) - 2 + k] for k in range(3)), np.zeros((len(bend), 1)))


def _normal_matrix(bend: Floats, precision: Floats, weight: Floats) -> Floats:
    """Upper banded form (3, n) of diag(precision) + bend^T diag(weight) bend."""
    n = len(precision)
    band = np.zeros((3, n))
    band[2] = precision
    for i in range(3):
        for j in range(i, 3):
            band[2 - (j - i), j : n - 2 + j] += weight * bend[:, i] * bend[:, j]
    return band


def _inverse_diagonal(factor: Floats) -> Floats:
    """Diagonal of the inverse of U^T U, given U in upper banded form (Takahashi's recurrence)."""
    n = factor.shape[1]
    pivot = factor[2]
    first = np.append(factor[1, 1:] / pivot[:-1], 0.0)
    second = np.append(factor[0, 2:] / pivot[:-2], [0.0, 0.0])
    diagonal, beside, beyond = np.zeros(n + 2), np.zeros(n + 2), np.zeros(n + 2)
    for i in range(n - 1, -1, -1):
        beside[i] = -first[i] * diagonal[i + 1] - second[i] * beside[i + 1]
        beyond[i] = -first[i] * beside[i + 1] - second[i] * diagonal[i + 2]
        diagonal[i] = 1 / pivot[i] ** 2 - first[i] * beside[i] - second[i] * beyond[i]
    return diagonal[:n]
