"""The manifest: the clock's arithmetic, and finding a part by its name."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.model import Camera, Clock, LayerRecord, Manifest, TableRecord
from ecat.model.session import DISTORTION_LENGTHS, camera_problems

FRAMES = st.integers(-5, 10**6)
LENGTHS = st.integers(2, 10**6)
DURATIONS = st.integers(0, 10**12)


def clock(duration_ns: int) -> Clock:
    return Clock(rule="uniform", duration_ns=duration_ns)


def time_of(duration_ns: int, frame: int, n_frames: int) -> int:
    t = clock(duration_ns).t_ns(frame, n_frames)
    assert t is not None
    return t


@given(DURATIONS, LENGTHS)
def test_the_first_image_is_at_zero_and_the_last_at_the_duration(duration: int, n: int) -> None:
    assert time_of(duration, 0, n) == 0
    assert time_of(duration, n - 1, n) == duration


@given(DURATIONS, LENGTHS, FRAMES)
def test_time_never_runs_backwards(duration: int, n: int, frame: int) -> None:
    assert time_of(duration, frame, n) <= time_of(duration, frame + 1, n)


@given(DURATIONS, LENGTHS, FRAMES)
def test_a_time_is_rounded_to_the_nearest_nanosecond(duration: int, n: int, frame: int) -> None:
    exact_times_n = duration * max(frame, 0)
    # in integers: floats have too few digits for nanoseconds
    assert abs(2 * (n - 1) * time_of(duration, frame, n) - 2 * exact_times_n) <= n - 1


@given(DURATIONS, LENGTHS, st.integers(-(10**9), 0))
def test_before_the_first_image_the_time_is_zero(duration: int, n: int, frame: int) -> None:
    assert time_of(duration, frame, n) == 0


@given(DURATIONS, LENGTHS, st.lists(FRAMES, max_size=5))
def test_many_frames_have_the_times_of_each(duration: int, n: int, frames: list[int]) -> None:
    assert clock(duration).times_ns(frames, n) == [time_of(duration, frame, n) for frame in frames]


@pytest.mark.parametrize(
    ("clock", "n_frames"),
    [
        (Clock(), 10),
        (Clock(rule="unknown", duration_ns=10), 10),
        (Clock(rule="recorded", duration_ns=10), 10),
        (Clock(rule="uniform"), 10),
        (Clock(rule="uniform", duration_ns=10), 1),
        (Clock(rule="uniform", duration_ns=10), 0),
    ],
)
def test_without_a_uniform_clock_there_are_no_times(clock: Clock, n_frames: int) -> None:
    assert clock.t_ns(0, n_frames) is None
    assert clock.times_ns((0, 1, 5), n_frames) == [None] * 3


def test_a_time_that_needs_more_than_64_bits_is_missing() -> None:
    assert time_of(2**62, 1, 2) == 2**62
    assert clock(2**62).t_ns(2, 2) is None


def test_parts_are_found_by_name() -> None:
    camera = Camera(name="color", width_px=4, height_px=3, fx_px=1, fy_px=1, cx_px=2, cy_px=1.5)
    table = TableRecord(name="poses", file="tables/poses.parquet", sha256="", rows=0)
    layer = LayerRecord(name="main", file="annotations/main.xml", sha256="")
    manifest = Manifest(name="s", created="2020", cameras=(camera,), tables=(table,), layers=(layer,))
    assert (manifest.camera("color"), manifest.table("poses"), manifest.layer("main")) == (
        camera,
        table,
        layer,
    )
    assert (manifest.camera("depth"), manifest.table("frames"), manifest.layer("gold")) == (None,) * 3


CAMERA = Camera(name="color", width_px=640, height_px=480, fx_px=500, fy_px=500, cx_px=320, cy_px=240)


@pytest.mark.parametrize("terms", DISTORTION_LENGTHS)
def test_cameras_with_lenses_of_any_known_length_have_no_problems(terms: int) -> None:
    turned = replace(
        CAMERA, distortion=(0.1,) * terms, rotation=(0.6, 0.0, 0.0, 0.8), translation_m=(1, 2, 3)
    )
    assert list(camera_problems(turned)) == []


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308])
@pytest.mark.parametrize(
    "field", ["fx_px", "fy_px", "cx_px", "cy_px", "distortion", "rotation", "translation_m"]
)
def test_a_value_that_no_camera_has_is_a_problem_of_its_field(field: str, value: float) -> None:
    length = {"distortion": 4, "rotation": 4, "translation_m": 3}.get(field)
    changes: dict[str, Any] = {field: value if length is None else (value,) * length}
    (problem,) = camera_problems(replace(CAMERA, **changes))
    assert problem.startswith(f"{field}: expected ")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fx_px", 0.0),
        ("fy_px", -500.0),
        ("rotation", (0.0,) * 4),
        ("rotation", (1.0,) * 4),
        *(("distortion", (0.0,) * n) for n in (1, 2, 3, 6, 7, 9, 13, 15)),
    ],
)
def test_focal_lengths_turns_and_lenses_that_cannot_be(field: str, value: object) -> None:
    changes: dict[str, Any] = {field: value}
    (problem,) = camera_problems(replace(CAMERA, **changes))
    assert problem.startswith(f"{field}: expected ")
