"""Corners of markers lie where they were drawn, to a tenth of a pixel, whatever the blur."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.corners import Outlines, Several, clockwise, outline
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES
from tests.geometry.printed import Print, photograph, random_ring, seen_ring

CODE = NOMINAL_BOXES[2].faces[0].code
MIDDLE = np.array([80.3, 79.6])


def measured(rng: np.random.Generator, ring: Floats, blur_px: float = 0.5, noise: float = 2.0) -> Outlines:
    grey = photograph(rng, [CODE], [ring], shape=(160, 160), blur_px=blur_px, noise=noise)
    start = ring + rng.normal(0, 0.8, ring.shape)
    return outline(grey, outline(grey, start[None], reach_px=3).rings, reach_px=2)


@pytest.mark.parametrize("blur_px", [0.0, 0.5, 1.0])
def test_corners_of_small_tilted_markers_are_known_to_a_fifth_of_a_pixel(blur_px: float) -> None:
    rng = np.random.default_rng(3)
    rings = [random_ring(rng, rng.uniform(25, 40)) + MIDDLE + rng.uniform(-1, 1, 2) for _ in range(25)]
    errors = np.array([measured(rng, ring, blur_px).rings[0] - ring for ring in rings])
    assert np.sqrt((errors**2).sum(-1).mean()) < 0.2
    assert np.abs(errors.mean((0, 1))).max() < 0.03


def test_the_order_of_the_corners_is_kept() -> None:
    rng = np.random.default_rng(0)
    ring = random_ring(rng, 40.0) + MIDDLE
    grey = photograph(rng, [CODE], [ring], shape=(160, 160))
    for k in range(4):
        turned = np.roll(ring, k, 0)
        assert np.abs(outline(grey, turned[None], reach_px=2).rings[0] - turned).max() < 0.3


def test_blur_does_not_move_the_edges() -> None:
    rng = np.random.default_rng(1)
    ring = seen_ring(36.0, 0.0, 0.0, 0.3) + MIDDLE
    area = [np.linalg.norm(np.ptp(measured(rng, ring, b, noise=0).rings[0], axis=0)) for b in (0.2, 0.8, 1.4)]
    assert np.ptp(area) < 0.1


def test_the_blur_is_measured() -> None:
    rng = np.random.default_rng(2)
    ring = seen_ring(60.0, 0.2, 1.0, 0.3) + MIDDLE
    for blur_px in (0.6, 1.0, 1.5):
        # a pixel's own width blurs, too
        expected = np.hypot(blur_px, np.sqrt(1 / 12))
        assert measured(rng, ring, blur_px).blur_px[0] == pytest.approx(expected, abs=0.12)


def test_sigma_says_how_far_the_corners_are_off() -> None:
    rng = np.random.default_rng(4)
    scaled: list[Floats] = []
    for _ in range(40):
        ring = random_ring(rng, 40.0, np.radians(40)) + MIDDLE
        found = measured(rng, ring, 0.7, noise=6.0)
        scaled.append((found.rings[0] - ring) / found.sigma_px[0][:, None])
    assert 0.5 < np.sqrt(np.mean(np.square(scaled))) < 2.0


def test_where_there_are_no_edges_there_is_no_support() -> None:
    rng = np.random.default_rng(5)
    ring = random_ring(rng, 40.0) + MIDDLE
    bare = photograph(rng, [], [], shape=(160, 160))
    assert outline(bare, ring[None], reach_px=3).support[0] < 0.2
    bright_inside = photograph(rng, [CODE], [ring], shape=(160, 160), paper=Print(ink=220, paper=30))
    assert outline(bright_inside, ring[None], reach_px=2).support[0] < 0.2


def test_rings_beyond_the_image_and_no_rings_at_all_do_no_harm() -> None:
    grey = np.full((50, 60), 100, np.uint8)
    far = np.array([[[-500.0, -500], [900, -20], [50, 70], [10, 1e4]], [[5, 5], [5, 5], [5, 5], [5, 5]]])
    assert np.isfinite(outline(grey, far, reach_px=3).rings).all()
    assert len(outline(grey, np.empty((0, 4, 2)), reach_px=3)) == 0


def test_rings_are_turned_clockwise() -> None:
    ring = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
    both = clockwise(np.stack([ring, ring[::-1]]))
    assert (both[0] == ring).all()
    assert (both[1] == ring).all()


def test_rings_of_several_images_are_measured_as_each_is_alone() -> None:
    rng = np.random.default_rng(4)
    rings = np.stack([random_ring(rng, 30.0) + MIDDLE for _ in range(5)])
    images = [photograph(rng, [CODE], [ring], shape=(160, 160)) for ring in rings[:4]]
    which = np.array([0, 0, 3, 3, 3])  # no ring is in the images between
    rings = rings[[0, 0, 3, 3, 3]] + rng.normal(0, 0.5, rings.shape)
    together = outline(Several(images, which), rings, reach_px=3)
    alone = np.concatenate(
        [outline(images[i], ring[None], reach_px=3).rings for i, ring in zip(which, rings, strict=True)]
    )
    assert np.allclose(together.rings, alone)
    assert len(outline(Several(images, which[:0]), rings[:0], reach_px=3)) == 0
