"""Is the session's folder sound: files as the manifest says, current tables, no leftovers of a crash."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from ecat import process
from ecat.check.finding import Finding, error, warning
from ecat.errors import EcatError, SchemaError
from ecat.model import Layer, LayerRecord
from ecat.store import Fault, Session, files, layer_from_journal, leftovers, validate
from ecat.store.manifest import journal_file, layer_file, table_file
from ecat.store.xml import MAX_BYTES, layer_from_xml
from ecat.tables import PUBLISHED, TABLES

PUBLISHED_NAMES = frozenset(schema.name for schema in PUBLISHED)
REPUBLISH = "publish the tables of the annotations anew"
ADOPT = "take the edit over and publish its tables anew"
REMOVE = "remove it"
RERUN = "run the stage that made it again"
NEW_JOURNAL = "set the journal aside and begin a new one"
REBUILD = "write it anew from its journal, and set aside what is there"


def left_over(folder: Path, seen: set[Path]) -> Iterator[Finding]:
    """What an interrupted write or import left in a folder and beside it, save for what was ``seen``."""
    for path in leftovers(folder):
        if (place := path.resolve()) not in seen:
            seen.add(place)
            yield warning("leftover", path.name, "left behind by a write that was interrupted", REMOVE)


def read_layers(session: Session) -> tuple[dict[str, Layer], list[Finding]]:
    """The layers that can be had (those edited outside of ecat as they are now, and those that only their journal
    tells), and what is wrong with them.
    """
    layers: dict[str, Layer] = {}
    findings: list[Finding] = []
    for record in session.manifest.layers:
        try:
            layers[record.name] = session.layer(record.name)
        except EcatError as damage:
            place = f"layer {record.name}"
            try:
                layers[record.name] = _edited(session, record)
            except EcatError as reason:
                layer, why_not = _from_journal(session, record)
                if layer is not None:
                    layers[record.name] = layer
                repair = "" if layer is None else REBUILD
                findings += [
                    error("layer-unreadable", place, problem + why_not, repair)
                    for problem in _problems(reason)
                ]
            else:
                message = damage.where.partition(": ")[2] or damage.what
                findings.append(error("layer-edited", place, message, ADOPT))
    if len(layers) < len(session.manifest.layers):
        findings = unrepairable(findings)
    return layers, findings


def unrepairable(findings: Iterable[Finding]) -> list[Finding]:
    """The findings of a session some layer of which cannot be read: publishing needs all of them."""
    return [replace(f, repair="") if f.repair in {ADOPT, REPUBLISH} else f for f in findings]


def _edited(session: Session, record: LayerRecord) -> Layer:
    path = files.confined(session.path, layer_file(record.name))
    with files.typed_errors(f"cannot read layer {record.name}", path):
        return layer_from_xml(files.read_bytes(path, MAX_BYTES), name=record.name)


def _from_journal(session: Session, record: LayerRecord) -> tuple[Layer | None, str]:
    """A layer as its journal tells it, or why it does not."""
    if not record.journal_revision and not (session.path / journal_file(record.name)).exists():
        return None, ""
    try:
        return layer_from_journal(session, record), ""
    except EcatError as reason:
        return None, f"; its journal cannot replace it: {reason.where.partition(': ')[2] or reason.what}"


def _problems(reason: EcatError) -> tuple[str, ...]:
    problems = reason.problems if isinstance(reason, SchemaError) else ()
    return problems or (reason.where or reason.what,)


def linked_journals(session: Session) -> Iterator[Finding]:
    """Journals that are symbolic links: nothing is appended to what a link names, wherever it leads."""
    for path in sorted((session.path / "annotations").glob("*.journal.jsonl")):
        if path.is_symlink():
            place = f"layer {path.name.removesuffix('.journal.jsonl')}, journal"
            message = f"it is a symbolic link to {path.readlink()}: the layer cannot be edited"
            yield error("journal-link", place, message)


def published_tables(session: Session) -> Iterator[Finding]:
    """Tables of the annotations that are not those of the layers as they are."""
    manifest = session.manifest
    layers = {record.name: record.sha256 for record in manifest.layers}
    for name in sorted(PUBLISHED_NAMES):
        record = manifest.table(name)
        if record is None:
            message = "session.json does not list it, though every session has it"
            yield error("table-missing", f"table {name}", message, REPUBLISH)
        elif record.inputs != layers:
            message = "it was made from other revisions of the annotations"
            yield error("table-stale", f"table {name}", message, REPUBLISH)


def unlisted_tables(session: Session) -> Iterator[Finding]:
    """Files of tables that the manifest does not know, so that nothing reads them."""
    known = {record.name for record in session.manifest.tables} | PUBLISHED_NAMES
    for name in sorted(TABLES.keys() - known):
        if (session.path / table_file(name)).is_file():
            message = f"{table_file(name)} is there, but session.json does not list it: nothing reads it"
            yield error("table-unlisted", f"table {name}", message)


def stale_tables(session: Session, known: list[Finding]) -> Iterator[Finding]:
    """Tables that their stage would make otherwise now, save for those of ``known`` findings."""
    explained = {finding.place for finding in known}
    try:
        for name, changed in process.stale_tables(session):
            if f"table {name}" not in explained:
                message = f"changed since it was made: {changed}"
                yield warning("table-stale", f"table {name}", message, RERUN)
    except EcatError:
        return  # what cannot be read is a finding of its own


def irregular_streams(session: Session) -> Iterator[Finding]:
    """Recorded files that are no files: folders, pipes, devices."""
    for file in dict.fromkeys(stream.file for stream in session.manifest.streams if stream.present):
        path = session.path / file
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "a pipe or a device"
            yield error("stream-damaged", _stream_place(session, file), f"{file} is {what}, not a file")


def _stream_place(session: Session, file: str) -> str:
    names = [stream.name for stream in session.manifest.streams if stream.file == file]
    return f"stream {', '.join(names)}"


def damaged_files(session: Session, known: list[Finding], *, deep: bool) -> Iterator[Finding]:
    """Files that are missing or not as the manifest says, save for what ``known`` findings explain."""
    explained = {finding.place for finding in known}
    layers_sound = not any(finding.place.startswith("layer ") for finding in known)
    for fault in validate(session, deep=deep):
        finding = _damage(session, fault)
        published = finding.place.removeprefix("table ") in PUBLISHED_NAMES
        if finding.place not in explained and (layers_sound or not published):
            yield finding


def _damage(session: Session, fault: Fault) -> Finding:
    # the error of the store begins with the path, which `place` says already
    message = fault.problem.removeprefix(f"{session.path / fault.file}: ")
    made_by = process.made_by(session)
    for table in session.manifest.tables:
        if table.file == fault.file:
            place = f"table {table.name}"
            if table.name in PUBLISHED_NAMES:
                return error("table-damaged", place, message, REPUBLISH)
            return error("table-damaged", place, message, RERUN if table.name in made_by else "")
    for layer in session.manifest.layers:
        if layer.file == fault.file:
            return error("layer-unreadable", f"layer {layer.name}", message)
        if fault.file == journal_file(layer.name):
            return error("journal-misfit", f"layer {layer.name}, journal", message, NEW_JOURNAL)
    return error("stream-damaged", _stream_place(session, fault.file), message)
