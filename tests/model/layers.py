"""Layers of every shape: a strategy that follows the dataclasses, so that a new field is covered at once."""

from __future__ import annotations

import types
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

from ecat.model import CodingScheme, KeyFrame, Layer

_CHARACTERS = st.characters(
    exclude_categories=("Cc", "Cs"), include_characters="\t\n\r\x7f\x85", exclude_characters="\ufffe\uffff"
)
_AWKWARD = st.sampled_from(
    ["", " a ", "\n", "a\r\nb\rc\n", "\t\ta", '<a href="x">&amp;\'</a>', "]]>", "\x85\u2028", "Đỗ 😀", "-->"]
)
TEXTS = _AWKWARD | st.text(_CHARACTERS, max_size=12)
"""Texts that XML can hold, with line ends, tabs, outer blanks and markup."""

FRAMES = st.integers(-1, 5) | st.integers(-1, 2**31 - 2)
TIMES = st.integers(-(2**63), 2**63 - 1)
NUMBERS = st.floats().map(lambda number: number + 0.0) | st.integers(-10, 2000).map(float)
"""Numbers with NaN and infinities, without -0."""


def _values(name: str, hint: Any) -> st.SearchStrategy[Any]:
    kind = get_origin(hint)
    if kind in (Union, types.UnionType):
        return st.none() | _values(name, next(arg for arg in get_args(hint) if arg is not types.NoneType))
    if kind is Literal:
        return st.sampled_from(get_args(hint))
    if kind is tuple:
        (item, _) = get_args(hint)
        return st.lists(_values(name, item), max_size=4 if item is float else 2).map(tuple)
    if is_dataclass(hint):
        assert isinstance(hint, type)
        return instances(hint)
    numbers = TIMES if name.endswith("_ns") else FRAMES
    return {str: TEXTS, bool: st.booleans(), float: NUMBERS, int: numbers}[hint]


def instances(kind: type[Any]) -> st.SearchStrategy[Any]:
    """Instances of a dataclass of :mod:`ecat.model`, every field drawn."""
    hints = get_type_hints(kind)
    return st.builds(kind, **{item.name: _values(item.name, hints[item.name]) for item in fields(kind)})


LAYERS: st.SearchStrategy[Layer] = instances(Layer)
SCHEMES: st.SearchStrategy[CodingScheme] = instances(CodingScheme)


def distinct(layer: Layer) -> Layer:
    """The layer with ids that nothing shares, and one key frame at a frame."""
    return replace(
        layer,
        objects=tuple(
            replace(
                thing,
                id=f"o{i}",
                key_frames=_apart(thing.key_frames),
                key_frames_3d=_apart(thing.key_frames_3d),
            )
            for i, thing in enumerate(layer.objects)
        ),
        events=tuple(replace(event, id=f"a{i}") for i, event in enumerate(layer.events)),
        relations=tuple(replace(relation, id=f"r{i}") for i, relation in enumerate(layer.relations)),
        decisions=tuple(replace(decision, proposal=f"p{i}") for i, decision in enumerate(layer.decisions)),
    )


def _apart(keys: tuple[KeyFrame, ...]) -> tuple[KeyFrame, ...]:
    return tuple({key.frame: key for key in keys}.values())


DISTINCT: st.SearchStrategy[Layer] = LAYERS.map(distinct)
"""Layers whose elements can be told apart."""
