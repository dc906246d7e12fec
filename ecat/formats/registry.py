"""Foreign formats by name: ecat's own and those that other packages add as entry points (group ``ecat.formats``).

An entry point names a :class:`ecat.formats.format.Format`: ``module:NAME``, or a module that calls it ``FORMAT``.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from ecat.errors import FormatError, NotFoundError, UsageError
from ecat.formats.format import Format

GROUP = "ecat.formats"
_OWN = {
    "ecat-2018": "ecat.formats.ecat2018",
    "poses": "ecat.formats.poses",
    "poses-smooth": "ecat.formats.poses:SMOOTH",
}


@cache
def all_formats() -> tuple[Format, ...]:
    """Every format, in the order of their names.  Ecat's own are there even if it runs from a bare checkout."""
    modules = _OWN | {point.name: point.value for point in entry_points(group=GROUP)}
    return tuple(_load(name, modules[name]) for name in sorted(modules))


def _load(name: str, value: str) -> Format:
    module, _, attribute = value.partition(":")
    try:
        return getattr(import_module(module), attribute or "FORMAT")
    except Exception as error:  # another package's fault must not take ecat's formats with it
        if name in _OWN:
            raise
        return Format(name=name, description=f"cannot be loaded: {type(error).__name__}: {error}")


def find(name: str) -> Format:
    """The format called ``name``.

    Raises
    ------
    UsageError : there is none; the message lists those there are.
    """
    for known in all_formats():
        if known.name == name:
            return known
    names = ", ".join(known.name for known in all_formats())
    raise UsageError(f"unknown format {name!r}", where=f"known formats: {names}", fix="ecat formats")


def sniff(path: Path) -> Format:
    """The format that ``path`` looks like.

    Raises
    ------
    NotFoundError : nothing is there.
    FormatError : it looks like none.
    """
    if not path.exists():
        raise NotFoundError(f"cannot import {path}", where="no such file or folder", fix="check the path")
    for known in all_formats():
        if known.sniff is not None and known.sniff(path):
            return known
    raise FormatError(
        f"cannot import {path}",
        where="it looks like none of the formats that ecat reads",
        consequence="nothing was written",
        fix="ecat formats lists them; --format NAME insists on one",
    )
