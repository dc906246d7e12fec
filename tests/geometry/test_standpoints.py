"""Places of a camera, told from how much its images differ, and what ties them together."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.depth import RangeNoise
from ecat.geometry.standpoints import (
    MOVED,
    changes,
    common_motion,
    outline_motion,
    standpoints,
    thinned,
)
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z

NOISE = RangeNoise()


def differences(places: str) -> Floats:
    """One letter per image: images differ if their letters do, and ``?`` differs from everything."""
    code = np.array(list(places))
    same = (code[:, None] == code) & (code != "?")
    return np.where(same | np.eye(len(code), dtype=bool), 1.0, 10.0)


@pytest.mark.parametrize(
    ("places", "expected"),
    [
        ("aaaaaa", ["012345"]),
        ("aaaabbbb", ["0123", "4567"]),
        ("aaa??aaa", ["012567"]),
        ("aaabbaaa", ["012567"]),
        ("?aaaa", ["1234"]),
        ("aaa?bbb", ["012", "456"]),
        ("aaaabb", ["0123"]),
        ("aaabbbaaa", ["012", "345", "678"]),
        ("??????", []),
        ("ab", ["01"]),
        ("", []),
    ],
)
def test_a_new_place_is_one_that_lasts(places: str, expected: list[str]) -> None:
    found = ["".join(map(str, place.members)) for place in standpoints(differences(places))]
    assert found == expected


def test_noise_is_no_change_and_a_hand_is_none_either() -> None:
    rng = np.random.default_rng(0)
    z = rng.uniform(1, 3, 3000)
    views = z + NOISE.sigma(z) * rng.standard_normal((4, 3000))
    views[1, :600] = 0.8  # a hand before a fifth of the image
    views[2, 500:900] = np.nan
    views[3] += 0.05
    differ = changes(views, views, NOISE)
    assert (differ[:3, :3] < MOVED / 1.5).all()
    assert (differ[3, :3] > MOVED).all()


def test_views_with_nothing_in_common_differ() -> None:
    assert np.isinf(changes(np.full((1, 50), np.nan), np.ones((1, 50)), NOISE)).all()


def test_thinned_pixels_are_of_the_mask_and_not_too_many() -> None:
    mask = np.zeros((400, 500), bool)
    mask[100:300, 50:450] = True
    pixels = thinned(mask)
    assert mask.ravel()[pixels].all()
    assert 1000 < len(pixels) < 2500


SQUARE: Floats = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
BOXES: Floats = np.array([[0.0, 0.0], [0.4, 0.1], [-0.2, 0.3]])[:, None] + 0.076 * SQUARE
MOTION = Rigid(matrix_about_z(np.array([0.4]))[0], np.array([0.3, -0.1, 0.0]))


def laid(motion: Rigid, points: Floats) -> Floats:
    return points @ motion.rotation[:2, :2].T + motion.translation[:2]


def test_boxes_that_stood_still_tell_how_the_camera_moved() -> None:
    found = common_motion(laid(MOTION, BOXES), BOXES)
    assert found is not None
    np.testing.assert_allclose(found.rotation, MOTION.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, MOTION.translation, atol=1e-12)


def test_a_box_that_was_moved_meanwhile_does_not_count() -> None:
    after = BOXES.copy()
    after[1] += 0.1
    found = common_motion(laid(MOTION, BOXES), after)
    assert found is not None
    np.testing.assert_allclose(found.translation, MOTION.translation, atol=1e-12)


def test_two_boxes_that_contradict_each_other_tell_nothing() -> None:
    after = BOXES[:2].copy()
    after[1] += 0.1
    assert common_motion(laid(MOTION, BOXES[:2]), after) is None


def test_a_single_box_is_believed_and_none_tells_nothing() -> None:
    assert common_motion(laid(MOTION, BOXES[:1]), BOXES[:1]) is not None
    assert common_motion(BOXES[:0], BOXES[:0]) is None


def test_the_outline_of_a_table_tells_how_the_camera_moved() -> None:
    ring = np.array([[0.8, 0.5], [-0.8, 0.5], [-0.9, -0.5], [0.8, -0.5]])
    found = outline_motion(laid(MOTION, ring), np.roll(ring, 1, 0))
    assert found is not None
    np.testing.assert_allclose(laid(found, ring), laid(MOTION, ring), atol=1e-3)


def test_outlines_of_two_tables_do_not_fit() -> None:
    ring = np.array([[0.8, 0.5], [-0.8, 0.5], [-0.8, -0.5], [0.8, -0.5]])
    assert outline_motion(ring, 0.9 * ring) is None


def test_views_differ_from_one_another_as_they_differ_from_copies() -> None:
    rng = np.random.default_rng(3)
    views = rng.normal(1.5, 0.02, (7, 80))
    views[rng.random(views.shape) < 0.2] = np.nan
    np.testing.assert_array_equal(changes(views, views, NOISE), changes(views, views.copy(), NOISE))
