"""Skeletons as the Kinect recorder wrote them, and their video frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError, UsageError
from ecat.formats.ecat2018.body_scheme import KINECT_V2, BodyScheme, Joint
from ecat.formats.ecat2018.rig import (
    BATCH_RECORDS,
    RIG_SCHEMA,
    frames_as_ecat,
    frames_renumbered,
    iter_rig,
    read_rig,
    records_shown_by_ecat,
    write_rig,
)

TWO = BodyScheme((Joint("Neck"), Joint("Head")), ((0, 1),))


def record(
    *, body: str = "3", frame: str = "7", points: str = "1,2,3,4,5,6", extra: str = "", time: str = ""
) -> str:
    return (
        f'<Body_Data><Subject id="{body}"/><Timestamp {time} frame="{frame}"/>'
        f"<Skeleton_Joint_Locations_Orig><Pts>{points}</Pts></Skeleton_Joint_Locations_Orig>{extra}</Body_Data>\n"
    )


def rig(*records: str) -> bytes:
    return f"<BodyDataSequence>\n{''.join(records)}</BodyDataSequence>".encode()


def column(table: pa.Table, name: str) -> list[Any]:
    return table[name].to_pylist()


class TestReading:
    def test_joints_come_in_the_axes_of_the_physical_camera(self) -> None:
        """Trap: Kinect camera space has x to the right of the mirrored image and y up."""
        table = read_rig(rig(record()), TWO).joints
        assert table.schema == RIG_SCHEMA
        assert column(table, "joint") == ["Neck", "Head"]
        assert [column(table, axis) for axis in "xyz"] == [[-1, -4], [-2, -5], [3, 6]]

    def test_confidence_half_means_not_tracked_and_zero_means_inferred(self) -> None:
        """Trap: the two look exchanged in the file."""
        extra = "<Skeleton_Joint_Confidences><Vals>{}</Vals></Skeleton_Joint_Confidences>"
        records = [record(extra=extra.format(pair)) for pair in ("1,0", "0.5,0.7")]
        table = read_rig(rig(*records), TWO).joints
        assert column(table, "state") == ["tracked", "inferred", "not_tracked", None]
        assert column(table, "confidence") == [1, 0, 0.5, 0.7]

    def test_infinite_pixels_are_null_and_depth_joints_are_pixels(self) -> None:
        """Trap: projected points may be infinite, and the depth joints' unit is labelled m."""
        extra = (
            "<Skeleton_ImgPlane_Joint_Locations><Pts>1,2,-∞,∞</Pts></Skeleton_ImgPlane_Joint_Locations>"
            '<Skeleton_Depth_Joint_Locations><Pts unit="m">100,200,300,400</Pts>'
            "</Skeleton_Depth_Joint_Locations>"
        )
        table = read_rig(rig(record(extra=extra)), TWO).joints
        assert [column(table, name) for name in ("u_px", "v_px")] == [[1, None], [2, None]]
        assert [column(table, name) for name in ("depth_u_px", "depth_v_px")] == [[100, 300], [200, 400]]

    def test_times_are_since_the_first_colour_frame_and_the_wall_clock_is_local(self) -> None:
        """Trap: the wall clock ends in Z but is local time."""
        time = 'time="2017-10-04T22:35:30.583746Z" timeFromBegin="1500"'
        table = read_rig(rig(record(time=time), record()), TWO).joints
        assert column(table, "t_ns")[::2] == [1_500_000_000, None]
        assert column(table, "recorded_at")[::2] == [datetime(2017, 10, 4, 22, 35, 30, 583746), None]  # noqa: DTZ001

    def test_bodies_share_the_counter_of_a_colour_frame(self) -> None:
        """Trap: the counter is incremented elsewhere, so several records may share a number."""
        table = read_rig(rig(record(body="2"), record(body="3"), record(body="3")), TWO).joints
        assert column(table, "record") == [0, 0, 1, 1, 2, 2]
        assert column(table, "body") == [2, 2, 3, 3, 3, 3]
        assert set(column(table, "counter")) == {7}

    def test_elements_of_the_older_recorder_are_passed_over(self) -> None:
        extra = "<Skeleton_Joint_Locations><Pts ref='a'>9</Pts></Skeleton_Joint_Locations>"
        assert read_rig(rig(record(extra=extra)), TWO).joints.num_rows == 2

    def test_the_scheme_says_where_things_are(self) -> None:
        scheme = replace(
            TWO, sequence_root="r", frame_root="f", points_3d_path="@p", counter_path="@n", body_path="b"
        )
        table = read_rig(b'<r><f p="1,2,3,4,5,6" n="4"><b>1</b></f></r>', scheme).joints
        assert column(table, "counter") == [4, 4]

    def test_an_empty_recording_has_no_rows(self) -> None:
        assert read_rig(rig()).joints.num_rows == 0

    @pytest.mark.parametrize(
        ("bad", "told"),
        [
            (record(points="1,2,3"), "expected 6 numbers, found 3"),
            (record(points="1,2,3,4,5,x"), "'x' is not a number"),
            (record(frame="one"), "'one' is not an integer"),
            (record(body="500"), "not an integer from 0 to 127"),
            ("<Body_Data><Subject id='1'/></Body_Data>", "Timestamp/@frame is missing"),
        ],
    )
    def test_a_wrong_record_is_refused_with_its_line(self, bad: str, told: str) -> None:
        with pytest.raises(FormatError, match="line 3, <Body_Data>") as error:
            read_rig(rig(record(), bad), TWO)
        assert told in error.value.where

    def test_another_document_is_refused(self) -> None:
        with pytest.raises(FormatError, match="expected the root <BodyDataSequence>"):
            read_rig(b"<session/>")


