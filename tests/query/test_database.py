"""Questions to many sessions."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from ecat.errors import CorruptError, MissingExtraError, NotFoundError, UsageError
from ecat.query import open_database, tables_at
from ecat.store import open_session
from ecat.tables import TABLES
from tests.store.sessions import make

pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'ecat[query]'")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    for number, name in enumerate(("a/one", "a/two", "b/three")):
        make(folder / name, number, n=10 * (number + 1))
    return folder


def rows(path: Path, question: str) -> list[dict[str, object]]:
    with open_database(path) as database:
        return database.ask(question).rows()


def test_a_table_has_the_rows_of_all_sessions_and_says_where_each_is_from(project: Path) -> None:
    found = rows(project, "select session, count(*) n from poses group by session order by session")
    assert found == [
        {"session": "a/one", "n": 10},
        {"session": "a/two", "n": 20},
        {"session": "b/three", "n": 30},
    ]


def test_every_value_is_that_of_the_session_s_own_table(project: Path) -> None:
    for name in ("poses", "events", "event_segments"):
        found = rows(project, f"select * exclude (session) from {name} where session = 'a/two'")
        own = open_session(project / "a" / "two").table(name).to_arrow().to_pylist()
        assert found == own
        assert own


def test_the_names_of_packed_columns_are_texts(project: Path) -> None:
    assert rows(project, "select distinct object_id from poses where session = 'b/three'") == [
        {"object_id": "object_id2"}
    ]
    assert rows(project, "select text from events where text ~ '[12]' order by text") == [
        {"text": "1"},
        {"text": "2"},
    ]


def test_tables_can_be_joined_with_the_sessions(project: Path) -> None:
    [row] = rows(
        project,
        "select max(s.duration_s) longest, count(*) n from events e join sessions s using (session)",
    )
    assert row == {"longest": 80.0, "n": 3}


def test_tables_that_no_session_has_are_empty(project: Path) -> None:
    assert rows(project, "select * from hulls") == []


def test_a_single_session_goes_by_its_folder(project: Path) -> None:
    assert rows(project / "a" / "one", "select session, name from sessions") == [
        {"session": "one", "name": "session"}
    ]


def test_every_table_and_column_is_explained(project: Path) -> None:
    known = {table.name: table for table in tables_at(project)}
    assert set(known) == {"sessions", *TABLES}
    assert (known["poses"].rows, known["sessions"].rows, known["hulls"].rows) == (60, 3, 0)
    assert known["poses"].columns[0] == ("session", "the session's folder")
    assert all(meaning for table in known.values() for _, meaning in table.columns)


@pytest.mark.parametrize(
    "question",
    [
        "copy (select 1) to '{out}'",
        "copy poses to '{out}'",
        "export database '{out}'",
        "attach '{out}'",
        "select * from read_csv('/etc/passwd')",
        "select * from read_text('/etc/passwd')",
        "select * from '/etc/passwd'",
        "select * from glob('/*')",
        "install httpfs",
        "load httpfs",
        "set enable_external_access = true",
        "set python_enable_replacements = true",
        "select * from secret",
        "create table t as select * from read_blob('/etc/passwd')",
    ],
)
def test_a_question_reaches_nothing_but_the_sessions(project: Path, tmp_path: Path, question: str) -> None:
    secret = pa.table({"a": [1]})
    with pytest.raises(UsageError, match="cannot answer this question"):
        rows(project, question.format(out=tmp_path / "out"))
    assert list(tmp_path.iterdir()) == []
    del secret


def test_what_is_too_much_for_the_memory_leaves_no_trace(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """DuckDB puts it by in .tmp of the working folder if nobody says otherwise, and lets SQL write there."""
    (tmp_path / ".tmp").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="cannot answer this question"):
        rows(project, "copy (select 1) to '.tmp/out.csv'")
    with open_database(project) as database:
        asked = "select value from duckdb_settings() where name = 'temp_directory'"
        [place] = (Path(str(row["value"])) for row in database.ask(asked).rows())
        with pytest.raises(UsageError, match="expected one SELECT, found COPY"):
            database.ask(f"copy (select 1) to '{place}/out.csv'")
        assert list(place.iterdir()) == []
    assert not place.exists()
    assert [path.name for path in tmp_path.rglob("*")] == [".tmp"]


@pytest.mark.parametrize(
    ("question", "found"),
    [
        ("select 1; select 2", "2 statements"),
        ("select 1; drop view poses", "2 statements"),
        ("create table t (a int)", "CREATE"),
        ("begin", "TRANSACTION"),
        ("prepare p as select 1", "PREPARE"),
        ("pragma enable_profiling", "PRAGMA"),
        ("checkpoint", "CALL"),
        ("-- nothing", "nothing"),
    ],
)
def test_a_question_is_one_and_only_asks(project: Path, question: str, found: str) -> None:
    with pytest.raises(UsageError, match=f"expected one SELECT, found {found}"):
        rows(project, question)


@pytest.mark.parametrize(
    "question", ["from sessions", "describe poses", "show tables", "pivot sessions on name using sum(frames)"]
)
def test_a_question_may_be_put_in_any_way_that_duckdb_knows(project: Path, question: str) -> None:
    assert rows(project, question)


def test_columns_of_the_same_name_are_told_apart(project: Path) -> None:
    [row] = rows(project, "select 1 as a, 2 as a, 3 as a_1, 4 as a")
    assert row == {"a": 1, "a_2": 2, "a_1": 3, "a_3": 4}


def test_the_memory_of_a_question_is_bounded(project: Path) -> None:
    asked = "select value from duckdb_settings() where name = 'memory_limit'"
    assert rows(project, asked) == [{"value": "1.8 GiB"}]


@pytest.fixture
def alarm() -> Iterator[threading.Timer]:
    """Presses Ctrl-C a second after it is started, in a process in which signals do not end what waits."""
    here = threading.get_ident()
    timer = threading.Timer(1, lambda: signal.pthread_kill(here, signal.SIGINT))
    signal.siginterrupt(signal.SIGINT, False)
    yield timer
    timer.cancel()
    signal.siginterrupt(signal.SIGINT, True)


def test_a_long_question_can_be_interrupted(project: Path, alarm: threading.Timer) -> None:
    """DuckDB itself goes on until it has the next rows, however long that takes."""
    started = time.monotonic()
    with open_database(project) as database, pytest.raises(KeyboardInterrupt):  # noqa: PT012
        alarm.start()
        database.ask("select sum(sqrt(a.range + b.range)) from range(10000000) a, range(10000000) b").rows()
    assert time.monotonic() - started < 30


class PressedAgain:
    """A connection that Ctrl-C keeps from being interrupted, until the third time."""

    def __init__(self, connection: Any) -> None:
        self.connection, self.times = connection, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.connection, name)

    def interrupt(self) -> None:
        self.times += 1
        if self.times < 3:
            raise KeyboardInterrupt
        self.connection.interrupt()


def test_ctrl_c_again_leaves_no_question_at_work(project: Path, alarm: threading.Timer) -> None:
    started = time.monotonic()
    with open_database(project) as database, pytest.raises(KeyboardInterrupt):  # noqa: PT012
        database._connection = PressedAgain(database._connection)  # type: ignore[assignment]
        alarm.start()
        database.ask("select sum(sqrt(a.range + b.range)) from range(10000000) a, range(10000000) b").rows()
    assert time.monotonic() - started < 30


@pytest.mark.parametrize("moment", ["date '20000-01-01'", "'infinity'::timestamp", "[date '20000-01-01']"])
def test_times_that_python_has_not_are_said(project: Path, moment: str) -> None:
    with pytest.raises(UsageError, match="cannot show the answer") as caught:
        rows(project, f"select {moment}")
    assert "cast(... as varchar)" in caught.value.fix
    assert rows(project, f"select cast({moment} as varchar) as text")


def test_a_mistake_is_explained_and_the_tables_are_named(project: Path) -> None:
    with pytest.raises(UsageError) as caught:
        rows(project, "select typo from poses")
    assert 'Referenced column "typo" not found' in caught.value.where
    assert "--tables" in caught.value.fix
    with pytest.raises(UsageError, match="cannot answer this question"):
        rows(project, "   ")


def test_a_damaged_table_is_an_error_and_a_damaged_session_is_left_out_and_named(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make(tmp_path / name)
    (tmp_path / "a" / "session.json").write_text("{")
    with open_database(tmp_path) as database:
        assert database.ask("select session from sessions").rows() == [{"session": "b"}]
        [(path, error)] = database.failures
        assert path.name == "a"
        assert "session.json" in str(error)
    (tmp_path / "b" / "tables" / "poses.parquet").write_bytes(b"PAR1" * 10)
    with pytest.raises(CorruptError, match="cannot read the tables") as caught:
        rows(tmp_path, "select * from poses")
    assert "ecat check" in caught.value.fix


def test_a_question_goes_on_without_a_damaged_table_that_it_does_not_read(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make(tmp_path / name, n=2000)
    table = tmp_path / "b" / "tables" / "poses.parquet"
    data = table.read_bytes()
    # what does not fit its checksum is damaged, even if it can be unpacked
    for broken in (b"PAR1" * 10, data[:4] + bytes(byte ^ 1 for byte in data[4:-2000]) + data[-2000:]):
        table.write_bytes(broken)
        with pytest.raises(CorruptError) as caught:
            rows(tmp_path, "select avg(x), avg(y), avg(z) from poses")
        assert "where session <> 'NAME'" in caught.value.fix
        assert rows(tmp_path, "select count(*) n from events") == [{"n": 2}]
        assert rows(tmp_path, "select count(z) n from poses where session <> 'b'") == [{"n": 2000}]
        assert rows(
            tmp_path, "select count(z) n from events join poses using (session) where session <> 'b'"
        ) == [{"n": 2000}]


def test_without_sessions_or_without_duckdb_it_says_so(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(NotFoundError):
        rows(tmp_path / "nowhere", "select 1")
    monkeypatch.setitem(__import__("sys").modules, "duckdb", None)
    with pytest.raises(MissingExtraError, match="cannot answer questions") as caught:
        rows(project, "select 1")
    assert "ecat[query]" in caught.value.fix
