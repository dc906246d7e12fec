"""Smoothing takes noise away, not motion, and never lags."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.smoothing import Smoothness, random_share
from ecat.geometry.smoothing import smooth_track as smooth_with_covariance
from ecat.geometry.transforms import Floats

T: Floats = np.arange(200) / 30
SIGMA: Floats = np.full(200, 0.001)
HAND = Smoothness(acceleration=0.3)


def smooth_track(t_s: Floats, values: Floats, sigma: Floats, smoothness: Smoothness) -> tuple[Floats, Floats]:
    """With errors alike along all axes: the track and its standard deviations (n,)."""
    d = values.shape[1]
    track, covariance = smooth_with_covariance(t_s, values, sigma[:, None, None] ** 2 * np.eye(d), smoothness)
    return track, np.sqrt(np.einsum("nii->n", covariance) / d)


def noisy(track: Floats, seed: int = 0) -> Floats:
    return track + np.random.default_rng(seed).normal(0, 0.001, track.shape)


def test_a_thing_at_rest_hardly_moves() -> None:
    found, sigma = smooth_track(T, noisy(np.zeros((200, 2))), SIGMA, HAND)
    assert np.sqrt((found**2).mean()) < 0.0005
    assert (sigma[5:-5] < 0.0008).all()


def test_a_push_of_8_mm_in_four_frames_is_neither_early_late_nor_round() -> None:
    push = np.clip((np.arange(200) - 100) / 4, 0, 1)[:, None] * np.array([[0.008, 0.0]])
    found, _ = smooth_track(T, noisy(push), SIGMA, HAND)
    assert abs(np.median(found[110:150, 0]) - np.median(found[50:90, 0]) - 0.008) < 0.0005
    # the time at which half of the way is covered
    crossing = np.interp(0.004, found[95:110, 0], np.arange(95, 110))
    assert crossing == pytest.approx(102, abs=0.5)
    assert abs(found[:97, 0]).max() < 0.0015


def test_time_has_no_direction() -> None:
    track = noisy(np.cumsum(np.random.default_rng(1).normal(0, 0.004, (200, 2)), 0))
    forth, _ = smooth_track(T, track, SIGMA, HAND)
    back, _ = smooth_track(T, track[::-1], SIGMA, HAND)
    np.testing.assert_allclose(forth, back[::-1], atol=1e-9)


def test_gaps_are_bridged_with_growing_doubt() -> None:
    track = np.column_stack([T * 0.1, T * 0.0])
    seen = noisy(track)
    seen[80:90] = np.nan
    found, sigma = smooth_track(T, seen, SIGMA, HAND)
    np.testing.assert_allclose(found[80:90], track[80:90], atol=0.002)
    assert sigma[85] > 2 * sigma[75]
    assert sigma[85] >= sigma[81] > sigma[79]
    assert sigma[85] >= sigma[88] > sigma[90]


def test_stated_errors_are_those_of_the_linear_problem() -> None:
    """With errors of constant weight the standard deviation is the root of the inverse's diagonal."""
    calm = Smoothness(acceleration=0.3, tails=1e12, outliers=1e12)
    _, sigma = smooth_track(T, np.zeros((200, 1)), SIGMA, calm)
    h = 1 / 30
    bend = (np.eye(200)[:-2] - 2 * np.eye(200)[1:-1] + np.eye(200)[2:]) / h**2
    full = np.eye(200) / 0.001**2 + bend.T @ bend / 0.3**2
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(np.linalg.inv(full))), rtol=1e-6)


def test_uneven_times_are_minded() -> None:
    uneven = np.sort(np.random.default_rng(2).uniform(0, 6, 200)) + 1e-3 * np.arange(200)
    line = (0.2 * uneven)[:, None]
    found, _ = smooth_track(uneven, line, SIGMA, HAND)
    np.testing.assert_allclose(found, line, atol=1e-6)


def test_too_little_to_smooth_stays_as_it_is() -> None:
    values = np.array([[1.0], [np.nan], [2.0]])
    found, sigma = smooth_track(np.arange(3.0), values, np.full(3, 0.1), HAND)
    np.testing.assert_array_equal(found, values)
    assert np.isnan(sigma[1])


@pytest.mark.parametrize("step_s", [0.0, 1e-9, 18e-6, 1e-4])
def test_frames_that_are_hardly_apart_in_time_are_averaged(step_s: float) -> None:
    """A clock in wrong units; the second differences alone would be too large for any solver."""
    values = noisy(np.full((200, 3), 0.5))
    values[50:60] = np.nan
    found, sigma = smooth_track(np.arange(200.0) * step_s, values, SIGMA, HAND)
    assert np.abs(found - 0.5).max() < 0.0015
    assert (sigma < 0.001).all()


