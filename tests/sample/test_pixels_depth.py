"""Rendered depth images: exact without noise, and with it as the noise model says."""

from __future__ import annotations

import numpy as np
import pytest

from ecat.geometry.transforms import Floats, Rigid
from ecat.sample import GroundTruth, sample_session
from ecat.sample.pixels import EXACT_DEPTH, DepthNoise, Renderer
from ecat.sample.pixels.sensors import NoiseTape, time_of_flight
from ecat.sample.pixels.world import SIDES, Capsule, Room, arm, room
from ecat.sample.scene import HALF_M, TABLE_OUTLINE_M

SHAPE = (424, 512)


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return sample_session(seed=2, actions=["around"])[1]


@pytest.fixture(scope="module")
def exact(truth: GroundTruth) -> Renderer:
    return Renderer(truth, depth_noise=EXACT_DEPTH)


def points(renderer: Renderer, depth: np.ndarray[tuple[int, ...], np.dtype[np.uint16]]) -> Floats:
    """Where the pixels' sight lines end (h, w, 3), ``table`` frame."""
    camera = renderer.cameras["depth"]
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
    ray = camera.unproject(pixels.astype(float))
    return renderer.truth.scene.depth_from_table.inverse().apply(ray * depth[..., None] / 1000)


def free_distance(renderer: Renderer, scenery: Room, frame: int, at: Floats) -> Floats:
    """How far (...) points (..., 3) are from the nearest surface, metres; negative inside of something solid."""
    boxes, joints = renderer.state(frame)
    distances: list[Floats] = []
    for turn, place in zip(boxes.rotation, boxes.translation, strict=True):
        beyond = np.abs(Rigid(turn, place).inverse().apply(at)) - HALF_M
        outside = np.sqrt((np.maximum(beyond, 0) ** 2).sum(-1))
        distances.append(outside + np.minimum(beyond.max(-1), 0))
    limbs = [part for side in SIDES for part in arm(joints, renderer.truth.seed, side)]
    distances += [capsule_distance(capsule, at) for capsule in (*limbs, *scenery.capsules)]
    for quad in scenery.quads:
        off = at - quad.corner
        s, t = (np.clip(off @ way / (way @ way), 0, 1)[..., None] * way for way in (quad.right, quad.down))
        distances.append(np.sqrt(((off - s - t) ** 2).sum(-1)))
    return np.min(distances, axis=0)


def capsule_distance(capsule: Capsule, at: Floats) -> Floats:
    axis = capsule.b - capsule.a
    share = np.clip((at - capsule.a) @ axis / (axis @ axis), 0, 1)
    return np.sqrt(((at - capsule.a - share[..., None] * axis) ** 2).sum(-1)) - capsule.radius


def test_every_sight_line_ends_at_the_first_surface(truth: GroundTruth, exact: Renderer) -> None:
    """The image is compared with distances to all surfaces, which know nothing of sight lines."""
    carry = truth.moves[0].carries[0]
    scenery = room(truth, np.random.default_rng(0), "wood")
    eye = truth.scene.depth_from_table.inverse().translation
    for frame in (carry.hold, carry.move + 12):
        depth = exact.depth(frame)
        ends = points(exact, depth)[::3, ::3]
        low, high = TABLE_OUTLINE_M.min(0), TABLE_OUTLINE_M.max(0)
        # the table's two slanting sides are cut out of its picture, and off the outline everything is at rest
        slanted = (np.abs(ends[..., 0]) > high[0] - 0.06) & (np.abs(ends[..., 0]) < high[0] + 0.02)
        sure = ~(slanted & (ends[..., 1] > low[1] - 0.02) & (ends[..., 1] < high[1] + 0.02))
        assert sure.mean() > 0.9
        missed = np.abs(free_distance(exact, scenery, frame, ends))[sure]
        assert (missed < 0.001).mean() > 0.999
        assert np.median(missed) < 0.0003
        for share in (0.6, 0.9, 0.97):
            on_the_way = eye + share * (ends - eye)
            assert (free_distance(exact, scenery, frame, on_the_way)[sure] > -0.002).all()


def test_without_noise_every_pixel_has_a_depth_and_the_table_is_flat(
    exact: Renderer, truth: GroundTruth
) -> None:
    depth = exact.depth(0)
    assert depth.shape == SHAPE
    assert depth.dtype == np.uint16
    assert (depth > 0).all()
    at = points(exact, depth)
    table = (np.abs(at[..., 0]) < 0.5) & (at[..., 1] > -0.44) & (at[..., 1] < -0.35)
    assert table.sum() > 5000
    assert np.abs(at[table][:, 2]).max() < 0.0006


