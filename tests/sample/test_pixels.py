"""Rendered colour images: everything is where the camera's model says, and covered by what is before it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.transforms import Floats, Rigid
from ecat.sample import GroundTruth, sample_session
from ecat.sample.pixels import EXACT_COLOR, TEXTURES, ColorNoise, Renderer, distractor
from ecat.sample.pixels.layers import Capsule, Layer, Quad, limb_layer, quad_layer, smeared
from ecat.sample.pixels.sensors import NoiseTape, noisy
from ecat.sample.pixels.view import View, flipped, resized

SMALL = (960, 540)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return sample_session(seed=0, actions=["next"])[1]


@pytest.fixture(scope="module")
def sharp(truth: GroundTruth) -> Renderer:
    """No noise, nothing smeared; optics as usual."""
    return Renderer(truth, noise=EXACT_COLOR, motion_blur=False)


def carried(truth: GroundTruth) -> int:
    """A frame in the middle of the first movement."""
    carry = truth.moves[0].carries[0]
    return (carry.move + carry.still) // 2


# --------------------------------------------------------------------------------------------- geometry


def measured_corners(image: Floats, ring: Floats) -> Floats:
    """Corners (4, 2) where lines through the measured edges meet.

    Across an edge the brightness goes from one level to the other; where the edge is follows from the area under the
    profile, whatever the blur is.
    """
    lines: list[tuple[Floats, Floats]] = []
    for start, end in zip(ring, np.roll(ring, -1, 0), strict=True):
        along = (end - start) / math.hypot(*(end - start))
        out = np.array([along[1], -along[0]])
        out *= np.sign(out @ (start - ring.mean(0)))
        share, way = np.linspace(0.25, 0.75, 41), np.arange(-30, 31) / 10
        u, v = np.moveaxis(start + share[:, None, None] * (end - start) + way[:, None] * out, -1, 0).astype(
            "f4"
        )
        profile = cv2.remap(image.astype(np.float32), u, v, cv2.INTER_LINEAR)
        inner, outer = profile[:, :3].mean(1), profile[:, -3:].mean(1)
        lit = ((profile - inner[:, None]) / (outer - inner)[:, None]).sum(1)
        shift = np.polyfit(share, 3.05 - 0.1 * lit, 1)
        lines.append((start + out * shift[1], end + out * shift.sum()))
    corners: list[Floats] = []
    for (a, b), (c, d) in pairwise([lines[-1], *lines]):
        s, _ = np.linalg.solve(np.stack([b - a, c - d], 1), c - a)
        corners.append(a + s * (b - a))
    return np.array(corners)


@pytest.mark.parametrize(("size", "camera"), [(None, "color"), ((1440, 810), "color"), (None, "color2")])
def test_marker_corners_are_where_the_camera_projects_them(
    truth: GroundTruth, size: tuple[int, int] | None, camera: str
) -> None:
    renderer = Renderer(truth, noise=EXACT_COLOR, motion_blur=False, size=size, cameras=2)
    errors: list[Floats] = []
    for frame in (0, truth.n_frames - 1):
        seen = renderer.faces(frame, camera)
        image = renderer.color(frame, camera).mean(-1)
        for box, face in np.argwhere((seen.visible > 0.999) & (seen.tilt_rad < 0.95) & (seen.side_px > 42)):
            ring = renderer.cameras[camera].project(
                truth.scene.depth_from_table.apply(truth.corners[box, frame, face])
            )
            assert ring == pytest.approx(seen.pixels[box, face], abs=1e-9)
            errors.append(measured_corners(image, ring) - ring)
    error = np.sqrt((np.concatenate(errors) ** 2).sum(-1))
    assert len(error) >= 4
    assert error.max() < 0.03


def test_a_pixel_is_the_mean_of_its_square_around_whole_coordinates(truth: GroundTruth) -> None:
    """A white square seen head on, against the area of its pixels' squares."""
    camera = replace(KINECT_V2_COLOR, width=64, height=48, cx=31.3, cy=22.6)
    view = View(camera, Rigid.identity())
    z, half = 2.0, 0.0123
    white = np.full((8, 8, 4), 255, np.uint8)
    # the picture's own right is the viewer's: the camera's x as seen from before it
    quad = Quad(np.array([-half, -half, z]), np.array([2 * half, 0, 0]), np.array([0, 2 * half, 0]), white)
    layer = quad_layer(view, quad, 1.0, view.whole)
    assert layer is not None
    u = camera.cx + np.array([-1, 1]) * camera.fx * half / z
    v = camera.cy + np.array([-1, 1]) * camera.fy * half / z

    def covered(edges: Floats, n: int) -> Floats:
        pixel = np.arange(n)
        return np.clip(np.minimum(edges[1], pixel + 0.5) - np.maximum(edges[0], pixel - 0.5), 0, 1)

    assert layer.cover == pytest.approx(np.outer(covered(v, 48), covered(u, 64)), abs=0.2)
    rows, columns = np.mgrid[0:48, 0:64]
    total = layer.cover.sum()
    assert total == pytest.approx(np.diff(u)[0] * np.diff(v)[0], rel=0.005)
    assert (layer.cover * columns).sum() / total == pytest.approx(camera.cx, abs=0.02)
    assert (layer.cover * rows).sum() / total == pytest.approx(camera.cy, abs=0.02)


