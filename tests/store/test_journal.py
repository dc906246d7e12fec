"""A journal tells every state of its layer, and the session is never behind it for long."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest

from ecat.errors import CorruptError, DiskError, StaleError, UsageError
from ecat.store import Journal, Place, Session, open_session, validate
from ecat.store.journal import START
from tests.store.conftest import Steps
from tests.store.sessions import append, edited, layer, record


def test_there_is_no_journal_before_the_first_step(session: Session) -> None:
    journal = Journal(session.path, "main")
    assert journal.size() == 0
    assert list(journal.records()) == []


def test_every_state_can_be_replayed(session: Session) -> None:
    states = append(session, 3)
    journal = Journal(session.path, "main")
    assert journal.base() == states[0]
    for revision, state in enumerate(states):
        found, place = journal.replay(revision)
        assert found == state
        assert place.revision == revision
    assert journal.replay()[1].offset == journal.size()


def test_the_next_to_open_the_session_takes_the_journal_over(session: Session) -> None:
    states = append(session, 2)
    opened = open_session(session.path)
    assert opened.layer() == states[-1]
    assert opened.events.to_arrow().num_rows == len(states[-1].events)
    said = opened.manifest.layer("main")
    assert said is not None
    assert (said.journal_revision, said.journal_bytes) == (2, Journal(session.path, "main").size())
    assert validate(opened, deep=True) == []
    assert open_session(session.path).manifest.revision == opened.manifest.revision


def test_a_reader_that_was_open_reads_on_after_a_refresh(session: Session) -> None:
    states = append(session)
    assert session.layer() == states[0]
    assert session.refresh().layer() == states[1]


def test_while_somebody_writes_readers_get_the_last_checkpoint(session: Session) -> None:
    states = append(session)
    with session.write():
        pass
    append(session)
    with open_session(session.path).write() as commit:
        states = append(session)
        beside = open_session(session.path)
        assert len(beside.layer().events) == len(states[-2].events)
        commit.update(foreign={"a": "b"})
    assert open_session(session.path).layer() == states[-1]


def test_a_torn_line_changes_nothing(session: Session) -> None:
    states = append(session)
    with Journal(session.path, "main").path.open("ab") as file:
        file.write(b'{"revision": 2, "auth')
    assert open_session(session.path).layer() == states[-1]
    assert append(session)[-1] == open_session(session.path).layer()


def test_a_torn_beginning_is_no_journal(session: Session) -> None:
    journal = Journal(session.path, "main")
    append(session)
    whole = journal.path.read_bytes()
    journal.path.write_bytes(whole[: whole.index(b"\n") + 10])
    assert open_session(session.path).layer() == layer()
    assert append(session)[-1] == open_session(session.path).layer()


class TestReplacedLayers:
    """Another program puts a layer that people edit."""

    def test_the_replacement_is_a_step_of_the_history(self, session: Session) -> None:
        states = append(session)
        opened = open_session(session.path)
        with opened.write() as commit:
            commit.put_layer(layer(7))
        journal = Journal(session.path, "main")
        steps = [step for step, _ in journal.records()]
        assert [(step.revision, step.op) for step in steps] == [(1, "x"), (2, "replace")]
        assert journal.replay(1)[0] == states[1]
        assert journal.replay(2)[0] == layer(7) == open_session(session.path).layer()
        assert validate(opened, deep=True) == []

    def test_putting_what_is_there_is_no_step(self, session: Session) -> None:
        append(session)
        opened = open_session(session.path)
        with opened.write() as commit:
            commit.put_layer(opened.layer())
        assert len(list(Journal(session.path, "main").records())) == 1
        assert validate(open_session(session.path), deep=True) == []

    def test_an_edit_since_it_was_read_is_not_overwritten(self, session: Session) -> None:
        append(session)
        opened = open_session(session.path)
        states = append(session)
        with pytest.raises(StaleError), opened.write() as commit:
            commit.put_layer(layer(7))
        assert open_session(session.path).layer() == states[-1]

    def test_an_edit_while_it_is_written_is_not_overwritten(self, session: Session) -> None:
        append(session)
        opened = open_session(session.path)

        def write_while_another_edits() -> None:
            with opened.write() as commit:
                commit.put_layer(layer(7))
                append(session)

        with pytest.raises(StaleError):
            write_while_another_edits()
        assert len(open_session(session.path).layer().events) == 3

    def test_a_commit_that_fails_leaves_no_step(self, session: Session, steps: Steps) -> None:
        append(session)
        opened = open_session(session.path)
        failed = 0
        for step in range(200):
            steps.count, steps.fail_at = 0, step
            steps.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(session.path))
            try:
                with opened.write() as commit:
                    commit.put_layer(layer(7))
            except DiskError as error:
                failed += 1
                if "noted" not in error.consequence:
                    steps.fail_at = None
                    assert len(list(Journal(session.path, "main").records())) == 1
                    continue
            break
        steps.fail_at = None
        assert failed > 20
        assert open_session(session.path).layer() == layer(7)
        assert len(list(Journal(session.path, "main").records())) == 2

    def test_tables_may_be_put_while_people_edit(self, session: Session) -> None:
        append(session)
        opened = open_session(session.path)
        states = append(session)
        with opened.write() as commit:
            commit.put_prototypes([])
            commit.put_layer(layer(3, "machine"))
        assert open_session(session.path).layer() == states[-1]

    def test_who_writes_sees_what_people_have_edited_since(self, session: Session) -> None:
        opened = open_session(session.path)
        edited = append(session)[-1]
        with opened.write() as commit:
            commit.put_layer(replace(opened.layer(), name="machine"))
        assert open_session(session.path).layer("machine") == replace(edited, name="machine")

    def test_who_could_not_write_is_as_far_behind_as_before(self, session: Session) -> None:
        opened = open_session(session.path)
        read = opened.layer()
        edited = append(session)[-1]
        for _ in range(2):
            with pytest.raises(StaleError), opened.write() as commit:
                commit.put_layer(read)
        assert open_session(session.path).layer() == edited


class TestMisfits:
    """A journal that is not its layer's: the session opens as it was last saved, and the misfit is named."""

    @pytest.fixture
    def saved(self, session: Session) -> Session:
        append(session, 2)
        return open_session(session.path)

    def check(self, session: Session, what: str) -> None:
        """The session opens, and ``validate`` names the journal."""
        opened = open_session(session.path)
        assert opened.layer() == session.layer()
        (fault,) = validate(opened)
        assert fault.file == "annotations/main.journal.jsonl"
        assert what in fault.problem

    def test_a_missing_journal(self, saved: Session) -> None:
        Journal(saved.path, "main").path.unlink()
        self.check(saved, "0 bytes, but the XML contains")

    def test_a_journal_cut_short(self, saved: Session) -> None:
        path = Journal(saved.path, "main").path
        path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-1]))
        self.check(saved, "but the XML contains")

    def test_a_record_that_follows_no_other(self, saved: Session) -> None:
        path = Journal(saved.path, "main").path
        lines = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join([*lines, lines[-1]]))
        self.check(saved, "revision 2 follows, expected 3")

    def test_changes_of_something_else(self, saved: Session) -> None:
        journal = Journal(saved.path, "main")
        other = layer(3)
        with journal.hold() as held:
            place = held.news(START)[-1][1]
            held.append(place, [record(3, other, replace(other, events=()))])
            held.append(Place(3, journal.size()), [record(4, other, replace(other, events=()))])
        self.check(saved, "does not fit the layer")

    def test_a_journal_of_another_layer(self, session: Session) -> None:
        journal = Journal(session.path, "main")
        with journal.hold() as held:
            held.append(START, [record(1, layer(3), edited(layer(3), 1))], base=layer(3))
        self.check(session, "it continues another layer")

    def test_no_record(self, saved: Session) -> None:
        with Journal(saved.path, "main").path.open("ab") as file:
            file.write(b'{"revision": 3, "author": 7}\n')
        with pytest.raises(CorruptError, match="is not a record"):
            list(Journal(saved.path, "main").records())


@pytest.mark.parametrize("name", ["", "../main", "a/b", ".hidden", "blocks.scheme", "blocks.Scheme"])
def test_a_layer_is_named_like_a_file(session: Session, name: str) -> None:
    with pytest.raises(UsageError, match="not a layer's name"):
        Journal(session.path, name)


def test_a_link_out_of_the_session_is_not_followed(session: Session, tmp_path: Path) -> None:
    (session.path / "annotations" / "main.journal.jsonl").symlink_to(tmp_path / "elsewhere")
    assert open_session(session.path).layer() == layer()
    assert not (tmp_path / "elsewhere").exists()
