"""``ecat learn qsr SESSION``: a session's qualitative track as a table, and as relations that it proposes."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from ecat.check import check
from ecat.store import Session, TableData, open_session
from learn.features import qsr
from learn.features.qsr.intervals import author_of, relations_of
from tests.learn.features import sessions
from tests.learn.features.sessions import SHELL, STELLA

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sessions.make(tmp_path_factory.mktemp("s") / "slide", sessions.draft()).path


@pytest.fixture
def session(processed: Path, tmp_path: Path) -> Session:
    return open_session(shutil.copytree(processed, tmp_path / "slide"))


def test_a_track_is_a_table(session: Session, tmp_path: Path, ecat: Ecat) -> None:
    dest = tmp_path / "t.parquet"
    result = ecat(
        "learn",
        "qsr",
        session.path,
        "--relation",
        "cardir",
        "--of",
        "Shell, Stella Artois",
        "-o",
        dest,
        "--json",
    )
    assert result.code == 0, result.err
    table = pq.read_table(dest)
    assert result.json["rows"] == table.num_rows == session.manifest.n_frames
    expected = qsr.qualitative_tracks(session, "cardir", of=[(SHELL, STELLA)])
    assert table["value"].to_pylist() == expected["value"].to_pylist()


def test_what_holds_is_proposed_beside_what_others_propose_and_replaced(session: Session, ecat: Ecat) -> None:
    for name, more in (("cardir", ()), ("mos", ("--quantisation", 0.005)), ("cardir", ("--least", 20))):
        result = ecat("learn", "qsr", session.path, "--relation", name, *more, "--propose", "--json")
        assert result.code == 0, result.err
        assert result.json["proposed"] > 0
    relations = open_session(session.path).layer("machine").relations
    assert {one.author for one in relations} == {author_of("cardir"), author_of("mos")}
    assert all(one.status == "proposed" and one.source == "computed" for one in relations)
    long = [one for one in relations if one.predicate.startswith("cardir=")]
    assert all(one.end_frame is not None and one.end_frame - one.start_frame >= 20 for one in long)
    listed = ecat("relation", "list", session.path, "--layer", "machine", "--json")
    assert "cardir=" in listed.out
    assert [finding for finding in check(session.path) if finding.severity == "error"] == []


def test_stretches_of_equal_values_are_intervals_and_unknown_ones_part_them(session: Session) -> None:
    track = qsr.qualitative_tracks(session, "cardir", of=[(SHELL, STELLA)]).slice(0, 12)
    values = ["n"] * 3 + [None] * 2 + ["n"] * 3 + ["ne"] + ["e"] * 3
    place = track.column_names.index("value")
    told = track.set_column(place, "value", pa.array(values).dictionary_encode())
    found = relations_of(session, told, least=2)
    assert [(one.predicate, one.start_frame, one.end_frame) for one in found] == [
        ("cardir=n", 0, 3),
        ("cardir=n", 5, 8),
        ("cardir=e", 9, 12),
    ]
    assert found[0].targets == (SHELL, STELLA)
    assert found[0].start_ns == 0


def test_what_holds_does_not_hold_in_frames_that_are_not_in_the_track(session: Session) -> None:
    track = qsr.qualitative_tracks(session, "cardir", of=[(SHELL, STELLA)]).slice(0, 30)
    place = track.column_names.index("value")
    track = track.set_column(place, "value", pa.array(["n"] * 30).dictionary_encode())
    sparse = track.filter((pc.field("frame") < 7) | (pc.field("frame") >= 20))
    found = relations_of(session, sparse)
    assert [(one.start_frame, one.end_frame) for one in found] == [(0, 7), (20, 30)]


def test_where_the_clock_goes_back_a_relation_has_frames_and_no_times(tmp_path: Path) -> None:
    draft = sessions.draft()
    t_ns = np.arange(draft.manifest.n_frames or 0)[::-1] * 33_000_000
    session = sessions.make(tmp_path / "s", sessions.with_times(draft, t_ns))
    found = relations_of(session, qsr.qualitative_tracks(session, "cardir"))
    assert (None, None) in {(one.start_ns, one.end_ns) for one in found}
    assert all(one.start_ns is None or one.end_ns is None or one.start_ns < one.end_ns for one in found)


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--propose", "--collapse"),
        ("--least", "3", "-o", "OUT"),
        ("--of", "Shell", "--propose"),
        ("--of", "Shell,Pilsner", "--propose"),
        ("--of", "Shell,o2", "--propose"),
        ("--object", "1", "--propose"),
    ],
)
def test_a_wrong_call_is_one_error(
    arguments: tuple[str, ...], session: Session, tmp_path: Path, ecat: Ecat
) -> None:
    words = [tmp_path / "t.parquet" if word == "OUT" else word for word in arguments]
    result = ecat("learn", "qsr", session.path, "--relation", "qtccs", *words, "--json")
    assert (result.code, result.json["error"]["error"]) == (2, "UsageError")
    assert open_session(session.path).manifest == session.manifest


def test_options_of_sessions_are_refused_of_files(tmp_path: Path, ecat: Ecat) -> None:
    path = tmp_path / "tracks.parquet"
    pq.write_table(
        pa.table({"track": [1], "frame": [0], "x1": [0.0], "y1": [0.0], "x2": [1.0], "y2": [0.0]}), path
    )
    for words in ((), ("--propose", "-o", tmp_path / "o.parquet")):
        result = ecat("learn", "qsr", path, "--relation", "cardir", *words, "--json")
        assert (result.code, result.json["error"]["error"]) == (2, "UsageError")


def test_a_session_with_too_few_boxes_is_refused_with_those_it_has(
    session: Session, tmp_path: Path, ecat: Ecat
) -> None:
    with session.write() as commit:
        poses = session.table("poses").to_arrow()
        commit.put_table("poses", TableData(data=sessions.only(SHELL)(poses)))
    dest = tmp_path / "t.parquet"
    result = ecat("learn", "qsr", session.path, "--relation", "cardir", "-o", dest, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "InputError")
    assert f"poses are known of {SHELL} only" in result.json["error"]["where"]
    assert not dest.exists()
    assert ecat("learn", "qsr", session.path, "--relation", "mos", "-o", dest).code == 0


def test_a_project_is_refused_with_its_sessions(processed: Path, tmp_path: Path, ecat: Ecat) -> None:
    shutil.copytree(processed, tmp_path / "project" / "slide")
    dest = tmp_path / "t.parquet"
    result = ecat("learn", "qsr", tmp_path / "project", "--relation", "cardir", "-o", dest, "--json")
    assert (result.code, result.json["error"]["error"]) == (2, "UsageError")
    assert str(tmp_path / "project" / "slide") in result.json["error"]["where"]
    assert str(tmp_path / "project" / "slide") in result.json["error"]["fix"]


def test_boxes_have_their_sizes_and_what_is_no_box_is_a_point(
    session: Session, tmp_path: Path, ecat: Ecat
) -> None:
    command = ("learn", "qsr", session.path, "--relation", "rcc8")
    assert ecat(*command, "-o", tmp_path / "a.parquet").err == ""
    poses = session.table("poses").to_arrow()
    place = poses.column_names.index("object_id")
    names = ["thing" if name == SHELL else name for name in poses["object_id"].to_pylist()]
    other = poses.set_column(place, poses.schema.field(place), pa.array(names).dictionary_encode())
    with session.write() as commit:
        commit.put_table("poses", TableData(data=other))
    result = ecat(*command, "-o", tmp_path / "b.parquet")
    assert result.code == 0, result.err
    assert "object thing is a point" in result.err
