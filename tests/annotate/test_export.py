"""What was annotated from nothing is a session that ECAT 2018 can open, and reads again as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ecat.annotate import Editor
from ecat.formats import export, import_source
from ecat.model import AnnotatedObject, Layer
from ecat.model.annotation import without_usual_ids
from ecat.store import Session, open_session
from tests.annotate.bench import do, event, op, relation, thing


def annotate(session: Session) -> Layer:
    """Everything that ECAT can hold, made, changed and taken back."""
    with Editor(session, author="ann", scheme="ecat-2018") as editor:
        do(editor, thing("cup", "rectangle", frame=0, coordinates=[10.5, 20, 30, 40], color="#00ff00"))
        do(editor, thing("table", "polygon", frame=0, coordinates=[0, 0, 9, 0, 9, 9, 0, 9], color="#ff0000"))
        do(editor, op("set_key_frame", object="o1", frame=50, coordinates=[-1, 2, 3, 4]))
        do(
            editor,
            op("set_absent", object="o1", frame=80),
            op("set_property", target="o1", name="size", value="<big>"),
        )
        do(editor, event(0, 100, tier="event", text='cup & "table"'), op("find_references"))
        do(editor, event(10, 40, tier="event"), event(50, 60, tier="event", text="lost"))
        do(editor, op("link_events", id="a2", type="CAUSE", target="a1"))
        do(editor, op("set_predicates", id="a1", predicates=[{"start": 0, "end": 3, "type": "cup"}]))
        do(editor, op("edit_event", id="a1", type="cup"))
        do(editor, relation("SUPPORT", "o2", "o1", start=3), relation("STAND", "o1", start=5))
        do(editor, relation("STAND", "o1", start=9, polarity=False))
        do(editor, op("remove_event", id="a3"))
        editor.undo()
        editor.undo()
        editor.redo()
        do(editor, op("split_event", id="a2", frame=20))
        return editor.layer


def trip(session: Session, folder: Path) -> Session:
    """Export and import."""
    export(session.path, folder / "project", format="ecat-2018")
    import_source(folder / "project", folder / "back")
    return open_session(folder / "back")


def test_it_comes_back_as_it_was(session: Session, tmp_path: Path) -> None:
    made = annotate(session)
    found = trip(session, tmp_path).layer()
    assert without_usual_ids(found).relations == tuple(
        replace(fact, author="", start_ns=None, id="") for fact in made.relations
    )
    assert [_plain(thing) for thing in found.objects] == [_plain(thing) for thing in made.objects]
    assert found.events == tuple(
        replace(e, author="", segments=tuple(replace(s, start_ns=None, end_ns=None) for s in e.segments))
        for e in made.events
    )
    assert (found.object_counter, found.event_counter) == (made.object_counter, made.event_counter)


def _plain(thing: AnnotatedObject) -> AnnotatedObject:
    """Times follow from the clock, which ECAT keeps to the millisecond."""
    return replace(thing, stream="", key_frames=tuple(replace(key, t_ns=None) for key in thing.key_frames))


def test_sub_events_come_back(session: Session, tmp_path: Path) -> None:
    with Editor(session) as editor:
        do(
            editor,
            event(0, 100, tier="event"),
            event(10, 40, parent="a1"),
            op("add_event", segments=[[0, 5], [9, 12]]),
        )
    found = trip(session, tmp_path).layer()
    assert [e.parent for e in found.events] == [None, "a1", None]
    assert found.events[0].links == ()
    # ECAT has one span per event
    assert [(s.start_frame, s.end_frame) for s in found.events[2].segments] == [(0, 12)]


def test_an_imported_session_that_was_edited_and_restored_is_written_byte_for_byte(
    session: Session, tmp_path: Path
) -> None:
    annotate(session)
    back = trip(session, tmp_path)
    first = (tmp_path / "project" / "files.param").read_bytes()
    with Editor(back, author="bob") as editor:
        do(editor, op("remove_object", id="o1"), op("remove_event", id="a1"), event(0, 9))
        do(editor, thing("mug", "rectangle", frame=0, coordinates=[1, 2, 3, 4]))
        editor.undo()
        editor.restore(0)
    export(back.path, tmp_path / "again", format="ecat-2018")
    assert (tmp_path / "again" / "files.param").read_bytes() == first


def test_of_layers_without_main_a_persons_is_written(session: Session, tmp_path: Path) -> None:
    with Editor(session, "machine") as editor:
        do(editor, event(0, 9))
    with Editor(session, "zoe") as editor:
        do(editor, event(20, 29))
    assert trip(session, tmp_path).layer().events[0].segments[0].start_frame == 20
