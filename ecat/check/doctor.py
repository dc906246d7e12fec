"""Examine what is in a folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from ecat.check import disk
from ecat.check.advice import advice
from ecat.check.annotation import ANNOTATION
from ecat.check.clock import CLOCK
from ecat.check.finding import Check, Finding, Objects, Patient, error, note
from ecat.check.manifest import MANIFEST
from ecat.check.marks import MARKS
from ecat.check.references import REFERENCES
from ecat.check.schema import SCHEMA
from ecat.check.table import TABLE
from ecat.errors import EcatError, NotFoundError, SchemaError
from ecat.model import CodingScheme, Layer
from ecat.progress import Progress, silent
from ecat.store import (
    Session,
    find_sessions,
    open_project,
    open_session,
)
from ecat.store.manifest import PROJECT_FILE, SESSION_FILE, is_plain_name
from ecat.store.schemes import find_scheme
from ecat.store.transaction import COMMIT_FILE

CHECKS: tuple[Check, ...] = (*MANIFEST, *SCHEMA, *CLOCK, *MARKS, *TABLE, *REFERENCES, *ANNOTATION)
"""The checks of a session's content, in the order of their findings."""
Siblings = dict[Path, Objects]


def examine(patient: Patient) -> list[Finding]:
    """The findings of all :data:`CHECKS`."""
    # numbers at the end of their range are findings; on the way there they may overflow
    with np.errstate(all="ignore"):
        return [finding for check_ in CHECKS for finding in check_(patient)]


def check(path: Path, *, deep: bool = False, progress: Progress = silent) -> list[Finding]:
    """Examine a session, project or workspace.

    Parameters
    ----------
    deep : also compare the hashes of recorded files and tables, which reads every byte.

    Raises
    ------
    NotFoundError : there is no session at ``path``.
    """
    sessions = find_sessions(path)
    siblings: Siblings = {}
    seen: set[Path] = set()
    findings: list[Finding] = []
    for folder in sorted({path} | {p for s in sessions for p in s.parents if p.is_relative_to(path)}):
        if folder not in sessions:
            findings += _named(_check_project(folder, seen), folder, path)
    for i, session in enumerate(sessions):
        progress("checking", i, len(sessions))
        findings += _named(_check_session(session, siblings, seen, deep=deep), session, path)
    progress("checking", len(sessions), len(sessions))
    return findings


def _named(findings: Iterator[Finding], folder: Path, root: Path) -> list[Finding]:
    name = folder.relative_to(root).as_posix()
    return [replace(finding, session=name, fix=advice(finding, folder)) for finding in findings]


def _check_project(path: Path, seen: set[Path]) -> Iterator[Finding]:
    yield from disk.left_over(path, seen)
    if (path / PROJECT_FILE).exists():
        try:
            open_project(path)
        except EcatError as reason:
            yield from _unreadable("project-unreadable", path / PROJECT_FILE, reason)


def _unreadable(code: str, file: Path, reason: EcatError) -> Iterator[Finding]:
    """A finding for every problem of a manifest."""
    problems = reason.problems if isinstance(reason, SchemaError) else ()
    for problem in problems or (reason.where or reason.what,):
        message = problem.removeprefix(f"{file}: ").removeprefix(f"{file.parent}: ")
        yield error(code, file.name, message)


def _check_session(path: Path, siblings: Siblings, seen: set[Path], *, deep: bool) -> Iterator[Finding]:
    interrupted = (path / COMMIT_FILE).exists()
    try:
        session = open_session(path)
    except EcatError as reason:
        yield from _unreadable("session-unreadable", path / SESSION_FILE, reason)
        return
    if interrupted:
        yield note(
            "interrupted-commit", COMMIT_FILE, "a write was interrupted; it has been finished by opening"
        )
    yield from disk.left_over(path, seen)
    layers, found = disk.read_layers(session)
    found += disk.published_tables(session)
    found += disk.irregular_streams(session)
    found += disk.linked_journals(session)
    found += disk.damaged_files(session, found, deep=deep)
    found += disk.stale_tables(session, found)
    found += disk.unlisted_tables(session)
    siblings[path] = _objects(session, layers)
    yield from found if siblings[path] != "unreadable" else disk.unrepairable(found)

    @cache
    def table(name: str) -> pa.Table | None:
        return _table(session, name)

    patient = Patient(
        manifest=session.manifest,
        layers=layers,
        table=table,
        scheme=partial(_scheme, path),
        sibling=lambda name: _objects_of(path.parent / name, siblings) if is_plain_name(name) else None,
    )
    yield from examine(patient)


def _table(session: Session, name: str) -> pa.Table | None:
    """The rows, or None: why a table cannot be read is a finding of its own."""
    try:
        return session.table(name).to_arrow() if session.has_table(name) else None
    except EcatError:
        return None


def _scheme(path: Path, name: str) -> CodingScheme | None:
    """The coding scheme; what follows one that is not at hand is not compared with any."""
    try:
        return find_scheme(path, name) if name else None
    except EcatError:
        return None


def _objects_of(path: Path, siblings: Siblings) -> Objects:
    """The objects of the session at ``path``; kept in ``siblings``, as many sessions refer to one."""
    if path not in siblings:
        try:
            session = open_session(path)
            siblings[path] = _objects(session, disk.read_layers(session)[0])
        except NotFoundError:
            siblings[path] = None
        except EcatError:
            siblings[path] = "unreadable"
    return siblings[path]


def _objects(session: Session, layers: Mapping[str, Layer]) -> Objects:
    if len(layers) < len(session.manifest.layers):
        return "unreadable"
    return frozenset(thing.id for layer in layers.values() for thing in layer.objects)