class TestDamage:
    """Trap: a crashed recording leaves an unfinished rig file."""

    @pytest.mark.parametrize("count", [1, 5, BATCH_RECORDS, BATCH_RECORDS + 3])
    def test_the_complete_records_of_a_truncated_file_are_kept_and_the_loss_is_told(self, count: int) -> None:
        whole = rig(*[record(frame=str(i)) for i in range(count + 1)])
        cut = whole[: whole.rindex(b"<Skeleton_Joint")]
        found = read_rig(cut, TWO)
        assert found.joints.num_rows == 2 * count
        assert len(found.findings) == 1
        assert (
            f"{count} records before it were kept: line {count + 2}: the file ends too early"
            in found.findings[0]
        )

    def test_streaming_yields_them_too_and_then_raises(self) -> None:
        stream = iter_rig(rig(record(), record())[:-60], TWO)
        assert next(stream).num_rows == 2
        with pytest.raises(FormatError, match="ends too early"):
            next(stream)

    def test_streaming_a_whole_file_gives_batches(self) -> None:
        batches = list(iter_rig(rig(*[record()] * (BATCH_RECORDS + 1)), TWO))
        assert [batch.num_rows for batch in batches] == [2 * BATCH_RECORDS, 2]
        assert pa.Table.from_batches(batches)["record"][-1].as_py() == BATCH_RECORDS


single = st.floats(-1e4, 1e4, width=32).map(lambda value: float("%.7g" % value) + 0.0)  # noqa: UP031


@st.composite
def tables(draw: st.DrawFn, scheme: BodyScheme = TWO) -> pa.Table:
    n, joints = draw(st.integers(0, 4)), len(scheme.joints)

    def each(values: Sequence[object]) -> list[object]:
        return [value for value in values for _ in range(joints)]

    def numbers() -> list[float | None]:
        return draw(st.lists(st.none() | single, min_size=n * joints, max_size=n * joints))

    times = st.none() | st.integers(0, 10**6).map(lambda ms: ms * 10**6)
    clocks = st.none() | st.datetimes(datetime(1990, 1, 1), datetime(2050, 1, 1))  # noqa: DTZ001
    states = {1.0: "tracked", 0.0: "inferred", 0.5: "not_tracked"}
    confidence = draw(st.lists(st.sampled_from([0.0, 0.5, 1.0]), min_size=n * joints, max_size=n * joints))
    columns: dict[str, Any] = {
        "record": each(range(n)),
        "t_ns": each(draw(st.lists(times, min_size=n, max_size=n))),
        "recorded_at": each(draw(st.lists(clocks, min_size=n, max_size=n))),
        "counter": each(draw(st.lists(st.integers(0, 10**6), min_size=n, max_size=n))),
        "body": each(draw(st.lists(st.integers(0, 5), min_size=n, max_size=n))),
        "joint": [joint.name for joint in scheme.joints] * n,
        **{name: list(numbers()) for name in ("x", "y", "z", "u_px", "v_px", "depth_u_px", "depth_v_px")},
        "confidence": list(confidence),
        "state": [states[value] for value in confidence],
    }
    return pa.table(columns, schema=RIG_SCHEMA)


