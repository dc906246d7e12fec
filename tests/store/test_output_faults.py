"""A file that leaves a session survives a failing disk and a faster neighbour."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from ecat.errors import DiskError, ExistsError
from ecat.store import staged_file
from tests.store.conftest import Steps


def save(dest: Path, *, replaces: bytes = b"", meanwhile: Callable[[], object] = lambda: None) -> None:
    with staged_file(dest, replaces=replaces) as staging:
        staging.write_text("new")
        meanwhile()


def test_an_error_at_any_step_leaves_nothing_or_says_that_the_file_is_there(
    tmp_path: Path, steps: Steps
) -> None:
    save(tmp_path / "first" / "inner" / "file")
    count = steps.count
    assert count >= 5
    for step in range(count):
        folder = tmp_path / str(step)
        folder.mkdir()
        steps.count, steps.fail_at = 0, step
        steps.error = OSError(errno.EIO, os.strerror(errno.EIO))
        with pytest.raises(DiskError) as caught:
            save(folder / "new" / "inner" / "file")
        there = [path for path in folder.rglob("*") if path.is_file()]
        if there:
            assert [path.read_text() for path in there] == ["new"]
            assert "is there, but may not survive a power failure" in caught.value.consequence
        else:
            assert "nothing was written" in caught.value.consequence
            assert list(folder.iterdir()) == []


def test_what_appeared_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    dest = tmp_path / "file"
    with pytest.raises(ExistsError, match="it was left as it is"):
        save(dest, meanwhile=lambda: dest.write_text("from somebody else"))
    assert [path.read_text() for path in tmp_path.iterdir()] == ["from somebody else"]


def test_a_folder_is_never_replaced_by_a_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(ExistsError):
        save(tmp_path / "folder", replaces=b"n")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize("replaces", [b"", b"n"])
def test_a_link_that_leads_nowhere_is_not_followed_and_not_replaced(tmp_path: Path, replaces: bytes) -> None:
    dest = tmp_path / "link"
    dest.symlink_to("nowhere")
    with pytest.raises(ExistsError, match="a symbolic link to nowhere"):
        save(dest, replaces=replaces)
    assert [path.name for path in tmp_path.iterdir()] == ["link"]


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save(tmp_path / "new" / "file", meanwhile=interrupt)
    assert list(tmp_path.iterdir()) == []
