"""What is done to a project as a whole: new ones, recordings brought in, sessions put away, edits of all of them.

Nothing here reaches outside of the folder that is served.
"""

from __future__ import annotations

import contextlib
import re
import secrets
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecat import formats
from ecat.errors import ConflictError, EcatError, NotFoundError, UsageError
from ecat.model import ProjectManifest
from ecat.progress import Progress
from ecat.store import Project, create_project, files, find_sessions
from ecat.store.lock import LOCK_FILE, locked
from ecat.store.manifest import is_file_name
from ecat.web.library import ARCHIVE, projects

if TYPE_CHECKING:
    from ecat.web.site import Site

_STAMP = re.compile(r"\d{8}T\d{6}-[0-9a-f]{6}")


def make_project(site: Site, name: str, inside: str) -> Project:
    """Make an empty project.

    Raises
    ------
    UsageError : ``name`` is not that of a folder, or what is served is one session.
    NotFoundError : there is no project ``inside``.
    ExistsError : there is something of that name.
    """
    place = _place(site, name, inside, f"cannot make project {name[:80]}")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return create_project(place, ProjectManifest(name=name, created=now))


def import_upload(
    site: Site, upload: str, name: str, inside: str, *, format_: str | None, progress: Progress
) -> dict[str, Any]:
    """Turn what was sent into a session or project called ``name``; its id, if it is one session, and remarks.

    Raises
    ------
    EcatError : as of :func:`make_project` and :func:`ecat.formats.import_source`.
    """
    place = _place(site, name, inside, f"cannot import {name[:80]}")
    with site.uploads.taken(upload) as source:
        report = formats.import_source(source, place, format=format_, progress=progress)
    ids = {path: sid for sid, path in site.library.find().items()}
    return {
        "id": ids.get(place),
        "sessions": report.sessions,
        "format": report.format,
        "findings": list(report.findings),
    }


def _place(site: Site, name: str, inside: str, what: str) -> Path:
    """Where something new of this name goes: in a project that was found, never anywhere else."""
    root = site.library.root
    if site.library.is_session:
        raise UsageError(what, where="what is served is one session", fix="serve the folder of the project")
    if not is_file_name(name):
        raise UsageError(
            what, where=f"{name[:80]!r} is no name of a folder", fix="take letters, digits, '_' and '-'"
        )
    known = {path.relative_to(root).as_posix(): path for path in projects(root)} | {"": root}
    if inside not in known:
        raise NotFoundError(what, where=f"there is no project {inside[:80]}", fix="name one that there is")
    return known[inside] / name


# ------------------------------------------------------------------------------------------------ put away


async def remove(site: Site, sid: str, name: str, *, keep: bool) -> str | None:
    """Take a session out of the project: into the archive, where its id is returned, or for good.

    Raises
    ------
    UsageError : ``name`` is not the session's, or the session is all that is served.
    ConflictError : somebody has it open.
    LockedError : another program writes to it.
    """
    path, what = site.library.path(sid), f"cannot {'archive' if keep else 'delete'} session {sid}"
    if site.library.is_session:
        raise UsageError(what, where="it is all that is served", fix="serve the folder of the project")
    if name != site.library.title(sid):
        where = f"the session is called {site.library.title(sid)}, not {name[:80]}"
        raise UsageError(what, where=where, fix="say its name to confirm")
    if site.jobs.busy_with(sid):
        where = "something is being done to it just now"
        raise ConflictError(what, where=where, consequence="it was left as it is", fix="wait, or stop that")
    async with site.leaving(sid) as people:
        if people:
            raise ConflictError(
                what,
                where=f"{', '.join(people)}: still in it",
                consequence="it was left as it is",
                fix="let them close it",
            )
        archived = _put_away(site, path, what)
        if keep:
            return archived
        _drop(site, archived)
        return None


