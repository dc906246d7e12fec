"""Where the steps of a layer's history are in its journal, and which of them each author can undo or do again."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from ecat.annotate.operations import Edit
from ecat.errors import ConflictError
from ecat.model.changes import Change, Json, invert
from ecat.model.document import Document
from ecat.model.record import Record
from ecat.store import Journal, Place
from ecat.store.journal import START


@dataclass(frozen=True, slots=True)
class Step:
    """Something to undo or do again: the revision that is meant, and the one whose changes are turned back for it."""

    revision: int
    source: int


@dataclass(slots=True)
class Steps:
    """What one author can undo and do again, the next one last."""

    undo: list[Step] = field(default_factory=list[Step])
    redo: list[Step] = field(default_factory=list[Step])


class History:
    """The steps of a journal, as far as they were noted."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._ends: list[int] = []
        self._authors: list[str] = []
        self._steps: dict[str, Steps] = {}

    @property
    def end(self) -> Place:
        """The place behind the last step."""
        return self.place(len(self._ends))

    def place(self, revision: int) -> Place:
        """The place behind a step."""
        return Place(revision, self._ends[revision - 1]) if revision else START

    def note(self, record: Record, place: Place) -> None:
        """Take the next step in."""
        self._ends.append(place.offset)
        self._authors.append(record.author)
        mine = self._steps.setdefault(record.author, Steps())
        step = Step(record.revision, record.revision)
        if record.op == "undo":
            undone = _taken(mine.undo, record.operation.get("undoes"))
            mine.redo += [Step(undone.revision, record.revision)] if undone else []
        elif record.op == "redo":
            redone = _taken(mine.redo, record.operation.get("redoes"))
            mine.undo += [Step(redone.revision, record.revision)] if redone else []
        elif record.op != "replace":
            mine.undo.append(step)
            mine.redo.clear()

    def steps(self, author: str) -> Steps:
        """What an author can undo and do again."""
        return self._steps.get(author, Steps())

    def record(self, revision: int) -> Record:
        """A step, from the disk."""
        return next(record for record, _ in self._journal.records(self.place(revision - 1)))

    def records(self, start: int, limit: int) -> list[Record]:
        """Steps from ``start`` on, at most ``limit``."""
        first = max(1, start)
        last = min(len(self._ends), first + max(0, limit) - 1)
        if first > last:
            return []
        found = self._journal.records(self.place(first - 1), until=last)
        return [record for record, _ in found]

    def others_since(self, revision: int, author: str) -> bool:
        """Whether anybody else did something after a step."""
        return any(name != author for name in self._authors[revision:])


def _taken(steps: list[Step], revision: object) -> Step | None:
    """Take the step of a revision from a stack; what lies above it was taken by a journal that was edited."""
    for i in range(len(steps) - 1, -1, -1):
        if steps[i].revision == revision:
            return steps.pop(i)
    return None


def turn_back(edit: Edit, changes: Iterable[Change], who: str) -> tuple[Change, ...]:
    """Undo changes that are not the last ones: elements are put back where they were touched since by nobody.

    Raises
    ------
    ConflictError : an element is not as the changes left it; nothing was changed.
    """
    document = edit.document
    made: list[Change] = []
    try:
        for change in invert(changes):
            turned = _turned_header(document, change) if change.kind == "layer" else _turned(document, change)
            if turned.before != turned.after:
                document.apply((turned,))
                made.append(turned)
    except _Changed as changed:
        document.apply(invert(made))
        raise ConflictError(
            f"cannot {edit.op}",
            where=f"{changed}, changed since by {who}",
            fix="undo that first, or edit it as it is now",
        ) from None
    return tuple(made)


class _Changed(Exception):  # noqa: N818 - a signal within this module
    """An element is not what it was."""


def _turned(document: Document, change: Change) -> Change:
    kind, name = change.kind, change.id
    if kind in {"key_frame", "key_frame_3d"} and document.object(name.rpartition("@")[0]) is None:
        raise _Changed(f"object {name.rpartition('@')[0]} is not there")
    whole = change.after is None
    now = document.said(kind, name, whole=whole)
    if now != change.before:
        raise _Changed(f"{kind.replace('_', ' ')} {name}")
    if whole:
        return Change(kind, name, document.position(kind, name), now, None)
    if now is None and kind in {"key_frame", "key_frame_3d"}:
        return replace(change, index=_place_of_key_frame(document, change))
    return change


def _place_of_key_frame(document: Document, change: Change) -> int:
    """Where a key frame goes back to: its old place, unless others have put key frames before it since."""
    owner, _, text = change.id.rpartition("@")
    thing, frame = document.object(owner), int(text)
    assert thing is not None
    frames = [key.frame for key in (thing.key_frames if change.kind == "key_frame" else thing.key_frames_3d)]
    here = min(change.index, len(frames))
    fits = all(other < frame for other in frames[:here]) and all(frame < other for other in frames[here:])
    # those of an imported object may be out of order, and then come back as they were
    return here if fits or frames != sorted(frames) else bisect_left(frames, frame)


def _turned_header(document: Document, change: Change) -> Change:
    """Counters that have gone on meanwhile stay: ids that others were given are theirs."""
    now: Json = document.said("layer", "") or {}
    left, back = change.before or {}, change.after or {}
    new = dict(now)
    for name in {*left, *back}:
        if now.get(name) == left.get(name):
            new.pop(name, None)
            new.update({name: back[name]} if name in back else {})
        elif not name.endswith("_counter"):
            raise _Changed(f"the layer's {name}")
    return Change("layer", "", -1, now, new)
