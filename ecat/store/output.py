"""Files that leave a session: written whole and durable, or not at all."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path

from ecat.errors import ExistsError
from ecat.store import files
from ecat.store.manifest import SESSION_FILE


def write_new_file(path: Path, pieces: Iterable[bytes]) -> None:
    """Write a file into a folder that is being made (:func:`ecat.store.staged_folder`)."""
    with files.typed_errors(f"cannot write {path.name}", path, "it is not complete"):
        with files.NewFile(path) as file:
            for piece in pieces:
                file.write(piece)
        files.sync(path)


def keep_out_of_sessions(what: str, dest: Path) -> None:
    """Return if ``dest`` is not inside of a session: what lies there belongs to the session alone.

    Raises
    ------
    ExistsError : it is; the error says that ``what`` could not be done.
    """
    for folder in dest.resolve().parents:
        if (folder / SESSION_FILE).exists():
            raise ExistsError(
                what,
                where=f"{dest}: inside of the session {folder}",
                consequence="the session was left as it is",
                fix="choose a destination outside of it",
            )


def refuse_dangling(what: str, dest: Path) -> None:
    """Return if ``dest`` is not a symbolic link that leads nowhere: whoever made it did not mean this.

    Raises
    ------
    ExistsError : it is; the error says that ``what`` could not be done.
    """
    if dest.is_symlink() and not dest.exists():
        raise ExistsError(
            what,
            where=f"{dest}: a symbolic link to {dest.readlink()}, where nothing is",
            consequence="nothing was written",
            fix="name the destination itself, or remove the link",
        )


@contextmanager
def staged_file(dest: Path, *, replaces: bytes = b"") -> Generator[Path]:
    """A path to write to, which becomes ``dest`` when the block ends, complete and durable; or nothing does.

    Raises
    ------
    ExistsError : ``dest`` is there, and is not to be replaced; or it is inside of a session.
    """
    what = f"cannot write {dest.name}"
    staging = dest.with_name(f".{dest.name}.{secrets.token_hex(8)}.partial")
    missing = [folder for folder in (dest.parent, *dest.parent.parents) if not folder.exists()]
    made: list[Path] = []
    try:
        with files.typed_errors(what, dest, f"nothing was written to {dest}"):
            _must_be_free(dest, replaces)
            for folder in reversed(missing):
                files.make_folder(folder)
                made.insert(0, folder)
            yield staging
            files.sync(staging)
            _must_be_free(dest, replaces)
            files.rename(staging, dest)
    except BaseException:
        with contextlib.suppress(OSError):
            staging.unlink(missing_ok=True)
            for folder in made:
                folder.rmdir()
        raise
    with files.typed_errors(what, dest, f"{dest} is there, but may not survive a power failure"):
        for folder in (dest.parent, *(folder.parent for folder in made)):
            files.sync(folder)


def _must_be_free(dest: Path, replaces: bytes) -> None:
    keep_out_of_sessions(f"cannot write {dest.name}", dest)
    refuse_dangling(f"cannot write {dest.name}", dest)
    if dest.exists() and not (replaces and _is_of_kind(dest, replaces)):
        raise ExistsError(
            f"cannot write {dest.name}",
            where=f"{dest}: there is something already",
            consequence="it was left as it is",
            fix="choose another name",
        )


def _is_of_kind(dest: Path, head: bytes) -> bool:
    """Whether ``dest`` is a file that begins like ours."""
    if not dest.is_file():
        return False
    with dest.open("rb") as file:
        return file.read(len(head)) == head
