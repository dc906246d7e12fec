"""An editor: what it acknowledges is there, whoever edits beside it, and whatever becomes of the process."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from ecat.annotate import AddObject, Editor, RemoveKeyFrame, SetKeyFrame
from ecat.errors import (
    ConflictError,
    CorruptError,
    DiskError,
    LockedError,
    NotFoundError,
    OperationError,
    SchemaError,
    StaleError,
    UsageError,
)
from ecat.model import Event, Layer, Segment
from ecat.store import Journal, Session, files, open_session, validate
from tests.annotate.bench import do, edit, event, op, relation, thing


def ids(layer: Layer) -> list[str]:
    return [e.id for e in layer.events]


class TestOpening:
    def test_a_layer_that_is_not_there_is_made(self, session: Session, reopened: Callable[[], Layer]) -> None:
        editor = Editor(session, "ann", "ann", scheme="blocks")
        assert open_session(session.path).layer("ann") == Layer(name="ann", scheme="blocks")
        assert editor.revision == editor.pending == 0
        assert editor.scheme is not None
        assert not editor.can_undo()

    def test_its_scheme_is_one_that_there_is(self, session: Session) -> None:
        with pytest.raises(NotFoundError, match="cannot find the coding scheme 'none'"):
            Editor(session, "ann", scheme="none")
        assert session.manifest.layer("ann") is None

    def test_a_layer_is_named_like_a_file(self, session: Session) -> None:
        with pytest.raises(UsageError):
            Editor(session, "../main")

    def test_a_layer_whose_ids_are_not_unique_is_refused(self, session: Session) -> None:
        with session.write() as commit:
            commit.put_layer(Layer(events=(Event(id="a1"), Event(id="a1"))))
        with pytest.raises(SchemaError, match="cannot tell the parts"):
            Editor(session)

    def test_a_layer_that_was_edited_by_hand_is_checked_first(self, session: Session) -> None:
        with Editor(session) as editor:
            do(editor, event(0, 9))
        path = session.path / "annotations" / "main.xml"
        path.write_text(path.read_text().replace('end_frame="9"', 'end_frame="8"'))
        with pytest.raises(CorruptError, match=r"main\.xml"):
            Editor(open_session(session.path))

    def test_a_journal_that_does_not_fit_is_refused(self, session: Session) -> None:
        with Editor(session) as editor:
            do(editor, event(0, 9))
        Journal(session.path, "main").path.unlink()
        with pytest.raises(CorruptError, match="cannot use the journal"):
            Editor(open_session(session.path))


class TestSteps:
    def test_a_step_is_on_the_disk_when_it_is_acknowledged(
        self, session: Session, reopened: Callable[[], Layer]
    ) -> None:
        editor = edit(session)
        record = do(editor, event(0, 9))
        assert (record.revision, record.author, record.operation["op"]) == (1, "ann", "add_event")
        assert record.time.endswith("Z")
        assert [step for step, _ in Journal(session.path, "main").records()] == [record]
        assert editor.pending == 1
        assert reopened() == editor.layer

    def test_several_operations_are_one_step_or_none(self, session: Session) -> None:
        editor = edit(session)
        record = do(editor, thing("cup"), event(0, 9, roles={"Theme": "o1"}))
        assert [o["op"] for o in record.operation["operations"]] == ["add_object", "add_event"]
        before = editor.layer
        with pytest.raises(OperationError):
            do(editor, event(0, 9), event(9, 0))
        assert (editor.layer, editor.revision) == (before, 1)
        editor.undo()
        assert editor.layer == Layer()

    def test_what_changes_nothing_is_no_step(self, session: Session) -> None:
        editor = edit(session)
        do(editor, thing("cup"))
        record = do(editor, op("edit_object", id="o1", name="cup"))
        assert (record.revision, record.changes, editor.revision) == (1, (), 1)
        assert editor.apply([]).changes == ()

    @pytest.mark.parametrize("author", ["\0", "\ud800", "a" * 201])
    def test_an_author_has_a_name(self, session: Session, author: str) -> None:
        with pytest.raises(SchemaError) as caught:
            do(edit(session), event(0, 9), author=author)
        assert caught.value.problems[0].startswith("author: ")

    def test_a_full_disk_changes_nothing(self, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        before = editor.layer

        def full(action: str, path: Path) -> None:
            if action == "sync":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

        monkeypatch.setattr(files, "step", full)
        for asked in (event(20, 29), op("remove_event", id="a1")):
            with pytest.raises(DiskError, match="nothing was appended"):
                do(editor, asked)
        with pytest.raises(DiskError):
            editor.undo()
        assert (editor.layer, editor.revision, editor.can_undo()) == (before, 1, True)
        monkeypatch.undo()
        assert do(editor, event(20, 29)).revision == 2
        assert open_session(session.path).layer() == editor.layer

    def test_a_step_of_a_batch_can_be_far_larger_than_one(self, session: Session) -> None:
        editor = edit(session)
        do(editor, *(event(n, n + 1) for n in range(900)))
        editor.undo()
        assert editor.layer == Layer()
        editor.redo()
        assert len(editor.layer.events) == 900


class TestUndo:
    def test_everything_can_be_undone_even_the_first_step(self, session: Session) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        editor.undo()
        assert editor.layer == Layer()
        assert editor.history()[-1].operation == {"op": "undo", "undoes": 1}

    def test_a_new_step_ends_what_could_be_done_again(self, session: Session) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        do(editor, event(20, 29))
        editor.undo()
        do(editor, thing("cup"))
        assert not editor.can_redo()
        editor.undo()
        editor.undo()
        assert editor.layer == Layer()
        editor.redo()
        editor.redo()
        assert (ids(editor.layer), len(editor.layer.objects)) == (["a1"], 1)

    def test_everybody_undoes_what_they_did_themselves(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9))
        do(bob, event(20, 29))
        ann.undo()
        assert ids(ann.layer) == ["a2"]
        bob.undo()
        assert ids(bob.layer) == []
        ann.redo()
        bob.redo()
        assert ids(bob.layer) == ["a2", "a1"] or ids(bob.layer) == ["a1", "a2"]

    def test_ids_that_others_got_stay_theirs(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9))
        do(bob, event(20, 29))
        ann.undo()
        do(ann, event(40, 49))
        assert ids(ann.layer) == ["a2", "a3"]

    def test_what_others_changed_since_is_not_undone(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9))
        do(bob, op("edit_event", id="a1", text="bob was here"))
        with pytest.raises(ConflictError, match="cannot undo") as caught:
            ann.undo()
        assert caught.value.where == "event a1, changed since by others"
        assert (ann.layer, ann.revision) == (bob.layer, 2)

    def test_nor_what_others_built_upon(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, thing("cup"))
        do(ann, event(0, 50))
        do(bob, event(10, 20, parent="a1"), relation("STAND", "o1"))
        with pytest.raises(ConflictError, match="cannot undo"):
            ann.undo()
        do(bob, op("set_parent", id="a2"))
        ann.undo()
        with pytest.raises(ConflictError) as caught:
            ann.undo()
        assert "relation r1 names object o1" in caught.value.where

    def test_a_key_frame_of_an_object_that_is_gone_is_not_undone(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(bob, thing("cup", "point", frame=0, coordinates=[1, 2]))
        do(ann, op("set_key_frame", object="o1", frame=9, coordinates=[3, 4]))
        do(bob, op("remove_object", id="o1"))
        with pytest.raises(ConflictError):
            ann.undo()

    def test_it_outlives_the_process_and_every_save(self, session: Session) -> None:
        for start in (0, 20, 40):
            with edit(session) as editor:
                do(editor, event(start, start + 9))
        with edit(session) as editor:
            editor.undo()
            editor.undo()
        with edit(session) as editor:
            assert ids(editor.layer) == ["a1"]
            editor.redo()
        assert ids(open_session(session.path).layer()) == ["a1", "a2"]


class TestHistory:
    def test_any_revision_can_be_looked_at_and_restored(self, session: Session) -> None:
        editor = edit(session)
        states = [editor.layer]
        for asked in (
            thing("cup"),
            event(0, 9),
            op("edit_event", id="a1", text="cup"),
            op("find_references"),
        ):
            do(editor, asked)
            states.append(editor.layer)
        assert [editor.at(n) for n in range(5)] == states
        assert editor.restore(2).operation == {"op": "restore", "revision": 2}
        assert editor.layer == states[2]
        editor.undo()
        assert editor.layer == states[4]
        with pytest.raises(UsageError, match="cannot go to revision 9"):
            editor.restore(9)

    def test_it_can_be_browsed(self, session: Session) -> None:
        editor = edit(session)
        for n in range(5):
            do(editor, event(n, n + 1))
        assert [record.revision for record in editor.history(2, 3)] == [2, 3, 4]
        assert editor.history(6) == editor.history(1, 0) == []
        assert len(edit(session).history()) == 5

    def test_it_says_that_another_program_replaced_the_layer(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, event(0, 9))
            writer = open_session(session.path)
            with writer.write() as commit:
                commit.put_layer(Layer())
            (news,) = editor.refresh()
            assert (news.op, editor.layer.events) == ("replace", ())
            with pytest.raises(ConflictError):
                editor.undo()
            editor.restore(1)
        assert ids(open_session(session.path).layer()) == ["a1"]


class TestManyAtOnce:
    def test_editors_see_what_others_did_before_they_do_something(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9))
        assert bob.revision == 0
        do(bob, op("edit_event", id="a1", text="seen"))
        assert [record.author for record in ann.refresh()] == ["bob"]
        assert ann.refresh() == []
        assert ann.layer == bob.layer

    def test_who_names_an_old_revision_gets_what_happened_since(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9), base=0)
        do(ann, event(20, 29), base=1)
        with pytest.raises(StaleError) as caught:
            do(bob, event(40, 49), base=0)
        assert caught.value.revision == 2
        assert [record.revision for record in caught.value.records] == [1, 2]
        assert bob.layer == ann.layer
        assert do(bob, event(40, 49), base=2).revision == 3
        for base in (7, -1):
            with pytest.raises(StaleError):
                do(bob, event(60, 69), base=base)

    def test_one_editor_may_serve_several_people(self, session: Session) -> None:
        editor = edit(session, "server")
        do(editor, event(0, 9), author="ann")
        do(editor, event(20, 29), author="bob")
        assert (editor.can_undo("ann"), editor.can_undo("bob"), editor.can_undo()) == (True, True, False)
        editor.undo(author="ann")
        assert ids(editor.layer) == ["a2"]
        assert editor.layer.events[0].author == "bob"

    def test_before_the_first_step_another_program_may_replace_the_layer(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        replaced = Layer(events=(Event(id="a7", segments=(Segment(start_frame=0, end_frame=9),)),))
        with open_session(session.path).write() as commit:
            commit.put_layer(replaced)
        assert ann.refresh() == []
        assert ann.layer == replaced
        with pytest.raises(StaleError):
            do(bob, event(20, 29), base=0)
        late = edit(session, "late")
        do(bob, event(20, 29), base=0)
        assert ids(open_session(session.path).layer()) == ["a7", "a1"]
        assert validate(open_session(session.path)) == []
        late.refresh()
        assert late.layer == bob.layer

    def test_nor_does_it_matter_who_takes_the_first_step(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        with open_session(session.path).write() as commit:
            commit.put_layer(Layer(scheme="blocks"))
        do(edit(session, "eve"), event(20, 29))
        do(ann, event(40, 49))
        bob.refresh()
        assert bob.layer == ann.layer == open_session(session.path).layer()
        assert ann.layer.scheme == "blocks"


class TestSaving:
    def test_a_saved_session_contains_everything(self, session: Session) -> None:
        with Editor(session, author="ann") as editor:
            do(editor, thing("cup"), event(0, 9, roles={"Theme": "o1"}), relation("STAND", "o1"))
            editor.save()
            assert (editor.pending, editor.saved_revision) == (0, 1)
            do(editor, event(20, 29))
        assert session.manifest.revision == open_session(session.path).manifest.revision
        assert session.events.to_arrow().num_rows == 2
        assert validate(session, deep=True) == []

    def test_nothing_new_is_not_saved(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, event(0, 9))
        revision = open_session(session.path).manifest.revision
        with edit(session):
            pass
        assert open_session(session.path).manifest.revision == revision

    def test_what_somebody_else_has_saved_already_is_not_saved_again(self, session: Session) -> None:
        ann, bob = edit(session, "ann"), edit(session, "bob")
        do(ann, event(0, 9))
        bob.save()
        revision = open_session(session.path).manifest.revision
        ann.save()
        assert ann.pending == 0
        assert open_session(session.path).manifest.revision == revision

    def test_editing_goes_on_while_it_saves(self, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        done: list[int] = []

        def meanwhile(action: str, path: Path) -> None:
            if path.name == "session.json" and not done:
                done.append(do(editor, event(20, 29)).revision)

        monkeypatch.setattr(files, "step", meanwhile)
        editor.save()
        assert done == [2]
        assert editor.pending == 1
        monkeypatch.undo()
        assert open_session(session.path).layer() == editor.layer

    def test_what_cannot_be_saved_now_is_taken_over_later(
        self, session: Session, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(Session.save_checkpoint, "__kwdefaults__", {"wait_s": 0.0})
        with edit(session) as editor:
            do(editor, event(0, 9))
            with session.hold():
                with edit(session, "bob") as other:
                    do(other, event(20, 29))
                assert len(open_session(session.path).layer().events) == 0
                with pytest.raises(LockedError):
                    editor.save()
        assert len(open_session(session.path).layer().events) == 2

    def test_a_hand_edit_of_the_xml_is_not_overwritten(self, session: Session) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        editor.save()
        path = session.path / "annotations" / "main.xml"
        path.write_text(path.read_text().replace('end_frame="9"', 'end_frame="8"'))
        do(editor, event(20, 29))
        with pytest.raises(CorruptError, match=r"main\.xml"):
            editor.save()
        assert 'end_frame="8"' in path.read_text()

    def test_and_can_be_taken_over_with_what_was_edited_since(self, session: Session) -> None:
        from ecat.store import adopt_edited_layers

        editor = edit(session)
        do(editor, event(0, 9))
        editor.save()
        path = session.path / "annotations" / "main.xml"
        path.write_text(path.read_text().replace('end_frame="9"', 'end_frame="8"'))
        do(editor, event(20, 29))
        assert adopt_edited_layers(open_session(session.path)) == ["main"]
        opened = open_session(session.path)
        spans = [e.segments[0].end_frame for e in opened.layer().events]
        assert spans == [8, 29]
        assert validate(opened, deep=True) == []
        with edit(session) as again:
            assert [record.op for record in again.history()] == ["add_event", "add_event", "replace"]
            assert again.at(2).events[0].segments[0].end_frame == 9


def test_a_key_frame_comes_back_among_those_that_others_set_meanwhile(session: Session) -> None:
    with Editor(session, author="ann") as editor:
        editor.apply(AddObject(kind="point", id="o1", frame=10, coordinates=(1.0, 1.0)))
        editor.apply(RemoveKeyFrame(object="o1", frame=10))
        for frame in (2, 5):
            editor.apply(SetKeyFrame(object="o1", frame=frame, coordinates=(2.0, 2.0)), author="ben")
        editor.undo()
        assert [key.frame for key in editor.layer.objects[0].key_frames] == [2, 5, 10]
