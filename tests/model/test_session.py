"""The manifest: the clock's arithmetic, and finding a part by its name."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.model import Camera, Clock, LayerRecord, Manifest, TableRecord

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
