"""Faces of all objects become rows sorted by frame, object and order."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.ecat2018.mark_tables import mark_batches
from ecat.formats.ecat2018.marks import CodeBook, Faces
from ecat.model import Clock
from ecat.tables import MARKERS_2D, MARKERS_3D, ROW_GROUP_ROWS
from tests.formats.ecat2018.documents import CODE, POINTS
from tests.formats.ecat2018.test_marks import marker_run, run

CLOCK = Clock(rule="uniform", duration_ns=9_000_000_000)


def table(*groups: Faces, clock: Clock = CLOCK) -> pa.Table:
    return pa.Table.from_batches(list(mark_batches(groups, groups[0].book, clock, 10)))


def rows(found: pa.Table, *names: str) -> list[tuple[Any, ...]]:
    return list(zip(*(found[name].to_pylist() for name in names), strict=True))


def test_two_boxes_are_one_table() -> None:
    book = CodeBook()
    first, second = Faces(2, "", book, object_id="o2"), Faces(2, "", book, object_id="o3")
    first.add(marker_run((0, 2), (5, 1)))
    second.add(marker_run((0, 1), (3, 0)))
    second.absent.add(1)
    found = table(first, second)
    assert found.schema == MARKERS_2D.arrow
    assert rows(found, "frame", "t_ns", "object_id", "order", "present") == [
        (0, 0, "o2", 0, True),
        (0, 0, "o2", 1, True),
        (0, 0, "o3", 0, True),
        (3, 3_000_000_000, "o3", None, False),
        (5, 5_000_000_000, "o2", 0, True),
    ]
    assert found["code"].to_pylist()[:4] == [CODE.replace(" ,", "").strip()] * 3 + [None]
    assert found["u0_px"].to_pylist() == [859, 859, 859, None, 859]


def test_missing_points_are_null() -> None:
    faces = Faces(3, "", CodeBook(), object_id="o2")
    faces.add(run([POINTS.replace("-0.1955648,-0.2209547,1.445", "-∞,-∞,-∞")]))
    found = table(faces)
    assert found.schema == MARKERS_3D.arrow
    assert rows(found, "x0", "y0", "z0", "x1") == [(None, None, None, 0.1970665)]


def test_without_a_clock_there_are_no_times() -> None:
    faces = Faces(2, "", CodeBook(), object_id="o2")
    faces.add(marker_run((0, 1)))
    assert table(faces, clock=Clock())["t_ns"].to_pylist() == [None]


def test_a_frame_whose_time_no_64_bits_hold_has_none() -> None:
    faces = Faces(2, "", CodeBook(), object_id="o2")
    faces.add(marker_run((2**31 - 1, 1)))
    long = Clock(rule="uniform", duration_ns=10**15)
    assert pa.Table.from_batches(list(mark_batches([faces], faces.book, long, 2)))["t_ns"].to_pylist() == [
        None
    ]


def test_texts_of_codes_and_corners_that_are_unusual_are_there() -> None:
    faces = Faces(2, "", CodeBook(), object_id="o2")
    faces.add(run(["1.0,2,3,4,5,6,7,8", "1,2,3,4,5,6,7,8"], [CODE.replace(" ", ""), CODE]))
    assert rows(table(faces), "corners_text", "code_text") == [
        ("1.0,2,3,4,5,6,7,8", CODE.replace(" ", "")),
        (None, None),
    ]


@pytest.mark.parametrize("n", [ROW_GROUP_ROWS, ROW_GROUP_ROWS + 1])
def test_rows_come_in_groups_of_bounded_size(n: int) -> None:
    faces = Faces(2, "", CodeBook(), object_id="o2")
    faces.add(marker_run(*((i, 0) for i in range(n))))
    batches = list(mark_batches([faces], faces.book, Clock(), 10))
    assert [batch.num_rows for batch in batches] == [ROW_GROUP_ROWS, n - ROW_GROUP_ROWS][: len(batches)]
    assert sum(batch.num_rows for batch in batches) == n


@given(
    st.lists(
        st.dictionaries(st.integers(0, 20), st.integers(0, 3), min_size=1, max_size=6), min_size=1, max_size=4
    )
)
def test_rows_are_sorted_and_none_is_lost(objects: list[dict[int, int]]) -> None:
    book = CodeBook()
    groups: list[Faces] = []
    for i, markers in enumerate(objects):
        faces = Faces(2, "", book, object_id=f"o{i}")
        faces.add(marker_run(*sorted(markers.items())))
        groups.append(faces)
    found = rows(table(*groups), "frame", "object_id", "order")
    assert [(f, o, -1 if k is None else k) for f, o, k in found] == sorted(
        (f, f"o{i}", k)
        for i, markers in enumerate(objects)
        for f, count in markers.items()
        for k in (range(count) if count else [-1])
    )
