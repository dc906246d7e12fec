"""What a change of a session consists of."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ecat.errors import StaleError, UsageError
from ecat.model import Layer, LayerRecord, Manifest, Stream, TableRecord
from ecat.model.annotation import with_relation_ids
from ecat.store import files
from ecat.store.journal import START, Journal, Place, replacement
from ecat.store.manifest import SESSION_FILE, dump_manifest, is_layer_name, layer_file, table_file
from ecat.store.parquet import TableData, write_table
from ecat.store.publish import publish
from ecat.store.schemes import scheme_or_default
from ecat.store.together import run_together
from ecat.store.transaction import COMMIT_FILE, NewFiles
from ecat.store.xml import layer_to_xml
from ecat.tables import PUBLISHED, SCHEMA_VERSION, TABLES

_PUBLISHED = {schema.name for schema in PUBLISHED}
_KEPT_BY_THE_STORE = {"schema_version", "revision", "layers", "tables"}
_MAY_BE_UPDATED = {field.name for field in fields(Manifest)} - _KEPT_BY_THE_STORE

R = TypeVar("R", LayerRecord, TableRecord)


class Commit:
    """A change of a session: all that is put in here counts once the block of ``session.write()`` ends.

    ``moved_on`` are the layers that others have changed since the one who writes has read them.
    """

    def __init__(
        self,
        new: NewFiles,
        manifest: Manifest,
        read_layer: Callable[[str], Layer],
        moved_on: Collection[str] = (),
    ) -> None:
        self._new = new
        self._before = manifest
        self._manifest = manifest
        self._read_layer = read_layer
        self._moved_on = moved_on
        self._layers: dict[str, Layer] = {}
        self._journals: dict[str, Place] = {}
        self._publish = not manifest.tables

    def put_layer(self, layer: Layer, *, contains: Place | None = None) -> None:
        """Add an annotation layer, or replace the one of that name; the published tables follow.

        The journal of a layer gets a record of the replacement, and loses nothing.  ``contains`` is how much of it
        ``layer`` takes into account, as much as the layer's XML by default.

        Raises
        ------
        StaleError : others have changed the layer since it was read.
        """
        if layer.name in self._moved_on:
            raise self._stale(layer.name)
        self._put_layer(layer)
        old = self._before.layer(layer.name)
        if Journal(self._new.folder, layer.name).size():
            known = Place(old.journal_revision, old.journal_bytes) if old else START
            self._journals[layer.name] = contains or known

    def put_checkpoint(self, layer: Layer, place: Place) -> None:
        """Replace a layer by what it is at a place of its journal."""
        self._journals.pop(layer.name, None)
        self._put_layer(layer, place)

    def _put_layer(self, layer: Layer, place: Place = START) -> None:
        if not is_layer_name(layer.name):
            raise UsageError(
                f"cannot write layer {layer.name!r}",
                where="a layer's name becomes that of a file",
                fix="take letters, digits, '_', '-', '.' and spaces",
            )
        old = self._before.layer(layer.name)
        file = layer_file(layer.name)
        record = LayerRecord(
            name=layer.name,
            file=file,
            sha256=self._write(file, layer_to_xml(layer)),
            revision=old.revision + 1 if old else 1,
            journal_revision=place.revision,
            journal_bytes=place.offset,
        )
        self._manifest = replace(self._manifest, layers=_with(self._manifest.layers, record))
        self._layers[layer.name] = layer
        self._publish = True

    def _continue_journal(self, name: str, contains: Place, until_committed: ExitStack) -> None:
        """Record that a layer is replaced; nobody else appends until the commit is done, or has failed."""
        journal = Journal(self._new.folder, name)
        held = until_committed.enter_context(journal.hold())
        if held.news(contains):
            raise self._stale(name)
        old, place = journal.replay(contains.revision)
        record = replacement(place.revision + 1, old, with_relation_ids(self._layers[name]))
        if record.changes:
            place = until_committed.enter_context(
                held.appended(place, record, is_final=(self._new.folder / COMMIT_FILE).exists)
            )
        mine = self._manifest.layer(name)
        if mine is not None:
            mine = replace(mine, journal_revision=place.revision, journal_bytes=place.offset)
            self._manifest = replace(self._manifest, layers=_with(self._manifest.layers, mine))

    def _stale(self, name: str) -> StaleError:
        return StaleError(
            f"cannot replace layer {name}",
            where=f"{self._new.folder}: others have edited it since it was read",
            consequence="nothing was written",
            fix="run it again; in Python, session.refresh() first",
        )

    def put_table(self, name: str, table: TableData) -> None:
        """Add the table called ``name``, or replace it; rows that come as an iterable are consumed now."""
        if name not in TABLES or name in _PUBLISHED:
            why, fix = "there is no such table", f"name one of {', '.join(TABLES)}"
            if name in _PUBLISHED:
                why, fix = "it follows from the layers", "put those instead"
            raise UsageError(f"cannot write table {name}", where=why, fix=fix)
        self._put_table(name, table)

    def put_prototypes(self, prototypes: Sequence[Mapping[str, object]]) -> None:
        """Replace what is known of the boxes (:meth:`ecat.model.prototype.BoxPrototype.to_dict`)."""
        self._manifest = replace(
            self._manifest, prototypes=tuple(dict(prototype) for prototype in prototypes)
        )

    def update(self, **manifest_fields: Any) -> None:
        """Replace fields of the manifest; the store keeps revision, layers and tables itself."""
        if wrong := sorted(set(manifest_fields) - _MAY_BE_UPDATED):
            raise UsageError(
                f"cannot update {', '.join(wrong)}",
                where="the store keeps these itself, or they never change",
                fix=f"update {', '.join(sorted(_MAY_BE_UPDATED))}",
            )
        self._manifest = replace(self._manifest, **manifest_fields)
        self._publish = True

    def copy_streams(self, sources: Mapping[str, Path]) -> None:
        """Copy a file for each stream named, to where the stream's ``file`` says."""
        copied: dict[str, Path] = {}
        for name, source in sources.items():
            target = self._media_file(name, "copy")
            if copied.get(target, source) != source:
                fix = "give each stream a file of its own"
                raise UsageError(
                    f"cannot copy the file of stream {name}", where=f"{target} is taken", fix=fix
                )
            if target not in copied:
                with self._new.open(target) as file:
                    files.copy(source, file)
                copied[target] = source
            self._there(name)

    def write_streams(self, writers: Mapping[str, Callable[[Path], None]], *, in_order: bool = False) -> None:
        """Let a function write the file of each stream named; it is given the path to write to.

        They are called in threads, side by side, or ``in_order``.

        Raises
        ------
        UsageError : no such stream, two with one file; or the session was there before: recordings are not replaced.
        """
        if self._new.id:
            fix = "write them when the session is made, or copy finished files into it"
            raise UsageError("cannot write streams", where="the session was there before", fix=fix)
        works: list[Callable[[], None]] = []
        for name, write in writers.items():
            target = self._media_file(name, "write")
            if target in self._new.sha256:
                fix = "give each stream a file of its own"
                raise UsageError(
                    f"cannot write the file of stream {name}", where=f"{target} is taken", fix=fix
                )
            works.append(self._new.to_be_written(target, write))
        if in_order:
            for work in works:
                work()
        else:
            run_together(works)
        for name in writers:
            self._there(name)

    def revise(self, change: Callable[[Manifest], Manifest]) -> None:
        """Replace the manifest by what ``change`` makes of it; layers and tables stay the store's."""
        changed = change(self._manifest)
        self._manifest = replace(changed, layers=self._manifest.layers, tables=self._manifest.tables)

    def _media_file(self, name: str, verb: str) -> str:
        stream = next((stream for stream in self._manifest.streams if stream.name == name), None)
        if stream is None or not stream.file.startswith("media/"):
            raise UsageError(
                f"cannot {verb} the file of stream {name}",
                where="no such stream with a file in media/",
                fix="declare the stream in the manifest",
            )
        return stream.file

    def _there(self, name: str) -> None:
        """Record size and hash of the file that a stream has now."""

        def known(stream: Stream) -> Stream:
            size, sha256 = self._new.path(stream.file).stat().st_size, self._new.sha256[stream.file]
            return replace(stream, present=True, size_bytes=size, sha256=sha256)

        streams = tuple(known(s) if s.name == name else s for s in self._manifest.streams)
        self._manifest = replace(self._manifest, streams=streams)

    def close(self, revision: int, until_committed: ExitStack) -> bool:
        """Write what follows from what was put, published tables and manifest; false if nothing was put.

        What the journals got is taken back if the block of ``until_committed`` fails.
        """
        if self._manifest == self._before and not self._new.sha256 and not self._publish:
            return False
        for name, contains in self._journals.items():
            self._continue_journal(name, contains, until_committed)
        if self._publish:
            self._put_published()
        manifest = replace(self._manifest, revision=revision)
        self._write(SESSION_FILE, dump_manifest(manifest, self._new.folder / SESSION_FILE))
        return True

    def _put_published(self) -> None:
        records = self._manifest.layers
        layers = [self._layers.get(record.name) or self._read_layer(record.name) for record in records]
        inputs = {record.name: record.sha256 for record in records}
        tables = publish(layers, self._manifest, partial(scheme_or_default, self._new.folder))
        for name, rows in tables.items():
            self._put_table(name, TableData(data=rows, stage="publish", stage_version="1", inputs=inputs))

    def _put_table(self, name: str, table: TableData) -> None:
        file = table_file(name)
        errors = files.typed_errors(
            f"cannot write table {name}", self._new.folder / file, "nothing was changed"
        )
        with errors, self._new.open(file) as new:
            rows = write_table(new, name, table)
        record = TableRecord(
            name=name,
            file=file,
            sha256=self._new.sha256[file],
            rows=rows,
            schema_version=SCHEMA_VERSION,
            stage=table.stage,
            stage_version=table.stage_version,
            parameters=table.parameters,
            inputs=table.inputs,
        )
        self._manifest = replace(self._manifest, tables=_with(self._manifest.tables, record))

    def _write(self, file: str, data: bytes) -> str:
        with files.typed_errors(f"cannot write {file}", self._new.folder / file, "nothing was changed"):
            return self._new.write(file, data)


def _with(records: tuple[R, ...], record: R) -> tuple[R, ...]:
    others = [other for other in records if other.name != record.name]
    return tuple(sorted([*others, record], key=lambda item: item.name))
