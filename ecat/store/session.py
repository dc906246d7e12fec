"""The session folder: create, open, read, commit."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from ecat.errors import NotFoundError
from ecat.model import Layer, Manifest, Stream
from ecat.store import checkpoint, files
from ecat.store.commit import Commit
from ecat.store.journal import Place
from ecat.store.lock import locked
from ecat.store.parquet import TableData
from ecat.store.snapshot import Snapshot
from ecat.store.staging import staged_folder
from ecat.store.table_view import TableView, bounds_of
from ecat.store.transaction import NewFiles, new_id, roll_forward, settle

_LOCK_WAIT_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Draft:
    """A whole new session.

    Parameters
    ----------
    manifest : without records of layers and tables; the store fills them, and size and sha256 of the streams
        it copies. layers, tables : what to write. files : name of a stream, and the file to copy to where the
        stream's ``file`` says (inside ``media/``). media : name of a stream, and the function that writes its file
        to the path it is given. in_order : write media one after the other, as one depends on what another found, and
        not in threads, side by side. finish : makes the manifest what it should be once the media are written, for what
        only writing them tells; rows of ``tables`` that are made as they are asked for are made after it.
    """

    manifest: Manifest
    layers: tuple[Layer, ...] = ()
    tables: Mapping[str, TableData] = field(default_factory=dict[str, TableData])
    files: Mapping[str, Path] = field(default_factory=dict[str, Path])
    media: Mapping[str, Callable[[Path], None]] = field(default_factory=dict[str, Callable[[Path], None]])
    in_order: bool = False
    finish: Callable[[Manifest], Manifest] | None = None


class Session:
    """One session on disk, as it was when it was opened, refreshed or last written through this object.

    A reader never gets a mix of two revisions: what a later commit of another process has replaced raises
    :class:`ecat.errors.StaleError` until :meth:`refresh`; everything else reads on.
    """

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def __repr__(self) -> str:
        return f"Session({str(self.path)!r}, revision={self.manifest.revision})"

    @property
    def snapshot(self) -> Snapshot:
        """The revision that this session is at."""
        return self._snapshot

    @property
    def path(self) -> Path:
        """The session's folder."""
        return self._snapshot.path

    @property
    def manifest(self) -> Manifest:
        """What ``session.json`` says."""
        return self._snapshot.manifest

    @property
    def name(self) -> str:
        """The session's name."""
        return self.manifest.name

    def layer(self, name: str = "main") -> Layer:
        """The annotation layer called ``name``.

        Raises
        ------
        NotFoundError : there is no such layer.
        StaleError : another process has committed it since.
        CorruptError : its XML was edited outside of ecat (``ecat check`` takes the edit over).
        """
        return self._snapshot.layer(name)

    def table(
        self,
        name: str,
        *,
        start: float | None = None,
        end: float | None = None,
        start_frame: int | None = None,
        end_frame: int | None = None,
        columns: Sequence[str] | None = None,
    ) -> TableView:
        """The table called ``name``, or a slice of it; nothing is read before the view is asked.

        Parameters
        ----------
        start, end : seconds since the session's start, half-open; rows with intervals are those that overlap.
        start_frame, end_frame : the same in frames.
        columns : names of the columns wanted, all by default.

        Raises
        ------
        NotFoundError : there is no such table; the error names the stage that makes it.
        UsageError : the table, or the session, has no time to slice by; an end before its start; no such column.
        """
        snapshot = self._snapshot
        record = snapshot.table_record(name)
        bounds = bounds_of(
            record,
            snapshot.manifest.clock,
            start=start,
            end=end,
            start_frame=start_frame,
            end_frame=end_frame,
        )
        return TableView(snapshot, record, bounds, columns)

    def has_table(self, name: str) -> bool:
        """Whether there is a table called ``name``."""
        return self.manifest.table(name) is not None

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables that are there."""
        return tuple(record.name for record in self.manifest.tables)

    @property
    def objects(self) -> TableView:
        """Annotated objects of all layers."""
        return self.table("objects")

    @property
    def events(self) -> TableView:
        """Events of all layers."""
        return self.table("events")

    @property
    def event_segments(self) -> TableView:
        """Stretches of events."""
        return self.table("event_segments")

    @property
    def event_links(self) -> TableView:
        """Typed links between events."""
        return self.table("event_links")

    @property
    def event_roles(self) -> TableView:
        """What takes part in events."""
        return self.table("event_roles")

    @property
    def relations(self) -> TableView:
        """Predicates over objects and when they hold."""
        return self.table("relations")

    @property
    def keyframes(self) -> TableView:
        """Shapes drawn by a person."""
        return self.table("keyframes")

    @property
    def poses(self) -> TableView:
        """Pose of every box at every frame."""
        return self.table("poses")

    def stream(self, name: str) -> Stream:
        """The recorded stream called ``name``."""
        for stream in self.manifest.streams:
            if stream.name == name:
                return stream
        known = ", ".join(stream.name for stream in self.manifest.streams) or "none"
        where = f"{self.path}: the streams are: {known}"
        raise NotFoundError(f"cannot find stream {name}", where=where, fix="name one of them")

    def stream_path(self, name: str) -> Path:
        """The file of the stream called ``name``.

        Raises
        ------
        NotFoundError : there is no such stream, or its file was not there at import.
        SchemaError : a symbolic link leads out of the session.
        """
        stream = self.stream(name)
        if not stream.present:
            raise NotFoundError(
                f"cannot find the file of stream {name}",
                where=f"{self.path}: {stream.file or name} was not there when the session was imported",
                fix="import the session again, with the file in its place",
            )
        return files.confined(self.path, stream.file)

    @contextmanager
    def write(
        self, *, expected_revision: int | None = None, wait_s: float = _LOCK_WAIT_S
    ) -> Generator[Commit]:
        """Change the session: what is put into the commit is written at once when the block ends, or not at
        all.

        The session is locked for the time of the block, and this object has the new revision after it.

        Parameters
        ----------
        expected_revision : the revision that the change is based on; the one this object was read at, by
            default, where layers that others have edited since do not matter unless they are put. wait_s : how long
            to wait for another writer.

        Raises
        ------
        StaleError : the session on disk has moved on.
        LockedError : another process is writing for longer than ``wait_s``.
        ReadOnlyError, DiskError : nothing was changed.
        """
        what = f"cannot write to session {self.path.name}"
        with locked(self.path, wait_s=wait_s):
            with files.typed_errors(what, self.path, "nothing was written"):
                roll_forward(self.path, what)
            now = checkpoint.fold_if_possible(Snapshot.read(self.path))
            moved_on = _moved_on(self._snapshot.manifest, now.manifest)
            if expected_revision is None and moved_on is None:
                raise self._snapshot.stale(now.manifest.revision)
            if expected_revision not in {None, now.manifest.revision}:
                raise now.stale(now.manifest.revision)
            new = NewFiles(self.path, new_id())
            commit = Commit(new, now.manifest, now.layer, moved_on or ())
            # the files of layers that others have edited are those of now, which the block may look at
            read, self._snapshot = self._snapshot, now
            try:
                yield commit
                with ExitStack() as until_committed:
                    if commit.close(now.manifest.revision + 1, until_committed):
                        new.commit()
            except BaseException:
                new.discard()
                self._snapshot = read
                raise
            self._snapshot = Snapshot.read(self.path)

    def save_checkpoint(self, layer: Layer, place: Place, *, wait_s: float = _LOCK_WAIT_S) -> None:
        """Commit a layer as it is at ``place`` of its journal, unless the session contains more of that already.

        Raises
        ------
        LockedError : another process is writing for longer than ``wait_s``.
        CorruptError : the layer's XML was edited outside of ecat.
        ReadOnlyError, DiskError : nothing was changed.
        """
        what = f"cannot save layer {layer.name} of session {self.path.name}"
        with (
            locked(self.path, what=what, wait_s=wait_s),
            files.typed_errors(what, self.path, "nothing was changed"),
        ):
            roll_forward(self.path, what)
            now = Snapshot.read(self.path)
            record = now.manifest.layer(layer.name)
            if record is None or record.journal_revision < place.revision:
                if record is not None:
                    now.confirm_layer(record)
                now = checkpoint.save(now, [(layer, place)])
            self._snapshot = now

    @contextmanager
    def hold(self, *, wait_s: float = _LOCK_WAIT_S) -> Generator[Manifest]:
        """Keep everybody else from writing for the time of the block, which gets the manifest as it is now.

        Raises
        ------
        LockedError : another process is writing for longer than ``wait_s``.
        """
        what = f"cannot write to session {self.path.name}"
        with locked(self.path, wait_s=wait_s):
            roll_forward(self.path, what)
            yield Snapshot.read(self.path).manifest

    def reread(self) -> Session:
        """Read ``session.json`` again; returns this session."""
        settle(self.path)
        self._snapshot = Snapshot.read(self.path)
        return self

    def refresh(self) -> Session:
        """Read the session again, with what its journals say by now; returns this session."""
        self._snapshot = checkpoint.catch_up(self.reread().snapshot)
        return self


def _moved_on(read: Manifest, now: Manifest) -> set[str] | None:
    """The layers that are not as they were read; ``None`` if anything else has changed, but what follows from them."""

    def others(manifest: Manifest) -> Manifest:
        tables = tuple(table for table in manifest.tables if table.stage != "publish")
        return replace(manifest, revision=1, layers=(), tables=tables)

    if others(read) != others(now):
        return None
    changed = set(read.layers) ^ set(now.layers)
    return {record.name for record in changed}


def open_session(path: Path | str) -> Session:
    """Open the session in the folder ``path``: its manifest is read, nothing else.

    A commit that was interrupted is finished first; so is what an editor was killed before it could save, unless
    somebody else is writing just now: the annotations are those of the last checkpoint then.

    Raises
    ------
    NotFoundError : there is no such folder, or it is not a session.
    FormatError, SchemaError, LimitError : ``session.json`` is not a manifest that this ecat can read.
    CorruptError : an interrupted commit cannot be finished.
    ReadOnlyError : it could be, with the permission to write; or the manifest may not be read.
    """
    path = Path(path)
    with files.typed_errors(f"cannot open session {path.name}", path):
        settle(path)
    return Session(checkpoint.catch_up(Snapshot.read(path)))


def create_session(dest: Path | str, draft: Draft) -> Session:
    """Write a new session to the folder ``dest``, which appears complete or not at all.

    Raises
    ------
    ExistsError : ``dest`` is there and is not an empty folder.
    SchemaError, UsageError : the draft is not a session.
    DiskError, ReadOnlyError : nothing is left behind.
    """
    dest = Path(dest)
    with staged_folder(dest) as staging:
        fill_session(staging, draft, dest)
    return open_session(dest)


def fill_session(folder: Path, draft: Draft, dest: Path) -> None:
    """Write a new session, durably, into the empty ``folder``, which whoever calls is making in one piece.

    ``dest`` is where it is going to be, for errors, which are those of :func:`create_session`; what is left in
    ``folder`` after one is the caller's to remove.
    """
    manifest = replace(draft.manifest, layers=(), tables=())
    new = NewFiles(folder)
    commit = Commit(new, manifest, _no_layer)
    with files.typed_errors(f"cannot create {dest.name}", dest, f"nothing was written to {dest}"):
        commit.copy_streams(draft.files)
        commit.write_streams(draft.media, in_order=draft.in_order)
        if draft.finish is not None:
            commit.revise(draft.finish)
        for layer in draft.layers:
            commit.put_layer(layer)
        for name, table in draft.tables.items():
            commit.put_table(name, table)
        commit.close(manifest.revision, ExitStack())
        new.sync()


def _no_layer(name: str) -> Layer:
    where = "the session is being made and has no earlier layers"
    raise NotFoundError(f"cannot read layer {name}", where=where, fix="put the layer instead")
