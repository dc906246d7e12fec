"""Coding schemes: which tiers, event types, roles and predicates an annotation may use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ecat.errors import NotFoundError
from ecat.model import CodingScheme
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.store import Session, schemes
from ecat.store.schemes import read_scheme, write_scheme


def find_scheme(session: Session, name: str) -> CodingScheme:
    """The coding scheme called ``name``: ``annotations/<name>.scheme.xml`` of the session, ``<name>.scheme.xml`` beside
    its project's manifest, or a built-in one (``ecat-2018``, ``blocks``).

    Raises
    ------
    NotFoundError : there is none.
    FormatError, SchemaError, LimitError : its file is not a coding scheme.
    """
    return schemes.find_scheme(session.path, name)


def scheme_names(session: Session) -> list[str]:
    """The names of all coding schemes that :func:`find_scheme` finds."""
    return schemes.scheme_names(session.path)


def scheme_file(folder: Path, name: str) -> Path:
    """Where a scheme of the session or project in ``folder`` is written."""
    places = schemes.scheme_places(folder)
    return (places[0] if places else folder) / f"{name}{schemes.ENDING}"


def scheme_to_extend(folder: Path, name: str) -> CodingScheme:
    """The scheme called ``name`` for the session or project in ``folder``; a new one begins as a copy of
    ``ecat-2018``.
    """
    try:
        return schemes.find_scheme(folder, name)
    except NotFoundError:
        return replace(ECAT_2018_SCHEME, name=name)


__all__ = ["find_scheme", "read_scheme", "scheme_file", "scheme_names", "scheme_to_extend", "write_scheme"]
