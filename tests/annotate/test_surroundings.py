"""What an edit may look at beside its layer: proposals, other sessions, the clock, coding schemes."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from ecat.annotate import Editor, write_scheme
from ecat.annotate.schemes import scheme_file
from ecat.errors import NotFoundError, OperationError
from ecat.model import AnnotatedObject, Clock, CodingScheme, Event, Layer, Segment
from ecat.store import Draft, Session, TableData, create_session, open_session
from ecat.tables import TABLES
from tests.annotate.bench import MANIFEST, do, edit, event, op, relation, thing


def test_proposals_are_those_that_there_are_now(session: Session) -> None:
    editor = edit(session)
    proposed = Event(id="a1", segments=(Segment(start_frame=0, end_frame=9),), status="proposed")
    with open_session(session.path).write() as commit:
        commit.put_layer(Layer(name="machine", events=(proposed,)))
    do(editor, op("accept_proposal", proposal="machine/a1"))
    with pytest.raises(NotFoundError, match="cannot read layer robot"):
        do(editor, op("accept_proposal", proposal="robot/a1"))
    assert editor.layer.decisions[0].result == "a1"


def test_objects_of_the_sessions_beside_can_be_named(session: Session) -> None:
    other = create_session(session.path.parent / "other", Draft(manifest=MANIFEST))
    with Editor(other) as editor:
        do(editor, thing("cup", "point", frame=3, coordinates=[1, 2]))
    with edit(session) as editor:
        do(editor, op("copy_objects", session="other", frame=5))
        do(editor, relation("NEAR", "o1", "other/o1"))
        for name in ("never", "..", "a/b"):
            with pytest.raises(NotFoundError):
                do(editor, op("copy_objects", session=name, frame=5))
        assert editor.layer.objects[0].name == "cup"


def test_a_recorded_clock_gives_the_times(session: Session) -> None:
    times = np.arange(1000) ** 2
    rows = {"t_ns": pa.array(times), "frame": pa.array(range(1000), pa.int32())}
    table = pa.table({**rows, "stream": pa.array(["color"] * 1000)}).cast(TABLES["frames"].arrow)
    with session.write() as commit:
        commit.put_table("frames", TableData(data=table))
        commit.update(clock=Clock(rule="recorded"))
    editor = edit(session)
    do(editor, event(10, 20), event(990, 1000))
    first, last = (e.segments[0] for e in editor.layer.events)
    assert (first.start_ns, first.end_ns, last.start_ns) == (100, 400, 990**2)
    assert last.end_ns == 999**2 + 999


def test_its_own_coding_scheme_counts(session: Session) -> None:
    write_scheme(CodingScheme(name="mine", closed=True), scheme_file(session.path, "mine"))
    editor = Editor(session, scheme="mine")
    with pytest.raises(OperationError, match="cannot add event"):
        do(editor, event(0, 9, type="slide"))
    do(editor, op("set_scheme", name="blocks"))
    do(editor, event(0, 9, type="pour"))
    with pytest.raises(NotFoundError, match="cannot find the coding scheme 'none'"):
        do(editor, op("set_scheme", name="none"))


def test_objects_of_a_new_layer_are_not_called_as_those_that_tables_name(session: Session) -> None:
    boxes = tuple(AnnotatedObject(id=name, kind="marker_box") for name in ("shell", "o2", "o5"))
    with session.write() as commit:
        commit.put_layer(Layer(name="main", objects=boxes, object_counter=3))
    with Editor(session, "ann") as editor:
        do(editor, thing("cup"))
    assert [drawn.id for drawn in session.layer("ann").objects] == ["o6"]
