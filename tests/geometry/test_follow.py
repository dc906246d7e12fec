"""A drawn shape followed through images that move, turn, grow, and are hidden."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.geometry.follow import Follower, FollowParameters, Gray, Ranges
from ecat.geometry.transforms import Floats

SHAPE = np.array([[90.0, 70.0], [150.0, 72.0], [148.0, 130.0], [88.0, 128.0]])


def texture(seed: int) -> Gray:
    """Blotches of all sizes."""
    rng = np.random.default_rng(seed)
    sheets = [
        np.asarray(cv2.resize(rng.normal(0, 1, (n * 3, n * 4)), (320, 240), interpolation=cv2.INTER_CUBIC))
        for n in (5, 10, 20, 40)
    ]
    return np.clip(128 + 25 * sum(sheets), 0, 255).astype(np.uint8)


THING, BEHIND = texture(2), texture(7)


def motion(x: float, y: float = 0.0, turn_deg: float = 0.0, scale: float = 1.0) -> Floats:
    """Where points of the drawn image are (2, 3)."""
    u, v = SHAPE.mean(0)
    matrix = cv2.getRotationMatrix2D((u, v), turn_deg, scale)
    matrix[:, 2] += x, y
    return np.asarray(matrix, np.float64)


def image(matrix: Floats, hidden: NDArray[np.bool_] | None = None) -> Gray:
    """The thing, moved, before a background that stands still."""
    cut = np.zeros(THING.shape, np.uint8)
    cv2.fillPoly(cut, [np.rint(SHAPE).astype(np.int32)], 255)
    size = THING.shape[::-1]
    patch, mask = (cv2.warpAffine(part, matrix, size) for part in (THING, cut))
    made = np.where(mask > 127, patch, BEHIND)
    if hidden is not None:
        made[hidden] = 90
    return np.asarray(cv2.GaussianBlur(made, (3, 3), 0.6), np.uint8)


def moved(matrix: Floats) -> Floats:
    return SHAPE @ matrix[:, :2].T + matrix[:, 2]


def distance(matrix: Floats, at: float = 1.0) -> Ranges:
    """The thing is at ``at`` metres, the background at two."""
    ring = moved(matrix).astype(np.float32)

    def ranges(pixels: Floats) -> Floats:
        inner = [cv2.pointPolygonTest(ring, (float(u), float(v)), False) >= 0 for u, v in pixels]
        return np.where(inner, at, 2.0)

    return ranges


def test_a_shape_goes_where_the_thing_goes() -> None:
    follower = Follower(image(motion(0)), SHAPE)
    for k in range(1, 25):
        now = motion(4.0 * k, 1.0 * k, turn_deg=1.5 * k, scale=1 + 0.01 * k)
        found = follower.step(image(now))
        assert found is not None
        assert np.abs(found.polygon - moved(now)).max() < 2
        assert found.confidence > 0.8


def test_a_shape_does_not_drift_on_a_thing_that_stands() -> None:
    follower = Follower(image(motion(0)), SHAPE)
    rng = np.random.default_rng(0)
    for _ in range(20):
        noisy = np.clip(image(motion(0)) + rng.normal(0, 3, THING.shape), 0, 255).astype(np.uint8)
        found = follower.step(noisy)
        assert found is not None
        assert np.abs(found.polygon - SHAPE).max() < 0.5


def test_a_hidden_thing_is_doubted_where_it_was_and_found_again() -> None:
    follower = Follower(image(motion(0)), SHAPE)
    hand = np.zeros(THING.shape, bool)
    hand[50:150, 70:170] = True
    doubt = [follower.step(image(motion(0), hand)) for _ in range(10)]
    confidence = [found.confidence for found in doubt if found is not None]
    assert len(confidence) == 10
    assert max(confidence) < FollowParameters().least
    assert confidence == sorted(confidence, reverse=True)
    again = follower.step(image(motion(0)))
    assert again is not None
    assert again.confidence > 0.9
    assert np.abs(again.polygon - SHAPE).max() < 0.5


@pytest.mark.parametrize(("way_px", "lasts"), [(0.0, 8), (5.0, 3)])
def test_what_stays_hidden_is_lost_and_what_moved_is_lost_sooner(way_px: float, lasts: int) -> None:
    follower = Follower(image(motion(0)), SHAPE, parameters=FollowParameters(patience=8, haste=3))
    assert follower.step(image(motion(way_px))) is not None
    gone = np.full(THING.shape, 90, np.uint8)
    seen = [follower.step(gone) is not None for _ in range(12)]
    assert sum(seen) == lasts
    assert seen == sorted(seen, reverse=True)


def test_depth_keeps_the_background_out_of_a_shape_drawn_too_large() -> None:
    middle = SHAPE.mean(0)
    loose = middle + 1.6 * (SHAPE - middle)
    follower = Follower(image(motion(0)), loose, distance(motion(0)))
    for k in range(1, 15):
        now = motion(5.0 * k)
        found = follower.step(image(now), distance(now))
        assert found is not None
        assert np.abs(found.polygon - loose - np.array([5.0 * k, 0])).max() < 8


def test_depth_that_jumps_is_of_something_else() -> None:
    follower = Follower(image(motion(0)), SHAPE, distance(motion(0)))
    found = follower.step(image(motion(0)), distance(motion(0), at=0.6))
    assert found is not None
    assert found.confidence < FollowParameters().least


def test_a_plain_thing_offers_nothing_to_follow() -> None:
    plain = np.full((240, 320), 128, np.uint8)
    follower = Follower(plain, SHAPE)
    found = follower.step(plain)
    assert found is not None
    assert found.confidence < FollowParameters().least
