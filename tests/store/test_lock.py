"""One writer at a time; a lock file that is left behind is no lock."""

from __future__ import annotations

import errno
import os
import threading
import time
from pathlib import Path

import pytest

from ecat.errors import DiskError, LockedError, NotFoundError
from ecat.store import Session
from ecat.store.lock import LOCK_FILE, locked
from tests.store.sessions import number_at, write


def test_the_lock_file_is_there_only_while_it_is_held(tmp_path: Path) -> None:
    with locked(tmp_path):
        assert (tmp_path / LOCK_FILE).is_file()
    assert list(tmp_path.iterdir()) == []


def test_the_error_names_who_holds_it_and_since_when(tmp_path: Path) -> None:
    with locked(tmp_path):
        with pytest.raises(LockedError) as caught, locked(tmp_path):
            pytest.fail("two writers at once")
        assert f"process {os.getpid()} on " in caught.value.where
        assert " since 20" in caught.value.where
    with locked(tmp_path):
        (tmp_path / LOCK_FILE).write_text("unreadable")
        with pytest.raises(LockedError, match="held by another process"), locked(tmp_path):
            pytest.fail("two writers at once")


@pytest.mark.parametrize("content", ["", '{"pid": 1, "host": "elsewhere", "since": "2020"}', "\0" * 100])
def test_a_lock_file_left_behind_is_no_obstacle(session: Session, content: str) -> None:
    (session.path / LOCK_FILE).write_text(content)
    write(session, 1)
    assert number_at(session.path) == 1
    assert not (session.path / LOCK_FILE).exists()


def test_a_waiting_writer_gets_the_lock_as_soon_as_it_is_free(tmp_path: Path) -> None:
    order: list[str] = []

    def second() -> None:
        with locked(tmp_path, wait_s=10):
            order.append("second")

    thread = threading.Thread(target=second)
    with locked(tmp_path):
        thread.start()
        time.sleep(0.05)
        order.append("first")
    thread.join(10)
    assert order == ["first", "second"]
    assert list(tmp_path.iterdir()) == []


def test_many_writers_are_one_at_a_time(tmp_path: Path) -> None:
    inside: list[int] = []
    most: list[int] = []

    def work(number: int) -> None:
        for _ in range(10):
            with locked(tmp_path, wait_s=30):
                inside.append(number)
                most.append(len(inside))
                time.sleep(0.0005)
                inside.remove(number)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert most == [1] * 40


def test_the_lock_of_a_folder_that_has_moved_does_not_take_the_new_one_away(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with locked(folder):
        folder.rename(tmp_path / "moved")
        folder.mkdir()
        (folder / LOCK_FILE).write_text("somebody else's")
    assert (folder / LOCK_FILE).exists()


def test_a_folder_that_is_gone_or_knows_no_locks_is_a_typed_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(NotFoundError), locked(tmp_path / "gone"):
        pytest.fail("a lock on nothing")

    def refuse(descriptor: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("ecat.store.lock._take", refuse)
    with pytest.raises(DiskError, match=os.strerror(errno.ENOLCK)), locked(tmp_path):
        pytest.fail("a lock where there are none")
