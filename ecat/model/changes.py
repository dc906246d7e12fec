"""What an edit did to a layer, as values: every element touched, as it was before and as it is after.

Changes are exact both ways: :func:`invert` undoes them, and applying them (:mod:`ecat.model.document`) never asks
whether they are allowed.  They are also data: an element is its dataclass as JSON, without the fields that
have their default, and with ``null`` for a number that is missing (NaN).
"""

from __future__ import annotations

import math
import types
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Literal, TypeAlias, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from ecat.errors import SchemaError
from ecat.model.annotation import (
    AnnotatedObject,
    Decision,
    Event,
    KeyFrame,
    Layer,
    Relation,
)

Kind: TypeAlias = Literal["object", "event", "relation", "decision", "key_frame", "key_frame_3d", "layer"]
Json: TypeAlias = dict[str, Any]
T = TypeVar("T")

ELEMENTS: dict[Kind, type[Any]] = {
    "object": AnnotatedObject,
    "event": Event,
    "relation": Relation,
    "decision": Decision,
    "key_frame": KeyFrame,
    "key_frame_3d": KeyFrame,
    "layer": Layer,
}
"""The dataclass that each kind of change is about."""
LISTS: dict[str, Kind] = {
    "objects": "object", "events": "event", "relations": "relation", "decisions": "decision",
}  # fmt: skip
"""Fields of a layer that hold elements with an id of their own."""
KEY_FRAMES: dict[str, Kind] = {"key_frames": "key_frame", "key_frames_3d": "key_frame_3d"}
"""Fields of an object that hold its shapes."""
SHAPES = {kind: field for field, kind in KEY_FRAMES.items()}


