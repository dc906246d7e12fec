"""Slices of tables, for Arrow and pandas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ecat.errors import UsageError
from ecat.model import AnnotatedObject, Clock, Event, Layer, Relation, Segment
from ecat.model.annotation import Argument
from ecat.store import Draft, Session, TableData, create_session
from ecat.tables import TABLES
from tests.store.sessions import MANIFEST, make, rows


@pytest.fixture(scope="module")
def ten_seconds(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """300 poses in 10 s, and events of a second each with gaps of a second between."""
    segments = [
        Segment(start_frame=60 * i, end_frame=60 * i + 30, start_ns=2 * i * 10**9, end_ns=(2 * i + 1) * 10**9)
        for i in range(5)
    ]
    events = tuple(Event(id=f"e{i}", segments=(segment,)) for i, segment in enumerate(segments))
    made = Draft(
        manifest=MANIFEST,
        layers=(Layer(events=events),),
        tables={"poses": TableData(data=rows("poses", 300))},
    )
    return create_session(tmp_path_factory.mktemp("views") / "session", made)


bound = st.none() | st.floats(-2, 12).map(lambda seconds: round(seconds, 2))


@given(start=bound, end=bound)
@settings(deadline=None)
def test_a_slice_in_time_is_half_open(ten_seconds: Session, start: float | None, end: float | None) -> None:
    assume(start is None or end is None or start <= end)
    first = -(10**12) if start is None else round(start * 1e9)
    last = 10**12 if end is None else round(end * 1e9)
    times = [round(i * 1_000_000_000 // 30) for i in range(300)]
    wanted = [t for t in times if first <= t < last]
    view = ten_seconds.table("poses", start=start, end=end)
    assert view.to_arrow()["t_ns"].to_pylist() == wanted
    assert view.num_rows == len(wanted)


@pytest.mark.parametrize("bounds", [{"start": 2.0, "end": 1.0}, {"start_frame": 2, "end_frame": 1}])
def test_a_slice_that_ends_before_it_starts_is_refused(ten_seconds: Session, bounds: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="the end is before the start"):
        ten_seconds.table("poses", **bounds)


def test_a_slice_in_frames_is_half_open(ten_seconds: Session) -> None:
    view = ten_seconds.table("poses", start_frame=10, end_frame=12)
    assert view.to_arrow()["frame"].to_pylist() == [10, 11]
    assert ten_seconds.table("poses", start_frame=10, end_frame=10).num_rows == 0
    assert ten_seconds.table("poses", start_frame=-(2**70), end_frame=2**70).num_rows == 300


def test_time_and_frames_together_are_the_rows_in_both(ten_seconds: Session) -> None:
    view = ten_seconds.table("poses", start=1.0, end_frame=33)
    assert view.to_arrow()["frame"].to_pylist() == [30, 31, 32]


@pytest.mark.parametrize(
    ("start", "end", "found"),
    [
        (0.0, 1.0, ["e0"]),
        (1.0, 2.0, []),
        (0.999, 2.001, ["e0", "e1"]),
        (2.5, 2.6, ["e1"]),
        (None, 2.0, ["e0"]),
        (7.0, None, ["e4"]),
    ],
)
def test_rows_with_intervals_are_those_that_overlap(
    ten_seconds: Session, start: float | None, end: float | None, found: list[str]
) -> None:
    assert ten_seconds.table("events", start=start, end=end).to_arrow()["event_id"].to_pylist() == found


def test_what_holds_to_the_end_is_in_every_later_slice(tmp_path: Path) -> None:
    fact = Relation(predicate="ON", start_frame=30, arguments=(Argument(target="o1"),), source="marked")
    over = replace(fact, predicate="NEAR", end_frame=60)
    session = create_session(
        tmp_path / "session",
        Draft(
            manifest=MANIFEST, layers=(Layer(objects=(AnnotatedObject(id="o1"),), relations=(fact, over)),)
        ),
    )
    assert session.table("relations", start=50.0).to_arrow()["predicate"].to_pylist() == ["ON"]
    assert session.table("relations", start_frame=2000, end_frame=2001).num_rows == 1
    assert session.table("relations", end_frame=30).num_rows == 0


def test_columns_come_in_the_order_asked_for(ten_seconds: Session) -> None:
    view = ten_seconds.table("poses", start=1.0, end=1.1, columns=["z", "frame"])
    assert view.to_arrow().column_names == ["z", "frame"]
    assert view.schema.names == ["z", "frame"]
    assert view.to_pandas().columns.tolist() == ["z", "frame"]


def test_rows_without_any_column_are_still_counted(ten_seconds: Session) -> None:
    assert ten_seconds.table("poses", columns=[]).to_arrow().num_rows == 300
    assert ten_seconds.table("poses", end_frame=20, columns=[]).to_arrow().num_rows == 20


def test_rows_are_counted_without_reading(tmp_path: Path) -> None:
    session = make(tmp_path / "session", n=30)
    (session.path / "tables/poses.parquet").unlink()
    assert session.poses.num_rows == 30
    assert session.poses.schema == TABLES["poses"].arrow


@pytest.mark.parametrize("bounds", [{"start": float("nan")}, {"end": float("inf")}])
def test_a_bound_is_a_number(ten_seconds: Session, bounds: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="cannot slice at"):
        ten_seconds.table("poses", **bounds)  # pyright: ignore[reportArgumentType]


def test_a_table_without_time_is_not_sliced(ten_seconds: Session) -> None:
    with pytest.raises(UsageError, match="cannot slice table objects"):
        ten_seconds.table("objects", start=0.0)
    with pytest.raises(UsageError, match="cannot read nonsense of table poses"):
        ten_seconds.table("poses", columns=["nonsense"])


def test_a_session_without_a_clock_is_sliced_by_frame(tmp_path: Path) -> None:
    made = Draft(
        manifest=replace(MANIFEST, clock=Clock()), tables={"poses": TableData(data=rows("poses", 30))}
    )
    session = create_session(tmp_path / "session", made)
    with pytest.raises(UsageError, match="no clock"):
        session.table("poses", start=0.0)
    assert session.table("poses", start_frame=29).num_rows == 1


def test_pandas_types_do_not_depend_on_the_rows(ten_seconds: Session) -> None:
    whole, nothing = ten_seconds.poses.to_pandas(), ten_seconds.table("poses", end=-1.0).to_pandas()
    assert whole.dtypes.map(str).equals(nothing.dtypes.map(str))
    assert whole["frame"].dtype == "int32"
    assert whole["t_ns"].dtype == pd.Int64Dtype()
    assert whole["n_faces"].dtype == pd.Int16Dtype()
    assert isinstance(whole["object_id"].dtype, pd.CategoricalDtype)
    assert whole["x"].dtype == "float64"


def test_a_missing_whole_number_is_na_and_large_ones_are_exact(tmp_path: Path) -> None:
    table = rows("poses", 2)
    times = pa.array([2**62 + 1, None], pa.int64())
    made = {"poses": TableData(data=table.set_column(0, table.schema.field(0), times))}
    frame = create_session(tmp_path / "session", Draft(manifest=MANIFEST, tables=made)).poses.to_pandas()
    assert frame["t_ns"][0] == 2**62 + 1
    assert frame["t_ns"][1] is pd.NA