def spoilt(depth_m: float, bright: float, noise: DepthNoise, n: int = 200) -> Floats:
    """Measurements of a flat surface in millimetres, 0 where there is none."""
    flat = np.full((n, n), depth_m, np.float32)
    rng = np.random.default_rng(3)
    fixed = rng.standard_normal((n, n), dtype=np.float32)
    tape = NoiseTape(0, 4 * n * n)
    made = time_of_flight(flat, np.full_like(flat, bright), noise, fixed=fixed, tape=tape, rng=rng)
    return made.astype(float)


@pytest.mark.parametrize(("depth_m", "bright"), [(1.0, 1.0), (2.0, 1.0), (3.0, 0.5), (1.5, 0.1)])
def test_noise_grows_with_the_square_of_the_distance_and_with_darkness(depth_m: float, bright: float) -> None:
    noise = DepthNoise(lost=0.0)
    z = spoilt(depth_m, bright, noise)
    drawn = (noise.floor_mm + noise.square_mm * depth_m**2) / bright**0.5
    # rounding to whole millimetres adds a twelfth
    assert z.std() == pytest.approx((drawn**2 + noise.fixed_mm**2 + 1 / 12) ** 0.5, rel=0.02)
    nearer = noise.dark_mm * max(0.0, 1 - bright / 0.8)
    assert z.mean() == pytest.approx(1000 * depth_m - nearer, abs=0.12)


def test_a_larger_pixel_is_the_mean_of_smaller_ones() -> None:
    noise = DepthNoise(lost=0.0)
    assert spoilt(2.0, 1.0, noise.mean_of(4)).std() == pytest.approx(
        spoilt(2.0, 1.0, noise).std() / 2, rel=0.05
    )


def test_pixels_are_lost_at_random_out_of_range_and_where_too_little_comes_back() -> None:
    assert (spoilt(1.5, 0.8, DepthNoise(lost=0.02)) == 0).mean() == pytest.approx(0.02, abs=0.003)
    assert (spoilt(0.4, 0.8, DepthNoise()) == 0).all()
    assert (spoilt(4.6, 0.8, DepthNoise()) == 0).all()
    noise = DepthNoise(lost=0.0, faint=0.02)
    assert (spoilt(2.0, 0.08, noise) == 0).mean() == pytest.approx(0.5, abs=0.02)
    assert (spoilt(2.0, 0.13, noise) > 0).all()


def test_on_an_outline_pixels_fly_between_front_and_back_or_are_lost() -> None:
    noise = DepthNoise(lost=0.0, floor_mm=0.0, square_mm=0.0, fixed_mm=0.0, dark_mm=0.0)
    step = np.full((1000, 40), 1.0, np.float32)
    step[:, 20:] = 1.6
    rng, tape = np.random.default_rng(5), NoiseTape(0, 100_000)
    bright = np.full_like(step, 0.8)
    z = time_of_flight(step, bright, noise, fixed=np.zeros_like(step), tape=tape, rng=rng)
    assert (z[:, :19] == 1000).all()
    assert (z[:, 21:] == 1600).all()
    edge = z[:, 19:21]
    assert (edge == 0).mean() == pytest.approx(noise.torn, abs=0.03)
    flying = edge[(edge > 1000) & (edge < 1600)]
    assert flying.size / edge.size == pytest.approx(noise.flying, abs=0.03)
    assert flying.mean() == pytest.approx(1300, abs=20)


def test_a_spoilt_image_is_near_the_exact_one_but_for_outlines(truth: GroundTruth, exact: Renderer) -> None:
    spoilt_, true = Renderer(truth).depth(30), exact.depth(30)
    there = spoilt_ > 0
    assert 0.9 < there.mean() < 0.998
    error = spoilt_[there].astype(float) - true[there]
    assert np.abs(np.median(error)) < 2
    assert (np.abs(error) > 50).mean() < 0.02
    assert 1 < np.percentile(np.abs(error), 68) < 8


def test_depth_images_of_other_sizes_show_the_same(truth: GroundTruth, exact: Renderer) -> None:
    small = Renderer(truth, depth_noise=EXACT_DEPTH, depth_size=(256, 212))
    halves = exact.depth(0).reshape(212, 2, 256, 2)
    low, high = halves.min((1, 3)), halves.max((1, 3))
    flat = high - low < 40
    z = small.depth(0)
    assert z.shape == (212, 256)
    assert ((z >= low) & (z <= high))[flat].mean() > 0.995


def test_an_unmirrored_depth_image_is_the_mirrored_one_flipped(truth: GroundTruth, exact: Renderer) -> None:
    straight = Renderer(truth, depth_noise=EXACT_DEPTH, mirrored=False)
    frame = truth.moves[0].carries[0].move
    same = np.abs(straight.depth(frame)[:, ::-1].astype(int) - exact.depth(frame)) <= 1
    assert same.mean() > 0.9995
