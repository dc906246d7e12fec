"""Editing a layer: operations in, records out, each on the disk before it is acknowledged."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Any, Literal

from ecat.annotate.codec import operation_from_dict, operation_to_dict, require_author, require_few
from ecat.annotate.history import History, turn_back
from ecat.annotate.operations import Edit, Operation
from ecat.annotate.room import Room
from ecat.annotate.rules import perform, require_sound
from ecat.annotate.surroundings import Surroundings
from ecat.errors import ConflictError, LockedError, OperationError, StaleError, UsageError
from ecat.model import CodingScheme, Layer
from ecat.model.changes import Change, diff, invert
from ecat.model.document import Document
from ecat.model.record import Record
from ecat.store import Journal, Place, Session
from ecat.store.journal import now


class Editor:
    """A layer of a session that is being edited; several editors, in any processes, may edit one layer.

    Used in a ``with`` statement, it saves when it ends.  All methods may be called from any thread.

    Parameters
    ----------
    session : it is refreshed whenever the editor saves.
    layer : made, empty, if there is none.
    author : who edits, unless a call says otherwise.
    scheme : name of the coding scheme of a layer that is made.
    sessions : the layer of the same name of another session of the project, by that session's name; looked for beside
        this session by default.

    Raises
    ------
    UsageError : ``layer`` is not a name.
    CorruptError : the layer's XML was edited outside of ecat, or its journal does not fit it.
    SchemaError : ids in the layer are not unique.
    """

    def __init__(
        self,
        session: Session,
        layer: str = "main",
        author: str = "",
        scheme: str | None = None,
        *,
        sessions: Callable[[str], Layer] | None = None,
    ) -> None:
        self.session = session
        self.name = layer
        self.author = author
        self._mutex = threading.RLock()
        self._journal = Journal(session.path, layer)
        self._around = Surroundings(session, layer, sessions)
        if session.manifest.layer(layer) is None:
            self._around.make_layer(scheme or "")
        self._saving = threading.Lock()
        self._open()

    def __enter__(self) -> Editor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # every step is on the disk; while another process writes, whoever opens the session next takes them over
        with suppress(LockedError):
            self.save()

    # ------------------------------------------------------------------------------------------ looking

    @property
    def revision(self) -> int:
        """How many steps the layer's history has."""
        return self._place.revision

    @property
    def saved_revision(self) -> int:
        """The last step that the layer's XML and tables are known to contain."""
        return self._saved

    @property
    def pending(self) -> int:
        """How many steps are in the journal only."""
        return self.revision - self._saved

    @property
    def layer(self) -> Layer:
        """The layer as it is now."""
        with self._mutex:
            return self._document.layer()

    @property
    def document(self) -> Document:
        """The layer as it is now, to look things up in; only operations may change it."""
        return self._document

    @property
    def scheme(self) -> CodingScheme | None:
        """The layer's coding scheme, if it names one that can be found."""
        return self._around.scheme(self._document.header.scheme)

    def can_undo(self, author: str | None = None) -> bool:
        """Whether an author has something to undo."""
        return bool(self._history.steps(self._who(author)).undo)

    def can_redo(self, author: str | None = None) -> bool:
        """Whether an author has something to do again."""
        return bool(self._history.steps(self._who(author)).redo)

    def history(self, start: int = 1, limit: int = 100) -> list[Record]:
        """The steps from revision ``start`` on, oldest first, at most ``limit``."""
        with self._mutex:
            return self._history.records(start, limit)

    def at(self, revision: int) -> Layer:
        """The layer as it was at a revision; 0 is before the first step.

        Raises
        ------
        UsageError : there is no such revision.
        """
        with self._mutex:
            layer, last = self._document.layer(), self.revision
        if not 0 <= revision <= last:
            raise UsageError(
                f"cannot go to revision {revision}",
                where=f"layer {self.name} has revisions 0 to {last}",
                fix="name one of them",
            )
        if not last:
            return layer
        if revision < last - revision:
            return self._journal.replay(revision)[0]
        document = Document(layer)
        for record in reversed(self.history(revision + 1, last - revision)):
            document.apply(invert(record.changes))
        return document.layer()

    def refresh(self) -> list[Record]:
        """Take over what others have done since, and return it."""
        with self._mutex:
            if self._journal.size() != self._place.offset:
                return self._catch_up(self._journal.records(self._place))
            if not self._place.offset and self._around.sha256_now() != self._sha256:
                self._open()
            return []

    # ------------------------------------------------------------------------------------------ editing

    def apply(
        self,
        operations: Operation | Sequence[Operation],
        *,
        base: int | None = None,
        author: str | None = None,
    ) -> Record:
        """Do one operation, or several as one step: all of them or none.

        When this returns, the step is on the disk.  One that changes nothing is no step: the record returned has no
        changes and the revision that is.

        Parameters
        ----------
        base : the revision that whoever asks has seen; if others have gone on since, nothing is done.

        Raises
        ------
        OperationError : the annotation or its coding scheme does not allow it.
        SchemaError, LimitError : it is malformed, or too much.
        StaleError : the layer is not at ``base`` any more; with the ``records`` since.
        LockedError, DiskError, ReadOnlyError : it could not be written; nothing was changed.
        """
        asked = [operations] if isinstance(operations, Operation) else list(operations)
        require_few(len(asked))
        said = [operation_to_dict(operation) for operation in asked]
        checked = [operation_from_dict(data) for data in said]
        whole: dict[str, Any] = said[0] if len(said) == 1 else {"op": "batch", "operations": said}

        return self._step(whole, lambda edit: perform(edit, checked), base, author, may_be_empty=False)

    def undo(self, *, base: int | None = None, author: str | None = None) -> Record:
        """Undo the author's last step that is not undone.

        Raises
        ------
        OperationError : there is none.
        ConflictError : others have changed since what it changed.
        StaleError : as of :meth:`apply`.
        """
        return self._turn("undo", base, author)

    def redo(self, *, base: int | None = None, author: str | None = None) -> Record:
        """Do again what the author undid last; errors as of :meth:`undo`."""
        return self._turn("redo", base, author)

    def restore(self, revision: int, *, base: int | None = None, author: str | None = None) -> Record:
        """Let the layer be as it was at a revision, as one more step, which can be undone.

        Raises
        ------
        UsageError : there is no such revision.
        """

        def change(edit: Edit) -> tuple[Change, ...]:
            changes = diff(edit.document.layer(), self.at(revision))
            edit.document.apply(changes)
            return changes

        said = {"op": "restore", "revision": revision}
        return self._step(said, change, base, author, may_be_empty=False)

    def save(self) -> None:
        """Write XML and tables as of now; others may go on editing meanwhile.

        Raises
        ------
        LockedError : another process is writing to the session for long.
        CorruptError : the layer's XML was edited outside of ecat.
        DiskError, ReadOnlyError : they could not be written; every step is in the journal still.
        """
        with self._saving:
            with self._mutex:
                self.refresh()
                layer, place = self._document.layer(), self._place
            if place.revision > self._saved:
                self.session.save_checkpoint(layer, place)
                self._saved = max(self._saved, place.revision)
            self._around.forget_schemes()

    # ------------------------------------------------------------------------------------------ inside

    def _turn(self, way: Literal["undo", "redo"], base: int | None, author: str | None) -> Record:
        said: dict[str, Any] = {"op": way}

        def change(edit: Edit) -> tuple[Change, ...]:
            steps = self._history.steps(edit.author)
            waiting = steps.undo if way == "undo" else steps.redo
            if not waiting:
                where = f"layer {self.name}: {edit.author or 'nobody'} has nothing to {way}"
                raise OperationError(f"cannot {way}", where=where, fix="ecat log shows who did what")
            step = waiting[-1]
            said["undoes" if way == "undo" else "redoes"] = step.revision
            edit.op = way
            changes = turn_back(edit, self._history.record(step.source).changes, "others")
            if self._history.others_since(step.source, edit.author):
                try:
                    require_sound(edit, changes)
                except OperationError as broken:
                    edit.document.apply(invert(changes))
                    raise ConflictError(
                        broken.what, where=broken.where, fix="others build upon it: undo that first"
                    ) from None
            return changes

        return self._step(said, change, base, author, may_be_empty=True)

    def _step(
        self,
        operation: dict[str, Any],
        change: Callable[[Edit], tuple[Change, ...]],
        base: int | None,
        author: str | None,
        *,
        may_be_empty: bool,
    ) -> Record:
        """One step, which ``change`` makes in memory; then on the disk."""
        with self._mutex, self._begun(base), self._journal.hold() as held:
            self._catch_up(held.news(self._place))
            self._require_base(base)
            first = None if self._place.offset else self._document.layer()
            edit = self._edit(self._who(author))
            require_author(edit.author)
            changes = change(edit)
            if not changes and not may_be_empty:
                return Record(revision=self.revision, author=edit.author, time=now(), operation=operation)
            record = Record(
                revision=self.revision + 1,
                author=edit.author,
                time=now(),
                operation=operation,
                changes=changes,
            )
            try:
                self._room.require(changes, self._document)
                place = held.append(self._place, [record], base=first, sha256=self._sha256)
            except BaseException:
                self._document.apply(invert(changes))
                raise
            self._note(record, place)
            return record

    @contextmanager
    def _begun(self, base: int | None) -> Generator[None]:
        """While the layer has no journal, nobody may replace it as its first step is done."""
        if self._place.offset or self._journal.size():
            yield
            return
        with self.session.hold() as manifest:
            record = manifest.layer(self.name)
            replaced = record is None or record.sha256 != self._sha256
            if replaced:
                self._open()
            if replaced and base is not None:
                raise self._stale(base, ())
            yield

    def _open(self) -> None:
        """Read the layer as it was last saved, and its journal."""
        layer, self._place, self._sha256 = self._around.read_layer()
        self._document = Document(layer)
        self._room = Room(self._around.xml_bytes())
        self._saved = self._place.revision
        self._history = self._read_history()
        for record, place in self._journal.records(self._place):
            if not self._place.offset and self._journal.continues() != self._sha256:
                raise self._journal.damaged("it continues another layer than the XML")
            self._take(record, place)

    def _edit(self, author: str) -> Edit:
        around = self._around
        return Edit(
            self._document,
            author=author,
            n_frames=around.n_frames,
            scheme=self.scheme,
            stream=around.stream,
            t_ns=around.t_ns,
            layer_of=around.layer_of,
            session_of=around.session_of,
            find_scheme=around.find_scheme,
        )

    def _require_base(self, base: int | None) -> None:
        if base is None or base == self.revision:
            return
        since = self._history.records(base + 1, self.revision) if 0 <= base < self.revision else []
        raise self._stale(base, tuple(since))

    def _stale(self, base: int, since: tuple[Record, ...]) -> StaleError:
        return StaleError(
            f"cannot edit layer {self.name} as of revision {base}",
            where=f"{self.session.path}: it is at revision {self.revision} now",
            consequence="nothing was changed",
            fix="look at what others did, then do it again",
            revision=self.revision,
            records=since,
        )

    def _catch_up(self, news: Iterable[tuple[Record, Place]]) -> list[Record]:
        found: list[Record] = []
        for record, place in news:
            if not self._place.offset and self._journal.continues() != self._sha256:
                # somebody replaced the layer before its first step
                self._open()
                break
            self._take(record, place)
            found.append(record)
        return found

    def _take(self, record: Record, place: Place) -> None:
        self._journal.apply(self._document, record)
        self._room.took(record.changes)
        self._note(record, place)

    def _note(self, record: Record, place: Place) -> None:
        if self._history.end.revision < record.revision:
            self._history.note(record, place)
        self._place = place

    def _read_history(self) -> History:
        """The history up to where the XML is."""
        history = History(self._journal)
        for record, place in self._journal.records(until=self._place.revision, changes=False):
            history.note(record, place)
        if history.end != self._place:
            raise self._journal.damaged(
                f"its XML contains revision {self._place.revision}, which is not where it ends in the journal"
            )
        return history

    def _who(self, author: str | None) -> str:
        return self.author if author is None else author
