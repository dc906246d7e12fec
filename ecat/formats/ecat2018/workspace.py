"""ECAT sessions, projects and workspaces as folders (ECAT 2018 file format §1.1), in and out.

A folder with ``files.param`` is a session; a folder with sessions is a project, and its other folders are
empty sessions; a folder of projects is a workspace.  Projects may keep a list of sessions
(``<project>.project``), stale or not: it comes out again as it was.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from ecat.errors import EcatError, FormatError, InputError, os_error
from ecat.formats.ecat2018.elements import PREFIX
from ecat.formats.ecat2018.project_list import ProjectList, read_project_list, write_project_list
from ecat.formats.ecat2018.session_folder import SESSION_FILE, draft_of, write_session
from ecat.formats.format import ExportReport, ImportOptions, ImportReport
from ecat.formats.options import option
from ecat.model import ProjectManifest, Provenance
from ecat.progress import Progress
from ecat.store import (
    files,
    fill_session,
    find_sessions,
    open_project,
    open_session,
    staged_folder,
    write_new_file,
    write_project_manifest,
)
from ecat.store.manifest import PROJECT_FILE, is_inside

NAME = "ecat-2018"
MAX_DEPTH = 8
_WORKERS = 2
_MANY = 20  # failures named in one error


@dataclass(frozen=True, slots=True, kw_only=True)
class Ecat2018Options:
    """How to write."""

    layer: str = option("", "whose annotation, as ECAT has one; nothing: main, else the first of a person")


@dataclass
class Node:
    """A folder of the source tree: a session, a project or a workspace."""

    path: Path
    kind: str
    children: list[Node] = field(default_factory=list["Node"])

    def sessions(self) -> Iterator[Node]:
        """The sessions at and below this folder."""
        if self.kind == "session":
            yield self
        for child in self.children:
            yield from child.sessions()


def sniff(path: Path) -> bool:
    """Whether ``path`` is a ``files.param`` or a folder with sessions of ECAT at any depth."""
    if path.is_file():
        return path.name == SESSION_FILE
    return any(SESSION_FILE in names for _, _, names in _walk(path))


def _walk(path: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    for folder, inner, names in os.walk(path):
        depth = len(Path(folder).relative_to(path).parts)
        inner[:] = sorted(name for name in inner if not name.startswith(".")) if depth < MAX_DEPTH else []
        yield folder, inner, names


def tree_of(path: Path) -> Node | None:
    """The sessions below ``path`` as a tree, or ``None`` if there are none.

    Links to folders are followed only inside ``path``.
    """
    try:
        return _tree(path, {path.resolve()}, path.resolve(), MAX_DEPTH)
    except OSError as error:
        raise os_error(error, f"cannot import {path}", path, "nothing was written") from error


def _tree(path: Path, seen: set[Path], root: Path, depth: int) -> Node | None:
    if (path / SESSION_FILE).is_file():
        return Node(path, "session")
    if depth == 0:
        return None
    inner = [
        child
        for child in sorted(path.iterdir())
        if child.is_dir()
        and not child.name.startswith(".")
        and child.resolve().is_relative_to(root)
        # a link may lead back: each folder counts once
        and child.resolve() not in seen
    ]
    seen |= {child.resolve() for child in inner}
    nodes = [(child, _tree(child, seen, root, depth - 1)) for child in inner]
    is_project = any(node is not None and node.kind == "session" for _, node in nodes)
    children = [
        node if node is not None else Node(child, "session")
        for child, node in nodes
        if node is not None or is_project
    ]
    has_list = any(child.suffix == ".project" and child.is_file() for child in path.iterdir())
    if not children and not has_list:
        return None
    return Node(path, "project" if is_project or not children else "workspace", children)


# ---------------------------------------------------------------------------------------------- reading


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Import a session, project or workspace; see :class:`ecat.formats.format.Reader`."""
    node = _source(source)
    if node.kind == "session":
        findings: list[str] = []
        progress(node.path.name, 0, 1)
        draft = draft_of(node.path, options, findings)
        with staged_folder(dest) as staging:
            fill_session(staging, draft, dest)
        progress(node.path.name, 1, 1)
        return ImportReport(path=dest, format=NAME, sessions=1, findings=tuple(findings))
    work = _Import(options, progress, sum(1 for _ in node.sessions()))
    with staged_folder(dest) as staging:
        work.tree(node, staging)
        work.raise_failures(source, dest)
    return ImportReport(path=dest, format=NAME, sessions=work.done, findings=tuple(work.findings))


def _source(source: Path) -> Node:
    try:
        folder = source.parent if source.is_file() and source.name == SESSION_FILE else source
        is_folder = folder.is_dir()
    except OSError as error:
        raise os_error(error, f"cannot import {source}", source, "nothing was written") from error
    # `.` has no name of its own
    node = tree_of(folder if folder.name else folder.resolve()) if is_folder else None
    if node is None:
        raise FormatError(
            f"cannot import {source}",
            where=f"no {SESSION_FILE} in it" if is_folder else f"not a folder, nor a {SESSION_FILE}",
            consequence="nothing was written",
            fix="name the folder of an ECAT session, project or workspace",
        )
    return node


