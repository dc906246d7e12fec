"""A session as it was at one revision, and the rule by which a reader never gets a mix of two."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from ecat.errors import CorruptError, LimitError, NotFoundError, StaleError
from ecat.model import Layer, LayerRecord, Manifest, TableRecord
from ecat.store import files
from ecat.store.manifest import SESSION_FILE, parse_manifest, read_manifest_bytes
from ecat.store.transaction import settle
from ecat.store.xml import MAX_BYTES as MAX_LAYER_BYTES
from ecat.store.xml import layer_from_xml
from ecat.tables import PUBLISHED, SCHEMA_VERSION, TABLES

T = TypeVar("T")
_EDITED = "edited outside of ecat, the tables made from it are out of date"
_PUBLISHED = {schema.name for schema in PUBLISHED}
_STAGES = {
    "markers_2d": "track",
    "face_planes": "face_planes",
    "table_plane": "plane",
    "table_outline": "outline",
    "tracks_2d": "hull",
    "hulls": "hull",
    "poses": "pose",
    "poses_smooth": "smooth",
    "relation_proposals": "relations",
    "event_proposals": "propose",
}


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The manifest of the session in ``path``, and the sha256 of the ``session.json`` that it is from."""

    path: Path
    manifest: Manifest
    sha256: str

    @classmethod
    def read(cls, path: Path) -> Snapshot:
        """Read ``session.json``, nothing else."""
        with files.typed_errors(f"cannot open session {path.name}", path):
            data = read_manifest_bytes(path)
        return cls(
            path, parse_manifest(data, path / SESSION_FILE, Manifest), hashlib.sha256(data).hexdigest()
        )

    def confirm(self, record: TableRecord | LayerRecord) -> None:
        """Call after opening the record's file: returns if what was opened is what the record describes.

        Writers replace a file only while ``commit.json`` is there, and ``session.json`` before it goes.

        Raises
        ------
        StaleError : a later commit has replaced the file.
        """
        settle(self.path)
        data = read_manifest_bytes(self.path)
        if hashlib.sha256(data).hexdigest() == self.sha256:
            return
        now = parse_manifest(data, self.path / SESSION_FILE, Manifest)
        find = now.table if isinstance(record, TableRecord) else now.layer
        if find(record.name) != record:
            raise self.stale(now.revision)

    def stale(self, revision: int) -> StaleError:
        """The error for a session that has moved on to ``revision``."""
        return StaleError(
            f"cannot use session {self.path.name} as it was opened",
            where=f"{self.path}: opened at revision {self.manifest.revision}, now at {revision}",
            consequence="nothing was read or written",
            fix="run it again; in Python, session.refresh() first",
        )

    def damaged(self, record: TableRecord | LayerRecord, why: str) -> CorruptError:
        """The error for a file that is not what its record says."""
        return CorruptError(
            f"cannot read {record.file} of session {self.path.name}",
            where=f"{self.path / record.file}: {why}",
            consequence="the rest of the session is unaffected",
            fix=f"ecat check {self.path}",
        )

    def layer(self, name: str) -> Layer:
        """The annotation layer called ``name``."""
        record = self.manifest.layer(name)
        if record is None:
            known = ", ".join(layer.name for layer in self.manifest.layers) or "none"
            raise NotFoundError(
                f"cannot read layer {name}",
                where=f"{self.path}: the layers are: {known}",
                fix="name one of them",
            )
        path = files.confined(self.path, record.file)
        with files.typed_errors(f"cannot read layer {name}", path):
            data = files.read_bytes(path, MAX_LAYER_BYTES)
        if hashlib.sha256(data).hexdigest() != record.sha256:
            self.confirm(record)
            raise self.damaged(record, _EDITED)
        return layer_from_xml(data, name=name)

    def table_record(self, name: str) -> TableRecord:
        """The record of the table called ``name``."""
        if name not in TABLES:
            known = ", ".join(TABLES)
            raise NotFoundError(
                f"cannot read table {name}", where=f"known tables: {known}", fix="name one of them"
            )
        record = self.manifest.table(name)
        if record is not None:
            return record
        stage = _STAGES.get(name)
        raise NotFoundError(
            f"cannot read table {name} of session {self.path.name}",
            where=f"{self.path}: "
            + (f"stage {stage} has not run" if stage else "the recording has no such data"),
            fix=f"ecat process {self.path}" if stage else f"ecat info {self.path} lists the tables there are",
        )

    def read_table(self, record: TableRecord, read: Callable[[pq.ParquetFile], T]) -> T:
        """What ``read`` makes of the record's file."""
        path = files.confined(self.path, record.file)
        with files.typed_errors(f"cannot read table {record.name}", path), open_source(path) as source:
            # the open file stays what it is when its name is given to another one
            self.confirm(record)
            try:
                file = pq.ParquetFile(source, page_checksum_verification=True)
                if why := mismatch(file, record):
                    raise self.damaged(record, why)
                return read(file)
            except (pa.ArrowException, OSError) as error:
                raise self.damaged(record, str(error).splitlines()[0]) from error
            except MemoryError:
                raise LimitError(
                    f"cannot read table {record.name}",
                    where=f"{path}: more rows than fit into memory",
                    consequence="nothing was read",
                    fix="read a slice of it: start, end, columns",
                ) from None

    def confirm_layer(self, record: LayerRecord) -> None:
        """Returns if the XML of a layer is what the record describes; errors as in :meth:`layer`."""
        path = files.confined(self.path, record.file)
        with files.typed_errors(f"cannot read layer {record.name}", path):
            if files.sha256_of(path) != record.sha256:
                self.confirm(record)
                raise self.damaged(record, _EDITED)

    def confirm_layers(self, record: TableRecord) -> None:
        """Returns if the layers that a published table was made from are as they were."""
        if record.name not in _PUBLISHED:
            return
        for layer in self.manifest.layers:
            if files.sha256_of(files.confined(self.path, layer.file)) != layer.sha256:
                self.confirm(layer)
                raise self.damaged(
                    record, f"{layer.file} was edited outside of ecat, these rows are out of date"
                )


def open_source(path: Path) -> pa.NativeFile:
    """Open a Parquet file for reading."""
    files.open_regular(path).close()
    return pa.OSFile(str(path), "rb")


def mismatch(file: pq.ParquetFile, record: TableRecord) -> str:
    """What the file itself says against its record, or nothing."""
    if record.schema_version > SCHEMA_VERSION:
        return f"written by a newer ecat (table schema {record.schema_version})"
    if file.metadata.num_rows != record.rows:
        return f"{file.metadata.num_rows} rows, expected {record.rows}"
    metadata = file.schema_arrow.metadata or {}
    if metadata.get(b"ecat.inputs", b"{}") != json.dumps(record.inputs).encode():
        return "made from other inputs than the manifest says"
    known = TABLES.get(record.name)
    if known is None or file.schema_arrow.equals(known.arrow, check_metadata=False):
        return ""
    return "its columns are not those of the table's schema"
