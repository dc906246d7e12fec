"""What is found wrong with marks and poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from ecat.check import examine

if TYPE_CHECKING:
    from conftest import Case


def codes(case: Case) -> list[str]:
    return [finding.code for finding in examine(case.patient)]


def test_a_mark_that_occurs_twice_is_an_error(case: Case) -> None:
    def repeat(columns: dict[str, Any]) -> None:
        for values in columns.values():
            values.insert(40, values[40])

    case.change("markers_2d", repeat)
    assert codes(case) == ["mark-duplicate"]


def test_marks_beyond_the_last_frame_are_an_error(case: Case) -> None:
    def late(columns: dict[str, Any]) -> None:
        columns["frame"][-1] = 120

    case.change("poses", late)
    (finding,) = examine(case.patient)
    assert finding.message == "rows at frame 120, but the recording has frames 0 to 119"


def _hole(columns: dict[str, Any], every: int) -> None:
    for row in range(0, len(columns["frame"]), every):
        for axis in "xyz":
            columns[f"{axis}1"][row] = None


def test_corners_without_depth_are_found_when_there_are_many(case: Case) -> None:
    case.change("markers_3d", lambda columns: _hole(columns, 2))
    (finding,) = examine(case.patient)
    assert (finding.code, finding.place) == ("depth-holes", "table markers_3d, box o1")
    assert finding.message == "120 of 480 corners (25%) have no depth"


def test_a_few_corners_without_depth_are_fine(case: Case) -> None:
    case.change("markers_3d", lambda columns: _hole(columns, 20))
    assert codes(case) == []


def test_one_frame_with_marks_in_the_image_only_is_a_note(case: Case) -> None:
    case.keep("markers_3d", lambda row: (row["frame"], row["object_id"]) != (33, "o2"))
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("note", "depth-missing")
    assert finding.message == "1 of 120 frames with marks in the image have none in space: frame 33"


def test_many_frames_with_marks_in_the_image_only_are_a_warning(case: Case) -> None:
    case.keep("markers_3d", lambda row: row["frame"] % 4 > 0 or row["object_id"] == "o1")
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("warning", "depth-missing")


def test_a_recording_without_marks_in_space_is_fine(case: Case) -> None:
    case.tables.pop("markers_3d")
    assert codes(case) == []


def test_a_box_that_is_mostly_unseen_is_found(case: Case) -> None:
    for name in ("markers_2d", "markers_3d"):
        case.keep(name, lambda row: row["object_id"] == "o2" or row["frame"] % 3 == 0)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.message) == ("marker-coverage", "seen in 40 of 120 frames (33%)")


def _slow(case: Case) -> None:
    """One frame per second, so that the recording lasts two minutes."""

    def stretch(columns: dict[str, Any]) -> None:
        columns["t_ns"] = [t * 30 for t in columns["t_ns"]]

    for name in case.tables:
        case.change(name, stretch)


def test_a_box_that_is_lost_for_more_than_ten_seconds_is_found(case: Case) -> None:
    _slow(case)
    for name in ("markers_2d", "markers_3d"):
        case.keep(name, lambda row: row["object_id"] == "o2" or not 20 < row["frame"] < 35)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.place) == ("marker-loss", "table markers_2d, box o1")
    assert finding.message == "unseen for 14 frames (14.0 s), after frame 20"


def test_a_box_that_is_declared_absent_is_not_lost(case: Case) -> None:
    _slow(case)
    for name in ("markers_2d", "markers_3d"):
        case.keep(name, lambda row: row["object_id"] == "o2" or not 21 < row["frame"] < 100)

        def absent(columns: dict[str, Any]) -> None:
            row = next(
                i for i, f in enumerate(columns["frame"]) if f == 21 and columns["object_id"][i] == "o1"
            )
            columns["present"][row] = False
            columns["order"][row] = columns["code"][row] = None

        case.change(name, absent)
    assert codes(case) == []


def test_a_marker_that_jumps_across_the_image_is_found(case: Case) -> None:
    def jump(columns: dict[str, Any]) -> None:
        for i in range(4):
            columns[f"u{i}_px"][60] += 500  # frame 30, o1

    case.change("markers_2d", jump)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.place) == ("mark-jump", "table markers_2d, box o1")
    assert finding.message == "a marker jumps by more than 4 of its sides into frame 30, 31"


def repeat(case: Case, first: int, length: int) -> None:
    """Let the marks of frames from ``first + length`` on be those of ``length`` frames before."""

    def copy(columns: dict[str, Any]) -> None:
        for name, cells in columns.items():
            if name[0] in "uv":
                cells[2 * (first + length) : 2 * (first + 2 * length)] = cells[
                    2 * first : 2 * (first + length)
                ]

    case.change("markers_2d", copy)


def test_frames_that_a_recorder_wrote_twice_are_found(case: Case) -> None:
    repeat(case, 20, 3)
    repeat(case, 70, 5)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("warning", "frame-repeat")
    assert (
        finding.message
        == "8 frames repeat earlier ones exactly while things move: stretches from frame 23, 75"
    )


def test_two_frames_that_look_like_those_before_may_be_chance(case: Case) -> None:
    repeat(case, 20, 2)
    assert codes(case) == []


def test_things_that_stand_still_look_the_same(case: Case) -> None:
    case.keep("markers_2d", lambda row: row["object_id"] == "o2")
    case.keep("markers_3d", lambda row: row["object_id"] == "o2")
    assert codes(case) == []


def test_a_box_that_moves_faster_than_hands_is_found(case: Case) -> None:
    def jump(columns: dict[str, Any]) -> None:
        columns["z"][61] += 0.5

    case.change("poses", jump)
    (finding,) = examine(case.patient)
    assert finding.place == "table poses, box o2"
    assert finding.message == "it moves up to 0.50 m in one frame (15 m/s), into frame 30, 31"


def test_a_box_that_reappears_elsewhere_after_a_gap_did_not_jump(case: Case) -> None:
    def carry(columns: dict[str, Any]) -> None:
        columns["x"] = [x + (frame > 60) for x, frame in zip(columns["x"], columns["frame"], strict=True)]

    case.change("poses", carry)
    case.keep("poses", lambda row: row["frame"] not in range(58, 62))
    assert codes(case) == []


def test_sessions_without_a_length_or_a_clock_are_examined_all_the_same(case: Case) -> None:
    case.tables.pop("frames")
    case.manifest = replace(case.manifest, n_frames=0, clock=replace(case.manifest.clock, rule="unknown"))
    assert codes(case) == []


@pytest.mark.parametrize("value", [1e308, -1e308, 1.1e6])
@pytest.mark.parametrize(
    ("name", "column"), [("markers_2d", "u2_px"), ("markers_3d", "z0"), ("poses", "x"), ("poses", "qw")]
)
def test_numbers_that_are_no_place_are_an_error_and_count_as_missing(
    case: Case, name: str, column: str, value: float
) -> None:
    def far(columns: dict[str, Any]) -> None:
        columns[column][40] = columns[column][42] = value

    case.change(name, far)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code, finding.place) == ("error", "mark-absurd", f"table {name}")
    assert finding.message == f"2 numbers are no places (beyond 1,000,000), in column {column}"


def test_numbers_that_are_all_absurd_do_no_harm(case: Case) -> None:
    for name in ("markers_2d", "markers_3d", "poses"):

        def fill(columns: dict[str, Any]) -> None:
            for column, values in columns.items():
                if isinstance(values[0], float):
                    values[:] = [1e308 if i % 2 else -1e308 for i in range(len(values))]
                elif column == "frame":
                    values[-1] = 2**31 - 1
                    values[0] = -(2**31)

        case.change(name, fill)
    assert {"mark-absurd", "mark-outside"} <= set(codes(case))
