"""What a format can be told: a frozen dataclass per format, its fields filled from ``name=value`` texts.

A field's type says what a text has to be: ``int``, ``float``, ``bool``, ``str`` or a ``Literal`` of texts, or ``None``
beside one of these, written as nothing (``name=``).  Metadata: ``help``, a line for people; ``least`` and ``most``, the
bounds of a number.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from ecat.errors import UsageError

_T = TypeVar("_T")
_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True, slots=True)
class NoOptions:
    """Of a format that cannot be told anything."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptionHelp:
    """One option for people: ``values`` says what may be given, ``default`` what it is otherwise."""

    name: str
    values: str
    default: str
    help: str


def option(default: Any, help: str, *, least: float | None = None, most: float | None = None) -> Any:  # noqa: A002
    """A field of a format's options."""
    return field(default=default, metadata={"help": help, "least": least, "most": most})


def read_options(kind: type[_T], given: Mapping[str, str], format_name: str) -> _T:
    """The options of a format, from what was typed.

    Raises
    ------
    UsageError : no such option, or a value that it cannot have; the error says what it can.
    """
    known = {known.name: known for known in fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            raise _unknown(name, list(known), format_name)
    hints = get_type_hints(kind)
    return kind(**{name: _value(known[name], hints[name], text, format_name) for name, text in given.items()})


def describe(kind: type) -> Iterator[OptionHelp]:
    """The options of a format, in their order."""
    hints = get_type_hints(kind)
    for known in fields(kind):
        default = "" if known.default is None else str(known.default)
        yield OptionHelp(
            name=known.name,
            values=_values(known, hints[known.name]),
            default=default.lower() if isinstance(known.default, bool) else default,
            help=known.metadata.get("help", ""),
        )


def required(kind: type) -> tuple[str, ...]:
    """Names of options without a default."""
    return tuple(known.name for known in fields(kind) if known.default is MISSING)


def _unknown(name: str, known: list[str], format_name: str) -> UsageError:
    near = difflib.get_close_matches(name, known, 1)
    return UsageError(
        f"{format_name} has no option {name!r}",
        where=f"its options are: {', '.join(known) or 'none'}",
        fix=f"did you mean {near[0]}?" if near else f"ecat formats {format_name} explains them",
    )


def _plain(hint: Any) -> tuple[Any, bool]:
    """The type without ``None``, and whether there was one."""
    if isinstance(hint, UnionType):
        inner = [kind for kind in get_args(hint) if kind is not NoneType]
        return inner[0], len(inner) < len(get_args(hint))
    return hint, False


def _values(known: Field[Any], hint: Any) -> str:
    kind, optional = _plain(hint)
    if get_origin(kind) is Literal:
        values = ", ".join(get_args(kind))
    elif kind is bool:
        values = "true, false"
    elif kind is str:
        values = "a text"
    else:
        least, most = known.metadata.get("least"), known.metadata.get("most")
        bounds = (f" from {least:g}" if least is not None else "") + (
            f" to {most:g}" if most is not None else ""
        )
        values = f"{'a whole number' if kind is int else 'a number'}{bounds}"
    return f"{values}, or nothing" if optional else values


def _value(known: Field[Any], hint: Any, text: str, format_name: str) -> Any:
    kind, optional = _plain(hint)
    if optional and not text:
        return None
    if get_origin(kind) is Literal and text in get_args(kind):
        return text
    if kind is str:
        return text
    if kind is bool and text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if kind in {int, float} and (number := _number(kind, text)) is not None:
        least, most = known.metadata.get("least"), known.metadata.get("most")
        if (least is None or number >= least) and (most is None or number <= most):
            return number
    raise UsageError(
        f"{format_name} cannot be told {known.name}={text}",
        where=f"{known.name}: expected {_values(known, hint)}",
        fix=f"ecat formats {format_name} explains the options",
    )


def _number(kind: Any, text: str) -> float | None:
    try:
        number = kind(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
