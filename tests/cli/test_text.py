"""Tables and figures for people."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ecat.cli.text import cell, columns, count, duration, listing, shell


def test_columns_are_aligned_and_numbers_to_the_right() -> None:
    rows = [["poses", "5,298", "rows"], ["events", "19", "rows"], ["table", "1"]]
    assert columns(rows, indent=2) == "  poses   5,298  rows\n  events     19  rows\n  table       1"


def test_columns_of_mixed_content_align_left() -> None:
    assert columns([["a", "12"], ["b", "unknown"]]) == "a  12\nb  unknown"


def test_empty_columns_take_no_space() -> None:
    assert columns([["a", "", "x"], ["b", "", "y"]]) == "a  x\nb  y"


def test_a_cell_is_one_line_and_not_long() -> None:
    assert cell("a\nb\t c") == "a b c"
    assert cell("x" * 60) == "x" * 60
    assert cell("x" * 61) == "x" * 59 + "…"


def test_no_rows_are_no_text() -> None:
    assert columns([]) == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.040 s"),
        (59.9994, "59.999 s"),
        (59.9996, "1 min 00.000 s"),
        (88.357, "1 min 28.357 s"),
        (3723.4, "1 h 02 min 03 s"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_counts() -> None:
    assert [count(n, "event") for n in (0, 1, 2029)] == ["0 events", "1 event", "2,029 events"]


def test_listings_start_with_the_most() -> None:
    assert listing({"rig": 1, "polygon": 1, "marker_box": 2000}) == "2,000 marker_box, 1 polygon, 1 rig"


def installed(folder: Path, *names: str) -> Path:
    folder.mkdir()
    for name in names:
        (folder / name).touch(mode=0o755)
    return folder


def test_a_command_is_called_by_its_name_where_the_shell_finds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = installed(tmp_path / "bin", "python", "ecat")
    linked = installed(tmp_path / "linked")
    (linked / "ecat").symlink_to(ours / "ecat")
    monkeypatch.setattr(sys, "executable", str(ours / "python"))
    for path in (ours, linked):
        monkeypatch.setenv("PATH", str(path))
        assert shell("ecat", "info", "my session") == "ecat info 'my session'"


def test_a_command_is_called_by_its_path_where_the_shell_finds_none_or_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = installed(tmp_path / ".venv", "python", "ecat")
    other = installed(tmp_path / "other", "ecat")
    monkeypatch.setattr(sys, "executable", str(ours / "python"))
    for path in (other, tmp_path):
        monkeypatch.setenv("PATH", str(path))
        monkeypatch.chdir(tmp_path)
        assert shell("ecat") == ".venv/ecat"
        monkeypatch.chdir(other)
        assert shell("ecat") == str(ours / "ecat")


def test_a_command_that_is_not_installed_keeps_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    assert shell("ecat", "demo") == "ecat demo"