def test_a_time_that_occurs_twice_counts_as_one_with_both_measurements() -> None:
    track = (0.2 * T)[:, None]
    once, sigma_once = smooth_track(T, track, SIGMA, HAND)
    twice, sigma_twice = smooth_track(np.repeat(T, 2), np.repeat(track, 2, axis=0), np.repeat(SIGMA, 2), HAND)
    np.testing.assert_allclose(twice[::2], once, atol=1e-3)
    np.testing.assert_array_equal(twice[::2], twice[1::2])
    assert (sigma_twice[::2] < sigma_once).all()


@pytest.mark.parametrize("step_s", [1e-3, 1 / 30, 1.0, 1e6])
@pytest.mark.parametrize("sigma_m", [1e-12, 1e-3, 1e3])
def test_any_scale_of_time_and_error_has_a_solution(step_s: float, sigma_m: float) -> None:
    sigma = sigma_m * np.exp(np.random.default_rng(4).normal(0, 3, 200))
    found, doubt = smooth_track(np.arange(200.0) * step_s, noisy(np.zeros((200, 3))), sigma, HAND)
    assert np.isfinite(found).all()
    assert (doubt > 0).all()


def test_what_is_badly_known_along_one_axis_is_taken_from_other_times() -> None:
    """A face seen from the front: its distance is known ten times worse than its place in the image."""
    rng = np.random.default_rng(5)
    sigma = np.full((200, 2), 0.001)
    sigma[50:150, 0] = 0.02
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    spread = turn @ (sigma[:, :, None] ** 2 * np.eye(2)) @ turn.T
    values = rng.normal(0, 1, (200, 2)) * sigma @ turn.T
    found, covariance = smooth_with_covariance(T, values, spread, HAND)
    apart, _ = smooth_track(T, values, np.sqrt(np.einsum("nii->n", spread) / 2), HAND)
    assert np.sqrt((found[60:140] ** 2).mean()) < 0.8 * np.sqrt((apart[60:140] ** 2).mean())
    across = covariance[100] @ turn[:, 1] @ turn[:, 1], covariance[100] @ turn[:, 0] @ turn[:, 0]
    assert across[1] > 9 * across[0]


def test_stated_covariances_are_those_of_the_linear_problem() -> None:
    calm = Smoothness(acceleration=0.3, tails=1e12, outliers=1e12)
    rng = np.random.default_rng(6)
    root = rng.normal(0, 0.001, (12, 3, 3))
    spread = root @ np.swapaxes(root, 1, 2) + 1e-7 * np.eye(3)
    _, covariance = smooth_with_covariance(T[:12], np.zeros((12, 3)), spread, calm)
    bend = (np.eye(12)[:-2] - 2 * np.eye(12)[1:-1] + np.eye(12)[2:]) * 30.0**2
    full = np.kron(bend.T @ bend / 0.3**2, np.eye(3))
    for i, one in enumerate(spread):
        full[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += np.linalg.inv(one)
    blocks = np.linalg.inv(full).reshape(12, 3, 12, 3)
    np.testing.assert_allclose(covariance, blocks[np.arange(12), :, np.arange(12)], rtol=1e-5)


def test_what_speeds_up_while_it_is_hidden_is_found_half_way() -> None:
    """A hand accelerates and brakes evenly; hidden for a fifth of a second, it did not turn at one instant."""
    hand = 0.3 * np.sin(2 * np.pi * 0.7 * T)[:, None] * np.array([[1.0, 0.5]])
    for first in range(40, 160, 7):
        seen = noisy(hand)
        seen[first : first + 6] = np.nan
        found, sigma = smooth_track(T, seen, SIGMA, HAND)
        off = np.linalg.norm(found - hand, axis=1)[first : first + 6]
        assert off.max() < 0.008
        assert off.max() < 4 * sigma[first + 3]


@pytest.mark.parametrize(("correlation", "expected"), [(0.0, 1.0), (0.5, 3.0), (0.7, 5.7)])
def test_errors_that_last_for_some_frames_average_out_slowly(correlation: float, expected: float) -> None:
    """Noise of one hundredth of the stated variance, and what white noise does as much harm as it."""
    rng = np.random.default_rng(2)
    values = rng.normal(0, 1, (3000, 2))
    for i in range(1, len(values)):
        values[i] = correlation * values[i - 1] + np.sqrt(1 - correlation**2) * values[i]
    stated = np.broadcast_to(100 * np.eye(2), (3000, 2, 2))
    share = random_share(values, stated, np.zeros(3000, np.int64))
    assert share == pytest.approx(0.01 * expected, rel=0.3)


def test_without_a_rest_neighbours_tell_the_noise() -> None:
    values = np.random.default_rng(2).normal(0, 1, (300, 2)) + np.arange(300)[:, None]
    stated = np.broadcast_to(100 * np.eye(2), (300, 2, 2))
    share = random_share(values, stated, np.full(300, -1))
    assert share == pytest.approx(0.01, rel=0.5)
    assert random_share(values[:5], stated[:5], np.full(5, -1)) == 1
