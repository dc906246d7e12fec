"""Skeletons in space and in the image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rerun.chunk import Chunk

from ecat.view.scene import PALETTE, UNOBSERVED, rgba
from ecat.view.skeleton import joint_grid, skeletons
from tests.view.chunks import at, paths, scene, table

BODY = "/world/camera/skeleton/body_3"


def joints(**columns: Sequence[object]) -> list[Chunk]:
    n = len(columns["frame"])
    return list(skeletons(table("joints", body=[3] * n, **columns), scene()))


TWO: dict[str, Sequence[object]] = {
    "frame": [0, 0, 1],
    "joint": ["ElbowLeft", "ShoulderLeft", "ElbowLeft"],
    "x": [1.0, 2.0, 3.0],
    "y": [0.0, 0.0, 0.0],
    "z": [0.0, 0.0, 0.0],
    "state": ["tracked", "inferred", "tracked"],
}


def test_a_bone_joins_two_joints_of_one_frame() -> None:
    bones = at(joints(**TWO), f"{BODY}/bones", "strips")
    assert bones == {0: [[[2, 0, 0], [1, 0, 0]]], 1: [], 2: []}


def test_joints_and_bones_that_were_guessed_are_grey() -> None:
    chunks = joints(**TWO)
    assert at(chunks, BODY, "colors")[0] == [rgba(PALETTE[0]), rgba(UNOBSERVED)]
    assert at(chunks, f"{BODY}/bones", "colors")[0] == [rgba(UNOBSERVED)]


def test_a_body_that_left_is_gone() -> None:
    assert at(joints(**TWO), BODY, "positions")[2] == []


def test_a_body_is_drawn_in_the_image_where_that_is_known() -> None:
    assert "/world/camera/color/skeleton/body_3" not in paths(joints(**TWO))
    flat = joints(**TWO, u_px=[1.0, 2.0, None], v_px=[5.0, 6.0, None])
    assert at(flat, "/world/camera/color/skeleton/body_3", "positions") == {0: [[1, 5], [2, 6]], 1: [], 2: []}


def test_an_annotated_rig_has_its_own_name() -> None:
    assert "/world/camera/skeleton/Shell" in paths(joints(**TWO, object_id=["o1"] * 3))


def test_unknown_joints_are_points_without_bones() -> None:
    chunks = joints(frame=[0], joint=["Antenna"], x=[1.0], y=[1.0], z=[1.0])
    assert at(chunks, BODY, "positions")[0] == [[1, 1, 1]]
    assert at(chunks, f"{BODY}/bones", "strips")[0] == []


def test_missing_joints_of_a_frame_are_nan() -> None:
    frames, names, positions, tracked = joint_grid(table("joints", **TWO), "x y z")
    assert frames.tolist() == [0, 1]
    assert names.tolist() == ["ElbowLeft", "ShoulderLeft"]
    assert np.isnan(positions[1, 1]).all()
    assert tracked.tolist() == [[True, False], [True, False]]