class TestWriting:
    @given(tables())
    def test_reading_a_written_rig_gives_it_back(self, table: pa.Table) -> None:
        assert read_rig(b"".join(write_rig(table, TWO)), TWO).joints.to_pylist() == table.to_pylist()

    def test_a_record_is_written_as_the_recorder_did(self) -> None:
        time = 'time="2017-10-04T22:35:30.583746Z" timeFromBegin="33"'
        lines = b"".join(write_rig(read_rig(rig(record(time=time)), TWO).joints, TWO)).decode().split("\r\n")
        assert lines[:6] == [
            '\ufeff<?xml version="1.0" encoding="utf-8"?>',
            "<BodyDataSequence>",
            "  <Body_Data>",
            '    <Subject id="3" />',
            '    <Timestamp time="2017-10-04T22:35:30.583746Z" timeFromBegin="33" frame="7" />',
            "    <Skeleton_Joint_Locations_Orig>",
        ]
        assert lines[6] == '      <Pts unit="m">1,2,3,4,5,6</Pts>'

    def test_joints_of_another_scheme_are_not_written(self) -> None:
        table = read_rig(rig(record()), TWO).joints
        with pytest.raises(UsageError):
            list(write_rig(table, KINECT_V2))

    def test_a_full_skeleton_goes_through_a_file(self, tmp_path: Path) -> None:
        n = 300
        rows = n * len(KINECT_V2.joints)
        numbers = np.random.default_rng(0).normal(size=(8, rows)).astype(np.float32).astype(float).round(4)
        columns: list[Any] = [
            np.repeat(np.arange(n), 25),
            np.repeat(np.arange(n) * 33_000_000, 25),
            pa.nulls(rows),
            np.repeat(np.arange(n), 25),
            np.full(rows, 3),
            [joint.name for joint in KINECT_V2.joints] * n,
            *numbers,
            pa.nulls(rows),
        ]
        table = pa.table(columns, names=RIG_SCHEMA.names).cast(RIG_SCHEMA)
        path = tmp_path / "rig.xml"
        path.write_bytes(b"".join(write_rig(table)))
        found = read_rig(path)
        assert found.findings == ()
        assert found.joints.num_rows == rows
        assert pc.sum(pc.abs(pc.subtract(found.joints["z"], table["z"]))).as_py() < 1e-6


class TestAlignment:
    def test_ecat_counts_from_one_and_truncates(self) -> None:
        """Trap: ECAT showed skeletons a frame after the marks that belong to them."""
        start = np.datetime64("2017-10-04T22:35:30.583746")
        after_us = np.array([0, 33_354, 33_999, 34_000, 1_000_000, -500, -40_000], "m8[us]")
        found = frames_as_ecat(start + after_us, start, duration_ms=88_357, length=2649)
        assert found.tolist() == [1, 1, 1, 2, 30, 1, 0]

    def test_ecat_s_other_rule_renumbers_the_counters(self) -> None:
        assert frames_renumbered(np.array([9, 4, 4, 12], np.int32)).tolist() == [2, 1, 1, 3]

    def test_of_records_that_share_a_counter_ecat_kept_the_first_time_and_the_last_joints(self) -> None:
        """Trap: time and joints of what ECAT showed may come from different records."""
        frame = np.array([1, 2, 2, 3], np.int32)
        counter = np.array([5, 5, 6, 7], np.int32)
        shown = records_shown_by_ecat(frame, counter, np.array([3, 3, 3, 3], np.int8))
        assert shown == {(1, 3): (0, 1), (2, 3): (2, 2), (3, 3): (3, 3)}

    def test_of_counters_on_one_frame_the_one_seen_first_last_wins(self) -> None:
        frame = np.array([1, 1, 1], np.int32)
        counter = np.array([5, 6, 5], np.int32)
        shown = records_shown_by_ecat(frame, counter, np.array([3, 3, 3], np.int8))
        assert shown == {(1, 3): (1, 1)}