def test_a_face_is_what_a_thousand_sight_lines_per_pixel_see(truth: GroundTruth) -> None:
    """The pattern of one marker against brute force: every sub-sample is traced back to a cell of the print."""
    renderer = Renderer(truth, noise=EXACT_COLOR, motion_blur=False, blur_px=0.0)
    seen = renderer.faces(0)
    box, face = np.unravel_index(np.argmax(seen.side_px * (seen.visible > 0.999)), seen.visible.shape)
    ring = seen.pixels[box, face]
    (left, top), (right, bottom) = np.floor(ring.min(0)).astype(int), np.ceil(ring.max(0)).astype(int)
    image = renderer.color(0)[top : bottom + 1, left : right + 1].mean(-1)
    k = 16
    fine = (np.arange(k) + 0.5) / k - 0.5
    u = (np.arange(left, right + 1)[:, None] + fine).ravel()
    v = (np.arange(top, bottom + 1)[:, None] + fine).ravel()
    camera, corners = (
        renderer.cameras["color"],
        truth.scene.depth_from_table.apply(truth.corners[box, 0, face]),
    )
    ray = camera.unproject(np.stack(np.meshgrid(u, v), -1))
    eye = camera.from_reference.inverse().translation
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    normal = np.cross(across, down)
    hit = eye + ray * ((corners[0] - eye) @ normal / (ray @ normal))[..., None] - corners[0]
    s, t = hit @ across / (across @ across), hit @ down / (down @ down)
    code = truth.prototypes[box].faces[face].code
    cells = np.pad(np.array(list(code), float).reshape(5, 5), 1)
    inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    lit = cells[np.clip((t * 7).astype(int), 0, 6), np.clip((s * 7).astype(int), 0, 6)]
    mean = np.where(inside, lit, 0).reshape(len(image), k, -1, k).mean((1, 3))
    whole = inside.reshape(len(image), k, -1, k).all((1, 3))
    # brightness is an unknown, nearly even function of the white share
    fit = np.polynomial.Polynomial.fit(mean[whole], image[whole], 1)
    error = image[whole] - fit(mean[whole])
    assert fit(1.0) - fit(0.0) > 60
    assert np.sqrt((error**2).mean()) / (fit(1.0) - fit(0.0)) < 0.03


def test_the_unmirrored_image_is_the_mirrored_one_flipped(truth: GroundTruth) -> None:
    mirrored, straight = (
        Renderer(truth, size=SMALL, noise=EXACT_COLOR, mirrored=mirrored) for mirrored in (True, False)
    )
    difference = cv2.absdiff(mirrored.color(0), np.ascontiguousarray(straight.color(0)[:, ::-1]))
    # uneven light belongs to the image, not to the room
    assert np.median(difference) <= 12
    frame = carried(truth)
    assert straight.faces(frame).pixels[..., 0] == pytest.approx(
        SMALL[0] - 1 - mirrored.faces(frame).pixels[..., 0]
    )
    assert straight.faces(frame).visible == pytest.approx(mirrored.faces(frame).visible, abs=0.02)


def test_a_resized_camera_sees_the_same_in_other_pixels() -> None:
    point = np.array([0.3, -0.2, 1.7])
    small = resized(KINECT_V2_COLOR, 480, 270)
    assert small.project(point) == pytest.approx((KINECT_V2_COLOR.project(point) + 0.5) / 4 - 0.5)
    turned = flipped(KINECT_V2_COLOR)
    assert turned.project(point)[0] == pytest.approx(1919 - KINECT_V2_COLOR.project(point)[0])


