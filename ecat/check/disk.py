"""Is the session's folder sound: files as the manifest says, current tables, no leftovers of a crash."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ecat.check.finding import Finding, error, warning
from ecat.errors import EcatError, SchemaError
from ecat.model import Layer, LayerRecord
from ecat.store import Fault, Session, files, leftovers, validate
from ecat.store.manifest import layer_file
from ecat.store.xml import MAX_BYTES, layer_from_xml
from ecat.tables import PUBLISHED

PUBLISHED_NAMES = frozenset(schema.name for schema in PUBLISHED)
REPUBLISH = "publish the tables of the annotations anew"
ADOPT = "take the edit over and publish its tables anew"
REMOVE = "remove it"


def left_over(folder: Path, seen: set[Path]) -> Iterator[Finding]:
    """What an interrupted write or import left in a folder and beside it, save for what was ``seen``."""
    for path in leftovers(folder):
        if (place := path.resolve()) not in seen:
            seen.add(place)
            yield warning("leftover", path.name, "left behind by a write that was interrupted", REMOVE)


def read_layers(session: Session) -> tuple[dict[str, Layer], list[Finding]]:
    """The readable layers (those edited outside of ecat as they are now), and what is wrong with them."""
    layers: dict[str, Layer] = {}
    findings: list[Finding] = []
    for record in session.manifest.layers:
        try:
            layers[record.name] = session.layer(record.name)
        except EcatError as damage:
            try:
                layers[record.name] = _edited(session, record)
            except EcatError as reason:
                findings += _unreadable(record, reason)
            else:
                place = f"layer {record.name}"
                message = damage.where.partition(": ")[2] or damage.what
                findings.append(error("layer-edited", place, message, ADOPT))
    if len(layers) < len(session.manifest.layers):
        findings = [replace(finding, repair="") for finding in findings]  # publishing needs all of them
    return layers, findings


def _edited(session: Session, record: LayerRecord) -> Layer:
    path = files.confined(session.path, layer_file(record.name))
    with files.typed_errors(f"cannot read layer {record.name}", path):
        return layer_from_xml(files.read_bytes(path, MAX_BYTES), name=record.name)


def _unreadable(record: LayerRecord, reason: EcatError) -> Iterator[Finding]:
    problems = reason.problems if isinstance(reason, SchemaError) else ()
    for problem in problems or (reason.where or reason.what,):
        yield error("layer-unreadable", f"layer {record.name}", problem)


def stale_tables(session: Session) -> Iterator[Finding]:
    """Tables made from annotations or tables that have changed since."""
    manifest = session.manifest
    layers = {record.name: record.sha256 for record in manifest.layers}
    for record in manifest.tables:
        if record.name in PUBLISHED_NAMES and record.inputs != layers:
            message = "it was made from other revisions of the annotations"
            yield error("table-stale", f"table {record.name}", message, REPUBLISH)
    if all(record.name in PUBLISHED_NAMES or not record.stage for record in manifest.tables):
        return
    from ecat import process

    try:
        for name, changed in process.stale_tables(session):
            yield warning(
                "table-stale", f"table {name}", f"it was made from an older {changed}; run ecat process"
            )
    except EcatError:
        return  # a table that cannot be read is a finding of its own


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
    for table in session.manifest.tables:
        if table.file == fault.file:
            place = f"table {table.name}"
            if table.name in PUBLISHED_NAMES:
                return error("table-damaged", place, message, REPUBLISH)
            way_out = f"; make it anew: ecat process --stage {table.stage} --force" if table.stage else ""
            return error("table-damaged", place, message + way_out)
    for layer in session.manifest.layers:
        if layer.file == fault.file:
            return error("layer-unreadable", f"layer {layer.name}", message)
    names = [stream.name for stream in session.manifest.streams if stream.file == fault.file]
    return error("stream-damaged", f"stream {', '.join(names)}", message)
