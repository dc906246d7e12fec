"""A journal keeps every acknowledged record, and passes over a torn last line."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import CorruptError, DiskError, UsageError
from ecat.store import Session, append_journal, journal, read_journal
from tests.store.conftest import Steps
from tests.store.sessions import make

RECORDS: list[dict[str, Any]] = [{"do": "AddEvent", "text": "nâng\n\u2028"}, {"do": "Undo", "n": 1.5}, {}]


def journal_file(session: Session) -> Path:
    """Where the journal of the layer ``main`` is."""
    return session.path / "annotations" / "main.journal.jsonl"


def test_what_was_appended_is_read_in_order(session: Session) -> None:
    assert read_journal(session, "main") == []
    for record in RECORDS:
        append_journal(session, "main", record)
    append_journal(session, "gold", {"other": True})
    assert read_journal(session, "main") == RECORDS
    assert journal_file(session).read_bytes().count(b"\n") == len(RECORDS)


@pytest.mark.parametrize("torn", [b"{", b'{"do": "AddEv', b"\0" * 5000, b"\0\0\n", b"[]\n", b'{"whole": 1}'])
def test_a_torn_last_line_is_passed_over_and_then_removed(session: Session, torn: bytes) -> None:
    append_journal(session, "main", RECORDS[0])
    with journal_file(session).open("ab") as file:
        file.write(torn)
    assert read_journal(session, "main") == RECORDS[:1]
    append_journal(session, "main", RECORDS[1])
    assert read_journal(session, "main") == RECORDS[:2]


def test_a_line_longer_than_a_block_is_whole(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "_BLOCK", 16)
    for record in ({"text": "a" * 100}, {}, {"text": "b" * 33}, {}):
        append_journal(session, "main", record)
    assert len(read_journal(session, "main")) == 4


@given(cut=st.integers(0, 200))
@settings(max_examples=40, deadline=None)
def test_a_cut_anywhere_loses_only_the_records_behind_it(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    session = make(tmp_path_factory.mktemp("cut") / "session")
    for record in RECORDS:
        append_journal(session, "main", record)
    data = journal_file(session).read_bytes()[:cut]
    journal_file(session).write_bytes(data)
    whole = RECORDS[: data.count(b"\n")]
    assert read_journal(session, "main") == whole
    append_journal(session, "main", {"after": True})
    assert read_journal(session, "main") == [*whole, {"after": True}]


def test_a_bad_line_in_the_middle_is_corrupt(session: Session) -> None:
    append_journal(session, "main", RECORDS[0])
    journal_file(session).write_bytes(b"nonsense\n" + journal_file(session).read_bytes())
    with pytest.raises(CorruptError, match="line 1 is not a record"):
        read_journal(session, "main")


@pytest.mark.parametrize("record", [{"path": Path()}, {"x": float("nan")}, {"x": "\ud800"}])
def test_what_is_not_json_is_not_appended(session: Session, record: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="not JSON"):
        append_journal(session, "main", record)
    assert read_journal(session, "main") == []


@pytest.mark.parametrize("name", ["", "../main", "a/b", ".hidden"])
def test_a_layer_is_named_like_a_file(session: Session, name: str) -> None:
    with pytest.raises(UsageError, match="not a layer's name"):
        append_journal(session, name, {})


def test_a_full_disk_appends_nothing(session: Session, steps: Steps) -> None:
    append_journal(session, "main", RECORDS[0])
    for step in range(3):
        steps.count, steps.fail_at = 0, step
        steps.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(journal_file(session)))
        with pytest.raises(DiskError, match="nothing was appended"):
            append_journal(session, "main", RECORDS[1])
        assert read_journal(session, "main") == RECORDS[:1]
