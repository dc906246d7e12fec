"""Places of a camera, told from how much its images differ."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.depth import RangeNoise
from ecat.geometry.standpoints import MOVED, changes, standpoints, thinned
from ecat.geometry.transforms import Floats

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
