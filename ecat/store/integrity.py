"""Whether a session on disk is what its manifest says, and what interrupted writes left beside it."""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ecat.errors import EcatError, LockedError, NotFoundError
from ecat.model import Layer, LayerRecord, Stream, TableRecord
from ecat.model.document import Document
from ecat.store import files
from ecat.store.checkpoint import current
from ecat.store.journal import START, Journal, Place
from ecat.store.lock import locked
from ecat.store.manifest import journal_file, layer_file
from ecat.store.session import Session
from ecat.store.transaction import new_id, noted_files, settle
from ecat.store.xml import MAX_BYTES as MAX_LAYER_BYTES
from ecat.store.xml import layer_from_xml, layer_to_xml
from ecat.tables import PUBLISHED

_FOLDERS = ("", "tables", "annotations")
_NEW = re.compile(r"\..+\.[0-9a-f]{16}\.new")
_PARTIAL = re.compile(r"\..+\.[0-9a-f]{16}\.partial")


@dataclass(frozen=True, slots=True)
class Fault:
    """A file that is not what the manifest says: its path inside the session, and what is wrong."""

    file: str
    problem: str

    def __str__(self) -> str:
        return f"{self.file}: {self.problem}"


def validate(session: Session, *, deep: bool = False) -> list[Fault]:
    """Compare every file of the session with its manifest; an empty list means that they agree.

    Tables are compared by their metadata and schema, layers by their hash; ``deep`` reads every byte of every
    file.
    """
    return [
        *(fault for table in session.manifest.tables for fault in _table_faults(session, table, deep=deep)),
        *(fault for layer in session.manifest.layers for fault in _layer_faults(session, layer)),
        *(
            fault
            for stream in session.manifest.streams
            for fault in _stream_faults(session, stream, deep=deep)
        ),
    ]


def _table_faults(session: Session, record: TableRecord, *, deep: bool) -> Iterator[Fault]:
    layers = {layer.name: layer.sha256 for layer in session.manifest.layers}
    if record.name in {schema.name for schema in PUBLISHED} and record.inputs != layers:
        yield Fault(record.file, "made from other revisions of the layers than the manifest has")
    try:
        session.snapshot.read_table(record, lambda _: None)
        if deep and files.sha256_of(session.path / record.file) != record.sha256:
            yield Fault(record.file, "its content has changed")
    except (EcatError, OSError) as error:
        yield _fault(record.file, error)


def _layer_faults(session: Session, record: LayerRecord) -> Iterator[Fault]:
    try:
        session.layer(record.name)
    except EcatError as error:
        yield _fault(record.file, error)
        return
    journal = journal_file(record.name)
    try:
        current(session.snapshot, record)
        Journal(session.path, record.name).require(Place(record.journal_revision, record.journal_bytes))
    except EcatError as error:
        yield _fault(journal, error)


def _stream_faults(session: Session, stream: Stream, *, deep: bool) -> Iterator[Fault]:
    if not stream.present:
        return
    try:
        path = session.stream_path(stream.name)
        size = path.stat().st_size
        if stream.size_bytes is not None and size != stream.size_bytes:
            yield Fault(stream.file, f"{size} bytes, expected {stream.size_bytes}")
        elif deep and stream.sha256 and files.sha256_of(path) != stream.sha256:
            yield Fault(stream.file, "its content has changed")
    except (EcatError, OSError) as error:
        yield _fault(stream.file, error)


def _fault(file: str, error: EcatError | OSError) -> Fault:
    return Fault(file, (error.where or error.what) if isinstance(error, EcatError) else str(error.strerror))


def adopt_edited_layers(session: Session) -> list[str]:
    """Commit the layers whose XML was edited outside of ecat as they are now, and return their names.

    Raises
    ------
    FormatError, SchemaError : an edited file is not a layer any more; nothing was changed.
    """
    edited: dict[str, tuple[Layer, Place]] = {}
    for record in session.manifest.layers:
        path = files.confined(session.path, layer_file(record.name))
        with files.typed_errors(f"cannot read layer {record.name}", path, "nothing was changed"):
            if files.sha256_of(path) != record.sha256:
                layer = layer_from_xml(files.read_bytes(path, MAX_LAYER_BYTES), name=record.name)
                edited[record.name] = _continued(session, record, layer)
    if edited:
        with session.write() as commit:
            for layer, place in edited.values():
                commit.put_layer(layer, contains=place)
    return list(edited)


