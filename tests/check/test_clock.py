"""What is found wrong with clocks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from ecat.check import examine
from ecat.model import Clock

if TYPE_CHECKING:
    from conftest import Case

SECOND = 1_000_000_000


def codes(case: Case) -> list[str]:
    return [finding.code for finding in examine(case.patient)]


def test_a_healthy_recording_has_no_findings(case: Case) -> None:
    assert examine(case.patient) == []


def test_a_recorded_clock_without_times_is_an_error(case: Case) -> None:
    case.tables.pop("frames")
    assert codes(case) == ["clock-missing"]


@pytest.mark.parametrize("duration_s", [0.0, 119.5, 0.4])
def test_a_uniform_clock_with_a_frame_rate_that_no_camera_has_is_found(case: Case, duration_s: float) -> None:
    case.tables.clear()
    clock = Clock(rule="uniform", duration_ns=int(duration_s * SECOND))
    case.manifest = replace(case.manifest, clock=clock)
    assert codes(case) == ["clock-unknown", "clock-rate"]


@pytest.mark.parametrize("duration_s", [118.0, 4.0, 0.5])
def test_frame_rates_from_1_to_240_are_fine(case: Case, duration_s: float) -> None:
    case.tables.clear()
    case.manifest = replace(case.manifest, clock=Clock(rule="uniform", duration_ns=int(duration_s * SECOND)))
    assert codes(case) == ["clock-unknown"]


@pytest.mark.parametrize(
    ("clock", "what"),
    [
        (Clock(), "the times of frames are unknown"),
        (
            Clock(rule="uniform", duration_ns=4 * SECOND),
            "times follow from the number of frames and the duration, as there is no table frames",
        ),
    ],
)
def test_without_recorded_times_it_is_said_what_was_not_looked_for(
    case: Case, clock: Clock, what: str
) -> None:
    case.tables.clear()
    case.manifest = replace(case.manifest, clock=clock)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("note", "clock-unknown")
    assert finding.message == f"{what}: gaps, drift and repeated frames were not looked for"


def test_streams_whose_time_stands_still_are_no_reason_to_fail(case: Case) -> None:
    def stop(columns: dict[str, Any]) -> None:
        columns["t_ns"] = [
            0 if stream == "color" else t
            for t, stream in zip(columns["t_ns"], columns["stream"], strict=True)
        ]

    case.change("frames", stop)
    assert "clock-drift" not in codes(case)
    (found,) = [finding for finding in examine(case.patient) if finding.code == "time-still"]
    assert found.place == "table frames, stream color"
    assert found.message == "119 of 120 frames have the time of the one before"


@pytest.mark.parametrize("edge", [2**63 - 1, -(2**63)])
def test_times_at_the_end_of_their_range_do_not_overflow(case: Case, edge: int) -> None:
    def far(columns: dict[str, Any]) -> None:
        columns["t_ns"][-1], columns["frame"][-1] = edge, 2**31 - 1
        columns["t_ns"][0], columns["frame"][0] = 0, -(2**31)

    case.change("frames", far)
    assert codes(case)


def test_negative_durations_are_an_error(case: Case) -> None:
    case.manifest = replace(case.manifest, clock=Clock(rule="recorded", duration_ns=-1))
    assert codes(case) == ["clock-rate"]


def test_missing_frames_are_counted_with_the_place_of_the_gap(case: Case) -> None:
    streams = tuple(replace(s, n_frames=None) for s in case.manifest.streams)
    case.manifest = replace(case.manifest, streams=streams)
    case.keep("frames", lambda row: row["stream"] == "depth" or not 50 <= row["frame"] < 53)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.place) == ("frame-gap", "table frames, stream color")
    assert finding.message == "3 of 120 frames are missing, at most 3 in a row, after frame 49"


def test_a_stream_at_half_the_rate_of_the_video_has_no_gaps(case: Case) -> None:
    depth = replace(case.manifest.streams[1], n_frames=60)
    case.manifest = replace(case.manifest, streams=(case.manifest.streams[0], depth))
    case.keep("frames", lambda row: row["stream"] == "color" or row["frame"] % 2 == 0)
    assert codes(case) == []


def test_a_frame_that_occurs_twice_is_an_error(case: Case) -> None:
    def repeat_frame_70(columns: dict[str, Any]) -> None:
        columns["frame"][142] = 70

    case.change("frames", repeat_frame_70)
    assert codes(case) == ["frame-duplicate", "frame-gap"]


def test_time_that_runs_backwards_is_an_error(case: Case) -> None:
    def swap(columns: dict[str, Any]) -> None:
        columns["frame"][100], columns["frame"][102] = columns["frame"][102], columns["frame"][100]

    case.change("frames", swap)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.severity) == ("clock-backwards", "error")


def test_a_pause_without_a_gap_in_the_numbers_is_found(case: Case) -> None:
    def pause(columns: dict[str, Any]) -> None:
        columns["t_ns"] = [
            t + SECOND * (frame > 60) for t, frame in zip(columns["t_ns"], columns["frame"], strict=True)
        ]

    case.change("frames", pause)
    assert codes(case) == ["time-gap", "time-gap"]  # in both streams


def test_a_camera_that_halves_its_rate_in_the_dark_is_fine(case: Case) -> None:
    def dark(columns: dict[str, Any]) -> None:
        slow = [max(0, frame - 90) * 33_333_333 for frame in columns["frame"]]
        columns["t_ns"] = [t + extra for t, extra in zip(columns["t_ns"], slow, strict=True)]

    case.change("frames", dark)
    assert codes(case) == []


def test_streams_that_drift_apart_by_a_frame_are_found(case: Case) -> None:
    def drift(columns: dict[str, Any]) -> None:
        rows = zip(columns["t_ns"], columns["frame"], columns["stream"], strict=True)
        late = sorted((t + t // 100 * (stream == "depth"), frame, stream) for t, frame, stream in rows)
        columns["t_ns"], columns["frame"], columns["stream"] = map(list, zip(*late, strict=True))

    case.change("frames", drift)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.place) == ("clock-drift", "table frames, stream depth")
    assert (
        finding.message == "against color it moves from +0.006 s to +0.042 s over the recording, 1.1 frames"
    )


@pytest.mark.parametrize(
    ("shift_s", "message"),
    [
        (1000, "it begins 996.037 s after the end of color: they never run together"),
        (-1000, "it ends 996.029 s before the start of color: they never run together"),
    ],
)
def test_streams_that_never_run_together_are_found(case: Case, shift_s: int, message: str) -> None:
    def apart(columns: dict[str, Any]) -> None:
        rows = zip(columns["t_ns"], columns["frame"], columns["stream"], strict=True)
        moved = sorted(
            (t + shift_s * SECOND * (stream == "depth"), frame, stream) for t, frame, stream in rows
        )
        columns["t_ns"], columns["frame"], columns["stream"] = map(list, zip(*moved, strict=True))

    case.change("frames", apart)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("warning", "clock-apart")
    assert (finding.place, finding.message) == ("table frames, stream depth", message)


def test_streams_with_another_number_of_frames_than_declared_are_found(case: Case) -> None:
    color = replace(case.manifest.streams[0], n_frames=121)
    case.manifest = replace(case.manifest, streams=(color, case.manifest.streams[1]))
    assert codes(case) == ["frame-count"]


def test_times_of_a_stream_that_the_session_does_not_have_are_an_error(case: Case) -> None:
    case.manifest = replace(case.manifest, streams=case.manifest.streams[:1])
    assert codes(case) == ["dangling-stream"]


def test_images_that_an_even_stream_did_not_record_are_found(case: Case) -> None:
    def drop(columns: dict[str, Any]) -> None:
        rows = list(zip(columns["t_ns"], columns["frame"], columns["stream"], strict=True))
        kept = [row for row in rows if row[2] != "depth" or row[1] not in {20, 50}]
        number = iter(range(len(kept)))
        depth = {row: next(number) for row in kept if row[2] == "depth"}
        rows = [(t, depth.get((t, f, s), f), s) for t, f, s in kept]
        columns["t_ns"], columns["frame"], columns["stream"] = map(list, zip(*rows, strict=True))

    case.change("frames", drop)
    (found,) = (finding for finding in examine(case.patient) if finding.code == "frame-drop")
    assert found.message.startswith("about 2 images were not recorded")
    assert found.place == "table frames, stream depth"


def test_a_stream_that_begins_late_is_told(case: Case) -> None:
    def late(columns: dict[str, Any]) -> None:
        rows = zip(columns["t_ns"], columns["frame"], columns["stream"], strict=True)
        moved = sorted((t + 1_000_000_000 * (s == "depth"), f, s) for t, f, s in rows)
        columns["t_ns"], columns["frame"], columns["stream"] = map(list, zip(*moved, strict=True))

    case.change("frames", late)
    (found,) = (finding for finding in examine(case.patient) if finding.code == "clock-offset")
    assert (found.severity, found.message.startswith("it begins 1.0")) == ("note", True)
