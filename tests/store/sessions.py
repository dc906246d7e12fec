"""Sessions for the tests: every part of one carries the same number, so that a mix of two shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Segment
from ecat.model.changes import diff
from ecat.model.record import Record
from ecat.store import Draft, Journal, Session, TableData, create_session, open_session, validate
from ecat.store.commit import Commit
from ecat.store.journal import START
from ecat.tables import TABLES

MANIFEST = Manifest(
    name="session",
    created="2020-01-01T00:00:00",
    n_frames=2400,
    clock=Clock(rule="uniform", duration_ns=80_000_000_000),
)


def layer(number: int = 0, name: str = "main") -> Layer:
    """A layer whose event says ``number``."""
    event = Event(id="e1", text=str(number), segments=(Segment(start_frame=10, end_frame=20),))
    return Layer(
        name=name, objects=(AnnotatedObject(id="o1", name="box", kind="marker_box"),), events=(event,)
    )


def rows(name: str, n: int, number: int = 0) -> pa.Table:
    """``n`` rows of the table called ``name``, one per frame, 30 a second, telling ``number``."""
    schema = TABLES[name].arrow
    columns = []
    for field in schema:
        if field.name == "t_ns":
            columns.append(pa.array(np.arange(n) * 1_000_000_000 // 30))
        elif field.name == "frame":
            columns.append(pa.array(np.arange(n, dtype=np.int32)))
        elif pa.types.is_dictionary(field.type):
            columns.append(
                pa.array(np.full(n, f"{field.name}{number}", dtype=object), pa.string()).dictionary_encode()
            )
        elif pa.types.is_floating(field.type):
            columns.append(pa.array(np.random.default_rng(number).normal(size=n)))
        elif pa.types.is_boolean(field.type):
            columns.append(pa.array(np.ones(n, dtype=bool)))
        elif pa.types.is_integer(field.type):
            columns.append(pa.array(np.full(n, number % 128)).cast(field.type))
        elif pa.types.is_fixed_size_list(field.type):
            columns.append(pa.array([[0.5] * field.type.list_size] * n, field.type))
        else:
            value = {pa.string(): "text", pa.list_(pa.string()): ["a", "b"]}.get(
                field.type, [("key", "value")]
            )
            columns.append(pa.array([value] * n, field.type))
    return pa.table(columns, schema=schema)


def draft(number: int = 0, n: int = 30) -> Draft:
    """A session with one layer and a ``poses`` table of ``n`` rows."""
    return Draft(
        manifest=replace(MANIFEST, foreign={"test:number": str(number)}),
        layers=(layer(number),),
        tables={"poses": TableData(data=rows("poses", n, number))},
    )


def make(path: Path, number: int = 0, n: int = 30) -> Session:
    """The session of :func:`draft` at ``path``."""
    return create_session(path, draft(number, n))


def put(commit: Commit, number: int) -> None:
    """Let every part carry ``number``."""
    commit.put_layer(layer(number))
    commit.put_table("poses", TableData(data=rows("poses", 30, number)))
    commit.update(foreign={"test:number": str(number)})


def write(session: Session, number: int) -> None:
    """One commit of several files."""
    with session.write() as commit:
        put(commit, number)


def number_of(session: Session) -> int:
    """The number that every part of the session carries, as it is read through the session."""
    numbers = {
        session.layer().events[0].text,
        session.events.to_arrow()["text"][0].as_py(),
        session.poses.to_arrow()["support"][0].as_py().removeprefix("support"),
        session.manifest.foreign["test:number"],
    }
    assert len(numbers) == 1, f"a mix of commits: {numbers}"
    return int(numbers.pop())


def number_at(path: Path) -> int:
    """The number that the session at ``path`` carries, after checking every byte of it."""
    session = open_session(path)
    assert validate(session, deep=True) == []
    return number_of(session)


def edited(old: Layer, number: int) -> Layer:
    """The layer with one more event."""
    event = Event(id=f"n{number}", segments=(Segment(start_frame=number, end_frame=number + 1),))
    return replace(old, events=(*old.events, event))


def record(revision: int, old: Layer, new: Layer) -> Record:
    """A step from one layer to another."""
    return Record(
        revision=revision,
        author="ann",
        time="2020-01-01T00:00:00.000Z",
        operation={"op": "x"},
        changes=diff(old, new),
    )


def append(session: Session, steps: int = 1) -> list[Layer]:
    """Append steps to the journal of ``main``, and return every state, the one before them first."""
    journal = Journal(session.path, "main")
    states = [journal.replay()[0] if journal.size() else session.layer()]
    sha256 = session.manifest.layers[0].sha256
    with journal.hold() as held:
        news = held.news(START)
        place = news[-1][1] if news else START
        for _ in range(steps):
            new = edited(states[-1], place.revision + 1)
            place = held.append(
                place, [record(place.revision + 1, states[-1], new)], base=states[-1], sha256=sha256
            )
            states.append(new)
    return states
