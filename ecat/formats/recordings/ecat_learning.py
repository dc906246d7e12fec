"""Event exports of ECAT 2018: every session in the file becomes one with a skeleton, two boxes and labelled events.

Source: ECAT 2018 file format §1.11.  A session that was not changed goes back into the file that it came from, byte for
byte.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Literal

from ecat.errors import FormatError, InputError
from ecat.formats.ecat2018.learning_export import ExportedSession, read_learning_export, write_learning_export
from ecat.formats.ecat2018.side_files import is_learning_export
from ecat.formats.format import ExportReport, Format, ImportOptions, ImportReport
from ecat.formats.options import NoOptions
from ecat.formats.recordings.learning_sessions import NAME, draft_of, exported, kept
from ecat.formats.recordings.several import folder_name
from ecat.model import ProjectManifest, Provenance
from ecat.progress import Progress
from ecat.store import (
    create_session,
    files,
    find_sessions,
    open_session,
    staged_file,
    staged_folder,
    write_new_file,
    write_project_manifest,
)

_SUFFIXES = (".txt", ".xml")


def sniff(path: Path) -> bool:
    """Whether it is an export, or a folder with some in it."""
    try:
        return bool(_exports(path)) if path.is_dir() else is_learning_export(path)
    except OSError:
        return False


def _exports(folder: Path) -> list[Path]:
    return [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in _SUFFIXES and is_learning_export(path)
    ]


# ---------------------------------------------------------------------------------------------- reading


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read an export into a session or, where it has several, a project; a folder of exports into a workspace.

    Raises
    ------
    FormatError : not an export, or no session in it.
    LimitError : a text or element too large.
    StoreError : ``dest`` is taken or cannot be written; nothing is left there.
    """
    what = f"cannot import {source.name}"
    if not source.is_dir():
        return _file(source, dest, options, progress)
    with files.typed_errors(what, source, "nothing was written"):
        found = _exports(source)
    if not found:
        raise FormatError(what, where=f"{source}: there is no event export of ECAT 2018 in it")
    if len(found) == 1:
        return _file(found[0], dest, options, progress)
    findings: list[str] = []
    taken: set[str] = set()
    sessions = 0
    with staged_folder(dest) as staging:
        _write_manifest(staging, "workspace", dest, source.resolve().name)
        for done, path in enumerate(found):
            progress(path.name, done, len(found))
            place = staging / folder_name(path.stem, taken, default="project")
            try:
                report = _file(path, place, options, progress, always_project=True)
            except InputError as error:
                if not options.keep_going or (path == found[-1] and not sessions):
                    raise
                findings.append(f"{path.name} was left out: {error.what}: {error.where}")
                continue
            sessions += report.sessions
            findings += [f"{path.name}: {finding}" for finding in report.findings]
    return ImportReport(path=dest, format=NAME, sessions=sessions, findings=tuple(findings))


def _file(
    path: Path, dest: Path, options: ImportOptions, progress: Progress, *, always_project: bool = False
) -> ImportReport:
    """One export, a session in memory at a time."""
    findings: list[str] = []
    sessions = _until_broken(read_learning_export(path), options, findings)
    first = next(sessions, None)
    if first is None:
        raise FormatError(f"cannot import {path.name}", where=f"{path}: there is no session in it")
    line_end = {"line_end": _line_end(path)}
    second = next(sessions, None)
    if second is None and not always_project:
        create_session(dest, draft_of(first, _name(dest), path.name, line_end))
        return ImportReport(path=dest, format=NAME, sessions=1, findings=(*first.findings, *findings))
    taken: set[str] = set()
    done = 0
    with staged_folder(dest) as staging:
        _write_manifest(staging, "project", dest, path.name)
        for one in chain([first], [second] if second is not None else [], sessions):
            progress(f"reading {path.name}", done, 0)
            name = folder_name(one.name, taken, default="session")
            create_session(staging / name, draft_of(one, name, path.name, line_end | {"place": str(done)}))
            findings += [f"{name}: {finding}" for finding in one.findings]
            done += 1
    return ImportReport(path=dest, format=NAME, sessions=done, findings=tuple(findings))


def _until_broken(
    sessions: Iterator[ExportedSession], options: ImportOptions, findings: list[str]
) -> Iterator[ExportedSession]:
    """The sessions; where those before a fault are to be kept, the fault is told instead of raised."""
    done = 0
    try:
        for one in sessions:
            done += 1
            yield one
    except InputError as error:
        if not options.keep_going or not done:
            raise
        findings.append(f"what follows was left out: {error.where}")


def _line_end(path: Path) -> str:
    with files.typed_errors(f"cannot import {path.name}", path), path.open("rb") as file:
        return "crlf" if file.readline(200).endswith(b"\r\n") else "lf"


def _name(dest: Path) -> str:
    return folder_name(dest.resolve().name, set(), default="session")


def _write_manifest(folder: Path, kind: Literal["project", "workspace"], dest: Path, source: str) -> None:
    manifest = ProjectManifest(
        kind=kind,
        name=_name(dest),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        provenance=Provenance(format=NAME, source=source),
    )
    write_project_manifest(folder, manifest)


# ---------------------------------------------------------------------------------------------- writing


def write(path: Path, dest: Path, options: NoOptions, progress: Progress) -> ExportReport:
    """Write a session or a project as one file, a workspace as a folder with a file for each project.

    Raises
    ------
    StoreError : ``path`` is no session, or ``dest`` is taken or cannot be written; nothing is left there.
    """
    del options
    sessions = find_sessions(path)
    findings: list[str] = []
    if all(path in (folder, folder.parent) for folder in sessions):
        with staged_file(dest) as staging:
            write_new_file(staging, _pieces(sessions, findings, progress))
    else:
        projects: dict[Path, list[Path]] = {}
        for folder in sessions:
            projects.setdefault(folder.parent, []).append(folder)
        taken: set[str] = set()
        with staged_folder(dest) as staging:
            for project, inside in projects.items():
                name = folder_name("_".join(project.relative_to(path).parts), taken, default="sessions")
                write_new_file(staging / f"{name}{_suffix(inside[0])}", _pieces(inside, findings, progress))
    return ExportReport(path=dest, format=NAME, sessions=len(sessions), findings=tuple(findings))


def _suffix(folder: Path) -> str:
    """As the file had it that the session came from; ECAT called its exports .txt."""
    suffix = Path(open_session(folder).manifest.provenance.source).suffix
    return suffix if suffix.lower() in _SUFFIXES else _SUFFIXES[0]


def _pieces(folders: Sequence[Path], findings: list[str], progress: Progress) -> Iterator[bytes]:
    """The file of these sessions, in the order in which they stood in the one they came from."""
    places = {folder: _place(kept(open_session(folder), "place")) for folder in folders}
    ordered = sorted(folders, key=lambda folder: places[folder])
    line_end = kept(open_session(ordered[0]), "line_end") if ordered else None

    def sessions() -> Iterator[ExportedSession]:
        for done, folder in enumerate(ordered):
            progress(folder.name, done, len(ordered))
            yield exported(open_session(folder), findings)

    yield from write_learning_export(sessions(), newline="\n" if line_end == "lf" else "\r\n")


def _place(text: str | None) -> float:
    """Sessions that were in no file come last."""
    return float(text) if text is not None and text.isdecimal() else float("inf")


FORMAT = Format(
    name=NAME,
    description="event exports of ECAT (2015-2018): a skeleton, two boxes and labelled windows",
    sniff=sniff,
    read=read,
    write=write,
)
