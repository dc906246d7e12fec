"""Smoothing takes noise away, not motion, and never lags."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.smoothing import Smoothness, smooth_track
from ecat.geometry.transforms import Floats

T: Floats = np.arange(200) / 30
SIGMA: Floats = np.full(200, 0.001)
HAND = Smoothness(acceleration=0.3)


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
