"""What the elements of ``files.param`` have in common: attributes, whole numbers, predicate forms, kept facts.

Where the usual text of a value differs from what the file said, the file's text is kept as a ``foreign``
fact.  The writer uses it only while it still means the model's value, so an edit is never hidden by it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from ecat.errors import FormatError, LimitError
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import Foreign
from ecat.model.annotation import foreign_value

PREFIX = "ecat-2018:"
MAX_ATTRIBUTES = 1000
_INTEGER = re.compile(r"-?[0-9]{1,10}")
_FORM = re.compile(r"(\w+)\((X|X,Y|Y,X)\)")


def fact(name: str, value: str) -> Foreign:
    """A foreign fact of this format."""
    return Foreign(PREFIX + name, value)


def kept(items: tuple[Foreign, ...], name: str) -> str | None:
    """The text kept under ``name``."""
    return foreign_value(items, PREFIX + name)


def tag_of(element: Element) -> str:
    """The element's name."""
    return str(element.tag)


def attributes_of(element: Element, what: str) -> dict[str, str]:
    """The element's attributes in their order, without those of other XML namespaces.

    Raises
    ------
    LimitError : more than a thousand; the time to read them grows with the square of their number.
    """
    if len(element.attrib) > MAX_ATTRIBUTES:
        raise LimitError(
            what,
            where=f"line {element.sourceline}: {len(element.attrib):,} attributes, at most {MAX_ATTRIBUTES:,} are read",
            consequence="the session was not imported; nothing was written",
            fix="check that this is the right file",
        )
    return {str(name): str(value) for name, value in element.items() if not str(name).startswith("{")}


def attribute_facts(said: dict[str, str], usual: Sequence[str], known: Collection[str]) -> list[Foreign]:
    """Facts for attributes that are not the ``usual`` ones in their order; ``known`` ones have a place in the model."""
    if list(said) == list(usual):
        return []
    others = [fact(f"@{name}", value) for name, value in said.items() if name not in known]
    return [fact("attributes", ",".join(said)), *others]


def kept_attributes(values: dict[str, str], foreign: tuple[Foreign, ...]) -> list[tuple[str, str]]:
    """``values`` in the order that the file had them in, with those that only the file had."""
    order = kept(foreign, "attributes")
    if order is None:
        return list(values.items())
    names = [name for name in order.split(",") if name]
    return [(name, values[name] if name in values else kept(foreign, f"@{name}") or "") for name in names]


def small_number(text: str | None) -> int | None:
    """A whole number of at most four digits, or ``None``."""
    return int(text) if text is not None and re.fullmatch(r"[0-9]{1,4}", text) else None


def frame_number(text: str | None, what: str, line: int) -> int:
    """A whole number that fits 32 bits.

    Raises
    ------
    FormatError : it is missing or anything else.
    """
    if text is not None and _INTEGER.fullmatch(text):
        number = int(text)
        if -(1 << 31) <= number < 1 << 31:
            return number
    found = "nothing" if text is None else repr(text[:40])
    raise refused(
        what, f"line {line}: expected a whole number of 32 bits, found {found}", "correct the number"
    )


def refused(what: str, where: str, fix: str) -> FormatError:
    """The error for an element that cannot be understood."""
    return FormatError(
        what, where=where, consequence="the session was not imported; nothing was written", fix=fix
    )


def predicate_of(text: str) -> tuple[str, bool]:
    """Name, and whether the second slot is read first (``NAME(Y,X)``)."""
    form = _FORM.fullmatch(text)
    return (form.group(1), form.group(2) == "Y,X") if form else (text, False)
