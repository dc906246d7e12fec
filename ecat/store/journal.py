"""The journal of a layer: one line of JSON per step of its history, on the disk before it is acknowledged.

The first line is the layer as it was before the first step, so that the journal alone tells every state that the
layer ever had; the others are records (:class:`ecat.model.record.Record`), numbered by their ``revision``.
The layer's XML contains the journal up to a checkpoint that the manifest names; what lies behind it is taken
over by whoever opens the session next (:mod:`ecat.store.checkpoint`).
A torn last line was never acknowledged (:mod:`ecat.store.lines`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from ecat.errors import CorruptError, UsageError
from ecat.model import Layer
from ecat.model.changes import diff, to_json
from ecat.model.changes import from_json as element_from_json
from ecat.model.document import Document
from ecat.model.record import Record
from ecat.store import files
from ecat.store.lines import append_at, encoded, whole_lines
from ecat.store.lock import exclusive
from ecat.store.manifest import is_layer_name, journal_file

_ADVICE = "ecat check names what is wrong, ecat check --repair begins a new journal"


@dataclass(frozen=True, slots=True)
class Place:
    """How far somebody has read a journal: the last revision, and the byte after its line."""

    revision: int = 0
    offset: int = 0


START = Place()


class Journal:
    """The journal of one layer of the session in ``folder``, which need not be there yet.

    Raises
    ------
    UsageError : ``layer`` is not a name.
    """

    def __init__(self, folder: Path, layer: str) -> None:
        if not is_layer_name(layer):
            fix = "take letters, digits, '_', '-', '.' and spaces"
            raise UsageError(
                f"cannot use the journal of layer {layer!r}", where="not a layer's name", fix=fix
            )
        self.layer = layer
        self.folder = folder
        self.path = files.confined(folder, journal_file(layer))

    def size(self) -> int:
        """Bytes of the file; 0 if there is none."""
        try:
            return self.path.stat().st_size
        except OSError:
            return 0

    @contextmanager
    def hold(self) -> Generator[HeldJournal]:
        """Keep everybody else from appending for the time of the block; the file is made if it is not there.

        Raises
        ------
        LockedError : somebody else holds it for longer than five seconds.
        DiskError, ReadOnlyError : nothing was appended.
        """
        with files.typed_errors(f"cannot append to {self.path.name}", self.path, "nothing was appended"):
            files.make_folder(self.path.parent)
            with files.open_journal(self.path) as file, exclusive(file.fileno(), self.path):
                yield HeldJournal(self, file)

    def records(
        self, since: Place = START, *, until: int | None = None, changes: bool = True
    ) -> Iterator[tuple[Record, Place]]:
        """The records after ``since``, oldest first, up to revision ``until``, each with the place behind it.

        Without ``changes`` they have none, and are read faster.

        Raises
        ------
        CorruptError : a line other than the last is not the next record.
        LimitError : more than a gibibyte.
        """
        for line, end in self._lines(since.offset):
            if not since.offset and line.get("revision") == 0:
                continue
            if until is not None and since.revision >= until:
                return
            said = line if changes else {**line, "changes": []}
            record = self._record(said, since.revision + 1, end)
            since = Place(record.revision, end)
            yield record, since

    def base(self) -> Layer:
        """The layer before the first record.

        Raises
        ------
        CorruptError : the journal does not begin with it.
        """
        try:
            return element_from_json(Layer, self._beginning()["layer"])
        except (LookupError, TypeError, ValueError):
            raise self._no_beginning() from None

    def continues(self) -> str:
        """The sha256 of the XML that the journal continues.

        Raises
        ------
        CorruptError : the journal does not say so.
        """
        return str(self._beginning().get("sha256"))

    def _beginning(self) -> dict[str, Any]:
        line = next(iter(self._lines(0)), ({}, 0))[0]
        if line.get("revision") != 0:
            raise self._no_beginning()
        return line

    def _no_beginning(self) -> CorruptError:
        return self.damaged("it does not begin with the layer that it continues")

    def require(self, place: Place) -> None:
        """Return if there are records up to ``place``, one after the other.

        Raises
        ------
        CorruptError : there are not.
        """
        found = START
        for _, found in self.records(until=place.revision, changes=False):  # noqa: B007 - the last one counts
            pass
        if found != place:
            raise self.damaged(
                f"revision {place.revision} does not end at byte {place.offset}, as its XML says"
            )

    def replay(self, until: int | None = None) -> tuple[Layer, Place]:
        """The layer as the journal tells it, at revision ``until`` or the last, and the place behind that.

        Raises
        ------
        CorruptError : the journal contradicts itself.
        """
        document, place = Document(self.base()), START
        for record, behind in self.records(until=until):
            self.apply(document, record)
            place = behind
        return document.layer(), place

    def apply(self, document: Document, record: Record) -> None:
        """Make the changes of a record.

        Raises
        ------
        CorruptError : the document is not what they were made in.
        """
        try:
            document.apply(record.changes)
        except (LookupError, TypeError, ValueError) as error:
            raise self.damaged(f"revision {record.revision} does not fit the layer: {error}") from None

    def damaged(self, why: str) -> CorruptError:
        """The error for a journal that is not what it should be."""
        return CorruptError(
            f"cannot use the journal of layer {self.layer}",
            where=f"{self.path}: {why}",
            consequence="the annotation itself is as it was last saved",
            fix=_ADVICE,
        )

    def _lines(self, offset: int) -> Iterator[tuple[dict[str, Any], int]]:
        """Whole lines from ``offset`` on, each with the offset behind it."""
        if not self.size():
            return
        with (
            files.typed_errors(f"cannot read {self.path.name}", self.path),
            files.open_regular(self.path) as file,
        ):
            yield from whole_lines(file, self.path, offset)

    def _record(self, line: Mapping[str, Any], revision: int, end: int) -> Record:
        try:
            record = Record.from_dict(line)
        except (LookupError, TypeError, ValueError) as error:
            raise self.damaged(f"the line that ends at byte {end} is not a record: {error}") from None
        if record.revision != revision:
            raise self.damaged(f"revision {record.revision} follows, expected {revision}")
        return record


class HeldJournal:
    """A journal that nobody else can append to."""

    def __init__(self, journal: Journal, file: BinaryIO) -> None:
        self._journal = journal
        self._file = file

    def news(self, since: Place) -> list[tuple[Record, Place]]:
        """The records after ``since``, each with the place behind it; errors as in :meth:`Journal.records`."""
        size = self._file.seek(0, 2)
        if size == since.offset:
            return []
        if size < since.offset:
            raise self._journal.damaged(f"{size} bytes, expected {since.offset} or more")
        return list(self._journal.records(since))

    def append(
        self, since: Place, records: Sequence[Record], *, base: Layer | None = None, sha256: str = ""
    ) -> Place:
        """Append records after ``since``, where the whole lines end, and return the place behind them.

        When this returns, they are on the disk.  A new journal begins with the layer ``base``, whose XML has
        ``sha256``; whoever begins one holds the session's lock.
        """
        lines = [encoded(record.to_dict(), self._journal.path) for record in records]
        if not since.offset and base is not None:
            lines.insert(
                0, encoded({"revision": 0, "sha256": sha256, "layer": to_json(base)}, self._journal.path)
            )
        data = b"".join(lines)
        # what lies behind is torn, or a header without a record
        append_at(self._file, self._journal.path, since.offset, data)
        if not since.offset:
            files.sync(self._journal.path.parent)
            files.sync(self._journal.folder)
        return Place(since.revision + len(records), since.offset + len(data))

    @contextmanager
    def appended(self, since: Place, record: Record, *, is_final: Callable[[], bool]) -> Generator[Place]:
        """Append a record, and take it back if the block fails, before anybody knows of it; not once ``is_final``."""
        place = self.append(since, [record])
        try:
            yield place
        except BaseException:
            if not is_final():
                self._file.truncate(since.offset)
            raise


def now() -> str:
    """The time for a record: UTC, ISO 8601 with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def replacement(revision: int, old: Layer, new: Layer) -> Record:
    """The record of another program having replaced a layer."""
    return Record(
        revision=revision, author="ecat", time=now(), operation={"op": "replace"}, changes=diff(old, new)
    )
