"""Folders that appear complete and durable under their name, or not at all."""

from __future__ import annotations

import contextlib
import errno
import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ecat.errors import ExistsError
from ecat.store import files
from ecat.store.lock import LOCK_FILE, locked
from ecat.store.output import keep_out_of_sessions, refuse_dangling


@contextmanager
def staged_folder(dest: Path) -> Generator[Path]:
    """A folder that appears under the name ``dest``, complete and durable, when the block ends; or not at
    all.

    The block fills the folder that it is given, which is beside ``dest``, and syncs what it writes into it.

    Raises
    ------
    ExistsError : ``dest`` is there and is not an empty folder; or it is inside of a session.
    """
    what, consequence = f"cannot create {dest.name}", f"nothing was written to {dest}"
    place = Path(dest).resolve()
    staging = place.with_name(f".{place.name}.{secrets.token_hex(8)}.partial")
    made: list[Path] = []
    try:
        with files.typed_errors(what, dest, consequence):
            keep_out_of_sessions(what, dest)
            _must_be_free(place, dest)
            _make_parents(place.parent, made)
            files.make_folder(staging)
        # whoever cleans up can tell a folder that is being filled from one that was abandoned
        with locked(staging):
            yield staging
            with files.typed_errors(what, dest, consequence):
                files.sync(staging)
                _appear(staging, place, dest)
            with files.typed_errors(what, dest, f"{dest} is there, but may not survive a power failure"):
                for folder in (place.parent, *(folder.parent for folder in made)):
                    files.sync(folder)
                files.remove(place / LOCK_FILE)
    except BaseException:
        with contextlib.suppress(OSError):
            files.remove(staging)
        with contextlib.suppress(OSError):
            for folder in made:
                folder.rmdir()
        raise


@contextmanager
def staged_path(dest: Path, within: Path | None = None) -> Generator[Path]:
    """A path where nothing is yet; the file or folder that the block makes there appears as ``dest``, complete and
    durable, when it ends; or nothing does.

    Parameters
    ----------
    within : a folder on the same disk, for what is being made; by default that of ``dest``.

    Raises
    ------
    ExistsError : ``dest`` is there and is not an empty folder; or it is inside of a session.
    """
    what, consequence = f"cannot write {dest.name}", f"nothing was written to {dest}"
    place = Path(dest).resolve()
    staging = (within or place.parent) / f".{place.name}.{secrets.token_hex(8)}.partial"
    made: list[Path] = []
    try:
        with files.typed_errors(what, dest, consequence):
            keep_out_of_sessions(what, dest)
            _must_be_free(place, dest)
            _make_parents(place.parent, made)
            yield staging
            files.sync_tree(staging)
            if place.is_dir() and not staging.is_dir():
                place.rmdir()
            _appear(staging, place, dest)
        with files.typed_errors(what, dest, f"{dest} is there, but may not survive a power failure"):
            for folder in (place.parent, *(folder.parent for folder in made)):
                files.sync(folder)
    except BaseException:
        with contextlib.suppress(OSError):
            files.remove(staging)
        with contextlib.suppress(OSError):
            for folder in made:
                folder.rmdir()
        raise


def refuse_taken(dest: Path) -> None:
    """Return if something may be made at ``dest``, before anything long is begun.

    Raises
    ------
    ExistsError : it is there and is not an empty folder; or it is inside of a session.
    """
    keep_out_of_sessions(f"cannot write {dest.name}", dest)
    _must_be_free(dest.resolve(), dest)


def _must_be_free(place: Path, dest: Path) -> None:
    refuse_dangling(f"cannot create {dest.name}", dest)
    if place.exists() and not (place.is_dir() and not any(place.iterdir())):
        raise _taken(dest)


def _taken(dest: Path) -> ExistsError:
    return ExistsError(
        f"cannot create {dest.name}",
        where=f"{dest}: there is something already",
        consequence="it was left as it is",
        fix="choose another destination, or remove it first",
    )


def _make_parents(folder: Path, made: list[Path]) -> None:
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    for path in reversed(missing):
        files.make_folder(path)
        made.insert(0, path)


def _appear(staging: Path, place: Path, dest: Path) -> None:
    try:
        files.rename(staging, place)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR}:
            raise _taken(dest) from None
        raise
