"""Sessions that were put away: out of the project, and still on the disk.

A session lies in ``.archive/STAMP-RANDOM/`` of the folder that it was taken from, at the place where it was there.  The
folder is hidden, so that nobody takes what is in it for sessions of the project.
"""

from __future__ import annotations

import contextlib
import re
import secrets
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ecat.errors import ConflictError, NotFoundError, UsageError
from ecat.store import files
from ecat.store.lock import LOCK_FILE, locked
from ecat.store.project import find_sessions

ARCHIVE = ".archive"
_STAMP = re.compile(r"\d{8}T\d{6}-[0-9a-f]{6}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Archived:
    """A session in the archive: by what it is called there, where it was, and when it was put away (ISO 8601)."""

    id: str
    place: Path
    when: str

    @property
    def name(self) -> str:
        """Of its folder."""
        return self.place.name


def put_away(root: Path, path: Path) -> str:
    """Put the session ``path``, which lies in ``root``, into the archive there; what it is called in it.

    Raises
    ------
    UsageError : it does not lie in ``root``.
    LockedError : another program writes to it.
    DiskError : it cannot be moved.
    """
    what = f"cannot archive {path.name}"
    try:
        place = path.resolve().relative_to(root.resolve())
    except ValueError:
        raise UsageError(what, where=f"{path} is not in {root}", fix="name the project it is in") from None
    if not place.parts:
        raise UsageError(what, where=f"{path} is all there is", fix="name a session of a project")
    name = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(3)}"
    target = root / ARCHIVE / name / place
    with locked(path, what=what), files.typed_errors(what, path, "it was left as it is"):
        files.make_folders(target.parent)
        files.rename(path, target)
        files.sync(target.parent)
        files.sync(path.parent)
    files.remove(target / LOCK_FILE)
    return name


def archived(root: Path) -> list[Archived]:
    """The sessions in the archive of ``root``, the newest first."""
    folder = root / ARCHIVE
    if not folder.is_dir() or folder.is_symlink():
        return []
    found: list[Archived] = []
    for one in sorted(folder.iterdir(), reverse=True):
        # what has another name was not put there by us
        if not _STAMP.fullmatch(one.name):
            continue
        with contextlib.suppress(NotFoundError, ValueError):
            when = datetime.strptime(one.name[:15], "%Y%m%dT%H%M%S").replace(tzinfo=UTC)
            place = find_sessions(one)[0].relative_to(one)
            found.append(Archived(id=one.name, place=place, when=when.isoformat()))
    return found


def bring_back(root: Path, name: str) -> Path:
    """Put an archived session back to where it was; its folder.

    Raises
    ------
    NotFoundError : there is none of that name in the archive.
    ConflictError : there is something in its place by now.
    """
    what = "cannot bring the session back"
    one = _find(root, name, what)
    place = root / one.place
    if place.exists():
        raise ConflictError(
            what,
            where=f"{place}: there is something by now",
            consequence="it stays in the archive",
            fix="move what is there, and restore it again",
        )
    with files.typed_errors(what, place, "it stays in the archive"):
        files.make_folders(place.parent)
        files.rename(root / ARCHIVE / name / one.place, place)
        files.sync(place.parent)
    files.remove(root / ARCHIVE / name)
    return place


def delete(root: Path, name: str, said: str) -> None:
    """Delete an archived session for good; ``said`` is its name, to confirm.

    Raises
    ------
    NotFoundError : there is none of that name in the archive.
    UsageError : ``said`` is another name.
    DiskError : it cannot be deleted, or not all of it.
    """
    what = "cannot delete the session"
    one = _find(root, name, what)
    if said != one.name:
        raise UsageError(
            what, where=f"it is called {one.name}, not {said[:80]}", fix="say its name to confirm"
        )
    folder = root / ARCHIVE / name
    with files.typed_errors(what, folder, "some of it may be left in the archive"):
        shutil.rmtree(folder)
        if not any(folder.parent.iterdir()):
            folder.parent.rmdir()


def _find(root: Path, name: str, what: str) -> Archived:
    found = {one.id: one for one in archived(root)}.get(name)
    if found is None:
        raise NotFoundError(what, where=f"{name[:80]}: not in the archive", fix="look into it again")
    return found
