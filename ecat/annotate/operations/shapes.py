"""Operations on when an object is there, and what it looks like then (ECAT 2018 file format §2.12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.objects import new_key_frame
from ecat.model import AnnotatedObject, KeyFrame
from ecat.model.changes import SHAPES
from ecat.model.shapes import shape_at

Dimensions = Literal[2, 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class SetKeyFrame(Operation):
    """The shape of an object at a frame.

    Without ``coordinates`` it is the one shown there; where none is, that of the next key frame, or else the last
    one before.
    """

    object: str
    frame: int
    coordinates: tuple[float, ...] | None = None
    dimensions: Dimensions = 2

    def perform(self, edit: Edit) -> None:
        """Set it."""
        thing = edit.object(self.object)
        coordinates = self.coordinates
        if coordinates is None:
            coordinates = nearest_shape(thing, self.frame, self.dimensions)
        if coordinates is None:
            raise edit.refusal(f"object {self.object} has no shape yet", "give its coordinates")
        key = new_key_frame(edit, thing, self.frame, coordinates, self.dimensions)
        edit.put_key_frame(self.object, key, self.dimensions)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetAbsent(Operation):
    """An object is absent from a frame on, until its next shape."""

    object: str
    frame: int

    def perform(self, edit: Edit) -> None:
        """Say so."""
        thing = _drawn(edit, self.object)
        edit.put_key_frame(self.object, _absence(edit, self.frame), 2)
        after = min((k for k in thing.key_frames if k.frame > self.frame), key=_frame, default=None)
        if after is not None and not after.present:
            edit.drop_key_frame(self.object, after.frame, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveKeyFrame(Operation):
    """Forget the shape, or the absence, that was said at a frame."""

    object: str
    frame: int
    dimensions: Dimensions = 2

    def perform(self, edit: Edit) -> None:
        """Forget it."""
        keys = keys_of(edit.object(self.object), self.dimensions)
        if all(key.frame != self.frame for key in keys):
            there = ", ".join(str(key.frame) for key in keys[:20]) or "none"
            raise edit.refusal(
                f"object {self.object} has no key frame at frame {self.frame}",
                f"name one of its key frames: {there}",
            )
        edit.drop_key_frame(self.object, self.frame, self.dimensions)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPresence(Operation):
    """An object is there (or, not ``present``, absent) from ``start_frame`` to ``end_frame``, half-open.

    Before and after, everything stays as it is.  Without ``end_frame`` it is so to the end.
    """

    object: str
    start_frame: int
    end_frame: int | None = None
    present: bool = True

    def perform(self, edit: Edit) -> None:
        """Say so."""
        thing = _drawn(edit, self.object)
        start, end = edit.frame(self.start_frame), self.end_frame
        if end is not None and edit.frame(end, end=True) <= start:
            raise edit.refusal(f"frames {start} to {end} are no stretch", "let it end after it starts")
        beyond = end is None or (edit.n_frames > 0 and end >= edit.n_frames)
        after = None if end is None else shape_at(thing, end)
        shape = nearest_shape(thing, start, 2)
        if self.present and shape is None:
            raise edit.refusal(f"object {self.object} has no shape yet", "draw it first")
        for key in thing.key_frames:
            inside = start <= key.frame and (end is None or key.frame < end)
            if inside and key.present != self.present:
                edit.drop_key_frame(self.object, key.frame, 2)
        if end is not None and not beyond and all(key.frame != end for key in thing.key_frames):
            # whatever it was after the stretch, it is again
            edit.put_key_frame(self.object, _key(edit, thing, end, after), 2)
        now = edit.object(self.object)
        if not self.present:
            edit.put_key_frame(self.object, _absence(edit, start), 2)
        elif shape_at(now, start) is None and shape is not None:
            edit.put_key_frame(self.object, new_key_frame(edit, thing, start, shape, 2), 2)


def keys_of(thing: AnnotatedObject, dimensions: int) -> tuple[KeyFrame, ...]:
    """The key frames of an object, in pixels (2) or metres (3)."""
    keys: tuple[KeyFrame, ...] = getattr(thing, SHAPES["key_frame" if dimensions == 2 else "key_frame_3d"])
    return keys


def nearest_shape(thing: AnnotatedObject, frame: int, dimensions: int) -> tuple[float, ...] | None:
    """The shape shown at a frame; where none is, that of the next key frame, or else the last one before."""
    shown = shape_at(thing, frame, dimensions)
    if shown is not None:
        return shown
    keys = sorted((key for key in keys_of(thing, dimensions) if key.present), key=_frame)
    after = next((key for key in keys if key.frame > frame), None)
    found = after or next((key for key in reversed(keys) if key.frame <= frame), None)
    return None if found is None else found.coordinates


def _frame(key: KeyFrame) -> int:
    return key.frame


def _absence(edit: Edit, frame: int) -> KeyFrame:
    return KeyFrame(frame=edit.frame(frame), t_ns=edit.t_ns(frame), present=False)


def _key(edit: Edit, thing: AnnotatedObject, frame: int, shape: tuple[float, ...] | None) -> KeyFrame:
    return _absence(edit, frame) if shape is None else new_key_frame(edit, thing, frame, shape, 2)


def _drawn(edit: Edit, name: str) -> AnnotatedObject:
    thing = edit.object(name)
    if thing.kind in {"marker_box", "rig"}:
        raise edit.refusal(
            f"object {name} is a {thing.kind}: its tables say where it is seen", "draw another object"
        )
    return thing
