"""Cameras as a session's manifest has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecat.geometry.records import depth_from_camera
from ecat.model import Camera, Manifest

DEPTH = Camera(name="depth", width_px=640, height_px=480, fx_px=500, fy_px=510, cx_px=320, cy_px=240)
COLOR = replace(DEPTH, name="color", reference="depth", translation_m=(0.05, 0.0, 0.0))
SIDE = replace(
    DEPTH, name="side", reference="color", rotation=(0.0, 0.0, 1.0, 0.0), translation_m=(1.0, 0.0, 0.0)
)
MANIFEST = Manifest(name="s", created="2024-01-01T00:00:00", cameras=(COLOR, DEPTH, SIDE))


def test_a_camera_given_by_another_camera_stands_where_both_say() -> None:
    place = depth_from_camera(MANIFEST, SIDE)
    # half a turn about z, a metre aside, and the colour camera's five centimetres
    assert np.allclose(place.apply(np.array([0.2, 0.1, 1.0])), [0.85, -0.1, 1.0])


def test_cameras_given_by_each_other_have_a_place_all_the_same() -> None:
    circle = replace(MANIFEST, cameras=(replace(COLOR, reference="side"), SIDE))
    assert np.isfinite(depth_from_camera(circle, SIDE).translation).all()
