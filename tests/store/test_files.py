"""What changes the disk."""

from __future__ import annotations

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
