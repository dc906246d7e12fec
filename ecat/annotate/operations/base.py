"""What every operation is, and what it is given to work with."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar, Literal

from ecat.annotate.operations.near import Listed, advice
from ecat.errors import OperationError
from ecat.model import AnnotatedObject, CodingScheme, Event, KeyFrame, Layer, Relation, Segment
from ecat.model.annotation import Decision
from ecat.model.changes import KEY_FRAMES, SHAPES, Change, Kind, header, invert, to_json
from ecat.model.document import Document

MOST_FRAMES = 2**31 - 1
"""Where the length of a recording is not known, a frame is below this."""
_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_PREFIXES: dict[str, str] = {"object": "o", "event": "a", "relation": "r"}
_CAMEL = re.compile(r"(?<!^)(?=[A-Z])")


class Operation(ABC):
    """One edit as a value; ``perform`` says what it does to a layer.

    An operation is data that anybody may have written: whatever it says is checked, there and by
    :mod:`ecat.annotate.rules`.
    """

    op: ClassVar[str]

    def __init_subclass__(cls) -> None:
        cls.op = _CAMEL.sub("_", cls.__name__).lower()

    @abstractmethod
    def perform(self, edit: Edit) -> None:
        """Make the changes.

        Raises
        ------
        OperationError : the annotation does not allow it.
        """


def refusal(operation: str, where: str, fix: str) -> OperationError:
    """The error of an operation that cannot be done."""
    return OperationError(f"cannot {operation.replace('_', ' ')}", where=where, fix=fix)


@dataclass
class Edit:
    """A layer while operations change it.

    Parameters
    ----------
    document : the layer.
    author : who edits; goes into what is added.
    n_frames : of the recording; 0 if nobody knows.
    scheme : the layer's coding scheme, or the one that it gets (:class:`~ecat.annotate.operations.SetScheme`).
    stream : the video whose images frames count.
    t_ns : time of a frame, nanoseconds since the session's start, or ``None``.
    layer_of : another layer of the session, by name.
    session_of : the layer of the same name of another session of the project, by that session's name.
    find_scheme : a coding scheme by name.
    """

    document: Document
    author: str = ""
    n_frames: int = 0
    scheme: CodingScheme | None = None
    stream: str = ""
    t_ns: Callable[[int], int | None] = field(default=lambda _: None)
    layer_of: Callable[[str], Layer] = field(default=lambda name: _unknown("layer", name))
    session_of: Callable[[str], Layer] = field(default=lambda name: _unknown("session", name))
    find_scheme: Callable[[str], CodingScheme] = field(default=lambda name: _unknown("coding scheme", name))
    op: str = "edit"
    _changes: list[Change] = field(default_factory=list[Change])
    _last: dict[tuple[Kind, str], int] = field(default_factory=dict[tuple[Kind, str], int])

    @property
    def changes(self) -> tuple[Change, ...]:
        """What has been changed so far, one change per element that stays."""
        return tuple(self._changes)

    def roll_back(self) -> None:
        """Undo all of it."""
        self.document.apply(invert(self._changes))
        self._changes.clear()
        self._last.clear()

    # ------------------------------------------------------------------------------------------ finding

    def object(self, name: str) -> AnnotatedObject:
        """The object with this id, or an error."""
        return self._found(self.document.object(name), ("object",), name)

    def event(self, name: str) -> Event:
        """The event with this id, or an error."""
        return self._found(self.document.event(name), ("event",), name)

    def relation(self, name: str) -> Relation:
        """The relation with this id, or an error."""
        return self._found(self.document.relation(name), ("relation",), name)

    def owner(self, name: str) -> AnnotatedObject | Event:
        """The object or event with this id, or an error."""
        element = self.document.object(name) or self.document.event(name)
        return self._found(element, ("object", "event"), name)

    def _found(self, element: Any, kinds: tuple[Listed, ...], name: str) -> Any:
        if element is None:
            where = f"layer {self.document.name} has no {' or '.join(kinds)} {name}"
            raise self.refusal(where, advice(self.document, kinds, name))
        return element

    def refusal(self, where: str, fix: str) -> OperationError:
        """The error of the operation at work."""
        return refusal(self.op, where, fix)

    # ------------------------------------------------------------------------------------------ changing

    def put(self, element: AnnotatedObject | Event | Relation | Decision, index: int = -1) -> None:
        """Add an element at the end, or at ``index``, or replace the one with its id."""
        kind, name = _kind_and_id(element)
        before = self.document.said(kind, name)
        if before is None:
            where = index if index >= 0 else len(self.document.ids(kind))
            self._change(Change(kind, name, where, None, to_json(element)))
            return
        after = to_json(element, without=KEY_FRAMES if kind == "object" else ())
        if after != before:
            self._change(Change(kind, name, -1, before, after))

    def drop(self, kind: Kind, name: str) -> None:
        """Take an element out; whoever names it is the caller's business."""
        element = self.document.element(kind, name)
        self._change(Change(kind, name, self.document.position(kind, name), to_json(element), None))

    def put_key_frame(self, name: str, key: KeyFrame, dimensions: int) -> None:
        """Add a key frame to an object, or replace the one at its frame."""
        kind: Kind = "key_frame" if dimensions == 2 else "key_frame_3d"
        id_ = f"{name}@{key.frame}"
        before, after = self.document.said(kind, id_), to_json(key)
        if before is None:
            keys: tuple[KeyFrame, ...] = getattr(self.object(name), SHAPES[kind])
            at = next((i for i, other in enumerate(keys) if other.frame > key.frame), len(keys))
            self._change(Change(kind, id_, at, None, after))
        elif before != after:
            self._change(Change(kind, id_, -1, before, after))

    def drop_key_frame(self, name: str, frame: int, dimensions: int) -> None:
        """Take the key frame at ``frame`` out."""
        self.drop("key_frame" if dimensions == 2 else "key_frame_3d", f"{name}@{frame}")

    def set_header(self, **said: Any) -> None:
        """Set counters, the scheme or foreign facts of the layer."""
        before, after = header(self.document.header), header(replace(self.document.header, **said))
        if before != after:
            self._change(Change("layer", "", -1, before, after))

    def _change(self, change: Change) -> None:
        self.document.apply((change,))
        key = change.kind, change.id
        earlier = self._last.get(key)
        if change.before is None or change.after is None or earlier is None:
            self._changes.append(change)
            self._last[key] = len(self._changes) - 1
            if change.after is None:
                self._forget(change)
            return
        first = self._changes[earlier]
        shapes = {k: v for k, v in (first.after or {}).items() if k in KEY_FRAMES}
        after = change.after | (shapes if change.kind == "object" else {})
        self._changes[earlier] = Change(first.kind, first.id, first.index, first.before, after)

    def _forget(self, change: Change) -> None:
        """What comes after a removal is not the same element any more, whatever its id is."""
        del self._last[change.kind, change.id]
        if change.kind == "object":
            for key in [key for key in self._last if key[1].startswith(f"{change.id}@")]:
                del self._last[key]

    # ------------------------------------------------------------------------------------------ making

    def new_id(self, kind: Literal["object", "event", "relation"], wanted: str | None = None) -> str:
        """An id that nothing has, and nothing removed had; ``wanted`` if that is one.

        Raises
        ------
        OperationError : ``wanted`` is no id, or is taken.
        """
        if wanted is None:
            return self.new_ids(kind, 1)[0]
        counter, prefix = f"{kind}_counter", _PREFIXES[kind]
        last: int = getattr(self.document.header, counter)
        if not _ID.fullmatch(wanted):
            raise self.refusal(f"{wanted!r:.80} is no id", "take up to 64 letters, digits, '_', '.' and '-'")
        if any(self.document.element(k, wanted) is not None for k in _PREFIXES):  # type: ignore[arg-type]
            raise self.refusal(f"the id {wanted} is taken", "leave the id out, and get the next free one")
        digits = wanted.removeprefix(prefix)
        if wanted.startswith(prefix) and digits.isdigit() and last < int(digits) < MOST_FRAMES:
            self.set_header(**{counter: int(digits)})
        return wanted

    def new_ids(self, kind: Literal["object", "event", "relation"], n: int) -> list[str]:
        """The next ``n`` ids that nothing has, and nothing removed had."""
        counter, prefix = f"{kind}_counter", _PREFIXES[kind]
        number: int = getattr(self.document.header, counter)
        found: list[str] = []
        while len(found) < n:
            number += 1
            if self.document.element(kind, f"{prefix}{number}") is None:
                found.append(f"{prefix}{number}")
        self.set_header(**{counter: number})
        return found

    def frame(self, frame: int, *, end: bool = False) -> int:
        """``frame`` if it is one of the recording, or (``end``) the one after the last.

        Raises
        ------
        OperationError : it is not.
        """
        last = (self.n_frames or MOST_FRAMES) - (0 if end else 1)
        if not 0 <= frame <= last:
            raise self.refusal(f"frame {frame} is not in the recording", f"name one from 0 to {last}")
        return frame

    def segment(self, start: int, end: int, *, kept: Collection[int] = ()) -> Segment:
        """The stretch ``[start, end)`` with its times.

        ``kept`` are edges that were there before and are not judged: imported events begin at frame -1, or end behind
        the recording.

        Raises
        ------
        OperationError : it is empty, or not in the recording.
        """
        if start not in kept:
            self.frame(start)
        if end not in kept:
            self.frame(end, end=True)
        if end <= start:
            raise self.refusal(f"frames {start} to {end} are no stretch", "let it end after it starts")
        return Segment(start_frame=start, end_frame=end, start_ns=self.t_ns(start), end_ns=self.t_ns(end))

    def segments(self, spans: Sequence[tuple[int, int]]) -> tuple[Segment, ...]:
        """Stretches in order.

        Raises
        ------
        OperationError : there is none, or two overlap.
        """
        made = tuple(self.segment(start, end) for start, end in sorted(spans))
        if not made:
            raise self.refusal("an event without a stretch", "give segments: [[start, end], ...]")
        for first, second in pairwise(made):
            if second.start_frame < first.end_frame:
                raise self.refusal(
                    f"frames {first.start_frame} to {first.end_frame} and {second.start_frame} to "
                    f"{second.end_frame} overlap",
                    "let the segments of an event lie apart, or make it one",
                )
        return made


def _unknown(kind: str, name: str) -> Any:
    raise refusal("edit", f"there is no {kind} {name}", "name one that there is")


def _kind_and_id(element: Any) -> tuple[Kind, str]:
    kinds: dict[type[Any], Kind] = {
        AnnotatedObject: "object", Event: "event", Relation: "relation", Decision: "decision",
    }  # fmt: skip
    kind = kinds[type(element)]
    return kind, element.proposal if kind == "decision" else element.id
