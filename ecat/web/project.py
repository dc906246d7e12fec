"""What is done to a project as a whole: new ones, recordings brought in, sessions put away, edits of all of them.

Nothing here reaches outside of the folder that is served.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecat import formats
from ecat.errors import ConflictError, EcatError, NotFoundError, UsageError
from ecat.model import ProjectManifest
from ecat.progress import Progress
from ecat.store import Project, archive, create_project
from ecat.store.manifest import is_file_name
from ecat.web.library import projects

if TYPE_CHECKING:
    from ecat.web.site import Site


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
        name = archive.put_away(site.library.root, path)
        site.library.find()
        if keep:
            return name
        archive.delete(site.library.root, name, path.name)
        return None


def archived(site: Site) -> list[dict[str, Any]]:
    """The sessions in the archive, the newest first: id, name, where they were, when they were put away."""
    found = archive.archived(site.library.root)
    return [
        {"id": one.id, "name": one.name, "place": one.place.as_posix(), "when": one.when} for one in found
    ]


def restore(site: Site, name: str) -> str | None:
    """Bring a session back to where it was; its id.  Errors as of :func:`ecat.store.archive.bring_back`."""
    place = archive.bring_back(site.library.root, name)
    return {path: sid for sid, path in site.library.find().items()}.get(place)


def drop(site: Site, name: str, said: str) -> None:
    """Delete an archived session for good; ``said`` is its name, to confirm."""
    archive.delete(site.library.root, name, said)


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
