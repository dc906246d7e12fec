"""The event exports that the recognisers were trained on."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.learning_export import (
    BOX_SCHEMA,
    EVENT_SCHEMA,
    JOINT_SCHEMA,
    JOINTS,
    LABELS,
    ExportedSession,
    read_learning_export,
    write_learning_export,
)

RIG = ",".join(map(str, range(1, 40)))
BOX = ",".join(map(str, range(1, 13)))
FRAME = f'<frame no="0"><o type="rig">{RIG}</o><o type="glyph">{BOX}</o><o type="glyph">{BOX}</o></frame>'
EVENT = '<event start="0" end="20">Subject,None,Theme,pulls,From</event>'


def project(*sessions: str) -> bytes:
    return f"<project>\n{''.join(sessions)}</project>".encode()


def session(frames: str = FRAME, events: str = EVENT, name: str = "s") -> str:
    return f'<session name="{name}"><data>{frames}</data><events>{events}</events></session>\n'


def only(data: bytes) -> ExportedSession:
    (found,) = read_learning_export(data)
    return found


class TestRealFiles:
    def test_they_come_back_byte_for_byte_and_agree_with_the_reference_counts(self, shared: Path) -> None:
        paths = sorted((shared / "actions_ch4" / "xml").glob("*.txt"))
        assert len(paths) == 15
        counts: dict[tuple[str, str], tuple[int, int]] = {}
        for path in paths:
            sessions = list(read_learning_export(path))
            data = path.read_bytes()
            newline = "\r\n" if b"\r\n" in data else "\n"
            assert b"".join(write_learning_export(sessions, newline=newline)) == data
            for found in sessions:
                assert found.findings == ()
                counts[path.stem, found.name] = (found.joints.num_rows // 13, found.events.num_rows)
        with (shared / "actions_ch4" / "sessions.csv").open() as file:
            expected = {
                (row["project"], row["session"]): (int(row["n_frames"]), int(row["n_events"]))
                for row in csv.DictReader(file)
            }
        assert counts == expected

    def test_events_and_labels_are_those_of_the_reference(self, shared: Path) -> None:
        reference = pq.read_table(shared / "actions_ch4" / "events.parquet").to_pylist()
        names = ("rig_role", "glyph1_role", "glyph2_role", "verb", "prep")
        for path in (shared / "actions_ch4" / "xml").glob("p*.txt"):
            for found in read_learning_export(path):
                expected = [
                    (row["start_attr"], row["end_attr"], *(row[name] for name in names))
                    for row in reference
                    if row["project"] == path.stem and row["session"] == found.name
                ]
                got = [
                    (row["first_frame"], row["last_frame"], *(row[label] or "None" for label in LABELS))
                    for row in found.events.to_pylist()
                ]
                assert got == expected

    def test_the_session_without_data_is_empty(self, shared: Path) -> None:
        """Trap: a session with more or less than one rig and two boxes was exported empty."""
        sessions = list(read_learning_export(shared / "actions_ch4" / "xml" / "pushpast.txt"))
        assert [found.name for found in sessions if found.empty] == ["pushpast22"]

    def test_corners_never_seen_are_null_not_the_camera_s_centre(self, shared: Path) -> None:
        """Trap: infinite corners without a finite neighbour were exported as 0,0,0."""
        sessions = list(read_learning_export(shared / "actions_ch4" / "xml" / "pushpast.txt"))
        boxes = pa.concat_tables([found.boxes for found in sessions])
        assert boxes["x"].null_count > 0
        x, z = boxes["x"].to_numpy(), boxes["z"].to_numpy()
        assert not ((x == 0) & (z == 0)).any()


class TestReading:
    def test_a_session_has_named_joints_and_two_quads_in_the_axes_of_the_camera(self) -> None:
        found = only(project(session()))
        assert (found.joints.schema, found.boxes.schema, found.events.schema) == (
            JOINT_SCHEMA,
            BOX_SCHEMA,
            EVENT_SCHEMA,
        )
        assert found.joints["joint"].to_pylist() == list(JOINTS)
        assert [found.joints[axis][0].as_py() for axis in "xyz"] == [-1, -2, 3]
        assert found.boxes["box"].to_pylist() == [1] * 4 + [2] * 4
        assert found.boxes["corner"].to_pylist() == [0, 1, 2, 3] * 2
        assert [found.boxes[axis][4].as_py() for axis in "xyz"] == [-1, -2, 3]

    def test_a_role_of_none_is_null(self) -> None:
        (event,) = only(project(session())).events.to_pylist()
        assert [event[label] for label in LABELS] == ["Subject", None, "Theme", "pulls", "From"]
        assert (event["first_frame"], event["last_frame"]) == (0, 20)

    def test_what_follows_an_event_left_open_is_read_where_it_belongs(self) -> None:
        """Trap: a malformed event left its element open, so the rest of the file is nested in it."""
        inner = '<event start="5" end="25">a,b,c,d,e</event>'
        nested = session(name="second")
        data = project(
            f'<session name="first"><data>{FRAME}</data><events>{EVENT}\n'
            f'<event start="1" end="2">{inner}{nested}</event></events></session>'
        )
        found = {s.name: s for s in read_learning_export(data)}
        assert set(found) == {"first", "second"}
        assert found["first"].events["first_frame"].to_pylist() == [0, 5]
        assert found["second"].joints.num_rows == 13
        assert found["first"].findings == ("line 3, <event>: the event was left open and is dropped",)
        assert found["second"].findings == ()

    def test_frames_out_of_number_and_reversed_events_are_told(self) -> None:
        frames = FRAME.replace('"0"', '"3"')
        found = only(project(session(frames, EVENT.replace('"20"', '"-1"'))))
        assert found.findings == (
            "session s: its frames are not numbered 0, 1, 2, ...",
            "session s: an event ends before it starts",
        )

    @pytest.mark.parametrize(
        ("broken", "told"),
        [
            (session(FRAME.replace('type="rig"', 'type="glyph"')), "found 0 rigs, 3 glyphs"),
            (session(FRAME.replace(f'<o type="rig">{RIG}</o>', "")), "found 0 rigs, 2 glyphs"),
            (session(FRAME.replace(f'<o type="glyph">{BOX}</o>', "", 1)), "found 1 rig, 1 glyph"),
            (session(FRAME.replace('type="rig"', 'type="dog"')), "found 0 rigs, 2 glyphs, 1 of another type"),
            (
                session(
                    FRAME.replace('"rig"', '"x"').replace('"glyph"', '"rig"', 1).replace('"x"', '"glyph"')
                ),
                "found 1 rig, 2 glyphs in another order",
            ),
            (session('<frame no="0"/>', name="pull3"), "of session pull3: expected one rig and two glyphs"),
            (session(FRAME.replace(f">{BOX}<", ">1,2,3<", 1)), "expected 12 numbers, found 3"),
            (session(events=EVENT.replace("None,", "")), "expected 5 labels"),
            (session(FRAME.replace('no="0"', "")), "attribute no is missing"),
            ("<session/>", "attribute name is missing"),
            (FRAME, "outside any session"),
        ],
    )
    def test_what_is_no_export_is_refused_with_its_line(self, broken: str, told: str) -> None:
        with pytest.raises(FormatError, match="line 2") as error:
            list(read_learning_export(project(broken)))
        assert told in error.value.where

    def test_sessions_before_a_fault_are_yielded(self) -> None:
        stream = read_learning_export(project(session(), session())[:-60])
        assert next(stream).name == "s"
        with pytest.raises(FormatError, match="ends too early"):
            next(stream)


numbers = st.floats(-9, 9, width=32).map(lambda value: float("%.7g" % value) or 1.0)  # noqa: UP031
labels = st.lists(st.none() | st.text("abcXYZ &<", min_size=1), min_size=5, max_size=5)


@st.composite
def sessions(draw: st.DrawFn) -> ExportedSession:
    n = draw(st.integers(0, 2))
    frame = np.arange(n)

    def points(count: int) -> list[list[float | None]]:
        values = draw(
            st.lists(st.none() | st.tuples(numbers, numbers, numbers), min_size=count, max_size=count)
        )
        return [[None if value is None else value[axis] for value in values] for axis in range(3)]

    joints: list[Any] = [np.repeat(frame, 13), list(JOINTS) * n, *points(13 * n)]
    ring = np.tile(np.arange(8), n)
    boxes: list[Any] = [np.repeat(frame, 8), ring // 4 + 1, ring % 4, *points(8 * n)]
    events = [
        {"first_frame": first, "last_frame": first + 20, **dict(zip(LABELS, row, strict=True))}
        for first, row in draw(st.lists(st.tuples(st.integers(0, 99), labels), max_size=2))
    ]
    return ExportedSession(
        draw(st.text("abc &<>\"'")),
        pa.table(joints, names=JOINT_SCHEMA.names).cast(JOINT_SCHEMA),
        pa.table(boxes, names=BOX_SCHEMA.names).cast(BOX_SCHEMA),
        pa.Table.from_pylist(events, schema=EVENT_SCHEMA),
    )


def as_data(found: ExportedSession) -> tuple[object, ...]:
    return (
        found.name,
        found.joints.to_pylist(),
        found.boxes.to_pylist(),
        found.events.to_pylist(),
        found.empty,
    )


@given(st.lists(sessions(), max_size=3))
def test_reading_a_written_export_gives_its_sessions_back(exported: list[ExportedSession]) -> None:
    again = list(read_learning_export(b"".join(write_learning_export(exported))))
    assert [as_data(found) for found in again] == [as_data(found) for found in exported]
