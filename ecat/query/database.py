"""The tables of all sessions as one database for the time of a question.

Every table of the sessions is a table here, with the rows of all of them and a column ``session`` in front; the table
``sessions`` says what the sessions are.  DuckDB reads of the files what a question needs, when it needs it.  A question
can read nothing else, and write nothing but into a folder of its own, in which what is too much for the memory waits,
and which goes with the database: there is no other way from SQL to the disk, and none to Python.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa
import pyarrow.dataset as ds
from pyarrow import fs

from ecat.errors import CorruptError, EcatError, MissingExtraError, UsageError
from ecat.progress import Progress, silent
from ecat.store import Session, files, find_sessions, open_session
from ecat.tables import TABLES, Column, TableSchema

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

SESSION = pa.field("session", pa.string())
SESSIONS = TableSchema(
    "sessions",
    "What was asked: a row for each session.",
    (
        Column("session", pa.string(), "the session's folder"),
        Column("name", pa.string(), "the session's name"),
        Column("frames", pa.int64(), "images of the annotated video"),
        Column("duration_s", pa.float64(), "how long it is; null where it has no clock", "s", "", True),
        Column("created", pa.string(), "when it was recorded or made"),
        Column("format", pa.string(), "the format it was imported from"),
        Column("streams", pa.list_(pa.string()), "recorded streams"),
        Column("layers", pa.list_(pa.string()), "annotation layers"),
        Column("tables", pa.list_(pa.string()), "tables that it has"),
    ),
)
_T = TypeVar("_T")
_DISK = fs.LocalFileSystem()
_ROWS_AT_ONCE = 1 << 14
_LISTENING_S = 0.1
"""So often it is heard whether Ctrl-C was pressed."""
_MEMORY = "2GB"
"""What DuckDB may take before it puts things by on the disk; otherwise it takes most of what the machine has."""
_QUESTIONS = ("SELECT", "EXPLAIN", "MULTI")
"""Statements that only ask; MULTI is what DuckDB makes of a PIVOT."""
_LOCKED = (
    "SET enable_external_access = false",
    "SET python_enable_replacements = false",
    "SET autoinstall_known_extensions = false",
    "SET autoload_known_extensions = false",
    "SET lock_configuration = true",
)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The rows of an answer, as they come."""

    schema: pa.Schema
    batches: Iterator[pa.RecordBatch]

    def rows(self) -> list[dict[str, Any]]:
        """All of them at once.

        Raises
        ------
        UsageError : as of :func:`rows_of`.
        CorruptError : a table cannot be read.
        """
        return [row for batch in self.batches for row in rows_of(batch)]


def rows_of(batch: pa.RecordBatch) -> list[dict[str, Any]]:
    """The rows as Python has them.

    Raises
    ------
    UsageError : there is a time that Python has not, as one in the year 20,000 or at infinity.
    """
    try:
        return batch.to_pylist()
    except (OverflowError, ValueError) as error:
        raise UsageError(
            "cannot show the answer",
            where=str(error),
            fix="cast(... as varchar) in the question makes texts of its times; --to FILE writes them as they are",
        ) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableHelp:
    """A table that can be asked: how many rows it has, and its columns, each with what it means."""

    name: str
    rows: int
    columns: tuple[tuple[str, str], ...]