class _Import:
    """One import of a tree: what was done, what failed."""

    def __init__(self, options: ImportOptions, progress: Progress, total: int) -> None:
        self.findings: list[str] = []
        self.done = 0
        self._failures: list[EcatError] = []
        self._options = options
        self._progress = progress
        self._total = total

    def tree(self, node: Node, target: Path) -> None:
        """Make the project or workspace ``node`` in the folder ``target``, its sessions in their order."""
        jobs = list(self._folders(node, target))
        # while one session waits for the disk or is compressed, another is parsed; more than two gain little
        with ThreadPoolExecutor(_WORKERS) as pool:
            try:
                for job, made in [(job, pool.submit(self._make, *job)) for job in jobs]:
                    self._progress(job[0].path.name, self.done, self._total)
                    self._count(job[0], made)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _folders(self, node: Node, target: Path) -> Iterator[tuple[Node, Path]]:
        """Make the folders of projects, and give the sessions with their places."""
        write_project_manifest(target, self._manifest(node))
        for child in node.children:
            place = target / child.path.name
            if child.kind == "session":
                yield child, place
            else:
                place.mkdir()
                yield from self._folders(child, place)

    def _make(self, node: Node, place: Path) -> list[str]:
        findings: list[str] = []
        files.make_folder(place)
        try:
            fill_session(place, draft_of(node.path, self._options, findings), place)
        except InputError:
            files.remove(place)  # the other sessions may be kept
            raise
        return findings

    def _count(self, node: Node, made: Future[list[str]]) -> None:
        try:
            self.findings += made.result()
        except InputError as error:
            self._failures.append(error)
            self.findings.append(f"{node.path.name}: not imported: {error.what}: {error.where}")
        else:
            self.done += 1
            self._progress(node.path.name, self.done, self._total)

    def _manifest(self, node: Node) -> ProjectManifest:
        foreign: dict[str, str] = {}
        for path in sorted(node.path.iterdir()):
            if not path.is_file():
                continue
            if path.suffix != ".project":
                self.findings.append(f"{path.parent.name}/{path.name} belongs to no session; not imported")
                continue
            listed = read_project_list(path)
            key = f"{PREFIX}list:{path.name}"
            foreign[key] = "\n".join(listed.names)
            if listed.newline != "\n":
                foreign[f"{key}:line_end"] = "crlf"
            if not listed.final_newline:
                foreign[f"{key}:final_line_end"] = "no"
        return ProjectManifest(
            kind="project" if node.kind == "project" else "workspace",
            name=node.path.name,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            provenance=Provenance(format=NAME, source=node.path.name),
            foreign=foreign,
        )

    def raise_failures(self, source: Path, dest: Path) -> None:
        """Refuse the whole import if a session could not be read, unless it is to keep going."""
        if not self._failures or (self._options.keep_going and self.done):
            return
        if len(self._failures) == 1:
            only = self._failures[0]
            raise type(only)(
                only.what, where=only.where, consequence=f"nothing was written to {dest}", fix=only.fix
            )
        named = tuple(f"{error.what}: {error.where}" for error in self._failures[:_MANY])
        raise FormatError(
            f"cannot import {len(self._failures)} of {self._total} sessions of {source}",
            where=named,
            consequence=f"nothing was written to {dest}",
            fix="ecat import --keep-going imports the others",
        )


# ---------------------------------------------------------------------------------------------- writing


def write(path: Path, dest: Path, options: Ecat2018Options, progress: Progress) -> ExportReport:
    """Export a session, project or workspace; see :class:`ecat.formats.format.Writer`."""
    sessions = find_sessions(path)
    findings: list[str] = []
    with staged_folder(dest) as staging:
        for done, folder in enumerate(sessions):
            progress(folder.name, done, len(sessions))
            target = staging / folder.relative_to(path)
            target.mkdir(parents=True, exist_ok=True)
            write_session(open_session(folder), target, findings, layer=options.layer)
        progress(path.name, len(sessions), len(sessions))
        inside = set(sessions)
        for manifest in sorted(path.rglob(PROJECT_FILE)):
            # a session may hold a recorded file of that name
            if inside.isdisjoint(manifest.parents):
                target = staging / manifest.parent.relative_to(path)
                target.mkdir(parents=True, exist_ok=True)
                _write_lists(manifest.parent, target)
    return ExportReport(path=dest, format=NAME, sessions=len(sessions), findings=tuple(findings))


def _write_lists(project: Path, target: Path) -> None:
    foreign = open_project(project).manifest.foreign
    prefix = f"{PREFIX}list:"
    for key, value in foreign.items():
        name = key.removeprefix(prefix)
        if not key.startswith(prefix) or not name.endswith(".project") or not is_inside(name) or "/" in name:
            continue
        listed = ProjectList(
            tuple(value.split("\n")) if value else (),
            newline="\r\n" if foreign.get(f"{key}:line_end") == "crlf" else "\n",
            final_newline=foreign.get(f"{key}:final_line_end") != "no",
        )
        write_new_file(target / name, [write_project_list(listed)])
