"""What went wrong in ECAT 2018, and does not here (ECAT 2018 file format §4)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ecat.annotate import Editor
from ecat.errors import SchemaError
from ecat.model import Argument, Event, KeyFrame, Layer, Link, Relation, Role, Segment
from ecat.model.holding import presence
from ecat.store import Session, adopt_edited_layers, open_session
from tests.annotate.bench import Bench, do, edit, event, op, relation, thing

SPAN = (Segment(start_frame=0, end_frame=9),)


def reopened(session: Session) -> Layer:
    return open_session(session.path).layer()


class TestNothingIsLost:
    def test_finding_references_leaves_what_was_marked(self, bench: Bench) -> None:
        bench.do(thing("cup"), event(0, 9, text="take the mug and cup"))
        bench.do(op("add_reference", id="a1", start=9, end=12, target="o1"))
        bench.do(op("set_predicates", id="a1", predicates=[{"start": 0, "end": 4, "type": "take"}]))
        bench.do(op("find_references"))
        assert [(r.start, r.end) for r in bench.event().references] == [(9, 12), (17, 20)]
        assert len(bench.event().predicates) == 1

    def test_a_link_of_a_type_that_nobody_knows_is_kept(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, event(0, 9), event(9, 20), op("link_events", id="a1", type="next to?", target="a2"))
        assert reopened(session).events[0].links == (Link(type="next to?", target="a2"),)

    def test_what_was_imported_about_objects_that_are_gone_is_kept(self, session: Session) -> None:
        dangling = Relation(id="r1", predicate="ON", start_frame=0, arguments=(Argument(target="o9"),))
        imported = Event(id="a1", segments=SPAN, roles=(Role(name="Theme", target="o9"),))
        with session.write() as commit:
            commit.put_layer(Layer(events=(imported,), relations=(dangling,)))
        with edit(session) as editor:
            do(editor, op("edit_event", id="a1", text="still"), op("edit_relation", id="r1", start_frame=3))
        found = reopened(session)
        assert (found.relations[0].targets, found.events[0].roles) == (("o9",), imported.roles)

    def test_any_property_can_be_saved_and_read_again(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, thing("cup"))
            for name in ("my size", "1st", "a<b", "id"):
                do(editor, op("set_property", target="o1", name=name, value='"&'))
        assert [p.name for p in reopened(session).objects[0].properties] == ["my size", "1st", "a<b", "id"]

    def test_shapes_in_space_are_read_again(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, thing("top", "rectangle", dimensions=3, frame=0, coordinates=[0, 0, 1, 1, 0, 1]))
        assert reopened(session).objects[0].key_frames_3d[0].coordinates == (0, 0, 1, 1, 0, 1)

    def test_a_layer_that_cannot_be_read_is_not_overwritten(self, session: Session) -> None:
        with edit(session) as editor:
            do(editor, event(0, 9))
        path = session.path / "annotations" / "main.xml"
        broken = path.read_text().replace("<event ", "<event wrong='1' ")
        path.write_text(broken)
        with pytest.raises(SchemaError):
            adopt_edited_layers(open_session(session.path))
        assert path.read_text() == broken

    def test_closing_without_saving_loses_nothing(self, session: Session) -> None:
        do(edit(session), event(0, 9))
        assert len(reopened(session).events) == 1

    def test_saving_does_not_close(self, session: Session) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        editor.save()
        do(editor, event(9, 20))
        assert len(reopened(session).events) == 2

    def test_ids_begin_where_they_ended(self, session: Session) -> None:
        for _ in range(2):
            with edit(session) as editor:
                do(editor, event(0, 9))
                do(editor, op("remove_event", id=editor.layer.events[-1].id))
        with edit(session) as editor:
            do(editor, event(0, 9))
            assert [e.id for e in editor.layer.events] == ["a3"]


class TestNothingIsWrong:
    def test_the_first_undo_undoes_and_the_last_reaches_the_beginning(self, session: Session) -> None:
        editor = edit(session)
        do(editor, event(0, 9))
        do(editor, event(9, 20))
        editor.undo()
        assert len(editor.layer.events) == 1
        editor.undo()
        assert editor.layer == Layer()

    def test_windows_that_skip_what_is_there_add_the_others(self) -> None:
        bench = Bench(Layer(), n_frames=60)
        bench.do(event(20, 40))
        bench.do(op("add_windows", start=0, step=20, duration=20, existing="skip"))
        assert sorted(bench.spans(e.id)[0][0] for e in bench.layer.events) == [0, 20, 40]

    def test_a_man_is_not_in_a_woman(self, bench: Bench) -> None:
        bench.do(thing("man"), event(0, 9, text="a woman"), op("find_references"))
        assert bench.event().references == ()

    def test_after_one_reference_is_removed_another_can_be(self, bench: Bench) -> None:
        bench.do(thing("cup"), event(0, 9, text="cup cup cup"), op("find_references"))
        bench.do(op("remove_reference", id="a1", start=4, end=7))
        bench.do(op("remove_reference", id="a1", start=8, end=11))
        assert [(r.start, r.end) for r in bench.event().references] == [(0, 3)]

    def test_an_absence_at_the_very_first_frame_is_one(self, bench: Bench) -> None:
        bench.do(
            thing("cup", "rectangle", frame=0, coordinates=[1, 2, 3, 4]),
            op("set_absent", object="o1", frame=0),
        )
        assert presence(bench.layer.objects[0]) == ()

    def test_an_event_that_is_removed_leaves_no_link_to_it(self, bench: Bench) -> None:
        bench.do(event(0, 9), event(9, 20), op("link_events", id="a1", type="CAUSE", target="a2"))
        bench.do(op("remove_event", id="a2"))
        assert bench.event().links == ()

    def test_of_two_facts_at_one_frame_the_other_arguments_count(self, bench: Bench) -> None:
        bench.do(thing("ann"), thing("bob"), thing("eve"))
        bench.do(relation("LOOK_AT", "o1", "o2"), relation("LOOK_AT", "o3", "o2"))
        assert len(bench.layer.relations) == 2

    def test_a_key_frame_is_at_the_frame_that_is_shown(self, bench: Bench) -> None:
        bench.do(thing("cup", "rectangle", frame=7, coordinates=[1, 2, 3, 4]))
        assert bench.layer.objects[0].key_frames == (
            replace(KeyFrame(frame=7, coordinates=(1, 2, 3, 4)), t_ns=7 * 33_000_000),
        )


def test_two_editors_at_once_are_no_trap_either(session: Session) -> None:
    with Editor(session, author="ann") as ann, edit(session, "bob") as bob:
        do(ann, event(0, 9))
        do(bob, event(9, 20))
    assert len(reopened(session).events) == 2
