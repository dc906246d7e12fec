"""JSON of other programs: read into dataclasses that say what is expected of it, and written stably."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from ecat.errors import FormatError
from ecat.formats.ecat2018.xml_input import read_input
from ecat.formats.interchange.times import MOST_FRAMES, MOST_SECONDS

T = TypeVar("T")
MAX_JSON_BYTES = 128 << 20
"""JSON takes about ten times its size in memory."""
HEAD_BYTES = 1 << 16


def _text_of(value: object) -> object:
    """Numbers and nothing as text, where programs write either."""
    if value is None:
        return ""
    return str(value) if isinstance(value, int | float) else value


Text: TypeAlias = Annotated[str, BeforeValidator(_text_of)]
"""A text, or a number that stands for one."""
Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Seconds: TypeAlias = Annotated[float, Field(ge=-MOST_SECONDS, le=MOST_SECONDS, allow_inf_nan=False)]
Rate: TypeAlias = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]
Image: TypeAlias = Annotated[int, Field(ge=0, le=MOST_FRAMES)]
Size: TypeAlias = Annotated[int, Field(ge=0, le=1_000_000)]


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read_json(source: Path | bytes, kind: type[T], what: str) -> T:
    """A JSON file as ``kind``, a dataclass or a type of pydantic's; keys that it does not know are passed over.

    Raises
    ------
    FormatError : not JSON, or not of this kind: the first three places.
    LimitError : more than ``MAX_JSON_BYTES``.
    """
    data = read_input(source, what, MAX_JSON_BYTES)
    try:
        return _adapter(kind).validate_json(data.removeprefix(b"\xef\xbb\xbf"))
    except ValidationError as error:
        details = error.errors(include_url=False, include_input=False, include_context=False)
        places = tuple(f"{_place(detail['loc'])}{detail['msg']}" for detail in details[:3])
        raise FormatError(what, where=places) from None


def _place(location: Iterable[int | str]) -> str:
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{str(part)[:60]}" for part in location)
    return f"{path.removeprefix('.')}: " if path else ""


def write_json(data: object) -> bytes:
    """JSON as the other programs write it: UTF-8, one space deep, the same bytes for the same data."""
    return json.dumps(data, ensure_ascii=False, indent=1, allow_nan=False).encode() + b"\n"


def json_list(items: Iterable[object]) -> Iterator[str]:
    """A JSON array piece by piece, an item on each line."""
    yield "["
    separator = "\n"
    for item in items:
        yield separator + json.dumps(item, ensure_ascii=False, allow_nan=False)
        separator = ",\n"
    yield "\n]"


def head_of(path: Path, suffixes: tuple[str, ...]) -> bytes:
    """The beginning and the end of a file with one of these suffixes; nothing of others."""
    if path.suffix.lower() not in suffixes or not path.is_file():
        return b""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        size = file.seek(0, 2)
        file.seek(max(HEAD_BYTES, size - HEAD_BYTES))
        return head + file.read(HEAD_BYTES)


def tells(path: Path, suffixes: tuple[str, ...], *keys: str) -> bool:
    """Whether a JSON file has all these keys near its beginning or its end."""
    data = head_of(path, suffixes)
    return bool(data) and all(f'"{key}"'.encode() in data for key in keys)