def _put_away(site: Site, path: Path, what: str) -> str:
    root = site.library.root
    name = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(3)}"
    target = root / ARCHIVE / name / path.relative_to(root)
    with locked(path, what=what), files.typed_errors(what, path, "it was left as it is"):
        files.make_folders(target.parent)
        files.rename(path, target)
        files.sync(target.parent)
        files.sync(path.parent)
    files.remove(target / LOCK_FILE)
    site.library.find()
    return name


def archived(site: Site) -> list[dict[str, Any]]:
    """The sessions in the archive, the newest first: id, name, where they were, when they were put away."""
    found: list[dict[str, Any]] = []
    for name, path in sorted(_archived(site).items(), reverse=True):
        place = path.relative_to(site.library.root / ARCHIVE / name)
        when = datetime.strptime(name[:15], "%Y%m%dT%H%M%S").replace(tzinfo=UTC)
        found.append({"id": name, "name": path.name, "place": place.as_posix(), "when": when.isoformat()})
    return found


def _archived(site: Site) -> dict[str, Path]:
    folder, found = site.library.root / ARCHIVE, dict[str, Path]()
    if not folder.is_dir() or folder.is_symlink():
        return found
    for one in folder.iterdir():
        # what has another name was not put there by us
        if _STAMP.fullmatch(one.name):
            with contextlib.suppress(NotFoundError):
                for path in find_sessions(one):
                    found.setdefault(one.name, path)
    return found


def _in_archive(site: Site, name: str, what: str) -> Path:
    path = _archived(site).get(name)
    if path is None:
        raise NotFoundError(what, where=f"{name[:80]}: not in the archive", fix="look into it again")
    return path


def restore(site: Site, name: str) -> str | None:
    """Bring a session back to where it was; its id.

    Raises
    ------
    ConflictError : there is something by now.
    """
    what = "cannot bring the session back"
    path, folder = _in_archive(site, name, what), site.library.root / ARCHIVE / name
    place = site.library.root / path.relative_to(folder)
    if place.exists():
        raise ConflictError(
            what,
            where=f"{place}: there is something by now",
            consequence="it stays in the archive",
            fix="move what is there, and restore it again",
        )
    with files.typed_errors(what, place, "it stays in the archive"):
        files.make_folders(place.parent)
        files.rename(path, place)
        files.sync(place.parent)
    files.remove(folder)
    return {path: sid for sid, path in site.library.find().items()}.get(place)


def drop(site: Site, name: str, said: str) -> None:
    """Delete an archived session for good; ``said`` is its name, to confirm.

    Raises
    ------
    UsageError : ``said`` is another name.
    """
    what = "cannot delete the session"
    path = _in_archive(site, name, what)
    if said != path.name:
        raise UsageError(
            what, where=f"it is called {path.name}, not {said[:80]}", fix="say its name to confirm"
        )
    _drop(site, name)


def _drop(site: Site, name: str) -> None:
    folder = site.library.root / ARCHIVE / name
    with files.typed_errors("cannot delete the session", folder, "some of it may be left in the archive"):
        shutil.rmtree(folder)
        if not any(folder.parent.iterdir()):
            folder.parent.rmdir()


# ------------------------------------------------------------------------------------------------ all sessions


def edit_all(
    site: Site,
    sids: Sequence[str],
    layer: str,
    author: str,
    operations: list[dict[str, Any]],
    *,
    make: bool,
    progress: Progress,
) -> dict[str, Any]:
    """Do operations in many sessions, one step of undo in each; what stops one does not stop the others."""
    outcomes: list[dict[str, Any]] = []
    for i, sid in enumerate(sids):
        progress(sid, i, len(sids))
        said: dict[str, Any] = {"id": sid, "revision": None, "changes": 0, "error": None}
        try:
            record = site.wait_for(site.edit(sid, layer, author, operations, make=make))
            if record is not None:
                said |= {"revision": record.revision, "changes": len(record.changes)}
        except EcatError as error:
            said["error"] = str(error)
        outcomes.append(said)
    progress("", len(sids), len(sids))
    return {"sessions": outcomes}
