"""Times of other programs and back, and the frames nearest to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ecat.formats.interchange import times
from ecat.formats.interchange.times import FrameTimes, clock_of, times_of, times_of_clock
from ecat.model import Clock, Segment
from tests.formats.interchange.layers import RECORDED_NS, base_session

HOUR_NS = 3600 * 10**9
NS = st.integers(0, 24 * HOUR_NS)


@st.composite
def clocks(draw: st.DrawFn) -> FrameTimes:
    """Images at least a millisecond apart, in each of the ways that sessions tell their times."""
    kind = draw(st.sampled_from(["recorded", "uniform", "nominal"]))
    if kind == "recorded":
        steps = draw(st.lists(st.integers(1_000_000, 10**9), min_size=1, max_size=40))
        first = draw(st.integers(0, 10**9))
        return FrameTimes(recorded=np.cumsum([first, *steps]).astype(np.int64))
    if kind == "uniform":
        n = draw(st.integers(2, 100_000))
        return FrameTimes(uniform=(n, draw(st.integers(1_000_001 * (n - 1), HOUR_NS + 1_000_001 * n))))
    return FrameTimes(nominal_hz=draw(st.floats(0.1, 999)))


@given(NS)
def test_seconds_tell_every_nanosecond_of_a_day(t_ns: int) -> None:
    assert times.from_seconds(times.to_seconds(t_ns)) == t_ns


@given(st.integers(-HOUR_NS, 10**17))
def test_decimal_seconds_tell_every_nanosecond(t_ns: int) -> None:
    assert times.from_decimal(times.to_decimal(t_ns)) == t_ns


@given(NS)
def test_milliseconds_are_the_nearest(t_ns: int) -> None:
    assert abs(times.from_ms(times.to_ms(t_ns)) - t_ns) <= times.HALF_MS_NS
    assert times.to_ms(times.from_ms(times.to_ms(t_ns))) == times.to_ms(t_ns)


@given(NS)
def test_timestamps_tell_the_millisecond(t_ns: int) -> None:
    text = times.to_timestamp(t_ns)
    assert times.from_timestamp(text) == times.from_ms(times.to_ms(t_ns))
    assert text[2] == text[5] == ":"


def test_a_timestamp_as_the_field_writes_it() -> None:
    assert times.to_timestamp(3_723_004_000_000) == "01:02:03.004"
    assert times.from_timestamp("00:00:00.14") == 140_000_000


@pytest.mark.parametrize("text", ["", "1", "00:00", "a:b:c", "00:00:-1", "1e3", "0x1", "9" * 40])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        times.from_timestamp(text)
    if text != "1":
        with pytest.raises(ValueError, match="expected"):
            times.from_decimal(text)


@given(st.integers(0, 10**6), st.integers(1, 10**6))
def test_counted_images_come_back(start: int, length: int) -> None:
    first, last = times.to_counted(start, start + length)
    assert (first, last) == (start + 1, start + length)
    assert times.from_counted(first, last) == (start, start + length)


@given(clocks(), st.integers(0, 200_000))
def test_a_frame_is_the_one_nearest_to_its_time(clock: FrameTimes, frame: int) -> None:
    assert clock.frame(clock.ns(frame)) == frame


@given(clocks(), st.integers(0, 200_000))
def test_a_frame_is_known_by_its_millisecond(clock: FrameTimes, frame: int) -> None:
    assume(clock.ns(frame + 1) - clock.ns(frame) > 1_000_000)
    assume(frame == 0 or clock.ns(frame) - clock.ns(frame - 1) > 1_000_000)
    assert clock.frame(times.from_ms(times.to_ms(clock.ns(frame)))) == frame


@given(clocks(), st.integers(0, 2 * HOUR_NS))
def test_no_other_frame_is_nearer_to_a_time(clock: FrameTimes, t_ns: int) -> None:
    frame = clock.frame(t_ns)
    distance = abs(clock.ns(frame) - t_ns)
    assert all(abs(clock.ns(other) - t_ns) >= distance for other in (frame - 1, frame + 1) if other >= 0)


@given(clocks(), st.integers(0, 50_000), st.integers(1, 5_000))
def test_a_stretch_comes_back_through_milliseconds(clock: FrameTimes, start: int, length: int) -> None:
    segment = clock.of_frames(start, start + length)
    start_ns, end_ns = (times.from_ms(times.to_ms(t)) for t in clock.edges_ns(segment))
    assume(
        all(clock.ns(f + 1) - clock.ns(f) > 1_000_000 for f in (start, start + length, start + length - 1))
    )
    assert clock.of_times(start_ns, end_ns, within_ns=times.HALF_MS_NS) == segment


def test_a_time_between_images_is_kept_beside_the_nearest_frame() -> None:
    clock = FrameTimes(uniform=(11, 1_000_000_000))
    made = clock.of_times(140_000_000, 760_000_000, within_ns=times.HALF_MS_NS)
    assert made == Segment(start_frame=1, end_frame=8, start_ns=140_000_000, end_ns=760_000_000)


def test_a_stretch_within_one_image_still_has_one() -> None:
    clock = FrameTimes(uniform=(11, 1_000_000_000))
    made = clock.of_times(110_000_000, 120_000_000)
    assert (made.start_frame, made.end_frame) == (1, 2)
    moment = clock.of_moment(100_000_000)
    assert (moment.start_frame, moment.end_frame) == (1, 2)


def test_nothing_is_before_the_first_image() -> None:
    clock = FrameTimes(uniform=(11, 1_000_000_000))
    assert clock.ns(-1) == 0
    assert clock.frame(-5) == 0
    assert clock.of_frames(-1, 0) == Segment(start_frame=0, end_frame=1, start_ns=0, end_ns=100_000_000)


def test_a_session_without_a_clock_tells_images_only(tmp_path: Path) -> None:
    clock = times_of(base_session(tmp_path, "unknown"))
    assert not clock.known
    assert clock.of_times(1_000_000_000, 2_000_000_000) == Segment(start_frame=30, end_frame=60)


def test_recorded_times_are_those_of_the_annotated_video(tmp_path: Path) -> None:
    clock = times_of(base_session(tmp_path, "recorded"))
    assert [clock.ns(frame) for frame in range(90)] == RECORDED_NS
    step = int(np.median(np.diff(RECORDED_NS)))
    assert clock.ns(91) == RECORDED_NS[-1] + 2 * step


def test_recorded_times_that_go_back_do_not(tmp_path: Path) -> None:
    clock = FrameTimes(recorded=np.maximum.accumulate(np.array([0, 50, 40, 90], np.int64)))
    assert [clock.ns(frame) for frame in range(4)] == [0, 50, 50, 90]


@given(st.integers(2, 10**6), st.floats(1, 1000))
def test_a_clock_made_of_a_rate_has_that_rate(n_frames: int, rate_hz: float) -> None:
    clock = times_of_clock(clock_of(n_frames, rate_hz), n_frames)
    assert clock.known
    assert clock.rate_hz == pytest.approx(rate_hz, rel=1e-6)


def test_of_one_image_no_clock_is_made() -> None:
    assert clock_of(1, 30.0) == Clock(rule="unknown")
