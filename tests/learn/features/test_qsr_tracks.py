"""Qualitative tracks of a session's poses."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from ecat.errors import NotFoundError, UsageError
from ecat.sample import sample_session
from ecat.store import Session, TableData, create_session, open_session
from ecat.tables import POSES
from learn.features import qsr

N = 6
TURNED = (0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8))
"""By 45 degrees about z."""


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Session:
    draft = sample_session(seed=3, actions=("next",), name="slide")[0]
    return create_session(tmp_path_factory.mktemp("qsr") / "slide", draft)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Box a slides to the right past b, which is not seen in frame 3; c stands on b."""
    places = {
        "a": [(0.1 * k - 0.25, 0.0, 0.0) for k in range(N)],
        "b": [(0.0, 0.2, 0.0)] * N,
        "c": [(0.0, 0.2, 0.3)] * N,
    }
    rows = [
        dict.fromkeys(POSES.arrow.names)
        | {"frame": k, "object_id": name, "t_ns": k * 10**8}
        | dict(zip("xyz", places[name][k] if (name, k) != ("b", 3) else (None,) * 3, strict=True))
        | dict(zip(("qx", "qy", "qz", "qw"), TURNED if name == "c" else (0.0, 0.0, 0.0, 1.0), strict=True))
        for k in range(N)
        for name in places
    ]
    draft = sample_session(seed=3, actions=("next",), name="slide")[0]
    tables = {**draft.tables, "poses": TableData(data=pa.Table.from_pylist(rows, schema=POSES.arrow))}
    return create_session(tmp_path_factory.mktemp("qsr") / "slide", replace(draft, tables=tables))


def values(table: pa.Table) -> list[str | None]:
    return table["value"].to_pylist()


def test_a_track_has_a_row_per_frame(session: Session) -> None:
    track = qsr.qualitative_tracks(session, "cardir", of=[("a", "b")])
    assert track.schema.equals(qsr.QUALITATIVE_TRACKS.arrow, check_metadata=True)
    assert values(track) == ["sw", "sw", "s", None, "se", "se"]
    assert track["frame"].to_pylist() == list(range(N))
    assert {(row["track"], row["a"], row["b"], row["c"], row["relation"]) for row in track.to_pylist()} == {
        ("slide", "a", "b", None, "cardir")
    }


def test_by_default_all_objects_are_related(session: Session) -> None:
    pairs = qsr.qualitative_tracks(session, "argd", thresholds={"near": 0.25, "far": 1.0})
    assert len({(row["a"], row["b"]) for row in pairs.to_pylist()}) == 6
    assert pairs.num_rows == 6 * N
    moves = qsr.qualitative_tracks(session, "mos", threshold=0.01)
    assert moves.num_rows == 3 * (N - 1)
    assert moves["frame"].to_pylist()[: N - 1] == list(range(1, N))
    assert qsr.qualitative_tracks(session, "tpcc").num_rows == 6 * N


def test_distance_is_in_space(session: Session) -> None:
    above = qsr.qualitative_tracks(session, "argd", of=[("c", "b")], thresholds={"near": 0.25, "far": 1.0})
    assert values(above) == ["far", "far", "far", None, "far", "far"]


def test_states_form_chains(session: Session) -> None:
    chain = qsr.qualitative_tracks(
        session, "qtcbs", of=[("a", "c")], threshold=0.001, collapse=True, validate=True
    )
    assert values(chain) == ["-,0", "0,0", "+,0"]
    assert chain["position"].to_pylist() == [1, 2, 3]
    assert chain["frame"].null_count == 3


def test_sizes_are_those_of_the_rectangle_around_a_turned_box(session: Session) -> None:
    sizes = dict.fromkeys("abc", (0.1, 0.1, 0.1))
    assert values(qsr.qualitative_tracks(session, "rcc8", of=[("b", "c")], sizes_m=sizes))[0] == "ntpp"
    assert values(qsr.qualitative_tracks(session, "rcc8", of=[("b", "c")]))[0] == "eq"


def changed(session: Session, folder: Path, poses: pa.Table) -> Session:
    copy = Path(shutil.copytree(session.path, folder))
    with open_session(copy).write() as commit:
        commit.put_table("poses", TableData(data=poses))
    return open_session(copy)


def test_movement_is_not_known_across_frames_that_have_no_poses(session: Session, tmp_path: Path) -> None:
    poses = session.table("poses").to_arrow()
    sparse = changed(session, tmp_path / "s", poses.filter(pc.field("frame") != 2))
    track = qsr.qualitative_tracks(sparse, "mos", of=[("a",)], threshold=0.01)
    assert track["frame"].to_pylist() == [1, 3, 4, 5]
    assert values(track) == ["m", None, "m", "m"]


def test_poses_that_are_nowhere_or_turned_in_no_way_are_not_known(session: Session, tmp_path: Path) -> None:
    table = session.table("poses").to_arrow()
    for row, (column, value) in enumerate([("x", 1e30), ("qw", 0.0)]):
        values_ = table[column].to_pylist()
        values_[3 * row] = value  # of a, in the frames 0 and 1
        at = table.column_names.index(column)
        table = table.set_column(at, table.schema.field(at), pa.array(values_, table.schema.field(at).type))
    far = changed(session, tmp_path / "s", table)
    sizes = dict.fromkeys("abc", (0.1, 0.1, 0.1))
    track = qsr.qualitative_tracks(far, "rcc8", of=[("a", "c")], sizes_m=sizes)
    assert [value is None for value in values(track)] == [True, True] + [False] * (N - 2)


def test_a_track_that_is_asked_for_twice_is_there_once(session: Session) -> None:
    assert qsr.qualitative_tracks(session, "cardir", of=[("a", "b")] * 2).num_rows == N


@pytest.mark.parametrize(
    ("name", "ids", "said"),
    [
        ("cardir", ("a", "a"), "two objects, not the same"),
        ("mos", ("a", "b"), "one object"),
        ("cardir", (), "two"),
    ],
)
def test_a_relation_is_of_as_many_objects_as_it_has(
    session: Session, name: str, ids: tuple[str, ...], said: str
) -> None:
    with pytest.raises(UsageError, match=" and ".join(ids) or "nothing") as error:
        qsr.qualitative_tracks(session, name, of=[ids])
    assert said in error.value.where
    assert "[" not in str(error.value)


def test_what_is_not_there_is_said(session: Session, empty: Session) -> None:
    with pytest.raises(NotFoundError, match="poses"):
        qsr.qualitative_tracks(empty, "cardir")
    with pytest.raises(UsageError, match="zebra"):
        qsr.qualitative_tracks(session, "cardir", of=[("a", "zebra")])
    with pytest.raises(UsageError, match="cardir"):
        qsr.qualitative_tracks(session, "cardir", of=[("a",)])
    with pytest.raises(UsageError, match="nearness"):
        qsr.qualitative_tracks(session, "nearness")
    with pytest.raises(UsageError, match="chain"):
        qsr.qualitative_tracks(session, "cardir", collapse=True)
