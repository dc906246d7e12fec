"""Poses of boxes: exact without noise, with honest errors under noise, free when lifted, none when nothing
agrees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import (
    FREE,
    Noise,
    Scene,
    Sightings,
    corner_sharpness,
    linearise,
    motion,
    place,
    refine,
    solid_start,
)
from ecat.geometry.boxpose import BoxPoses, box_poses
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.poseerror import SteadyErrors
from ecat.geometry.transforms import Rigid, matrix_from_rotvec
from ecat.model.prototype import STELLA_ARTOIS

See = Callable[..., Sightings]
Stand = Callable[[int], Rigid]


def solved(seen: Sightings, table: Rigid) -> BoxPoses:
    return box_poses(seen, STELLA_ARTOIS, KINECT_V2_COLOR, table)


def off_mm(found: Rigid, true: Rigid) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return 1000 * np.linalg.norm(found.translation - true.translation, axis=1)


def test_standing_boxes_are_found_exactly(table: Rigid, standing: Stand, look: See) -> None:
    true = standing(50)
    found = solved(look(true), table)
    assert off_mm(found.pose, true).max() < 0.001
    np.testing.assert_allclose(found.pose.rotation, true.rotation, atol=1e-6)
    assert not found.free.any()
    assert (found.n_faces == 3).all()


def test_the_stated_error_is_the_real_one(table: Rigid, standing: Stand, look: See) -> None:
    true = standing(400)
    measured = replace(STELLA_ARTOIS, faces=tuple(replace(f, sigma_m=1e-5) for f in STELLA_ARTOIS.faces))
    steady = SteadyErrors(rest_m=1e-6, rest_rad=1e-6)
    found = box_poses(look(true, noise_px=0.4), measured, KINECT_V2_COLOR, table, steady=steady)
    sigma = np.sqrt(np.einsum("nii->ni", found.covariance)[:, :2])
    off = (found.pose.translation - true.translation)[:, :2] / sigma
    # the model allows blunt corners more error than this noise has, so it states a little too much
    assert 0.5 < np.sqrt((off**2).mean()) < 1.1


def test_lifted_and_tilted_boxes_are_not_forced_onto_the_table(
    table: Rigid, standing: Stand, look: See
) -> None:
    rest = standing(40)
    tilt = matrix_from_rotvec(np.array([0.25, 0.1, 0.0]))
    true = Rigid(tilt @ rest.rotation, rest.translation + np.array([0, 0, 0.06]))
    found = solved(look(true, noise_px=0.2), table)
    assert found.free.all()
    assert np.median(off_mm(found.pose, true)) < 3
    assert (found.residual_px < 0.5).all()


def test_one_face_is_enough_and_said_to_be_less_certain(table: Rigid, standing: Stand, look: See) -> None:
    true = standing(40)
    all_faces = look(true, noise_px=0.3)
    one, three = solved(all_faces.only_face(2), table), solved(all_faces, table)
    assert (one.n_faces == 1).all()
    assert np.median(off_mm(one.pose, true)) < 3
    assert (one.sigma_m > three.sigma_m).mean() > 0.95


def test_a_false_face_is_left_out(table: Rigid, standing: Stand, look: See) -> None:
    true = standing(30)
    seen = look(true, noise_px=0.2)
    seen.pixels[:, 2, :2] += [25.0, -15.0]
    found = solved(seen, table)
    assert (found.n_faces == 2).all()
    assert np.median(off_mm(found.pose, true)) < 2


def test_nonsense_has_no_pose(table: Rigid, standing: Stand, look: See) -> None:
    seen = look(standing(10)).only_face(2)
    seen.pixels[:, 2] = np.array([[900.0, 500.0], [700, 520], [860, 700], [1300, 560]])
    assert (solved(seen, table).n_faces == 0).all()


def test_corners_in_space_alone_give_the_pose(table: Rigid, standing: Stand, look: See) -> None:
    true = standing(30)
    seen = look(true, depth=True)
    noisy = seen.points + np.random.default_rng(6).normal(0, 0.002, seen.points.shape)
    found = solved(Sightings(np.full_like(seen.pixels, np.nan), noisy, seen.sharpness), table)
    assert (found.n_faces == 3).all()
    assert np.median(off_mm(found.pose, true)) < 3
    assert np.isnan(found.residual_px).all()


def test_frames_do_not_know_of_each_other(table: Rigid, standing: Stand, look: See) -> None:
    seen = look(standing(20), noise_px=0.5)
    together, alone = solved(seen, table), solved(seen[np.array([7])], table)
    np.testing.assert_allclose(alone.pose.translation[0], together.pose.translation[7], atol=1e-7)


def test_an_error_across_a_corner_counts_less_than_one_along_its_bisector() -> None:
    noise = Noise(across=2.0)
    kite = np.array([[10.0, 0], [30, 30], [10, 80], [-10, 30]])  # symmetric about its first corner's bisector
    sharpness = corner_sharpness(kite, noise)[0]
    np.testing.assert_allclose(sharpness @ [0.0, 1.0], [0, 1], atol=1e-12)
    np.testing.assert_allclose(sharpness @ [1.0, 0.0], [0.5, 0], atol=1e-12)


def test_derivatives_of_the_pose_are_differences(table: Rigid, standing: Stand, look: See) -> None:
    scene = Scene(KINECT_V2_COLOR, table, box_corners(STELLA_ARTOIS), 0.0762)
    pose = standing(5)
    seen = look(pose, noise_px=1.0, depth=True)
    placed = place(pose, scene.corners)
    parts = linearise(seen, scene, placed, Noise())
    moves = motion(placed, pose, FREE)
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        moved = Rigid(matrix_from_rotvec(step[3:]) @ pose.rotation, pose.translation + step[:3])
        after = linearise(seen, scene, place(moved, scene.corners), Noise())
        for part, new in zip(parts, after, strict=True):
            slope = -(new.gap - part.gap) / 1e-6
            np.testing.assert_allclose((part.by_point @ moves)[..., k], slope, rtol=1e-3, atol=0.5)


def test_refinement_never_makes_the_cost_larger(table: Rigid, standing: Stand, look: See) -> None:
    scene = Scene(KINECT_V2_COLOR, table, box_corners(STELLA_ARTOIS), 0.0762)
    true = standing(20)
    seen = look(true, noise_px=0.5, depth=True)
    start = solid_start(seen, scene)
    costs = [refine(seen, scene, start, Noise(), freedom=FREE, steps=n).cost for n in (0, 1, 3, 20)]
    for before, after in pairwise(costs):
        assert (after <= before + 1e-9).all()
    assert (costs[-1] < costs[0]).all()
