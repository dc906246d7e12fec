"""What is found wrong with annotations by themselves."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any

import pytest

from ecat.check import examine
from ecat.model import KeyFrame, Link, Role, Segment
from ecat.model.scheme import ECAT_2018_SCHEME

if TYPE_CHECKING:
    from conftest import Case


def codes(case: Case) -> list[str]:
    return [finding.code for finding in examine(case.patient)]


def segment(start: int, end: int, **times: int) -> tuple[Segment, ...]:
    return (Segment(start_frame=start, end_frame=end, **times),)


def test_a_reversed_interval_is_an_error(case: Case) -> None:
    case.change_event(1, segments=segment(20, 10))
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code, finding.place) == (
        "error",
        "interval-reversed",
        "layer main, event a2",
    )


def test_times_may_be_reversed_too(case: Case) -> None:
    case.change_event(1, segments=segment(10, 20, start_ns=5, end_ns=4))
    assert codes(case) == ["interval-reversed"]


def test_an_empty_interval_is_a_warning(case: Case) -> None:
    case.change_relation(2, end_frame=5)
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("warning", "interval-empty")


@pytest.mark.parametrize(("start", "end"), [(-2, 20), (10, 121), (120, 130)])
def test_an_event_outside_of_the_recording_is_found(case: Case, start: int, end: int) -> None:
    case.change_event(1, parent=None, segments=segment(start, end))
    (finding,) = examine(case.patient)
    assert finding.code == "outside-recording"
    assert finding.message == f"frames {start} to {end}, but the recording has 120 frames"


def test_an_event_that_ends_with_the_recording_is_fine(case: Case) -> None:
    case.change_event(1, segments=segment(100, 120))
    assert codes(case) == []


def test_a_relation_that_starts_after_the_recording_is_found(case: Case) -> None:
    case.change_relation(0, start_frame=120)
    assert codes(case) == ["outside-recording"]


def change_shapes(case: Case, *shapes: KeyFrame) -> None:
    table = replace(case.layer.objects[3], key_frames=shapes)
    case.layer = replace(case.layer, objects=(*case.layer.objects[:3], table))


def change_key_frames(case: Case, *frames: int) -> None:
    change_shapes(case, *(KeyFrame(frame=f, coordinates=(1.0,) * 4) for f in frames))


def test_a_key_frame_after_the_recording_is_found(case: Case) -> None:
    change_key_frames(case, -1, 119, 120, 500)
    (finding,) = examine(case.patient)
    assert finding.message == "key frames at frame 120, 500, but the recording has 120 frames"


@pytest.mark.parametrize("frames", [(5, 5), (9, 5)])
def test_key_frames_that_do_not_rise_are_an_error(case: Case, frames: tuple[int, int]) -> None:
    change_key_frames(case, *frames)
    assert codes(case) == ["key-frame-order"]


@pytest.mark.parametrize(
    ("numbers", "problem"),
    [
        ((1.0, 2.0, 3.0), "3 numbers, expected u, v, width, height"),
        ((nan, 2.0, 3.0, 4.0), "a coordinate that is no place"),
        ((1e308, 2.0, 3.0, 4.0), "a coordinate that is no place"),
    ],
)
def test_a_key_frame_that_is_no_shape_of_its_kind_is_found(
    case: Case, numbers: tuple[float, ...], problem: str
) -> None:
    change_shapes(case, KeyFrame(frame=3, coordinates=(1.0,) * 4), KeyFrame(frame=7, coordinates=numbers))
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code) == ("warning", "key-frame-value")
    assert finding.message == f"the rectangle at frame 7: {problem}"


def test_an_absence_has_no_shape_and_a_vertex_in_space_may_be_unknown(case: Case) -> None:
    change_shapes(case, KeyFrame(frame=3, present=False))
    table = replace(case.layer.objects[3], key_frames_3d=(KeyFrame(frame=3, coordinates=(nan, nan, nan)),))
    case.layer = replace(case.layer, objects=(*case.layer.objects[:3], table))
    assert codes(case) == []


def test_nothing_is_outside_of_a_recording_of_unknown_length(case: Case) -> None:
    case.manifest = replace(case.manifest, n_frames=0)
    case.change_event(1, parent=None, segments=segment(5000, 6000))
    assert codes(case) == []


@pytest.mark.parametrize(("start", "end"), [(50, 130), (-1, 20)])
def test_a_sub_event_that_exceeds_its_parent_is_found(case: Case, start: int, end: int) -> None:
    case.manifest = replace(case.manifest, n_frames=0)
    case.change_event(0, segments=segment(0, 120))
    case.change_event(1, segments=segment(start, end))
    (finding,) = examine(case.patient)
    assert finding.code == "sub-event-outside"
    assert finding.message == f"frames {start} to {end}, but its parent a1 has frames 0 to 120"


@pytest.mark.parametrize(
    ("event", "fields", "what"),
    [
        (1, {"tier": "gesture"}, "tier gesture is not in the coding scheme boxes"),
        (1, {"type": "hop"}, "type hop is not in the coding scheme boxes"),
        (1, {"links": (Link(type="BEFORE", target="a1"),)}, "link BEFORE is not in the coding scheme boxes"),
        (0, {"roles": ()}, "role theme is required for slide, and empty"),
        (
            0,
            {"roles": (Role(name="theme", target="o1"), Role(name="goal", target="o2"))},
            "role goal is not one of slide",
        ),
    ],
)
def test_events_that_the_coding_scheme_does_not_allow(
    case: Case, event: int, fields: dict[str, Any], what: str
) -> None:
    case.change_event(event, **fields)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.message) == ("off-scheme", what)


def test_relations_that_the_coding_scheme_does_not_allow(case: Case) -> None:
    case.change_relation(0, predicate="FLOATS")
    case.change_relation(2, arguments=())
    assert [finding.message for finding in examine(case.patient)] == [
        "predicate FLOATS is not in the coding scheme boxes",
        "it has 0 arguments, STAND takes 1",
    ]


def test_a_coding_scheme_that_is_not_known_is_not_held_against_anyone(case: Case) -> None:
    case.schemes.clear()
    case.change_event(1, type="hop", tier="gesture")
    assert codes(case) == []


def test_users_of_ecat_had_their_own_predicates(case: Case) -> None:
    case.layer = replace(case.layer, scheme="ecat-2018")
    case.schemes["ecat-2018"] = replace(ECAT_2018_SCHEME, tiers=())
    case.change_relation(0, predicate="FLOATS")
    assert codes(case) == []


def test_without_a_coding_scheme_anything_may_be_said(case: Case) -> None:
    case.layer = replace(case.layer, scheme="")
    case.change_event(1, type="hop", tier="gesture")
    assert codes(case) == []
