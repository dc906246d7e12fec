"""What changes the disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from threading import Lock

import pytest

from ecat.store import files


def test_every_one_of_many_is_synced_once_and_the_fault_of_one_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [tmp_path / f"{i}" for i in range(20)]
    for path in paths[:-1]:
        path.write_bytes(b"x")
    synced: list[Path] = []
    lock = Lock()

    def step(action: str, path: Path) -> None:
        with lock:
            synced.append(path)

    monkeypatch.setattr(files, "step", step)
    files.sync_all(paths[:-1])
    assert sorted(synced) == sorted(paths[:-1])
    with pytest.raises(FileNotFoundError):
        files.sync_all(paths)
    files.sync_all([])


def test_a_folder_that_somebody_else_has_just_made_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two processes that begin at once both look for it before either has made it."""
    wanted, in_the_way = tmp_path / "parts", tmp_path / "file"
    in_the_way.touch()
    monkeypatch.setattr(files, "step", lambda what, path: wanted.mkdir())  # pyright: ignore[reportUnknownLambdaType]

    files.make_folder(wanted)

    assert wanted.is_dir()
    monkeypatch.undo()
    with pytest.raises(FileExistsError):
        files.make_folder(in_the_way)


def test_linked_folders_share_their_files_where_the_disk_can(tmp_path: Path) -> None:
    (tmp_path / "a" / "inner").mkdir(parents=True)
    (tmp_path / "a" / "inner" / "file").write_text("content")
    files.link_or_copy(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b" / "inner" / "file").read_text() == "content"
    assert (tmp_path / "b" / "inner" / "file").samefile(tmp_path / "a" / "inner" / "file")


def test_where_the_disk_cannot_link_files_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(source: object, target: object) -> None:
        raise OSError(errno.EXDEV, "another disk")

    monkeypatch.setattr(os, "link", refuse)
    (tmp_path / "a").write_text("content")
    files.link_or_copy(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_text() == "content"
    assert not (tmp_path / "b").samefile(tmp_path / "a")


def test_a_tree_is_synced_from_the_files_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files.make_folders(tmp_path / "a" / "b")
    (tmp_path / "a" / "b" / "file").write_text("")
    synced: list[str] = []
    monkeypatch.setattr(files, "step", lambda action, path: synced.append(path.name))
    files.sync_tree(tmp_path / "a")
    assert synced == ["file", "b", "a"]
