"""Projects and workspaces: folders of sessions, and folders of projects."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ecat.errors import NotFoundError
from ecat.model import ProjectManifest
from ecat.store import files
from ecat.store.manifest import PROJECT_FILE, SESSION_FILE, dump_manifest, parse_manifest, read_manifest_bytes
from ecat.store.session import Session, open_session
from ecat.store.staging import staged_folder


@dataclass(frozen=True, slots=True)
class Project:
    """A folder with a ``project.json``: sessions, or (a workspace) projects, are folders inside it."""

    path: Path
    manifest: ProjectManifest

    def session_paths(self) -> list[Path]:
        """The folders of all sessions, at any depth, in the order of their paths."""
        return [path for path, file in _manifests(self.path) if file == SESSION_FILE]

    def sessions(self) -> Iterator[Session]:
        """All sessions, opened one by one."""
        return (open_session(path) for path in self.session_paths())

    def children(self) -> list[Project]:
        """The projects directly inside this one."""
        inner = [
            path
            for path in sorted(self.path.iterdir())
            if _is_visible(path) and (path / PROJECT_FILE).is_file()
        ]
        return [open_project(path) for path in inner]


def create_project(dest: Path | str, manifest: ProjectManifest) -> Project:
    """Make the folder ``dest`` with its ``project.json``; sessions are then created inside it.

    Raises
    ------
    ExistsError : ``dest`` is there and is not an empty folder.
    DiskError, ReadOnlyError : nothing is left behind.
    """
    dest = Path(dest)
    with staged_folder(dest) as staging:
        write_project_manifest(staging, manifest)
    return open_project(dest)


def write_project_manifest(folder: Path, manifest: ProjectManifest) -> None:
    """Write ``project.json`` into a folder that is being made (:func:`ecat.store.staged_folder`)."""
    path = folder / PROJECT_FILE
    with files.typed_errors(f"cannot write {PROJECT_FILE}", path, "it is not complete"):
        with files.NewFile(path) as file:
            file.write(dump_manifest(manifest, path))
        files.sync(path)


def open_project(path: Path | str) -> Project:
    """Open the project or workspace in the folder ``path``.

    Raises
    ------
    NotFoundError : there is no such folder, or it is not a project.
    FormatError, SchemaError, LimitError : ``project.json`` is not a manifest that this ecat can read.
    """
    path = Path(path)
    with files.typed_errors(f"cannot open project {path.name}", path):
        data = read_manifest_bytes(path, PROJECT_FILE)
    return Project(path, parse_manifest(data, path / PROJECT_FILE, ProjectManifest))


def find_sessions(path: Path | str) -> list[Path]:
    """The folders of all sessions at or below ``path``: a session, a project, a workspace or any folder of
    them.

    Raises
    ------
    NotFoundError : ``path`` is not there; or neither a session nor a project is in it.
    """
    path = Path(path)
    if (path / SESSION_FILE).is_file():
        return [path]
    found = list(_manifests(path)) if path.is_dir() else []
    if not found:
        why = "no session and no project in it" if path.is_dir() else "there is no such folder"
        raise NotFoundError(
            f"cannot find sessions in {path.name or path}", where=f"{path}: {why}", fix="check the path"
        )
    return [folder for folder, file in found if file == SESSION_FILE]


def _manifests(root: Path) -> Iterator[tuple[Path, str]]:
    # links are not followed, so that the walk ends; hidden folders are unfinished ones, or version control
    for folder, inner, names in os.walk(root):
        inner[:] = [] if SESSION_FILE in names else sorted(name for name in inner if not name.startswith("."))
        if SESSION_FILE in names:
            yield Path(folder), SESSION_FILE
        elif PROJECT_FILE in names:
            yield Path(folder), PROJECT_FILE


def _is_visible(path: Path) -> bool:
    return path.is_dir() and not path.name.startswith(".")
