"""Planes are found among outliers, and their frames depend on the plane alone."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from ecat.errors import InputError
from ecat.geometry.planes import fit_plane, plane_frame
from ecat.geometry.transforms import Floats

NORMAL: Floats = np.array([0.0, -0.94, -0.34]) / np.linalg.norm([0.94, 0.34])
OFFSET = 0.73


def on_plane(n: int, noise_m: float = 0.0) -> Floats:
    rng = np.random.default_rng(2)
    frame = plane_frame(NORMAL, OFFSET)
    flat = np.column_stack(
        [rng.uniform(-0.5, 0.5, (n, 2)), rng.normal(0, noise_m, n) if noise_m else np.zeros(n)]
    )
    return frame.apply(flat)


@pytest.mark.parametrize("n", [3, 8, 200])
def test_exact_points_give_the_plane_with_its_normal_towards_the_camera(n: int) -> None:
    fit = fit_plane(on_plane(n))
    np.testing.assert_allclose(fit.normal, NORMAL, atol=1e-9)
    assert fit.offset == pytest.approx(OFFSET)
    assert fit.inliers.sum() == n
    assert fit.rms_m < 1e-9


def test_a_third_of_wrong_points_changes_nothing() -> None:
    points = on_plane(60, noise_m=0.002)
    points[::3] += np.array([0.0, 0.1, 0.2])
    points[1] = np.nan
    fit = fit_plane(points)
    assert np.degrees(np.arccos(fit.normal @ NORMAL)) < 0.3
    there = plane_frame(NORMAL, OFFSET).translation
    assert abs(fit.normal @ there + fit.offset) < 0.001
    assert not fit.inliers[::3].any()
    assert not fit.inliers[1]
    assert fit.rms_m == pytest.approx(0.002, rel=0.4)


def test_same_points_same_plane() -> None:
    points = on_plane(60, noise_m=0.002)
    assert fit_plane(points).offset == fit_plane(points).offset


def test_an_hour_of_points_takes_no_gigabytes() -> None:
    points = on_plane(300_000, noise_m=0.002)
    points[::3] += np.array([0.0, 0.1, 0.2])
    tracemalloc.start()
    try:
        fit = fit_plane(points)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.degrees(np.arccos(fit.normal @ NORMAL)) < 0.05
    assert len(fit.inliers) == len(points)
    assert peak < 100e6


def test_too_few_points_and_points_on_a_line_are_refused() -> None:
    with pytest.raises(InputError, match="2 finite points of 3"):
        fit_plane(np.array([[0, 0, 1], [1, 0, 1], [np.nan, 0, 0]]))
    with pytest.raises(InputError, match="on one line"):
        fit_plane(np.linspace([0, 0, 1], [1, 1, 2], 8))


def test_the_frame_stands_on_the_plane_where_the_camera_looks() -> None:
    frame = plane_frame(NORMAL, OFFSET)
    np.testing.assert_allclose(frame.rotation[:, 2], NORMAL)
    np.testing.assert_allclose(frame.rotation.T @ frame.rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.rotation) == pytest.approx(1)
    assert NORMAL @ frame.translation + OFFSET == pytest.approx(0)
    np.testing.assert_allclose(frame.translation[:2], 0)
    assert frame.rotation[0, 0] > 0.9  # x runs to the camera's right


def test_a_plane_seen_edge_on_has_its_origin_below_the_camera() -> None:
    frame = plane_frame(np.array([0.0, -1.0, 0.0]), 0.7)
    np.testing.assert_allclose(frame.translation, [0, 0.7, 0])
