"""Several files changed as one: either all of them, or none, whatever happens in between.
 A commit writes every new file as ``.<name>.<id>.new`` beside the one that it replaces and syncs them; then
it writes ``commit.json``, the list of those files.  That instant is the commit: before it, nothing has
happened; after it, whoever opens the session next carries the list out.  The renames follow, ``session.json``
last, and ``commit.json`` goes.
 A reader that opens a table, then finds no ``commit.json``, then finds ``session.json`` as it was, has the
table of that ``session.json``: while a table is newer than the manifest, ``commit.json`` is there
(:mod:`ecat.store.snapshot`).
"""

from __future__ import annotations

import contextlib
import json
import secrets
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import StringConstraints, TypeAdapter, ValidationError

from ecat.errors import CorruptError, EcatError
from ecat.store import files
from ecat.store.lock import locked
from ecat.store.manifest import MAX_BYTES, SESSION_FILE, is_inside

COMMIT_FILE = "commit.json"
_SETTLE_S = 10.0
_NOTED = "the change is noted and will be finished when the session is next opened"


@dataclass(frozen=True, slots=True)
class CommitRecord:
    """``commit.json``: the id of the commit, and the sha256 of every file in the order of the renames."""

    id: Annotated[str, StringConstraints(pattern="^[0-9a-f]{16}$")]
    files: dict[str, str] = field(default_factory=dict[str, str])


_RECORD = TypeAdapter(CommitRecord)


def new_id() -> str:
    """A name that nobody else uses."""
    return secrets.token_hex(8)


class NewFiles:
    """Files on their way into ``folder``: under their own names if it is new, beside them if it is in use."""

    def __init__(self, folder: Path, commit_id: str = "") -> None:
        self.folder = folder
        self.id = commit_id
        self.sha256: dict[str, str] = {}
        self._paths: dict[str, Path] = {}

    def path(self, target: str) -> Path:
        """Where the file that will be ``target`` is now."""
        path = self._paths.get(target)
        if path is None:
            path = _new_path(self.folder, target, self.id) if self.id else files.confined(self.folder, target)
            self._paths[target] = path
        return path

    @contextmanager
    def open(self, target: str) -> Generator[files.NewFile]:
        """Write the file that will be ``target``; twice is allowed, and the last one counts."""
        path = self.path(target)
        folder = self.folder
        for part in Path(target).parent.parts:
            folder /= part
            files.make_folder(folder)
        with files.NewFile(path) as file:
            self.sha256[target] = ""
            yield file
        self.sha256[target] = file.sha256

    def to_be_written(self, target: str, write: Callable[[Path], None]) -> Callable[[], None]:
        """What lets a function write the file that will be ``target``, at the path that it is given."""
        with self.open(target):
            pass  # makes the folders, and the file, which the function replaces
        path = self.path(target)

        def written() -> None:
            write(path)
            self.sha256[target] = files.sha256_of(path)

        return written

    def write(self, target: str, data: bytes) -> str:
        """Write ``data`` to what will be ``target``, and return its sha256."""
        with self.open(target) as file:
            file.write(data)
        return self.sha256[target]

    def sync(self) -> None:
        """Wait until all of them, and the folders that they are in, are on the disk."""
        files.sync_all([*map(self.path, self.sha256), *_folders(self.folder, self.sha256)])

    def commit(self) -> None:
        """Let all of them take the place of their targets."""
        what = f"cannot write to session {self.folder.name}"
        last = {SESSION_FILE: self.sha256[SESSION_FILE]}
        record = CommitRecord(self.id, {k: v for k, v in self.sha256.items() if k != SESSION_FILE} | last)
        note = self.path(COMMIT_FILE)
        with files.typed_errors(what, self.folder, "nothing was changed"):
            self.sync()
            with files.NewFile(note) as file:
                file.write(json.dumps(_RECORD.dump_python(record), indent=2).encode())
            files.sync(note)
            files.rename(note, self.folder / COMMIT_FILE)
        with files.typed_errors(what, self.folder, _NOTED):
            files.sync(self.folder)
            _carry_out(self.folder, record)

    def discard(self) -> None:
        """Remove them, unless the commit has happened."""
        if not (self.folder / COMMIT_FILE).exists():
            for target in (*self.sha256, COMMIT_FILE):
                with contextlib.suppress(OSError):
                    self.path(target).unlink(missing_ok=True)


def _new_path(folder: Path, target: str, commit_id: str) -> Path:
    path = files.confined(folder, target)
    return path.with_name(f".{path.name}.{commit_id}.new")


def _folders(folder: Path, targets: Iterable[str]) -> list[Path]:
    """The folders that have the targets, from the inmost."""
    inner = {parent for target in targets for parent in Path(target).parents}
    return [folder / path for path in sorted(inner, reverse=True)]


def _carry_out(folder: Path, record: CommitRecord) -> None:
    for target in record.files:
        new = _new_path(folder, target, record.id)
        if new.exists():
            files.rename(new, folder / target)
    files.sync_all(_folders(folder, record.files))
    files.remove(folder / COMMIT_FILE)


def settle(folder: Path) -> None:
    """Finish the commit that was interrupted in ``folder``, or wait for the one that is under way.

    Raises
    ------
    ReadOnlyError : there is one to finish, and no permission to.
    LockedError : another process has been at it for ten seconds.
    CorruptError : what it wrote is not what it noted.
    """
    if not (folder / COMMIT_FILE).exists():
        return
    what = f"cannot finish the interrupted commit of {folder.name}"
    with locked(folder, what=what, wait_s=_SETTLE_S):
        roll_forward(folder, what)


def roll_forward(folder: Path, what: str) -> None:
    """Finish the commit that was interrupted, if there is one; the caller holds the lock."""
    path = folder / COMMIT_FILE
    try:
        record = _RECORD.validate_json(files.read_bytes(path, MAX_BYTES))
    except FileNotFoundError:
        return
    except ValidationError as error:
        raise _damaged(what, path, error.errors()[0]["msg"]) from None
    for target, sha256 in record.files.items():
        if not is_inside(target):
            raise _damaged(what, path, f"{target!r} is not in the session")
        new = _new_path(folder, target, record.id)
        try:
            found = files.sha256_of(new if new.exists() else folder / target)
        except FileNotFoundError:
            raise _damaged(what, path, f"{target} is missing") from None
        if found != sha256:
            raise _damaged(what, path, f"{target} is not as it was written")
    with files.typed_errors(what, path, _NOTED):
        _carry_out(folder, record)


def _damaged(what: str, path: Path, why: str) -> CorruptError:
    return CorruptError(
        what,
        where=f"{path}: {why}",
        consequence="nothing was changed",
        fix=f"restore the session from a copy; or remove {COMMIT_FILE}, then run ecat check",
    )


def noted_files(folder: Path) -> set[Path]:
    """The new files that an interrupted commit still needs."""
    try:
        record = _RECORD.validate_json(files.read_bytes(folder / COMMIT_FILE, MAX_BYTES))
        return {_new_path(folder, target, record.id) for target in record.files}
    except (OSError, ValidationError, EcatError):
        return set()
