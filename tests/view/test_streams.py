"""Which images of a session are shown, and through which cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecat.geometry.records import camera_of
from ecat.model import Camera, Manifest, Stream
from ecat.view.space import cameras
from ecat.view.streams import depth_step, reduced, shown_streams, straightened
from tests.view.chunks import at, paths

LENS = (0.3, -0.2, 0.001, -0.002, 0.05)
DEPTH = Camera(name="depth", width_px=640, height_px=480, fx_px=500, fy_px=510, cx_px=320, cy_px=240)
COLOR = replace(DEPTH, name="color", reference="depth", translation_m=(0.05, 0.0, 0.0))
SIDE = replace(
    DEPTH, name="side", reference="color", rotation=(0.0, 0.0, 1.0, 0.0), translation_m=(1.0, 0.0, 0.0)
)


def manifest(*streams: Stream) -> Manifest:
    return Manifest(
        name="s", created="2024-01-01T00:00:00", cameras=(COLOR, DEPTH, SIDE), streams=tuple(streams)
    )


def test_every_stream_of_images_has_a_place_of_its_own() -> None:
    streams = [
        Stream(name="rgb", kind="color", present=True, camera="color"),
        Stream(name="rgb 2", kind="color", present=True, camera="side"),
        Stream(name="d", kind="depth", present=True, camera="depth"),
        Stream(name="d2", kind="depth", present=True),
        Stream(name="ir", kind="infrared", present=True, camera="depth"),
        Stream(name="gone", kind="color"),
        Stream(name="sound", kind="audio", present=True),
    ]
    found = {
        shown.stream.name: (shown.image_path, shown.camera) for shown in shown_streams(manifest(*streams))
    }
    assert found == {
        "rgb": ("/world/camera/color/image", COLOR),
        "rgb 2": ("/world/camera/images/rgb_2/image", SIDE),
        "d": ("/world/camera/depth", DEPTH),
        "d2": ("/world/camera/images/d2", None),
        "ir": ("/world/camera/images/ir/image", DEPTH),
    }


def test_a_camera_for_images_of_another_size_is_none() -> None:
    stream = Stream(name="d", kind="depth", present=True, camera="depth", width_px=512, height_px=424)
    assert shown_streams(manifest(stream))[0].camera is None
    assert "/world/camera/depth" not in paths(cameras(manifest(stream)))


@pytest.mark.parametrize(("width", "step"), [(64, 1), (320, 1), (321, 2), (512, 2), (1920, 6)])
def test_wide_depth_is_thinned(width: int, step: int) -> None:
    assert depth_step(width) == step


def test_the_depth_camera_is_as_reduced_as_its_images() -> None:
    stream = Stream(name="depth", kind="depth", camera="depth", present=True)
    assert at(list(cameras(manifest(stream))), "/world/camera/depth", "resolution")[None] == [[320, 240]]


def test_the_camera_of_a_reduced_image_sees_the_same() -> None:
    small = reduced(Camera(name="d", width_px=5, height_px=4, fx_px=10, fy_px=8, cx_px=2, cy_px=2), 2)
    size = (small.width_px, small.height_px)
    assert (*size, small.fx_px, small.fy_px, small.cx_px, small.cy_px) == (3, 2, 5, 4, 1, 1)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("lens", [(), LENS])
def test_a_straightened_pixel_is_where_the_lens_put_it(mirrored: bool, lens: tuple[float, ...]) -> None:
    camera = replace(COLOR, mirrored=mirrored, distortion=lens)
    u, v = straightened(camera, 2)
    assert u.shape == (240, 320)
    point = camera_of(reduced(camera, 2)).unproject(np.array([40.0, 30.0]))
    expected = camera_of(replace(camera, translation_m=(0.0, 0.0, 0.0))).project(point)
    assert np.allclose([u[30, 40], v[30, 40]], expected)
    if not lens:
        assert np.allclose([u[30, 40], v[30, 40]], [80, 60])