def _continued(session: Session, record: LayerRecord, layer: Layer) -> tuple[Layer, Place]:
    """An edited layer with what its journal says that the XML did not contain yet, and the place that this is."""
    journal = Journal(session.path, record.name)
    place = Place(record.journal_revision, record.journal_bytes)
    if journal.size() <= place.offset:
        return layer, place
    document = Document(layer)
    for step, behind in journal.records(place):
        journal.apply(document, step)
        place = behind
    return document.layer(), place


def layer_from_journal(session: Session, record: LayerRecord) -> Layer:
    """A layer as it is in its XML, from its journal alone.

    Raises
    ------
    CorruptError : the journal does not tell all of it, from the beginning to where the XML was written.
    """
    journal, written = (
        Journal(session.path, record.name),
        Place(record.journal_revision, record.journal_bytes),
    )
    if journal.path.is_symlink():
        raise journal.damaged("a symbolic link, not the journal itself")
    layer, place = journal.replay(written.revision)
    if place != written:
        raise journal.damaged(f"revision {written.revision} does not end at byte {written.offset}")
    if layer.name != record.name:
        raise journal.damaged(f"it is that of layer {layer.name}")
    return layer


def rebuild_layer(session: Session, name: str) -> None:
    """Write the XML of a layer anew, from its journal; what is there instead is set aside.

    Raises
    ------
    NotFoundError : there is no such layer.
    CorruptError : the journal does not tell all of it.
    LockedError, DiskError, ReadOnlyError : the layer could not be written.
    """
    what = f"cannot make layer {name} from its journal"
    with session.hold() as manifest, files.typed_errors(what, session.path, "nothing was lost"):
        record = manifest.layer(name)
        if record is None:
            raise NotFoundError(
                what, where=f"{session.path}: it has no such layer", fix="name one of its layers"
            )
        data = layer_to_xml(layer_from_journal(session, record))
        path = files.confined(session.path, layer_file(name))
        files.make_folder(path.parent)
        new = path.with_name(f".{path.name}.{new_id()}.new")
        with files.NewFile(new) as file:
            file.write(data)
        files.sync(new)
        if path.exists() or path.is_symlink():
            files.rename(path, path.with_name(f"{name}.{new_id()}.old"))
        files.rename(new, path)
        files.sync(path.parent)
    if hashlib.sha256(data).hexdigest() != record.sha256:
        # the same layer, as another version of ecat writes it
        adopt_edited_layers(session.refresh())


def begin_journal(session: Session, name: str) -> None:
    """Let a layer begin a new journal, and set the old one, which does not fit it, aside.

    Raises
    ------
    NotFoundError : there is no such layer.
    """
    layer = session.layer(name)
    path = Journal(session.path, name).path
    with files.typed_errors(f"cannot begin a new journal of layer {name}", path, "nothing was changed"):
        if path.exists():
            files.rename(path, path.with_name(f"{name}.journal.{new_id()}.old"))
            files.sync(path.parent)
    with session.refresh().write() as commit:
        commit.put_checkpoint(layer, START)


def leftovers(path: Path) -> list[Path]:
    """What interrupted writes left behind: files that no commit will use, in a session; unfinished folders,
    in any folder and beside it.

    They do no harm, and a write that is under way looks the same; :func:`remove_leftovers` knows the
    difference.
    """
    noted = noted_files(path)
    found = [
        file
        for inner in _FOLDERS
        for file in (path / inner).glob(".*.new")
        if _NEW.fullmatch(file.name) and file not in noted
    ]
    place = path.resolve()
    found += [folder for folder in path.glob(".*.partial") if _PARTIAL.fullmatch(folder.name)]
    found += [
        folder
        for folder in place.parent.glob(".*.partial")
        if _PARTIAL.fullmatch(folder.name) and folder.name.startswith(f".{place.name}.")
    ]
    return sorted(found)


def remove_leftovers(path: Path) -> list[Path]:
    """Remove the :func:`leftovers` of writes that nobody is doing any more, and return what was removed.

    Raises
    ------
    ReadOnlyError, DiskError : one of them cannot be removed.
    """
    settle(path)
    removed: list[Path] = []
    for leftover in leftovers(path):
        with contextlib.suppress(LockedError), locked(leftover if leftover.is_dir() else path):
            with files.typed_errors(f"cannot remove {leftover.name}", leftover, "it is still there"):
                files.remove(leftover)
            removed.append(leftover)
    return removed
