"""Which sessions there are, and by which ids they are asked for."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecat.errors import EcatError, NotFoundError
from ecat.store import Session, files, find_sessions, open_project, open_session
from ecat.store.archive import ARCHIVE
from ecat.store.manifest import PROJECT_FILE, SESSION_FILE
from ecat.store.snapshot import Snapshot
from ecat.store.transaction import settle

_PLAIN = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_SLUG = 48


@dataclass(frozen=True)
class _Read:
    """A session as of one state of its ``session.json``."""

    state: tuple[int, int, int]
    session: Session


class Library:
    """A session, project, workspace or folder of sessions.

    An id is looked up among those of the sessions that were found, never joined to a path.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._paths: dict[str, Path] = {}
        self._read: dict[Path, _Read] = {}
        self.find()

    @property
    def name(self) -> str:
        """What the project calls itself, or the folder's name."""
        if (self.root / PROJECT_FILE).is_file():
            return open_project(self.root).manifest.name
        return self.root.resolve().name

    @property
    def is_session(self) -> bool:
        """Whether one session is all there is."""
        return (self.root / SESSION_FILE).is_file()

    def title(self, sid: str) -> str:
        """What the session with this id calls itself; its folder's name if it cannot be read."""
        return str(self._describe(sid)["name"])

    def beside(self, sid: str) -> dict[str, str]:
        """The ids of the other sessions in the same folder, by the names that annotations call them by."""
        place = self.path(sid)
        return {
            path.name: other
            for other, path in self.find().items()
            if path.parent == place.parent and path != place
        }

    def find(self) -> dict[str, Path]:
        """Look again which sessions there are; their folders by id.

        Raises
        ------
        NotFoundError : there is none, or the root is gone.
        """
        try:
            found = find_sessions(self.root)
        except NotFoundError:
            if not (self.root / ARCHIVE).is_dir():
                raise
            found = []  # all of them were put away
        self._paths = {_id_of(path, self.root): path for path in found}
        return self._paths

    def path(self, sid: str) -> Path:
        """The folder of the session with this id.

        Raises
        ------
        NotFoundError : there is no such session.
        """
        path = self._paths.get(sid)
        if path is None:
            path = self.find().get(sid)
        if path is None:
            raise NotFoundError(
                "cannot find the session",
                where=f"{sid[:80]}: not among those of {self.name}",
                fix="GET /api/project",
            )
        return path

    def session(self, sid: str) -> Session:
        """The session with this id as it is on disk now; opened again only if it was written since."""
        path = self.path(sid)
        try:
            state = _state(path)
        except OSError:
            self._read.pop(path, None)
            return open_session(path)  # says what is wrong
        read = self._read.get(path)
        if read is None or read.state != state:
            read = self._read[path] = _Read(state, open_session(path) if read is None else _read_again(path))
        return read.session

    def describe(self) -> dict[str, Any]:
        """The project and its sessions; one that cannot be read says why."""
        sessions = [self._describe(sid) for sid in self.find()]
        return {
            "name": self.name,
            "root": str(self.root.resolve()),
            "projects": self._projects(),
            "sessions": sessions,
            "whole": not self.is_session,
        }

    def _projects(self) -> list[dict[str, Any]]:
        """The projects, by their way from the root."""
        found: list[dict[str, Any]] = []
        for path in projects(self.root):
            try:
                name = open_project(path).manifest.name
            except EcatError:
                name = path.name
            found.append({"path": _way(path, self.root), "name": name})
        return found

    def _project_of(self, sid: str) -> str:
        """The way from the root to the project that a session is in; empty for the root itself."""
        folders = self._paths[sid].parents
        inside = (f for f in folders if (f / PROJECT_FILE).is_file() and f.is_relative_to(self.root))
        found = next(inside, self.root)
        return _way(found, self.root)

    def _describe(self, sid: str) -> dict[str, Any]:
        empty: dict[str, Any] = {
            "id": sid,
            "name": self._paths[sid].name,
            "path": _way(self._paths[sid], self.root),
            "project": self._project_of(sid),
            "n_frames": 0,
            "duration_s": None,
            "streams": [],
            "layers": [],
            "n_events": 0,
            "n_objects": 0,
            "n_relations": 0,
            "created": None,
            "error": None,
        }
        try:
            manifest = self.session(sid).manifest
        except EcatError as error:
            return empty | {"error": str(error)}
        rows = {record.name: record.rows for record in manifest.tables}
        ns = manifest.clock.duration_ns
        return empty | {
            "name": manifest.name,
            "n_frames": manifest.n_frames,
            "duration_s": None if ns is None else ns / 1e9,
            "streams": [stream.name for stream in manifest.streams],
            "layers": [layer.name for layer in manifest.layers],
            "n_events": rows.get("events", 0),
            "n_objects": rows.get("objects", 0),
            "n_relations": rows.get("relations", 0),
            "created": manifest.created,
        }


def projects(root: Path) -> Iterator[Path]:
    """The folders of projects at or below ``root``."""
    for folder, inner, names in os.walk(root):
        inner[:] = [] if SESSION_FILE in names else sorted(name for name in inner if not name.startswith("."))
        if PROJECT_FILE in names:
            yield Path(folder)


def _way(path: Path, root: Path) -> str:
    return "" if path == root else path.relative_to(root).as_posix()


def _read_again(path: Path) -> Session:
    """The session as it is on disk; what is being edited meanwhile is saved by its editor, not by whoever looks."""
    with files.typed_errors(f"cannot open session {path.name}", path):
        settle(path)
    return Session(Snapshot.read(path))


def _id_of(path: Path, root: Path) -> str:
    """A name for an address: the folder's own where it can be one, else one made of the way to it."""
    way = path.name if path == root else path.relative_to(root).as_posix()
    if path == root:
        way = path.resolve().name
    if _PLAIN.fullmatch(way) and way not in {".", ".."}:
        return way
    slug = re.sub(r"[^A-Za-z0-9_-]+", "-", way)[:_SLUG].strip("-") or "session"
    return f"{slug}-{hashlib.sha256(way.encode('utf-8', 'surrogateescape')).hexdigest()[:8]}"


def _state(path: Path) -> tuple[int, int, int]:
    stat = (path / SESSION_FILE).stat()
    return stat.st_ino, stat.st_size, stat.st_mtime_ns
