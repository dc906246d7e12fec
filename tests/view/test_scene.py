"""Time, names and colours that the whole view shares."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import LimitError
from ecat.model import Clock, Manifest, Stream
from ecat.sample.scene import BOXES
from ecat.view.scene import Timebase, box_sizes, entity_part, rgba, rows_per_frame, texts, things, timebase
from tests.view.chunks import table


def manifest(clock: Clock, n_frames: int = 4) -> Manifest:
    streams = (Stream(name="depth", kind="depth"), Stream(name="color", kind="color"))
    return Manifest(name="s", created="2024-01-01T00:00:00", n_frames=n_frames, clock=clock, streams=streams)


def indexes(base: Timebase, frames: list[int]) -> dict[str, list[int]]:
    columns = base.indexes(np.array(frames))
    return {c.timeline_name(): np.asarray(c.as_arrow_array().cast(pa.int64())).tolist() for c in columns}


def test_a_uniform_clock_gives_every_frame_its_time_and_the_end_too() -> None:
    base = timebase(manifest(Clock(rule="uniform", duration_ns=300)), None)
    assert indexes(base, [0, 1, 3, 4]) == {"frame": [0, 1, 3, 4], "session_time": [0, 100, 300, 400]}


def test_without_a_clock_there_are_frames_only() -> None:
    assert indexes(timebase(manifest(Clock()), None), [2]) == {"frame": [2]}


@pytest.mark.parametrize("rule", ["uniform", "recorded", "unknown"])
def test_a_recording_that_no_viewer_can_hold_is_refused(
    rule: Literal["uniform", "recorded", "unknown"],
) -> None:
    clock = Clock(rule=rule, duration_ns=10**9)
    late = table("frames", t_ns=[0], frame=[2**31 - 2], stream=["color"])
    huge = 1 if rule == "recorded" else 2**31 - 1
    with pytest.raises(LimitError, match="at most 1,000,000 can be shown"):
        timebase(manifest(clock, huge), late)


def test_a_recorded_clock_is_that_of_the_colour_images_and_what_it_misses_is_interpolated() -> None:
    frames = table(
        "frames",
        t_ns=[0, 5, 10, 40, 45],
        frame=[0, 0, 1, 3, 1],
        stream=["color", "depth", "color", "color", "depth"],
    )
    base = timebase(manifest(Clock(rule="recorded")), frames)
    assert base.t_ns is not None
    assert base.t_ns.tolist() == [0, 10, 25, 40, 52]


def test_frames_before_the_first_image_and_after_the_last_are_put_on_the_timeline_ends() -> None:
    assert indexes(Timebase(4, np.arange(5) * 7), [-1, 9]) == {"frame": [0, 4], "session_time": [0, 28]}


def test_a_time_falls_on_the_image_on_show() -> None:
    assert Timebase(3, np.array([0, 10, 20, 30])).frames_at(np.array([-5, 0, 9, 10, 99])).tolist() == [
        0,
        0,
        0,
        1,
        3,
    ]


def test_blanks_become_underscores_and_the_rest_is_escaped() -> None:
    assert entity_part(" Stella  Artois ") == "Stella_Artois"
    assert entity_part("a/b") == r"a\/b"
    assert entity_part("") == "_"


def test_objects_of_one_name_get_paths_of_their_own() -> None:
    objects = table(
        "objects",
        layer=["a", "a", "b"],
        object_id=["o1", "o2", "o1"],
        name=["box", "box", "other"],
    )
    found = things(objects, {"o2": (0.1, 0.1, 0.1)})
    assert [(t.part, t.name, t.size_m) for t in found.values()] == [
        ("box", "box", None),
        ("box_o2", "box", (0.1, 0.1, 0.1)),
    ]
    assert found["o1"].color != found["o2"].color


def test_a_box_is_as_large_as_the_prototype_that_most_of_its_codes_belong_to() -> None:
    code, foreign = BOXES[0].faces[0].code, BOXES[1].faces[0].code
    marks = table("markers_2d", object_id=["o1"] * 3 + ["o2"], code=[code, code, foreign, None])
    one = manifest(Clock())
    prototypes: tuple[dict[str, object], ...] = (
        {**BOXES[0].to_dict(), "size_m": [0.1, 0.2, 0.3]},
        BOXES[1].to_dict(),
    )
    known = Manifest(name=one.name, created=one.created, prototypes=prototypes)
    assert box_sizes(marks, known) == {"o1": (0.1, 0.2, 0.3)}
    assert box_sizes(marks, one) == {}


def test_nulls_of_plain_and_dictionary_columns_are_empty() -> None:
    rows = table("poses", object_id=["a", "b"], source=[None, "observed"])
    assert texts(rows, "source").tolist() == ["", "observed"]
    assert texts(table("events", text=["x", None]), "text").tolist() == ["x", ""]
    assert texts(table("poses"), "source").tolist() == []


def test_a_colour_is_red_green_blue_and_opacity_from_the_left() -> None:
    assert rgba((1, 2, 3), 4) == 0x01020304


@given(st.lists(st.integers(0, 20), max_size=30).map(sorted), st.integers(21, 25))
def test_every_row_is_shown_at_its_frame_alone(rows: list[int], n_frames: int) -> None:
    frames, counts = rows_per_frame(np.array(rows, np.int64), n_frames)
    sent = dict(zip(frames.tolist(), counts.tolist(), strict=True))
    assert list(sent) == sorted(sent)
    assert sum(sent.values()) == len(rows)
    shown = 0
    for frame in range(n_frames):
        shown = sent.get(frame, shown)
        assert shown == rows.count(frame)
