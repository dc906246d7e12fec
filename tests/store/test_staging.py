"""A new folder appears complete and durable, or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest

from ecat.errors import DiskError, ExistsError, LockedError, ReadOnlyError
from ecat.store import create_session, leftovers, remove_leftovers, staged_folder
from ecat.store.lock import locked
from ecat.store.staging import staged_path
from tests.store.conftest import Steps
from tests.store.sessions import draft, make, number_at


def test_the_folder_is_not_there_before_the_block_ends(tmp_path: Path) -> None:
    dest = tmp_path / "new"
    with staged_folder(dest) as staging:
        (staging / "file").write_text("content")
        assert not dest.exists()
    assert (dest / "file").read_text() == "content"
    assert [path.name for path in tmp_path.rglob("*")] == ["new", "file"]


def test_an_exception_leaves_nothing_not_even_parents(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), staged_folder(tmp_path / "a" / "b" / "new") as staging:
        (staging / "file").write_text(str(1 // 0))
    assert list(tmp_path.iterdir()) == []


def test_missing_parents_are_made(tmp_path: Path) -> None:
    make(tmp_path / "a" / "b" / "session")
    assert number_at(tmp_path / "a" / "b" / "session") == 0


def test_an_empty_folder_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    make(tmp_path / "session", 1)
    assert number_at(tmp_path / "session") == 1


@pytest.mark.parametrize("kind", ["file", "folder", "appears"])
def test_what_is_there_is_never_replaced(tmp_path: Path, kind: str) -> None:
    dest = tmp_path / "dest"
    if kind == "file":
        dest.write_text("precious")
    elif kind == "folder":
        dest.mkdir()
        (dest / "precious").write_text("")
    with pytest.raises(ExistsError, match="it was left as it is"), staged_folder(dest):
        # somebody else was faster
        make(dest)
    assert dest.is_file() or any(dest.iterdir())
    assert [path.name for path in tmp_path.iterdir()] == ["dest"]


def test_a_link_that_leads_nowhere_is_not_followed(tmp_path: Path) -> None:
    dest = tmp_path / "dest"
    dest.symlink_to("nowhere/there")
    with pytest.raises(ExistsError, match="a symbolic link to nowhere/there"):
        make(dest)
    assert [path.name for path in tmp_path.iterdir()] == ["dest"]


def test_a_folder_that_is_being_filled_is_no_leftover_to_remove(tmp_path: Path) -> None:
    with staged_folder(tmp_path / "new") as staging:
        assert leftovers(tmp_path) == [staging]
        assert remove_leftovers(tmp_path) == []
    assert (tmp_path / "new").is_dir()
    abandoned = tmp_path / ".new.0123456789abcdef.partial"
    abandoned.mkdir()
    (tmp_path / ".gitignore").write_text("")
    assert leftovers(tmp_path / "new") == [abandoned]
    assert remove_leftovers(tmp_path / "new") == [abandoned]
    assert sorted(path.name for path in tmp_path.iterdir()) == [".gitignore", "new"]


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENOSPC, DiskError), (errno.EIO, DiskError), (errno.EACCES, ReadOnlyError)]
)
def test_an_error_at_any_step_leaves_nothing(
    tmp_path: Path, steps: Steps, number: int, kind: type[Exception]
) -> None:
    dest = tmp_path / "session"
    made = draft()
    create_session(dest, made)
    step, count, steps.count = 0, steps.count, 0
    for step in range(count):
        shutil.rmtree(dest, ignore_errors=True)
        steps.count, steps.fail_at = 0, step
        steps.error = OSError(number, os.strerror(number), str(dest))
        with pytest.raises(kind) as caught:
            create_session(dest, made)
        if dest.exists():
            # the last steps make sure that it will be there after a power failure too
            assert "is there, but may not survive" in str(caught.value)
            assert number_at(dest) == 0
            assert step >= count - 3
        else:
            assert "nothing was" in str(caught.value)
            assert list(tmp_path.iterdir()) == []
    assert step > 30


def test_a_name_too_long_leaves_no_parents(tmp_path: Path) -> None:
    with pytest.raises(DiskError, match="use a shorter name"), staged_folder(tmp_path / "a" / ("b" * 300)):
        pytest.fail("a folder of that name")
    assert list(tmp_path.iterdir()) == []


def test_a_session_is_locked_while_it_is_being_created(tmp_path: Path) -> None:
    with staged_folder(tmp_path / "new") as staging, pytest.raises(LockedError), locked(staging):
        pytest.fail("two writers at once")


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_path_becomes_whatever_the_block_made(tmp_path: Path, kind: str) -> None:
    dest = tmp_path / "a" / "new"
    with staged_path(dest) as staging:
        assert not staging.exists()
        if kind == "file":
            staging.write_text("content")
        else:
            (staging / "inner").mkdir(parents=True)
            (staging / "inner" / "file").write_text("content")
        assert not dest.exists()
    assert (dest if kind == "file" else dest / "inner" / "file").read_text() == "content"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["new"]


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_path_takes_over_an_empty_folder_and_nothing_else(tmp_path: Path, kind: str) -> None:
    (tmp_path / "empty").mkdir()
    with staged_path(tmp_path / "empty") as staging:
        staging.write_text("") if kind == "file" else staging.mkdir()
    (tmp_path / "taken").write_text("precious")
    with pytest.raises(ExistsError, match="it was left as it is"), staged_path(tmp_path / "taken"):
        pass
    assert (tmp_path / "taken").read_text() == "precious"


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_exception_leaves_nothing_of_a_path(tmp_path: Path, error: type[BaseException]) -> None:
    def fill(dest: Path) -> None:
        with staged_path(dest) as staging:
            staging.mkdir()
            (staging / "file").write_text("")
            raise error

    with pytest.raises(error):
        fill(tmp_path / "a" / "new")
    assert list(tmp_path.iterdir()) == []