def test_a_lens_with_distortion_is_refused(truth: GroundTruth) -> None:
    bent = replace(truth.scene.color, distortion=(0.1,) + (0.0,) * 7)
    with pytest.raises(UsageError, match="color"):
        Renderer(replace(truth, scene=replace(truth.scene, color=bent)))


# -------------------------------------------------------------------------------------------- occlusion


def test_a_hand_hides_as_much_of_a_marker_as_the_image_shows(truth: GroundTruth) -> None:
    """The white paper and black ink of a marker have no colour, skin and sleeves have."""
    renderer = Renderer(truth, noise=EXACT_COLOR, motion_blur=False, blur_px=0.0, texture="cloth")
    told, shown = [], []
    for frame in range(truth.moves[0].carries[0].reach, truth.n_frames, 16):
        image = renderer.color(frame).astype(int)
        gray = np.ptp(image, axis=-1) <= 12
        seen = renderer.faces(frame)
        for box, face in np.argwhere((seen.tilt_rad < 1.3) & (seen.side_px > 25)):
            mask = np.zeros(gray.shape, np.uint8)
            cv2.fillConvexPoly(mask, np.rint(seen.pixels[box, face]).astype(np.int32), 1)
            told.append(seen.visible[box, face])
            shown.append(gray[mask == 1].mean())
    told, shown = np.array(told), np.array(shown)
    assert (told < 0.5).any()
    assert (told > 0.999).any()
    # another box's paper is gray as well, so only more can be shown than is told
    assert (shown > told - 0.06).all()
    assert np.median(np.abs(shown - told)) < 0.03


def test_faces_are_visible_where_the_simple_sensors_saw_them(truth: GroundTruth, sharp: Renderer) -> None:
    for frame in range(0, truth.n_frames, 20):
        visible = sharp.faces(frame).visible
        assert (visible[truth.hidden[:, frame] == 0] > 0.9).all()


def test_a_blank_box_has_no_marker(truth: GroundTruth) -> None:
    blank = Renderer(truth, noise=EXACT_COLOR, motion_blur=False, markers=False, size=SMALL)
    marked = Renderer(truth, noise=EXACT_COLOR, motion_blur=False, size=SMALL)
    (box, face), ring = (1, 2), blank.faces(0).pixels[1, 2]
    mask = np.zeros(SMALL[::-1], np.uint8)
    cv2.fillConvexPoly(mask, np.rint(ring).astype(np.int32), 1)
    spread = [np.ptp(r.color(0)[mask == 1].mean(-1)) for r in (blank, marked)]
    assert marked.faces(0).visible[box, face] > 0.99
    assert spread[0] < 50
    assert spread[1] > 100


def test_things_that_reach_into_one_another_are_told_apart_pixel_by_pixel() -> None:
    """Two crossed capsules: each is in front where it is nearer."""
    view = View(replace(KINECT_V2_COLOR, mirrored=False), Rigid.identity())
    red = Capsule(np.array([-0.2, 0, 1.0]), np.array([0.2, 0, 1.2]), 0.04, (0.0, 0.0, 200.0))
    blue = Capsule(np.array([-0.2, 0, 1.2]), np.array([0.2, 0, 1.0]), 0.04, (200.0, 0.0, 0.0))
    layer = limb_layer(view, [red, blue], np.array([0.0, 0, -1]))
    assert layer is not None
    row = round(view.camera.cy) - layer.rect.top
    line = layer.color[row, layer.cover[row] == 1]
    assert (line[:20, 2] > line[:20, 0]).all()
    assert (line[-20:, 0] > line[-20:, 2]).all()


# ---------------------------------------------------------------------------------------- blur and noise


