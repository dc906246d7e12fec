"""Files that leave a session are there whole, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from ecat.errors import DiskError, ExistsError, ReadOnlyError
from ecat.store import files, staged_file, staged_folder, write_new_file


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def fail(dest: Path, *, replaces: bytes = b"") -> None:
    """Write half a file."""
    with staged_file(dest, replaces=replaces) as staging:
        staging.write_bytes(b"ab")
        raise KeyError


class TestStagedFile:
    def test_it_appears_when_the_block_ends(self, tmp_path: Path) -> None:
        with staged_file(tmp_path / "new" / "out.bin") as staging:
            staging.write_bytes(b"abc")
            assert not (tmp_path / "new" / "out.bin").exists()
        assert (tmp_path / "new" / "out.bin").read_bytes() == b"abc"
        assert left(tmp_path / "new") == ["out.bin"]

    def test_an_error_leaves_nothing_not_even_the_folder(self, tmp_path: Path) -> None:
        with pytest.raises(KeyError):
            fail(tmp_path / "new" / "out.bin")
        assert left(tmp_path) == []

    def test_what_is_there_stays(self, tmp_path: Path) -> None:
        (tmp_path / "out.bin").write_bytes(b"old")
        with pytest.raises(ExistsError, match=r"cannot write out\.bin"), staged_file(tmp_path / "out.bin"):
            raise AssertionError
        assert (tmp_path / "out.bin").read_bytes() == b"old"

    def test_what_is_there_is_replaced_only_by_something_whole(self, tmp_path: Path) -> None:
        (tmp_path / "out.bin").write_bytes(b"old")
        with pytest.raises(KeyError):
            fail(tmp_path / "out.bin", replaces=b"ol")
        assert (tmp_path / "out.bin").read_bytes() == b"old"
        with staged_file(tmp_path / "out.bin", replaces=b"ol") as staging:
            staging.write_bytes(b"new")
        assert (tmp_path / "out.bin").read_bytes() == b"new"
        assert left(tmp_path) == ["out.bin"]

    def test_another_kind_of_file_and_a_part_of_a_session_are_never_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "out.bin").write_bytes(b"PNG")
        inside = tmp_path / "session" / "tables" / "poses.parquet"
        inside.parent.mkdir(parents=True)
        inside.write_bytes(b"old")
        (tmp_path / "session" / "session.json").write_bytes(b"old")
        for dest in (tmp_path / "out.bin", inside, tmp_path / "session" / "session.json"):
            before = dest.read_bytes()
            with pytest.raises(ExistsError):
                fail(dest, replaces=b"ol")
            assert dest.read_bytes() == before

    @pytest.mark.parametrize("write", [staged_file, staged_folder])
    def test_nothing_new_appears_inside_of_a_session(
        self, tmp_path: Path, write: Callable[[Path], AbstractContextManager[Path]]
    ) -> None:
        (tmp_path / "session.json").touch()
        with pytest.raises(ExistsError, match="inside of the session"), write(tmp_path / "media" / "new"):
            pass
        assert left(tmp_path) == ["session.json"]

    def test_a_full_disk_is_one_typed_error(self, tmp_path: Path) -> None:
        with pytest.raises(DiskError) as caught, staged_file(tmp_path / "out.bin"):
            raise OSError(28, "No space left on device")
        assert caught.value.consequence == f"nothing was written to {tmp_path / 'out.bin'}"
        assert left(tmp_path) == []


class TestWriteNewFile:
    def test_pieces_become_a_file(self, tmp_path: Path) -> None:
        write_new_file(tmp_path / "a", [b"x", b"yz"])
        assert (tmp_path / "a").read_bytes() == b"xyz"

    def test_no_permission_is_one_typed_error(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def denied(action: str, path: Path) -> None:
            raise PermissionError(13, "Permission denied", str(path))

        monkeypatch.setattr(files, "step", denied)
        with pytest.raises(ReadOnlyError, match="cannot write a"):
            write_new_file(tmp_path / "a", [b"x"])
