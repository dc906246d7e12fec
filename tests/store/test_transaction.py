"""A commit of several files happens as one, on a disk that fails, fills up or loses power."""

from __future__ import annotations

import errno
import itertools
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from ecat.errors import CorruptError, DiskError, EcatError, ReadOnlyError
from ecat.model import ProjectManifest
from ecat.store import Session, create_project, files, leftovers, open_project, open_session, remove_leftovers
from ecat.store.transaction import COMMIT_FILE
from tests.store.conftest import Steps
from tests.store.sessions import make, number_at, number_of, write


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below ``folder``."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def fill(folder: Path, content: dict[str, bytes]) -> Path:
    """The opposite of :func:`contents`."""
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def test_a_commit_bumps_the_revision_and_leaves_nothing_else(session: Session) -> None:
    before = set(contents(session.path))
    write(session, 1)
    assert set(contents(session.path)) == before
    assert session.manifest.revision == 2
    assert number_at(session.path) == 1


def test_an_exception_in_the_block_writes_nothing(session: Session) -> None:
    before = contents(session.path)
    with pytest.raises(ZeroDivisionError), session.write() as commit:
        commit.put_prototypes([{"name": str(1 // 0)}])
    assert contents(session.path) == before


def test_a_block_that_puts_nothing_writes_nothing(session: Session) -> None:
    before = contents(session.path)
    with session.write():
        pass
    assert contents(session.path) == before


def test_an_error_at_any_step_leaves_the_old_state_or_a_noted_new_one(session: Session, steps: Steps) -> None:
    old = contents(session.path)
    outcomes: list[int] = []
    for step in itertools.count():
        for name in contents(session.path).keys() - old.keys():
            (session.path / name).unlink()
        fill(session.path, old)
        steps.count, steps.fail_at = 0, step
        steps.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(session.path))
        message = ""
        try:
            write(open_session(session.path), 1)
        except DiskError as error:
            message = str(error)
        steps.fail_at = None
        if not message:
            assert steps.count <= step
            break
        noted = (session.path / COMMIT_FILE).exists()
        assert ("noted and will be finished" in message) == noted
        assert noted or contents(session.path) == old
        outcomes.append(number_at(session.path))
        assert leftovers(session.path) == []
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {0, 1}


def test_no_permission_is_a_typed_error_and_writes_nothing(session: Session, steps: Steps) -> None:
    before = contents(session.path)
    steps.fail_at = 0
    steps.error = PermissionError(errno.EACCES, "Permission denied", str(session.path / "session.json"))
    with pytest.raises(ReadOnlyError, match="nothing was changed"):
        write(session, 1)
    assert contents(session.path) == before


class Disk:
    """What is on the disk for certain: content that was synced, and names that a folder had when it was.

    At every step, the power may fail: each folder then has its synced names or its present ones, and files
    that were not synced are empty.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.content: dict[int, bytes] = {}
        self.names: dict[int, dict[str, int]] = {}
        for path in (root, *root.rglob("*")):
            self.sync(path)
        self.seen: set[tuple[tuple[str, bytes], ...]] = set()

    def sync(self, path: Path) -> None:
        """Note what a sync of ``path`` makes certain."""
        inode = path.stat().st_ino
        if path.is_dir():
            self.names[inode] = {inner.name: inner.stat().st_ino for inner in path.iterdir()}
        else:
            self.content[inode] = path.read_bytes()

    def after_power_failure(self) -> Iterator[dict[str, bytes]]:
        """What may be found, as far as it was not seen before."""
        folders = [path for path in (self.root, *self.root.rglob("*")) if path.is_dir()]
        choices = {inode: [names] for inode, names in self.names.items()}
        for folder in folders:
            present = {path.name: path.stat().st_ino for path in folder.iterdir()}
            choices.setdefault(folder.stat().st_ino, [{}]).append(present)
        for choice in itertools.product(*choices.values()):
            found = dict(self.walk(self.root.stat().st_ino, dict(zip(choices, choice, strict=True)), ""))
            key = tuple(sorted(found.items()))
            if key not in self.seen:
                self.seen.add(key)
                yield found

    def walk(self, folder: int, names: dict[int, dict[str, int]], prefix: str) -> Iterator[tuple[str, bytes]]:
        """Every file below ``folder``, where folders have these names in them."""
        for name, inode in names[folder].items():
            if inode in names:
                yield from self.walk(inode, names, f"{prefix}{name}/")
            else:
                yield prefix + name, self.content.get(inode, b"")


@pytest.mark.parametrize("action", ["create", "commit", "project"])
def test_a_power_failure_at_any_step_leaves_the_old_state_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, action: str
) -> None:
    place = tmp_path / "place"
    place.mkdir()
    session = make(place / "s") if action == "commit" else None
    disk = Disk(place)
    before: list[dict[str, bytes]] = []

    def step(what: str, path: Path) -> None:
        before.extend(disk.after_power_failure())
        if what == "sync":
            disk.sync(path)

    monkeypatch.setattr(files, "step", step)
    if session:
        write(session, 1)
    elif action == "create":
        make(place / "s", 1)
    else:
        create_project(place / "s", ProjectManifest(name="s", created="2020-01-01T00:00:00"))
    disk.seen.clear()
    after = list(disk.after_power_failure())
    monkeypatch.undo()

    numbers = itertools.count()

    def outcome(found: dict[str, bytes]) -> int:
        path = fill(tmp_path / f"found{next(numbers)}", found) / "s"
        if not path.exists():
            return 0
        return number_at(path) if action != "project" else len([open_project(path)])

    assert len(before) >= 5
    assert {outcome(found) for found in before} == {0, 1}
    assert {outcome(found) for found in after} == {1}


def interrupted(session: Session, steps: Steps) -> Path:
    """Stop a commit right after it was noted."""
    write(session, 1)
    steps_in_all, steps.count = steps.count, 0
    steps.fail_at = steps_in_all - 6
    steps.error = OSError(errno.EIO, "I/O error")
    with pytest.raises(DiskError):
        write(session, 2)
    steps.fail_at = None
    assert (session.path / COMMIT_FILE).exists()
    return session.path


def test_opening_finishes_an_interrupted_commit(session: Session, steps: Steps) -> None:
    path = interrupted(session, steps)
    assert number_of(open_session(path)) == 2
    assert not (path / COMMIT_FILE).exists()
    assert leftovers(path) == []


def test_a_session_object_finishes_it_too(session: Session, steps: Steps) -> None:
    interrupted(session, steps)
    assert number_of(session.refresh()) == 2


def test_the_next_writer_finishes_it_first_and_is_told_that_it_is_late(
    session: Session, steps: Steps
) -> None:
    interrupted(session, steps)
    with pytest.raises(EcatError, match="as it was opened"):
        write(session, 3)
    assert number_at(session.path) == 2


def test_new_files_that_a_noted_commit_needs_are_no_leftovers(session: Session, steps: Steps) -> None:
    path = interrupted(session, steps)
    assert leftovers(path) == []
    assert remove_leftovers(path) == []
    assert number_at(path) == 2


def test_a_folder_that_may_not_be_written_says_that_a_commit_is_unfinished(
    session: Session, steps: Steps, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = interrupted(session, steps)
    really = os.open

    def no_writing(name: str | Path, flags: int, mode: int = 0o777) -> int:
        if flags & (os.O_RDWR | os.O_WRONLY):
            raise PermissionError(errno.EACCES, "Permission denied", str(name))
        return really(name, flags, mode)

    monkeypatch.setattr(os, "open", no_writing)
    with pytest.raises(ReadOnlyError, match="cannot finish the interrupted commit"):
        open_session(path)


@pytest.mark.parametrize(
    "note",
    [
        b"",
        b"[]",
        b"{",
        b'{"id": "../../../../etc/x", "files": {}}',
        b'{"id": "0123456789abcdef", "files": {"../outside": "00"}}',
        b'{"id": "0123456789abcdef", "files": {"/etc/passwd": "00"}}',
        b'{"id": "0123456789abcdef", "files": {"tables/gone.parquet": "00"}}',
        b'{"id": "0123456789abcdef", "files": {"session.json": "00"}}',
        b"[" * 100_000,
        json.dumps({"id": "0123456789abcdef", "files": {"a" * 300: "00"}}).encode(),
    ],
)
def test_a_damaged_note_is_one_typed_error(session: Session, note: bytes) -> None:
    before = contents(session.path)
    (session.path / COMMIT_FILE).write_bytes(note)
    with pytest.raises((CorruptError, DiskError)):
        open_session(session.path)
    (session.path / COMMIT_FILE).unlink()
    assert contents(session.path) == before
    assert number_at(session.path) == 0
