"""Faces are recognised, corners put in the print's order, and squares have two poses of which one is true."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecat.geometry.boxes import (
    SQUARE,
    box_corners,
    boxes_by_codes,
    corner_order,
    from_leftmost,
    identify,
    match_codes,
    pair_corners,
    plausible,
    project_ring,
    square_poses,
)
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import NOMINAL_BOXES, SHELL, STELLA_ARTOIS

PLAIN = Camera("color", 1920, 1080, fx=1000, fy=1000, cx=960, cy=540)
CODE = STELLA_ARTOIS.faces[0].code


def photograph(camera: Camera, code: str, turn_deg: float) -> tuple[str, Floats]:
    """A print held before the camera, turned in its plane: the code as a detector reads it, and its ring of
    corners clockwise on the screen from the leftmost; and nothing else, in particular not the way
    ``identify`` thinks.
    """
    n = 5
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix() @ np.diag([1.0, -1, -1])
    corners = camera.project((SQUARE @ turn.T) * 0.1 + [0, 0, 1])
    centres = np.array([[(c + 0.5) / n - 0.5, 0.5 - (r + 0.5) / n, 0] for r in range(n) for c in range(n)])
    cells = camera.project((centres @ turn.T) * 0.1 + [0, 0, 1])
    around = corners - corners.mean(0)
    ring = corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    ring = np.roll(ring, -int(np.argmin(ring[:, 0])), 0)
    read = ""
    for r, c in product(range(n), range(n)):
        spot = ring[0] + (c + 0.5) / n * (ring[1] - ring[0]) + (r + 0.5) / n * (ring[3] - ring[0])
        read += code[int(np.argmin(np.linalg.norm(cells - spot, axis=1)))]
    return read, ring


@pytest.mark.parametrize("camera", [PLAIN, KINECT_V2_COLOR], ids=["plain", "mirrored"])
@pytest.mark.parametrize("turn_deg", [10, 80, 100, 170, 190, 260, 280, 350])
def test_however_a_print_is_turned_its_corners_are_found(camera: Camera, turn_deg: float) -> None:
    read, ring = photograph(camera, CODE, turn_deg)
    turns = identify(read, CODE, mirrored=camera.mirrored)
    assert turns is not None
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix() @ np.diag([1.0, -1, -1])
    expected = camera.project((SQUARE @ turn.T) * 0.1 + [0, 0, 1])
    np.testing.assert_allclose(ring[corner_order(turns, mirrored=camera.mirrored)], expected, atol=1e-9)


def test_another_print_is_not_taken_for_it() -> None:
    assert identify(SHELL.faces[0].code, CODE, mirrored=False) is None
    assert identify("1" * 16, CODE, mirrored=False) is None


def test_every_marker_of_the_known_boxes_is_told_apart() -> None:
    codes = [face.code for box in NOMINAL_BOXES for face in box.faces]
    found = match_codes(codes, NOMINAL_BOXES, mirrored=False)
    assert [found[code][:2] for code in codes] == [(b, f) for b in range(3) for f in range(3)]
    assert match_codes(["0" * 25], NOMINAL_BOXES, mirrored=False) == {}


def test_rings_start_at_the_leftmost_corner_the_upper_one_on_a_tie() -> None:
    ring = np.array([[[5.0, 0], [9, 3], [5, 6], [1, 3]], [[2.0, 9], [2, 1], [8, 1], [8, 9]]])
    np.testing.assert_array_equal(from_leftmost(ring), [[3, 0, 1, 2], [1, 2, 3, 0]])


@pytest.mark.parametrize("shift", range(4))
def test_corners_in_space_are_paired_with_those_in_the_image(shift: int) -> None:
    points = SQUARE * 0.1 + [0.1, 0.2, 1.3]
    pixels = KINECT_V2_COLOR.project(points)
    rolled = np.roll(points, shift, 0)
    rolled[2] = np.nan
    order = pair_corners(pixels[None], rolled[None], KINECT_V2_COLOR)[0]
    paired = rolled[order]
    known = np.isfinite(paired).all(1)
    assert known.sum() == 3
    np.testing.assert_allclose(paired[known], points[known])


def test_one_missing_corner_is_completed_two_are_not() -> None:
    points = np.stack([SQUARE * 0.1 + [0, 0, 1.0]] * 2)
    whole = KINECT_V2_COLOR.project(points)
    points[0, 1] = np.nan
    points[1, 1:3] = np.nan
    found = project_ring(points, KINECT_V2_COLOR)
    np.testing.assert_allclose(found[0], whole[0])
    assert np.isnan(found[1]).any()


@pytest.mark.parametrize("camera", [PLAIN, KINECT_V2_COLOR], ids=["plain", "mirrored"])
def test_one_of_the_two_poses_of_a_square_is_the_true_one(camera: Camera) -> None:
    n = 100
    rng = np.random.default_rng(3)
    true = Rigid(Rotation.random(n, rng=rng).as_matrix(), rng.normal(size=(n, 3)) * 0.2 + [0, 0, 1.3])
    points = np.einsum("nij,kj->nki", true.rotation, SQUARE * 0.09) + true.translation[:, None]
    found = square_poses(camera.project(points), np.full(n, 0.09), camera)
    off = [
        np.abs(p.rotation - true.rotation).max((1, 2)) + np.abs(p.translation - true.translation).max(1)
        for p in found
    ]
    assert np.minimum(*off).max() < 1e-9


def test_corners_lie_on_the_faces_of_the_box() -> None:
    corners = box_corners(STELLA_ARTOIS)
    np.testing.assert_allclose(corners[0, :, 2], 0.0762)
    np.testing.assert_allclose(corners[1, :, 1], -0.0762)
    np.testing.assert_allclose(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1), 0.089)


def test_rings_that_no_square_looks_like_are_told() -> None:
    good = [[0.0, 0], [50, 5], [45, 60], [-3, 50]]
    crossed = [good[0], good[2], good[1], good[3]]
    flat = [[0.0, 0], [50, 0], [100, 0], [50, 1e-3]]
    point = [[7.0, 7]] * 4
    far = [[0.0, 0], [1e300, 0], [1e300, 1e300], [0, 1e300]]
    missing = [good[0], good[1], good[2], [np.nan, np.nan]]
    rings = np.array([good, good[::-1], crossed, flat, point, far, missing])
    assert plausible(rings).tolist() == [True, True, False, False, False, False, False]


def test_an_object_is_the_box_that_most_of_its_codes_belong_to() -> None:
    shell, artois = SHELL.faces[0].code, STELLA_ARTOIS.faces[0].code
    counts = {("o2", artois): 9, ("o1", shell): 5, ("o1", artois): 4, ("o3", "0" * 25): 7}
    found = boxes_by_codes(counts, NOMINAL_BOXES, mirrored=False)
    assert [(key, box.name) for key, box in found.items()] == [("o1", SHELL.name), ("o2", STELLA_ARTOIS.name)]
