"""Operations as JSON, and layers to do them on, in memory and on the disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from ecat.annotate import Editor, operation_from_dict
from ecat.annotate.operations import Edit
from ecat.annotate.rules import perform
from ecat.errors import OperationError
from ecat.model import Clock, CodingScheme, Event, Layer, Manifest, Stream
from ecat.model.changes import Change, invert
from ecat.model.document import Document
from ecat.store import Session, open_session

N_FRAMES = 1000
STEP_NS = 33_000_000


@dataclass
class Bench:
    """A layer, and what operations may look at beside it; ``do`` takes operations as JSON."""

    layer: Layer = field(default_factory=Layer)
    scheme: CodingScheme | None = None
    n_frames: int = N_FRAMES
    layers: dict[str, Layer] = field(default_factory=dict[str, Layer])
    sessions: dict[str, Layer] = field(default_factory=dict[str, Layer])

    def __post_init__(self) -> None:
        self.document = Document(self.layer)

    def do(self, *operations: dict[str, Any]) -> tuple[Change, ...]:
        """Do operations as one step, which can be undone exactly."""
        before = self.document.layer()
        edit = Edit(
            self.document, author="ann", n_frames=self.n_frames, scheme=self.scheme, stream="color",
            t_ns=lambda frame: frame * STEP_NS, layer_of=self.layers.__getitem__, session_of=self._session,
        )  # fmt: skip
        try:
            changes = perform(edit, [operation_from_dict(data) for data in operations])
        except OperationError:
            assert self.document.layer() == before, "a refused operation left something behind"
            raise
        after = self.document.layer()
        self.document.apply(invert(changes))
        assert self.document.layer() == before
        self.document.apply(changes)
        assert self.document.layer() == after
        self.layer = after
        return changes

    def _session(self, name: str) -> Layer:
        if name not in self.sessions:
            raise OperationError("cannot edit", where=f"there is no session {name}", fix="name another")
        return self.sessions[name]

    def refused(self, *operations: dict[str, Any]) -> str:
        """Where an error says that the cause is."""
        with pytest.raises(OperationError) as caught:
            self.do(*operations)
        assert caught.value.fix
        return caught.value.where

    def event(self, name: str = "a1") -> Event:
        """The event with this id."""
        found = self.document.event(name)
        assert found is not None
        return found

    def spans(self, name: str = "a1") -> list[tuple[int, int]]:
        """The segments of an event."""
        return [(s.start_frame, s.end_frame) for s in self.event(name).segments]


def op(operation: str, **said: Any) -> dict[str, Any]:
    """An operation as JSON."""
    return {"op": operation, **said}


def event(start: int, end: int, **said: Any) -> dict[str, Any]:
    """Add an event."""
    return op("add_event", segments=[[start, end]], **said)


def thing(called: str = "", kind: str = "other", **said: Any) -> dict[str, Any]:
    """Add an object."""
    return op("add_object", name=called, kind=kind, **said)


def relation(predicate: str, *arguments: str, start: int = 0, **said: Any) -> dict[str, Any]:
    """Add a relation."""
    return op("add_relation", predicate=predicate, arguments=list(arguments), start_frame=start, **said)


MANIFEST = Manifest(
    name="session",
    created="2020-01-01T00:00:00",
    n_frames=N_FRAMES,
    clock=Clock(rule="uniform", duration_ns=(N_FRAMES - 1) * STEP_NS),
    streams=(Stream(name="color", kind="color", n_frames=N_FRAMES, width_px=640, height_px=480),),
)


def edit(session: Session, author: str = "ann", layer: str = "main") -> Editor:
    """An editor of the session, through a view of its own."""
    return Editor(open_session(session.path), layer, author)


def do(editor: Editor, *operations: dict[str, Any], **said: Any) -> Any:
    """Apply operations that are given as JSON."""
    return editor.apply([operation_from_dict(data) for data in operations], **said)
