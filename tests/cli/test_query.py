"""Questions and statistics, typed."""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Ecat

from ecat.store import remote

pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'ecat[query]'")

COUNT = "select type, count(*) as n from events group by type order by n desc, type"


def test_the_answer_is_a_table(ecat: Ecat, session: Path) -> None:
    found = ecat("query", session, COUNT)
    assert found.code == 0
    assert found.out.splitlines()[0].split() == ["type", "n"]
    assert ["grasp", "1"] in [line.split() for line in found.out.splitlines()]
    assert {"type": "grasp", "n": 1} in ecat("query", session, COUNT, "--json").json["rows"]


def test_more_rows_than_wanted_are_left_out_and_it_says_so(ecat: Ecat, session: Path) -> None:
    found = ecat("query", session, "select frame from joints", "--rows", 3)
    assert len(found.out.splitlines()) == 5
    assert "--rows prints more" in found.out
    assert ecat("query", session, "select 1 as one", "--rows", 1).out.splitlines() == ["one", "1"]


def test_a_plan_is_shown_as_it_is_drawn(ecat: Ecat, session: Path) -> None:
    found = ecat("query", session, f"explain {COUNT}").out
    assert "ORDER" in found.upper()
    assert len(found.splitlines()) > 5
    assert "explain_value" not in found


def test_all_rows_go_to_a_file(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    assert ecat("query", session, COUNT, "--to", tmp_path / "n.csv").out.startswith("wrote 5 rows")
    assert (tmp_path / "n.csv").read_text().splitlines()[0] == '"type","n"'


def test_json_has_numbers_where_there_are_some(ecat: Ecat, session: Path) -> None:
    numbers = "sum(n) a, 'nan'::double b, [1.5::double, '-inf'] c, 2.5::decimal(3,1) d"
    question = f"select {numbers}, uuid() e from range(3) t(n)"
    [row] = ecat("query", session, question, "--json").json["rows"]
    assert isinstance(row.pop("e"), str)
    assert row == {"a": 3, "b": None, "c": [1.5, None], "d": 2.5}


def test_the_question_may_come_from_the_input(
    ecat: Ecat, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("select 41 + 1 as n"))
    assert ecat("query", session, "-", "--json").json["rows"] == [{"n": 42}]


def test_the_tables_and_their_columns_are_listed(ecat: Ecat, session: Path) -> None:
    assert "session  the session's folder" in " ".join(ecat("query", session, "--tables").out.split("\n  "))
    tables = {table["name"]: table for table in ecat("query", session, "--tables", "--json").json["tables"]}
    assert tables["events"]["rows"] == 5


def test_a_mistake_says_what_to_do(ecat: Ecat, session: Path) -> None:
    found = ecat("query", session, "select nothing from nowhere")
    assert found.code == 2
    assert "nowhere does not exist" in found.err
    assert "--tables" in found.err
    assert ecat("query", session).code == 2


def test_the_statistics_say_what_is_there(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    found = ecat("stats", session)
    assert found.code == 0
    assert found.out.startswith("1 session, ")
    assert "slide_next" in found.out
    data = ecat("stats", session, "--json").json
    assert data["sessions"][0]["sessions"] == 1
    assert isinstance(data["sessions"][0]["frames"], int)
    assert isinstance(data["annotated"][0]["frames"], int)
    assert data["agreement"] == []


def test_the_statistics_are_drawn(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="Matplotlib is not installed: pip install 'ecat[plots]'")
    assert "drawn to" in ecat("stats", session, "--plot", tmp_path / "s.png").out
    assert (tmp_path / "s.png").read_bytes()[:4] == b"\x89PNG"


def test_a_session_that_cannot_be_read_is_named_and_the_others_are_counted(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "session.json").write_text("{")
    found = ecat("stats", tmp_path)
    assert found.code == 1
    assert found.out.startswith("1 session, ")
    assert "cannot read session.json" in found.out
    found = ecat("query", tmp_path, "select count(*) as n from sessions")
    assert (found.code, found.out.split()) == (1, ["n", "1"])
    assert "cannot read session.json" in found.err


def test_a_session_with_a_damaged_table_is_named_and_the_others_are_counted(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    broken = Path(shutil.copytree(session, tmp_path / "broken"))
    (broken / "tables" / "events.parquet").write_bytes(b"")
    found = ecat("stats", tmp_path, "--json")
    assert (found.code, found.json["sessions"][0]["sessions"]) == (1, 1)
    [failure] = found.json["failures"]
    assert failure["path"] == str(broken)
    assert failure["error"]["what"] == "cannot read table events of session slide"


def test_sessions_at_a_url_are_asked_counted_shown_and_described(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'ecat[remote]'")
    remote.send(session, f"memory://lab/{tmp_path.name}/one")
    url = f"memory://lab/{tmp_path.name}"
    assert ecat("query", url, COUNT, "--json").json == ecat("query", session.parent, COUNT, "--json").json
    assert "events" in ecat("query", url, "--tables").out
    assert ecat("stats", url).out.startswith("1 session")
    assert ecat("info", f"{url}/one").out.startswith("session ")
    saved = ecat("view", f"{url}/one", "--save", tmp_path / "one.rrd")
    assert saved.code == 0
    assert (tmp_path / "one.rrd").stat().st_size > 1000
    assert ecat("query", "memory://nowhere", COUNT).code == 1
