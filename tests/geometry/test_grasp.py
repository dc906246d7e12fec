"""The hand that stays fixed to a box carries it."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.grasp import Grasp, Grip, find_grasp
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z

SIZE = np.full(3, 0.15)
N, START, END = 120, 40, 80
GRIP = np.array([0.0, 0.02, 0.09])


def box() -> Rigid:
    """Slides 0.3 m and turns by half a radian in rows 40 to 80."""
    share = np.clip((np.arange(N) - START + 1) / (END - START + 1), 0, 1)
    place = np.stack([0.3 * share, np.zeros(N), np.full(N, 0.075)], -1)
    return Rigid(matrix_about_z(0.5 * share), place)


def hand(pose: Rigid, closed: tuple[int, int] = (30, 90)) -> Floats:
    """Fixed to the box in ``closed``, approaching before and leaving after by 8 mm a row."""
    path = pose.apply(np.broadcast_to(GRIP, (N, 3)))
    rows = np.arange(N)
    away = 0.008 * (np.maximum(closed[0] - rows, 0) + np.maximum(rows - closed[1] + 1, 0))
    return path + np.stack([np.zeros(N), away, np.zeros(N)], -1)


def grasp(pose: Rigid, path: Floats, sigma_m: float = 0.0) -> Grasp | None:
    return find_grasp(pose, SIZE, path, np.full(N, sigma_m), move=(START, END), bounds=(0, N), grip=Grip())


def test_hold_and_release_are_found_around_the_movement() -> None:
    pose = box()
    found = grasp(pose, hand(pose))
    assert found is not None
    assert abs(found.hold - 30) <= 2
    assert abs(found.release - 90) <= 2
    assert found.grasp < found.hold
    assert found.end > found.release
    assert found.spread_m == pytest.approx(0.0, abs=1e-6)


def test_grasp_begins_where_the_hand_is_near_its_grip() -> None:
    pose = box()
    found = grasp(pose, hand(pose))
    assert found is not None
    assert found.grasp == 30 - int(0.05 / 0.008)


@pytest.mark.parametrize("noise_m", [0.0, 0.004])
def test_a_hand_that_opens_gently_is_not_taken_to_hold_on(noise_m: float) -> None:
    pose, rows = box(), np.arange(N)
    path = hand(pose, (0, N))
    errors: list[tuple[int, int]] = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        opens, closed = int(rng.integers(84, 92)), int(rng.integers(28, 36))
        # minimum jerk, 56 mm in eight rows, as a person's hand goes
        tau = np.clip(np.maximum(rows - opens, closed - rows) / 8, 0, 1)
        away = 0.056 * tau**3 * (10 - 15 * tau + 6 * tau**2)
        moved = path + away[:, None] * np.array([0, 0, 1.0]) + rng.normal(0, noise_m, (N, 3))
        found = grasp(pose, moved, sigma_m=0.01)
        assert found is not None
        errors.append((found.release - opens, found.hold - closed))
    late, early = np.median(errors, axis=0)
    assert -1 <= late <= 2
    assert -2 <= early <= 1


def test_a_hand_that_rests_elsewhere_does_not_carry() -> None:
    pose = box()
    assert grasp(pose, np.full((N, 3), 0.5)) is None


def test_a_hand_that_passes_by_does_not_carry() -> None:
    pose = box()
    path = np.stack([np.linspace(0.4, -0.1, N), np.zeros(N), np.full(N, 0.2)], -1)
    assert grasp(pose, path) is None


def test_frames_without_the_box_or_the_hand_are_waited_through() -> None:
    pose, place = box(), box().translation.copy()
    place[45:70] = np.nan
    path = hand(pose)
    path[30:35] = np.nan
    found = grasp(Rigid(pose.rotation, place), path)
    assert found is not None
    assert found.hold <= 36
    assert abs(found.release - 90) <= 2


def test_an_unseen_hand_is_no_hand() -> None:
    assert grasp(box(), np.full((N, 3), np.nan)) is None