class Database:
    """Sessions that can be asked.

    ``failures`` are those that could not be opened, and why.
    """

    def __init__(
        self,
        path: Path,
        connection: DuckDBPyConnection,
        worker: Executor,
        failures: Sequence[tuple[Path, EcatError]],
    ) -> None:
        self._path = path
        self._connection = connection
        self._worker = worker
        self.failures = tuple(failures)

    def ask(self, question: str) -> Answer:
        """Ask a question in SQL; the answer before it cannot be read on.

        Columns of the answer that have the same name get numbers: ``session``, ``session_1``.

        Raises
        ------
        UsageError : not one question; or what DuckDB says to it.  Nothing is written whatever it says.
        CorruptError : a table cannot be read, here or while the answer is.
        """
        with _typed(self._path):
            self._require_one(question)
            rows = self._interruptibly(lambda: self._connection.sql(question).to_arrow_reader(_ROWS_AT_ONCE))
        names = _unlike(rows.schema.names)
        schema = pa.schema([field.with_name(name) for field, name in zip(rows.schema, names, strict=True)])
        return Answer(schema=schema, batches=self._read(rows, schema))

    def _require_one(self, question: str) -> None:
        kinds = [statement.type.name for statement in self._connection.extract_statements(question)]
        if len(kinds) == 1 and kinds[0] in _QUESTIONS:
            return
        found = kinds[0] if len(kinds) == 1 else f"{len(kinds)} statements" if kinds else "nothing"
        raise UsageError(
            "cannot answer this question",
            where=f"expected one SELECT, found {found}",
            fix=f"ecat query {self._path} 'select * from sessions'",  # noqa: S608  (a hint)
        )

    def _read(self, rows: pa.RecordBatchReader, schema: pa.Schema) -> Iterator[pa.RecordBatch]:
        with _typed(self._path):
            while (batch := self._interruptibly(lambda: next(rows, None))) is not None:
                yield batch.rename_columns(schema.names)

    def _interruptibly(self, step: Callable[[], _T]) -> _T:
        """Do ``step`` in another thread: while DuckDB is at work, it hears of no signal."""
        waiting = self._worker.submit(step)
        try:
            # some libraries make signals wait until what waits has ended
            while not wait([waiting], timeout=_LISTENING_S).done:
                pass
            return waiting.result()
        finally:
            # one that comes before the question has begun is lost
            while not waiting.done():
                # nor is DuckDB left at work when Ctrl-C is pressed twice
                with suppress(KeyboardInterrupt):
                    self._connection.interrupt()
                    wait([waiting], timeout=_LISTENING_S)


@contextmanager
def open_database(
    path: Path, *, left_out: Mapping[Path, EcatError] = MappingProxyType({}), progress: Progress = silent
) -> Generator[Database]:
    """The sessions at ``path``, to be asked while the block lasts.

    ``left_out`` are folders of sessions that are not asked, and why: they are among the failures.

    Raises
    ------
    NotFoundError : there is no session.
    MissingExtraError : DuckDB is not installed.
    """
    duckdb = _duckdb()
    sessions, failures = _open(path, progress, left_out)
    with (
        # by default it is .tmp of the working folder, and the only place that SQL may write to
        TemporaryDirectory(prefix="ecat-", ignore_cleanup_errors=True) as scratch,
        duckdb.connect(":memory:", config={"temp_directory": scratch, "memory_limit": _MEMORY}) as connection,
        ThreadPoolExecutor(1) as worker,
    ):
        connection.register(SESSIONS.name, _sessions(sessions))
        for name, data in _tables(sessions).items():
            connection.register(name, data)
        for setting in _LOCKED:
            connection.execute(setting)
        yield Database(path, connection, worker, failures)


def damaged_sessions(
    path: Path, tables: Sequence[str], *, progress: Progress = silent
) -> dict[Path, EcatError]:
    """The folders of sessions at ``path`` of which one of ``tables`` cannot be read, and why; reads all of them."""
    sessions, _ = _open(path, progress)
    found: dict[Path, EcatError] = {}
    for done, (label, session) in enumerate(sessions.items()):
        progress("looking for damage", done, len(sessions))
        for name in tables:
            try:
                for _ in _table(name, {label: session}).to_batches():
                    pass
            except (pa.ArrowException, OSError) as error:
                found[session.path] = CorruptError(
                    f"cannot read table {name} of session {session.name}",
                    where=str(error).partition("\n")[0],
                    consequence="the session was left out",
                    fix=f"ecat check {session.path} says what can be done",
                )
                break
    return found


def tables_at(path: Path) -> list[TableHelp]:
    """The tables that can be asked at ``path``, those with rows first.

    Raises
    ------
    NotFoundError : there is no session.
    """
    sessions, _ = _open(path, silent)
    meanings = {
        (schema.name, c.name): c.meaning + (f" [{c.unit}]" if c.unit else "")
        for schema in (SESSIONS, *TABLES.values())
        for c in schema.columns
    }
    columns = _meanings(SESSIONS.arrow, meanings, SESSIONS.name)
    found = [TableHelp(name=SESSIONS.name, rows=len(sessions), columns=columns)]
    for name, data in _tables(sessions).items():
        records = (session.manifest.table(name) for session in sessions.values())
        rows = sum(record.rows for record in records if record is not None)
        found.append(TableHelp(name=name, rows=rows, columns=_meanings(data.schema, meanings, name)))
    return sorted(found, key=lambda table: table.rows == 0)