@dataclass(frozen=True, slots=True)
class Change:
    """One element before and after; ``None`` where there was none, or is none any more.

    Parameters
    ----------
    kind : of the element; ``layer`` is what a layer says besides its elements: counters, scheme, foreign facts.
    id : of the element; ``<object id>@<frame>`` of a key frame, the proposal of a decision, empty for ``layer``.
    index : the position among the elements of its kind (key frames: of its object) at which it is put in or
        taken out; -1 for one that stays where it is.
    before, after : the element as JSON; an object carries its key frames only where it comes or goes.
    """

    kind: Kind
    id: str
    index: int
    before: Json | None
    after: Json | None

    def to_dict(self) -> Json:
        """The change as JSON-able data."""
        return {
            "kind": self.kind,
            "id": self.id,
            "index": self.index,
            "before": self.before,
            "after": self.after,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Change:
        """The change that :meth:`to_dict` wrote.

        Raises
        ------
        KeyError, TypeError, ValueError : it is none.
        """
        kind, index = data["kind"], data["index"]
        if kind not in ELEMENTS or not isinstance(index, int):
            raise ValueError(f"not a change: {kind!r} at {index!r}")
        change = cls(kind, str(data["id"]), index, data["before"], data["after"])
        for said in (change.before, change.after):
            if said is not None and kind != "layer":
                from_json(ELEMENTS[kind], said)
        return change


# ---------------------------------------------------------------------------------------------- elements as JSON


@cache
def _codec(kind: type[Any]) -> tuple[tuple[str, Any, Callable[[Any], Any], Callable[[Any], Any]], ...]:
    """Of every field: its name, its default, how it is written and how it is read."""
    hints = get_type_hints(kind)
    return tuple((f.name, f.default, *_field_codec(hints[f.name])) for f in fields(kind))


def _field_codec(hint: Any) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is tuple and is_dataclass(inner[0]):
        child = cast("type[Any]", inner[0])
        return (
            lambda items: [to_json(item) for item in items],
            lambda items: tuple(from_json(child, item) for item in _typed(items, list)),
        )
    if origin is tuple:
        return (
            lambda numbers: [_number(number) for number in numbers],
            lambda numbers: tuple(math.nan if n is None else float(n) for n in _typed(numbers, list)),
        )
    allowed: tuple[Any, ...] = inner if origin is Literal else ()
    if allowed:
        return _as_is, lambda value: _one_of(value, allowed)
    kinds = tuple(inner) if origin in (Union, types.UnionType) else (hint,)
    return _as_is, lambda value: _typed(value, *kinds)


def _as_is(value: Any) -> Any:
    return value


def _one_of(value: Any, allowed: tuple[Any, ...]) -> Any:
    if value not in allowed:
        raise ValueError(f"expected one of {allowed}, found {value!r}")
    return value


def _typed(value: Any, *kinds: type[Any]) -> Any:
    # an exact type: a bool is no int
    if type(value) not in kinds:
        raise ValueError(f"expected {' or '.join(kind.__name__ for kind in kinds)}, found {value!r:.60}")
    return value


def _number(value: float) -> float | int | str | None:
    if math.isfinite(value):
        return int(value) if value == int(value) and abs(value) < 1e15 else float(value)
    return None if math.isnan(value) else str(float(value))


def to_json(element: Any, *, without: Iterable[str] = ()) -> Json:
    """A dataclass of :mod:`ecat.model.annotation` as JSON-able data, without the fields named."""
    found: Json = {}
    for name, default, write, _ in _codec(type(element)):
        value = getattr(element, name)
        if (default is MISSING or value != default) and name not in without:
            found[name] = write(value)
    return found


def from_json(kind: type[T], data: Mapping[str, Any]) -> T:
    """What :func:`to_json` wrote.

    Raises
    ------
    KeyError, TypeError, ValueError : it is not that.
    """
    known = readers(kind)
    if not isinstance(data, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance] - it comes from a file
        raise TypeError(f"expected an element, found {data!r:.60}")
    return kind(**{name: known[name](value) for name, value in data.items()})


def header(layer: Layer) -> Json:
    """What a layer says besides its elements, as JSON."""
    return to_json(layer, without={*LISTS, "name", "version"})


@cache
def readers(kind: type[Any]) -> dict[str, Callable[[Any], Any]]:
    """How the fields of a dataclass are read from JSON, by name."""
    return {name: read for name, _, _, read in _codec(kind)}


# ---------------------------------------------------------------------------------------------- both ways


def invert(changes: Iterable[Change]) -> tuple[Change, ...]:
    """The changes that undo ``changes``."""
    return tuple(Change(c.kind, c.id, c.index, c.after, c.before) for c in reversed(tuple(changes)))


def diff(old: Layer, new: Layer) -> tuple[Change, ...]:
    """The changes that make ``new`` of ``old``, whatever their names are.

    Raises
    ------
    SchemaError : an id, or a frame of an object, occurs twice in one of them.
    """
    found: list[Change] = []
    before, after = header(old), header(new)
    if before != after:
        found.append(Change("layer", "", -1, before, after))
    for name, kind in LISTS.items():
        found += _diff_list(kind, "", by_id(old, name), by_id(new, name))
    return tuple(found)


def _diff_list(kind: Kind, prefix: str, old: dict[str, Any], new: dict[str, Any]) -> Iterator[Change]:
    stay = _in_order([name for name in new if name in old], {name: i for i, name in enumerate(old)})
    names = list(old)
    for i in range(len(names) - 1, -1, -1):
        if names[i] not in stay:
            yield Change(kind, prefix + names[i], i, to_json(old[names[i]]), None)
    for i, (name, element) in enumerate(new.items()):
        if name not in stay:
            yield Change(kind, prefix + name, i, None, to_json(element))
        elif old[name] is not element:
            yield from _diff_element(kind, prefix + name, old[name], element)


def _diff_element(kind: Kind, name: str, old: Any, new: Any) -> Iterator[Change]:
    inner: Iterable[str] = KEY_FRAMES if kind == "object" else ()
    before, after = to_json(old, without=inner), to_json(new, without=inner)
    if before != after:
        yield Change(kind, name, -1, before, after)
    for field in inner:
        yield from _diff_list(KEY_FRAMES[field], f"{name}@", key_frames(old, field), key_frames(new, field))


def _in_order(names: Sequence[str], position: Mapping[str, int]) -> set[str]:
    """The most of ``names`` that have ascending positions."""
    ends: list[int] = []
    last: list[int] = []
    before: list[int] = []
    for i, name in enumerate(names):
        k = bisect_left(ends, position[name])
        ends[k : k + 1] = [position[name]]
        before.append(last[k - 1] if k else -1)
        last[k : k + 1] = [i]
    found: set[str] = set()
    here = last[-1] if last else -1
    while here >= 0:
        found.add(names[here])
        here = before[here]
    return found


def by_id(layer: Layer, field: str) -> dict[str, Any]:
    """The elements of a field of a layer by their id.

    Raises
    ------
    SchemaError : an id, or a frame of an object, occurs twice.
    """
    elements = getattr(layer, field)
    found = {element.proposal if field == "decisions" else element.id: element for element in elements}
    if len(found) != len(elements):
        raise _twice(f"layer {layer.name}: {field} that have the same id")
    if field == "objects":
        for thing in layer.objects:
            for shapes in KEY_FRAMES:
                key_frames(thing, shapes)
    return found


def key_frames(thing: AnnotatedObject, field: str) -> dict[str, KeyFrame]:
    """The key frames of ``field`` by their frame, as a text.

    Raises
    ------
    SchemaError : a frame occurs twice.
    """
    keys: tuple[KeyFrame, ...] = getattr(thing, field)
    found = {str(key.frame): key for key in keys}
    if len(found) != len(keys):
        raise _twice(f"object {thing.id}: {field} at the same frame")
    return found


def _twice(where: str) -> SchemaError:
    return SchemaError(
        "cannot tell the parts of an annotation apart",
        problems=(where,),
        consequence="nothing was changed",
        fix="ecat check names each; correct the XML, then ecat check --repair",
    )
