"""What a change of a session consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

from ecat.errors import UsageError
from ecat.model import Layer, LayerRecord, Manifest, TableRecord
from ecat.store import files
from ecat.store.manifest import SESSION_FILE, dump_manifest, is_file_name, layer_file, table_file
from ecat.store.parquet import TableData, write_table
from ecat.store.publish import publish
from ecat.store.transaction import NewFiles
from ecat.store.xml import layer_to_xml
from ecat.tables import PUBLISHED, SCHEMA_VERSION, TABLES

_PUBLISHED = {schema.name for schema in PUBLISHED}
_KEPT_BY_THE_STORE = {"schema_version", "revision", "layers", "tables"}
_MAY_BE_UPDATED = {field.name for field in fields(Manifest)} - _KEPT_BY_THE_STORE

R = TypeVar("R", LayerRecord, TableRecord)


class Commit:
    """A change of a session: all that is put in here counts once the block of ``session.write()`` ends."""

    def __init__(self, new: NewFiles, manifest: Manifest, read_layer: Callable[[str], Layer]) -> None:
        self._new = new
        self._before = manifest
        self._manifest = manifest
        self._read_layer = read_layer
        self._layers: dict[str, Layer] = {}
        self._publish = not manifest.tables

    def put_layer(self, layer: Layer) -> None:
        """Add an annotation layer, or replace the one of that name; the published tables follow."""
        if not is_file_name(layer.name):
            raise UsageError(
                f"cannot write layer {layer.name!r}", fix="letters, digits, '_', '-', '.' and spaces"
            )
        old = self._before.layer(layer.name)
        file = layer_file(layer.name)
        sha256 = self._write(file, layer_to_xml(layer))
        record = LayerRecord(
            name=layer.name, file=file, sha256=sha256, revision=old.revision + 1 if old else 1
        )
        self._manifest = replace(self._manifest, layers=_with(self._manifest.layers, record))
        self._layers[layer.name] = layer
        self._publish = True

    def put_table(self, name: str, table: TableData) -> None:
        """Add the table called ``name``, or replace it; rows that come as an iterable are consumed now."""
        if name not in TABLES or name in _PUBLISHED:
            why = (
                "follows from the layers, put those"
                if name in _PUBLISHED
                else f"known tables: {', '.join(TABLES)}"
            )
            raise UsageError(f"cannot write table {name}", where=why)
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
                f"cannot update {', '.join(wrong)}", where=f"one of {', '.join(sorted(_MAY_BE_UPDATED))}"
            )
        self._manifest = replace(self._manifest, **manifest_fields)
        self._publish = True

    def copy_streams(self, sources: Mapping[str, Path]) -> None:
        """Copy a file for each stream named, to where the stream's ``file`` says."""
        copied: dict[str, tuple[Path, int]] = {}
        streams = {stream.name: stream for stream in self._manifest.streams}
        for name, source in sources.items():
            stream = streams.get(name)
            if stream is None or not stream.file.startswith("media/"):
                raise UsageError(
                    f"cannot copy the file of stream {name}", where="no such stream with a file in media/"
                )
            if copied.get(stream.file, (source, 0))[0] != source:
                raise UsageError(f"cannot copy the file of stream {name}", where=f"{stream.file} is taken")
            if stream.file not in copied:
                with self._new.open(stream.file) as file:
                    files.copy(source, file)
                copied[stream.file] = (source, file.size)
            facts = {
                "present": True,
                "size_bytes": copied[stream.file][1],
                "sha256": self._new.sha256[stream.file],
            }
            streams[name] = replace(stream, **facts)
        self._manifest = replace(self._manifest, streams=tuple(streams.values()))

    def close(self, revision: int) -> bool:
        """Write what follows from what was put, published tables and manifest; false if nothing was put."""
        if self._manifest == self._before and not self._new.sha256 and not self._publish:
            return False
        if self._publish:
            self._put_published()
        manifest = replace(self._manifest, revision=revision)
        self._write(SESSION_FILE, dump_manifest(manifest, self._new.folder / SESSION_FILE))
        return True

    def _put_published(self) -> None:
        records = self._manifest.layers
        layers = [self._layers.get(record.name) or self._read_layer(record.name) for record in records]
        inputs = {record.name: record.sha256 for record in records}
        for name, rows in publish(layers, self._manifest).items():
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
