"""Smoothing of a track over a fixed interval: no lag, and abrupt moves stay abrupt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats, known

MOST_CONDITION = 1e10
"""Largest ratio of the terms that bend the track to those that hold it to the measurements: above, sixteen digits
leave too few for the result, and from about 1e15 on the system cannot be solved at all."""
_LEAST_SCATTER, _LEAST_SHARE = 10, 0.01
_LEAST_VARIANCE = 1e-6
_LAG = 10
"""Measurements so far apart have errors that are taken to have nothing to do with each other."""
_MOST_CORRELATION = 0.9
_AT_ONCE = 4096
SIGMA_RANGE = 1e4
"""Standard deviations are taken to be within this factor of their median, for the same reason."""


@dataclass(frozen=True)
class Smoothness:
    """How a hand moves things, per coordinate.

    ``acceleration``: scale of the usual accelerations (unit/s^2) of a thing that stands or slides evenly;
    ``tails``: degrees of freedom of the Student t distribution of accelerations: the fewer, the more readily
    a sudden push is believed; ``outliers``: the same for measurement errors; ``memory_s``: accelerations that are so
    close in time are of one size, so that what moved before and after it was hidden is taken to have moved in between.
    """

    acceleration: float
    tails: float = 1.0
    outliers: float = 100.0
    memory_s: float = 0.1


def smooth_track(
    t_s: Floats, values: Floats, covariance: Floats, smoothness: Smoothness, *, rounds: int = 12
) -> tuple[Floats, Floats]:
    """Most probable track given all measurements, those before and those after: the fixed-interval smoother
    of an integrated random walk (what Rauch, Tung and Striebel's recursion computes), with Student t errors
    on both sides by iterative reweighting.

    Parameters
    ----------
    t_s : (n,) times that do not decrease, seconds; where they are closer together than an acceleration could
        show, measurements are averaged first.
    values : (n, d) measurements; rows with NaN are not measured, and filled in.
    covariance : (n, d, d) of the measurements' errors; ignored where not measured.

    Returns
    -------
    The track (n, d) and its covariance (n, d, d), which grows where nothing is measured.
    """
    measured = known(values) & known(covariance, 2)
    if measured.sum() < 3:
        blank = np.where(measured, 1.0, np.nan)
        return values * blank[:, None], covariance * blank[:, None, None]
    information, usual = _information(covariance, measured)
    values = np.where(measured[:, None], values, 0.0)
    # second differences over a step h bend with 16 / (acceleration^2 h^4), measurements hold with 1 / sigma^2
    step_s = 2 * np.sqrt(usual / (smoothness.acceleration * np.sqrt(MOST_CONDITION)))
    if np.diff(t_s).min() >= step_s:
        return _solved(t_s, values, information, smoothness, rounds)
    bins = np.floor((t_s - t_s[0]) / step_s)
    knots, place = np.unique(bins, return_inverse=True)
    merged, held = _merged(values, information, place, len(knots))
    seen = np.einsum("nii->n", held) > 0
    if seen.sum() < 3:
        spread = np.full(held.shape, np.nan)
        spread[seen] = np.linalg.inv(held[seen])
        return np.where(seen[:, None], merged, np.nan)[place], spread[place]
    knots_s = t_s[0] + (knots + 0.5) * step_s
    track, spread = _solved(knots_s, merged, held, smoothness, rounds)
    return track[place], spread[place]


def random_share(values: Floats, covariance: Floats, rest: NDArray[np.int64]) -> float:
    """Which share of the stated covariance (n, d, d) averages out in time; 1 where that cannot be told, and at most.

    The rest is steady: the same error in neighbouring frames, which no smoothing takes away.  What is random is
    measured robustly, by how far each measurement (n, d) is from the middle of two others: of neighbours, and of those
    ``_LAG`` away where a thing rests (``rest`` (n,) numbers its rests, -1 = none).  If the latter are further off,
    errors last for several frames, and average out as slowly as white noise of (1 + r) / (1 - r) times their variance,
    r being the correlation of neighbours (first-order autoregression).
    """
    still = rest >= 0
    slow = _scatter(values[still], covariance[still], rest[still], _LAG)
    if slow is None:
        quick = _scatter(values, covariance, np.zeros(len(values), np.int64), 1)
        return 1.0 if quick is None else float(np.clip(quick, _LEAST_SHARE, 1.0))
    quick = _scatter(values[still], covariance[still], rest[still], 1) or slow
    # the variance about the middle of neighbours is that of uncorrelated ones times (1 - r) (3 - r) / 3
    correlation = min(2 - np.sqrt(1 + 3 * min(quick / max(slow, 1e-12), 1.0)), _MOST_CORRELATION)
    return float(np.clip(slow * (1 + correlation) / (1 - correlation), _LEAST_SHARE, 1.0))


def _scatter(values: Floats, covariance: Floats, rest: NDArray[np.int64], lag: int) -> float | None:
    """Median square of the distance from the middle of those ``lag`` before and after, in stated variances."""
    from scipy.special import chdtri

    if len(values) < _LEAST_SCATTER + 2 * lag:
        return None
    # some at a time: of an hour, all that is computed on the way would be many times as large as the result
    squares: list[Floats] = []
    for first in range(lag, len(values) - lag, _AT_ONCE):
        here = np.arange(first, min(first + _AT_ONCE, len(values) - lag))
        before, after = here - lag, here + lag
        middle = (values[before] + values[after]) / 2
        spread = covariance[here] + (covariance[before] + covariance[after]) / 4
        whole = known(middle) & known(values[here]) & known(spread, 2) & (rest[before] == rest[after])
        gap, spread = (values[here] - middle)[whole], spread[whole]
        squares.append(np.einsum("ni,ni->n", gap, np.linalg.solve(spread, gap[..., None])[..., 0]))
    square = np.concatenate(squares)
    if len(square) < _LEAST_SCATTER:
        return None
    return float(np.median(square) / float(chdtri(values.shape[1], 0.5)))


def _information(covariance: Floats, measured: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Inverse covariances (n, d, d), zero where nothing is measured, within the range; the usual sigma."""
    variance, axes = np.linalg.eigh(
        np.where(measured[:, None, None], covariance, np.eye(covariance.shape[-1]))
    )
    usual = float(np.sqrt(np.median(np.maximum(variance[measured], 0).mean(1))))
    variance = np.clip(variance, (usual / SIGMA_RANGE) ** 2, (usual * SIGMA_RANGE) ** 2)
    inverse = (axes / variance[:, None]) @ np.swapaxes(axes, 1, 2)
    return np.where(measured[:, None, None], inverse, 0.0), usual


def _merged(values: Floats, information: Floats, place: NDArray[np.int64], n: int) -> tuple[Floats, Floats]:
    """Weighted means (n, d) of the rows at each of n places, and their information (n, d, d)."""
    total, pull = np.zeros((n, *information.shape[1:])), np.zeros((n, values.shape[1]))
    np.add.at(total, place, information)
    np.add.at(pull, place, np.einsum("nij,nj->ni", information, values))
    seen = np.einsum("nii->n", total) > 0
    mean = np.zeros_like(pull)
    mean[seen] = np.linalg.solve(total[seen], pull[seen][..., None])[..., 0]
    return mean, total


def _solved(
    t_s: Floats, values: Floats, information: Floats, smoothness: Smoothness, rounds: int
) -> tuple[Floats, Floats]:
    """The smoother itself, for times that are far enough apart; what has no information is not measured."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    n, d = values.shape
    bend = _second_differences(t_s)
    trust, calm = np.ones(n), np.ones(n - 2)
    seen = np.einsum("nii->n", information) > 0
    track, factor = values, np.empty((3 * d, n * d))
    for _ in range(rounds):
        held = information * trust[:, None, None]
        factor = cholesky_banded(_normal_matrix(bend, held, calm / smoothness.acceleration**2))
        pull = np.einsum("nij,nj->ni", held, values)
        track = np.asarray(cho_solve_banded((factor, False), pull.ravel()), np.float64).reshape(n, d)
        error = np.einsum("ni,nij,nj->n", track - values, information, track - values)
        trust = (smoothness.outliers + d) / (smoothness.outliers + error)
        force = (_apply(bend, track) ** 2).sum(1) / smoothness.acceleration**2
        force = _shared(force, t_s[1:-1], seen[:-2] & seen[1:-1] & seen[2:], smoothness.memory_s)
        calm = (smoothness.tails + d) / (smoothness.tails + force)
    return track, _inverse_blocks(factor, d)


def _shared(force: Floats, t_s: Floats, seen: NDArray[np.bool_], memory_s: float) -> Floats:
    """Squared accelerations (n,) averaged over those close in time.

    Where nothing is measured, those around it count: the track itself bends as little as it can there.
    """
    from scipy.ndimage import gaussian_filter1d

    if not seen.any():
        return force
    usual_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    filled = np.interp(t_s, t_s[seen], force[seen])
    return gaussian_filter1d(filled, memory_s / usual_s, mode="nearest")


def _second_differences(t_s: Floats) -> Floats:
    """Coefficients (n-2, 3) of the acceleration at the inner times, for uneven times."""
    before, after = np.diff(t_s)[:-1], np.diff(t_s)[1:]
    middle = (before + after) / 2
    return np.stack([1 / (before * middle), -(1 / before + 1 / after) / middle, 1 / (after * middle)], -1)


def _apply(bend: Floats, track: Floats) -> Floats:
    return sum((bend[:, k, None] * track[k : len(track) - 2 + k] for k in range(3)), np.zeros((len(bend), 1)))


def _normal_matrix(bend: Floats, information: Floats, weight: Floats) -> Floats:
    """Upper banded form (3 d, n d) of the information's blocks plus bend^T diag(weight) bend for each coordinate."""
    n, d = information.shape[:2]
    last = 3 * d - 1
    band = np.zeros((3 * d, n * d))
    for i in range(d):
        for j in range(i, d):
            band[last - (j - i), j::d] += information[:, i, j]
    for i in range(3):
        for j in range(i, 3):
            both = np.repeat(weight * bend[:, i] * bend[:, j], d)
            band[last - d * (j - i), d * j : d * (n - 2 + j)] += both
    return band


def _inverse_blocks(factor: Floats, d: int) -> Floats:
    """Diagonal blocks (n, d, d) of the inverse of U^T U, given U in upper banded form (Takahashi's recurrence)."""
    last, n = 3 * d - 1, factor.shape[1] // d
    pivot, first, second = (np.zeros((n, d, d)) for _ in range(3))
    for block, ahead in ((pivot, 0), (first, 1), (second, 2)):
        for i in range(d):
            for j in range(d):
                gap = d * ahead + j - i
                if 0 <= gap <= last and ahead < n:
                    block[: n - ahead, i, j] = factor[last - gap, d * ahead + j :: d][: n - ahead]
    inverse = np.linalg.inv(pivot)
    first, second = inverse @ first, inverse @ second
    own = inverse @ np.swapaxes(inverse, 1, 2)
    found = np.zeros((n + 2, d, d))
    beside, beyond = np.zeros((n + 2, d, d)), np.zeros((n + 2, d, d))
    for i in range(n - 1, -1, -1):
        beside[i] = -first[i] @ found[i + 1] - second[i] @ beside[i + 1].T
        beyond[i] = -first[i] @ beside[i + 1] - second[i] @ found[i + 2]
        block = own[i] - beside[i] @ first[i].T - beyond[i] @ second[i].T
        # rounding makes it a little skew, which the recurrence would let grow without bound
        found[i] = (block + block.T) / 2
    # where directions are known very differently well, rounding may leave a variance below zero
    variance, axes = np.linalg.eigh(found[:n])
    variance = np.maximum(variance, _LEAST_VARIANCE * variance[:, -1:])
    return (axes * variance[:, None]) @ np.swapaxes(axes, 1, 2)