def _meanings(
    schema: pa.Schema, meanings: Mapping[tuple[str, str], str], table: str
) -> tuple[tuple[str, str], ...]:
    own = {"session": "the session's folder"}
    return tuple((name, meanings.get((table, name), own.get(name, ""))) for name in schema.names)


def _duckdb() -> Any:
    try:
        import duckdb
    except ImportError:
        raise MissingExtraError(
            "cannot answer questions", where="DuckDB is not installed", fix="pip install 'ecat[query]'"
        ) from None
    return duckdb


def _open(
    path: Path, progress: Progress, left_out: Mapping[Path, EcatError] = MappingProxyType({})
) -> tuple[dict[str, Session], tuple[tuple[Path, EcatError], ...]]:
    """The sessions by label, and those that cannot be opened or are left out."""
    sessions: dict[str, Session] = {}
    failures: list[tuple[Path, EcatError]] = []
    folders = find_sessions(path)
    for done, folder in enumerate(folders):
        progress("opening", done, len(folders))
        inside = folder.relative_to(path)
        try:
            session = open_session(folder)
            if session.path in left_out:
                raise left_out[session.path]
            sessions[inside.as_posix() if inside.parts else folder.resolve().name] = session
        except EcatError as error:
            failures.append((folder, error))
    if folders and not sessions:
        raise failures[0][1]
    return sessions, tuple(failures)


def _sessions(sessions: dict[str, Session]) -> pa.Table:
    rows = [
        {
            "session": label,
            "name": session.name,
            "frames": session.manifest.n_frames,
            "duration_s": None if (ns := session.manifest.clock.duration_ns) is None else ns / 1e9,
            "created": session.manifest.created,
            "format": session.manifest.provenance.format,
            "streams": [stream.name for stream in session.manifest.streams],
            "layers": [layer.name for layer in session.manifest.layers],
            "tables": list(session.tables),
        }
        for label, session in sessions.items()
    ]
    return pa.Table.from_pylist(rows, schema=SESSIONS.arrow)


def _tables(sessions: dict[str, Session]) -> dict[str, ds.Dataset]:
    """Every table that some session has, with the rows of all; tables that none has are empty."""
    return {name: _table(name, sessions) for name in TABLES}


def _table(name: str, sessions: dict[str, Session]) -> ds.Dataset:
    schema = pa.schema([SESSION, *map(_plain, TABLES[name].arrow)])
    checked = ds.ParquetFragmentScanOptions(page_checksum_verification=True)
    parquet = ds.ParquetFileFormat(default_fragment_scan_options=checked)
    fragments: list[Any] = []
    for label, session in sessions.items():
        if (record := session.manifest.table(name)) is not None:
            place = str(files.confined(session.path, record.file).resolve())
            here: Any = ds.field("session") == label
            fragments.append(parquet.make_fragment(place, _DISK, here))
    return ds.FileSystemDataset(fragments, schema, parquet, _DISK)


def _plain(field: Any) -> Any:
    """A column of texts as texts, however it is packed in the files."""
    kind = field.type
    return pa.field(field.name, kind.value_type if pa.types.is_dictionary(kind) else kind)


def _unlike(names: Sequence[str]) -> list[str]:
    """The names, with a number behind those that are there already."""
    found: list[str] = []
    for name in names:
        numbered = (f"{name}_{n}" for n in count(1))
        found.append(name if name not in found else next(n for n in numbered if n not in (*found, *names)))
    return found


@contextmanager
def _typed(path: Path) -> Generator[None]:
    duckdb = _duckdb()
    try:
        yield
    except duckdb.Error as error:
        text = str(error)
        if "reading the stream registered as" in text:  # a file's fault, which DuckDB only hands on
            raise _unreadable(path, text) from None
        raise UsageError(
            "cannot answer this question",
            where=tuple(line for line in text.split("\n") if line.strip())[:6],
            fix=f"ecat query {path} --tables lists the tables and their columns",
        ) from None
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, str(error)) from None


def _unreadable(path: Path, text: str) -> CorruptError:
    return CorruptError(
        f"cannot read the tables of {path}",
        where=text.partition("\n")[0],
        consequence="the question was not answered",
        fix=f"ecat check {path} says which session is damaged; where session <> 'NAME' in a question leaves it out",
    )
