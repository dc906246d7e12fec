"""Depth in 12 bits, by lerobot's formula."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.formats.lerobot.depth import MOST, codes, depths_mm


def test_known_depths_have_known_codes() -> None:
    """The figures are lerobot 0.6.1's own."""
    table = codes(0.001)
    assert table[[0, 10, 1000, 10_000, 65_535]].tolist() == [0, 0, 755, 4095, 4095]


def test_depth_comes_back_to_half_a_step() -> None:
    millimetres = np.arange(10, 10_001)
    steps = np.diff(depths_mm())
    back = depths_mm()[codes(0.001)[millimetres]]
    assert np.abs(back - millimetres).max() <= steps.max() / 2 + 0.01
    assert steps[0] == pytest.approx(1.16, abs=0.01)
    assert steps[-1] == pytest.approx(4.4, abs=0.1)


def test_the_unit_of_the_camera_does_not_matter() -> None:
    fine, coarse = codes(0.0001), codes(0.001)
    assert (np.abs(fine[np.arange(100, 60_000, 10)].astype(int) - coarse[np.arange(10, 6000)]) <= 1).all()


def test_no_depth_is_the_nearest_one() -> None:
    assert codes(0.001)[0] == 0
    assert depths_mm()[0] == pytest.approx(10)
    assert depths_mm()[MOST] == pytest.approx(10_000)
