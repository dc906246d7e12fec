"""What a raw network sees changes with the scene as the scene does, and glitches of depth do not move a marker."""

from __future__ import annotations

import numpy as np
import pytest

from learn.features.points import SWAP_POINTS
from learn.features.raw import (
    DEPTH,
    HEIGHT,
    MIRROR_CHANNELS,
    MIRROR_SIGNS,
    N_CHANNELS,
    PLANE,
    SHAPE,
    SWAP_CHANNELS,
    raw_channels,
)
from learn.features.windows import Floats, Table, mirror, windows_of
from tests.learn.recognize.made import HEIGHT as TABLE_HEIGHT
from tests.learn.recognize.made import SLOPE, scene

TABLE = Table(SLOPE, TABLE_HEIGHT)


@pytest.fixture
def windows() -> Floats:
    noise = np.random.default_rng(0).normal(0, 0.002, (45, 21, 3))
    return windows_of(scene(1, past=True) + noise)


def test_each_number_of_a_frame_has_its_place(windows: Floats) -> None:
    assert raw_channels(windows, TABLE).shape == (6, 20, N_CHANNELS)
    covered = np.concatenate([np.arange(N_CHANNELS)[part] for part in (PLANE, SHAPE, HEIGHT, DEPTH)])
    assert covered.tolist() == list(range(N_CHANNELS))


def test_exchanged_boxes_exchange_their_channels(windows: Floats) -> None:
    exchanged = raw_channels(windows[:, :, SWAP_POINTS], TABLE)
    np.testing.assert_allclose(exchanged, raw_channels(windows, TABLE)[..., SWAP_CHANNELS], atol=1e-6)


def test_a_mirrored_scene_has_mirrored_channels(windows: Floats) -> None:
    found = raw_channels(windows, TABLE)[..., MIRROR_CHANNELS] * MIRROR_SIGNS
    np.testing.assert_allclose(raw_channels(mirror(windows), TABLE), found, atol=1e-6)


def test_where_the_scene_is_does_not_matter_along_the_table(windows: Floats) -> None:
    moved = windows + np.array([0.3, 0.2 * SLOPE, 0.2])
    found, expected = raw_channels(moved, TABLE), raw_channels(windows, TABLE)
    np.testing.assert_allclose(found[..., PLANE], expected[..., PLANE], atol=0.02)
    np.testing.assert_allclose(found[..., HEIGHT], expected[..., HEIGHT], atol=1e-6)


def test_a_corner_whose_depth_jumps_stays_where_it_is(windows: Floats) -> None:
    glitch = windows.copy()
    glitch[:, 7:9, 14] *= 1.4
    found, expected = raw_channels(glitch, TABLE), raw_channels(windows, TABLE)
    np.testing.assert_allclose(found[..., :58], expected[..., :58], atol=1e-6)


@pytest.mark.parametrize("lost", [np.nan, -1.0])
def test_what_was_not_seen_is_where_it_was_last(lost: float, windows: Floats) -> None:
    gap = windows.copy()
    gap[:, 5, 15] = lost
    found, expected = raw_channels(gap, TABLE), raw_channels(windows, TABLE)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, expected, atol=0.05)


@pytest.mark.parametrize("box", [0, 1])
def test_a_marker_with_three_corners_in_one_place_was_lost(box: int, windows: Floats) -> None:
    """As it is written for dozens of frames: the box has not jumped there, it is where it was seen last."""
    flat, expected = windows.copy(), windows.copy()
    corners = slice(13 + 4 * box, 17 + 4 * box)
    flat[:, 8:14, corners] = [0.6, -0.2, 1.6]
    flat[:, 8:14, corners.start] = np.nan
    expected[:, 8:14, corners] = expected[:, 7:8, corners]
    np.testing.assert_allclose(raw_channels(flat, TABLE), raw_channels(expected, TABLE), atol=1e-6)


def test_two_corners_in_one_place_are_seen(windows: Floats) -> None:
    windows[:, 8, 14] = windows[:, 8, 13]
    gone = windows.copy()
    gone[:, 8, 13:17] = np.nan
    found, without = raw_channels(windows, TABLE), raw_channels(gone, TABLE)
    assert np.abs(found - without).max() > 1e-4


def test_what_was_never_seen_is_still_a_number(windows: Floats) -> None:
    windows[:, :, :13] = np.nan
    windows[:, :, 17:] = -1.0
    assert np.isfinite(raw_channels(windows, TABLE)).all()
