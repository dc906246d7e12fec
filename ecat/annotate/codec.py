"""Operations as JSON, and the limits of what anybody may ask for."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from ecat.annotate.operations import OPERATIONS, Operation
from ecat.errors import LimitError, SchemaError
from ecat.model.changes import to_json

MOST_TEXT = 10_000
"""Characters of one text."""
MOST_NAME = 200
"""Characters of an author's name."""
MOST_NUMBERS = 10_000
"""Numbers, or other parts, of one list."""
MOST_OPERATIONS = 100_000
"""Operations at once."""
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_INT32 = range(-(2**31), 2**31)


def operation_from_dict(data: Mapping[str, Any]) -> Operation:
    """The operation of ``{"op": "<name>", ...fields}``.

    Raises
    ------
    SchemaError : no such operation, an unknown field, one that is missing or wrong; each with its path.
    LimitError : a text or a list is too long.
    """
    name = data.get("op")
    kind = OPERATIONS.get(name) if isinstance(name, str) else None
    if kind is None:
        known = ", ".join(OPERATIONS)
        raise _wrong([f"op: {name!r:.60} is no operation; there are {known}"])
    if problems := list(_problems(data, "")):
        raise _wrong(problems[:20])
    try:
        text = json.dumps({key: value for key, value in data.items() if key != "op"}, allow_nan=False)
        return cast("Operation", _adapter(kind).validate_json(text, strict=True))
    except (TypeError, ValueError) as error:
        if not isinstance(error, ValidationError):
            raise _wrong([f"op {name}: not JSON: {error}"]) from None
        raise _wrong(
            [f"{_dotted(e['loc']) or name}: {e['msg']}" for e in error.errors(include_url=False)[:20]]
        ) from None


def operations_from_list(data: Sequence[Mapping[str, Any]]) -> tuple[Operation, ...]:
    """Several operations; errors as of :func:`operation_from_dict`, with the position of the wrong one.

    Raises
    ------
    LimitError : more than a hundred thousand.
    """
    require_few(len(data))
    found: list[Operation] = []
    for i, item in enumerate(data):
        try:
            found.append(operation_from_dict(item))
        except SchemaError as error:
            raise _wrong([f"[{i}].{problem}" for problem in error.problems]) from None
    return tuple(found)


def operation_to_dict(operation: Operation) -> dict[str, Any]:
    """An operation as JSON-able data, without the fields that have their default."""
    said: dict[str, Any] = {"op": operation.op}
    for item in fields(cast("Any", operation)):
        value = getattr(operation, item.name)
        default = item.default_factory() if item.default_factory is not MISSING else item.default
        if value != default:
            said[item.name] = _plain(value)
    return said


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(item) for item in cast("Sequence[Any]", value)]
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in cast("Mapping[Any, Any]", value).items()}
    return to_json(value) if is_dataclass(value) else value


def require_few(n: int) -> None:
    """Return unless ``n`` operations are too many at once.

    Raises
    ------
    LimitError : they are.
    """
    if n > MOST_OPERATIONS:
        raise LimitError(
            "cannot do so much at once",
            where=f"{n:,} operations, at most {MOST_OPERATIONS:,} are one step",
            consequence="nothing was changed",
            fix="do it in several steps",
        )


def require_author(name: str) -> None:
    """Return if ``name`` can be kept as that of an author.

    Raises
    ------
    SchemaError : it cannot.
    """
    problems = list(_problems(name, "author"))
    if len(name) > MOST_NAME:
        problems = [f"author: {len(name):,} characters, at most {MOST_NAME} are a name"]
    if problems:
        raise _wrong(problems)


def _problems(value: Any, path: str) -> Iterator[str]:
    place = path.removeprefix(".") or "operation"
    if isinstance(value, str):
        if len(value) > MOST_TEXT:
            yield f"{place}: {len(value):,} characters, at most {MOST_TEXT:,} are kept"
        elif found := _NOT_XML.search(value):
            yield f"{place}: the character U+{ord(found[0]):04X} cannot be kept"
    elif isinstance(value, float):
        if not math.isfinite(value):
            yield f"{place}: not a number"
    elif isinstance(value, int):
        if value not in _INT32:
            yield f"{place}: beyond 32 bits"
    elif isinstance(value, Mapping | list | tuple):
        items: list[tuple[str, Any]] = (
            [(f".{key}", item) for key, item in cast("Mapping[str, Any]", value).items()]
            if isinstance(value, Mapping)
            else [(f"[{i}]", item) for i, item in enumerate(cast("Sequence[Any]", value))]
        )
        if len(items) > MOST_NUMBERS and not path.startswith(".ids"):
            yield f"{place}: {len(items):,} parts, at most {MOST_NUMBERS:,} are kept"
            return
        for key, item in items:
            yield from _problems(key, f"{path}{key[:40]}") if isinstance(value, Mapping) else ()
            yield from _problems(item, f"{path}{key[:40]}")


@cache
def _adapter(kind: type[Operation]) -> TypeAdapter[Any]:
    config = ConfigDict(extra="forbid", allow_inf_nan=False)
    return TypeAdapter(with_config(config)(cast("Any", kind)))


def _dotted(location: Sequence[int | str]) -> str:
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return path.removeprefix(".")


def _wrong(problems: Sequence[str]) -> SchemaError:
    return SchemaError(
        "cannot read the operation",
        problems=tuple(problems),
        consequence="nothing was changed",
        fix="correct what is named",
    )
