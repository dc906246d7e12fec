"""A file of lines keeps every acknowledged one, and passes over a torn last one."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import CorruptError, DiskError, LimitError, UsageError
from ecat.store.lines import append_line, read_lines
from tests.store.conftest import Steps

RECORDS: list[dict[str, Any]] = [{"do": "AddEvent", "text": "nâng\n\u2028"}, {"do": "Undo", "n": 1.5}, {}]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file that is not there yet, in a folder that is not there yet."""
    return tmp_path / "annotations" / "main.jsonl"


def test_what_was_appended_is_read_in_order(path: Path) -> None:
    assert read_lines(path) == []
    for record in RECORDS:
        append_line(path, record)
    assert read_lines(path) == RECORDS
    assert path.read_bytes().count(b"\n") == len(RECORDS)


@pytest.mark.parametrize("torn", [b"{", b'{"do": "AddEv', b"\0" * 5000, b"\0\0\n", b"[]\n", b'{"whole": 1}'])
def test_a_torn_last_line_is_passed_over_and_then_removed(path: Path, torn: bytes) -> None:
    append_line(path, RECORDS[0])
    with path.open("ab") as file:
        file.write(torn)
    assert read_lines(path) == RECORDS[:1]
    append_line(path, RECORDS[1])
    assert read_lines(path) == RECORDS[:2]


@given(cut=st.integers(0, 200))
@settings(max_examples=40, deadline=None)
def test_a_cut_anywhere_loses_only_the_records_behind_it(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = tmp_path_factory.mktemp("cut") / "annotations" / "main.jsonl"
    for record in RECORDS:
        append_line(path, record)
    data = path.read_bytes()[:cut]
    path.write_bytes(data)
    whole = RECORDS[: data.count(b"\n")]
    assert read_lines(path) == whole
    append_line(path, {"after": True})
    assert read_lines(path) == [*whole, {"after": True}]


def test_a_bad_line_in_the_middle_is_corrupt(path: Path) -> None:
    append_line(path, RECORDS[0])
    path.write_bytes(b"nonsense\n" + path.read_bytes())
    with pytest.raises(CorruptError, match="the line at byte 0 is not a record"):
        read_lines(path)


@pytest.mark.parametrize("record", [{"path": Path()}, {"x": float("nan")}, {"x": "\ud800"}])
def test_what_is_not_json_is_not_appended(path: Path, record: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="not JSON"):
        append_line(path, record)
    assert read_lines(path) == []


def test_no_more_is_appended_than_can_be_read_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    append_line(path, RECORDS[1])
    monkeypatch.setattr("ecat.store.lines.MAX_BYTES", 2 * path.stat().st_size)
    append_line(path, RECORDS[1])
    with pytest.raises(LimitError, match="nothing was appended"):
        append_line(path, RECORDS[2])
    assert read_lines(path) == [RECORDS[1]] * 2


def test_a_full_disk_appends_nothing(path: Path, steps: Steps) -> None:
    append_line(path, RECORDS[0])
    for step in range(3):
        steps.count, steps.fail_at = 0, step
        steps.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        with pytest.raises(DiskError, match="nothing was appended"):
            append_line(path, RECORDS[1])
        assert read_lines(path) == RECORDS[:1]
