"""Faces are found again where they were, as long as they show what they showed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.geometry import detection
from ecat.geometry.detection import Detector, Found, belonging
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES
from tests.geometry.printed import photograph, random_ring

BOXES = NOMINAL_BOXES[:2]
CODE = BOXES[0].faces[0].code
MIDDLE = np.array([80.3, 79.6])
SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def seen(rng: np.random.Generator, ring: Floats, code: str = CODE, blur_px: float = 0.6) -> NDArray[np.uint8]:
    return photograph(rng, [code], [ring], shape=(160, 160), blur_px=blur_px)


def once_more(
    detector: Detector, found: Found, *images: NDArray[np.uint8]
) -> tuple[Found, NDArray[np.bool_]]:
    which = np.arange(len(images))
    return detector.again(images, found[np.zeros(len(images), np.intp)], which, reach_px=3)


@pytest.mark.parametrize("side_px", [16.0, 24.0, 60.0])
def test_a_face_that_looks_as_before_need_not_be_read(
    side_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    ring = random_ring(rng, side_px, np.radians(50)) + MIDDLE
    detector = Detector(BOXES)
    found = detector.search(seen(rng, ring))
    monkeypatch.delattr(detection, "read_codes")
    images = [seen(rng, ring + 0.3 * i) for i in range(5)]
    again, there = once_more(detector, found, *images)
    assert there.all()
    assert np.abs(again.rings - [ring + 0.3 * i for i in range(5)]).max() < 0.5


@pytest.mark.parametrize("side_px", [24.0, 40.0])
def test_a_face_of_which_one_cell_changes_is_not_the_same(side_px: float) -> None:
    rng = np.random.default_rng(1)
    ring = random_ring(rng, side_px, np.radians(40)) + MIDDLE
    detector = Detector(BOXES)
    found = detector.search(seen(rng, ring))
    other = [CODE[:i] + str(1 - int(CODE[i])) + CODE[i + 1 :] for i in range(len(CODE))]
    _, there = once_more(detector, found, *(seen(rng, ring, code) for code in [*other, CODE]))
    assert there.tolist() == [False] * len(CODE) + [True]


def test_a_face_that_is_suddenly_blurred_is_read_anew() -> None:
    rng = np.random.default_rng(2)
    ring = random_ring(rng, 30.0, np.radians(30)) + MIDDLE
    detector = Detector(BOXES)
    found = detector.search(seen(rng, ring, blur_px=0.3))
    again, there = once_more(detector, found, seen(rng, ring, blur_px=0.35), seen(rng, ring, blur_px=1.8))
    assert there.all()
    assert (again.look[0] == found.look[0]).all()
    assert np.abs(again.look[1] - found.look[0]).max() > 0.1


def test_what_a_face_looks_like_does_not_depend_on_how_it_is_turned() -> None:
    rng = np.random.default_rng(3)
    ring = random_ring(rng, 40.0, np.radians(30)) + MIDDLE
    detector = Detector(BOXES)
    grey = seen(rng, ring)
    looks = [detector.read(grey, np.roll(ring, k, 0)[None]).look[0] for k in range(4)]
    assert np.abs(np.array(looks) - looks[0]).max() < 0.1


def test_cells_and_paper_belong_to_a_face_and_other_faces_do_not() -> None:
    known = np.stack([40 * SQUARE, 40 * SQUARE + [100, 0]])
    rings = np.stack(
        [
            10 * SQUARE + [25, 20],  # a cell
            60 * SQUARE - 10,  # the paper
            40 * SQUARE + [3, 3],  # the face itself, not quite in its place
            10 * SQUARE + [60, 60],  # beside it
            60 * SQUARE + [45, 30],  # a larger face beside it
        ]
    )
    assert belonging(rings, known).tolist() == [True, True, False, False, False]
    assert belonging(rings, known[:0]).tolist() == [False] * 5
    assert not len(belonging(rings[:0], known))