def test_blur_of_motion_leaves_a_thing_where_it_is() -> None:
    view = View(KINECT_V2_COLOR, Rigid.identity())
    capsule = Capsule(np.array([0.0, 0, 2.0]), np.array([0.01, 0.02, 2.0]), 0.02, (100.0, 100.0, 100.0))
    still = limb_layer(view, [capsule], UP)
    assert still is not None
    moved = smeared(still, np.array([7.0, -3.0]), view.whole)

    def moments(layer: Layer) -> tuple[float, Floats, Floats]:
        cover = layer.cover.astype(float)
        v, u = np.mgrid[0 : cover.shape[0], 0 : cover.shape[1]]
        place = np.stack([u + layer.rect.left, v + layer.rect.top], -1).reshape(-1, 2).astype(float)
        weights = cover.ravel() / cover.sum()
        centre = np.asarray(weights @ place, np.float64)
        off = place - centre
        return float(cover.sum()), centre, np.asarray(off.T @ (off * weights[:, None]), np.float64)

    (area, centre, spread), (area_moved, centre_moved, spread_moved) = moments(still), moments(moved)
    assert area_moved == pytest.approx(area, rel=1e-4)
    assert centre_moved == pytest.approx(centre, abs=0.02)
    # a way of length w adds w ** 2 / 12
    assert (spread_moved - spread)[0, 0] == pytest.approx(49 / 12, rel=0.1)
    assert (spread_moved - spread)[0, 1] == pytest.approx(-21 / 12, rel=0.1)


def test_the_variance_of_the_noise_is_read_noise_and_a_share_of_the_brightness() -> None:
    tape, noise = NoiseTape(0, 400_000), ColorNoise(read=2.0, shot=0.05)
    for brightness in (40, 120, 200):
        image = np.full((300, 400, 3), brightness, np.float32)
        spoilt = noisy(image, noise, tape, np.random.default_rng(1)).astype(float)
        # rounding to whole levels adds a twelfth
        assert spoilt.var() == pytest.approx(4 + 0.05 * brightness + 1 / 12, rel=0.02)
        assert spoilt.mean() == pytest.approx(brightness, abs=0.05)


def test_noise_is_new_where_something_moves_and_in_two_images(truth: GroundTruth) -> None:
    renderer, exact = Renderer(truth, size=SMALL), Renderer(truth, size=SMALL, noise=EXACT_COLOR)
    noise = [renderer.color(f).astype(float) - exact.color(f) for f in (0, 1)]
    u, v = renderer.faces(0).pixels.reshape(-1, 2).mean(0).astype(int)
    one, two = (n[v - 60 : v + 60, u - 60 : u + 60] for n in noise)
    assert 1.2 < one.std() < 3
    assert abs((one * two).mean()) < 0.05 * one.std() * two.std()


def test_an_image_depends_on_the_frame_and_not_on_what_was_asked_before(truth: GroundTruth) -> None:
    frames = [carried(truth), 3, carried(truth) + 0.5]
    one, two = Renderer(truth, seed=3, size=SMALL), Renderer(truth, seed=3, size=SMALL)
    forward = {f: (one.color(f).tobytes(), one.depth(f).tobytes()) for f in frames}
    assert forward == {f: (two.color(f).tobytes(), two.depth(f).tobytes()) for f in reversed(frames)}
    assert len({images[0] for images in forward.values()}) == 3


def test_other_seeds_look_different(truth: GroundTruth) -> None:
    images: list[NDArray[np.uint8]] = [
        Renderer(truth, seed=seed, size=(320, 180)).color(0) for seed in range(3)
    ]
    assert all(cv2.absdiff(a, b).mean() > 3 for a, b in pairwise(images))


@pytest.mark.parametrize("texture", TEXTURES)
def test_every_texture_can_be_put_on_the_table(truth: GroundTruth, texture: str) -> None:
    image = Renderer(truth, size=(320, 180), texture=texture).color(0)  # type: ignore[arg-type]
    assert image.shape == (180, 320, 3)
    assert image[100:].std() > 15


@pytest.mark.parametrize(
    ("arguments", "told"),
    [({"cameras": 3}, "3 colour cameras"), ({"size": (8, 8)}, "8 x 8"), ({"depth_size": (8, 80)}, "8 x 80")],
)
def test_impossible_cameras_are_refused(truth: GroundTruth, arguments: dict[str, object], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        Renderer(truth, **arguments)  # type: ignore[arg-type]


def test_distractors_are_many_and_the_same_for_the_same_seed() -> None:
    images = [distractor(seed, (160, 120)) for seed in range(12)]
    assert all(image.shape == (120, 160, 3) and image.std() > 5 for image in images)
    assert all(cv2.absdiff(a, b).mean() > 5 for a, b in pairwise(images))
    assert (distractor(3, (160, 120)) == images[3]).all()
