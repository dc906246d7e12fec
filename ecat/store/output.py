"""Files that leave a session: written whole and durable, or not at all."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path

from ecat.errors import ExistsError
from ecat.store import files


def write_new_file(path: Path, pieces: Iterable[bytes]) -> None:
    """Write a file into a folder that is being made (:func:`ecat.store.staged_folder`)."""
    with files.typed_errors(f"cannot write {path.name}", path):
        with files.NewFile(path) as file:
            for piece in pieces:
                file.write(piece)
        files.sync(path)


@contextmanager
def staged_file(dest: Path, *, replace: bool = False) -> Generator[Path]:
    """A path to write to, which becomes ``dest`` when the block ends, complete and durable; or nothing does.

    Raises
    ------
    ExistsError : ``dest`` is there, and is not to be replaced.
    """
    what = f"cannot write {dest.name}"
    if dest.exists() and not replace:
        raise ExistsError(
            what,
            where=f"{dest}: there is something already",
            consequence="it was left as it is",
            fix="choose another name",
        )
    staging = dest.with_name(f".{dest.name}.{secrets.token_hex(8)}.partial")
    try:
        with files.typed_errors(what, dest, f"nothing was written to {dest}"):
            if not dest.parent.exists():
                files.make_folder(dest.parent)
            yield staging
            files.sync(staging)
            files.rename(staging, dest)
            files.sync(dest.parent)
    finally:
        with contextlib.suppress(OSError):
            staging.unlink(missing_ok=True)
