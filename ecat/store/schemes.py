"""Coding schemes by name: in the session, beside the project's manifest, or built in."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path

from ecat.errors import EcatError, ExistsError, NotFoundError, UsageError
from ecat.model import CodingScheme
from ecat.model.scheme import BUILT_IN_SCHEMES, ECAT_2018_SCHEME
from ecat.store import files
from ecat.store.manifest import PROJECT_FILE, SESSION_FILE, is_file_name
from ecat.store.xml import scheme_from_xml, scheme_to_xml

ENDING = ".scheme.xml"
MAX_BYTES = 4 << 20


def scheme_places(folder: Path) -> list[Path]:
    """Where schemes for the session or project in ``folder`` lie, the nearest first."""
    found = [folder / "annotations"] if (folder / SESSION_FILE).is_file() else []
    inside = [folder, *folder.resolve().parents][: 3 if found else 2]
    return found + [place for place in inside if (place / PROJECT_FILE).is_file()]


def scheme_names(folder: Path) -> list[str]:
    """The names of all schemes for the session or project in ``folder``."""
    files_ = (path for place in scheme_places(folder) for path in place.glob(f"*{ENDING}"))
    return sorted({path.name.removesuffix(ENDING) for path in files_} | set(BUILT_IN_SCHEMES))


def find_scheme(folder: Path, name: str) -> CodingScheme:
    """The coding scheme called ``name``: a file in the session, one of the project, or a built-in one.

    Raises
    ------
    NotFoundError : there is none.
    FormatError, SchemaError, LimitError : its file is not a coding scheme.
    """
    for path in _files(folder, name):
        if path.is_file():
            return read_scheme(path)
    if name in BUILT_IN_SCHEMES:
        return BUILT_IN_SCHEMES[name]
    raise NotFoundError(
        f"cannot find the coding scheme {name!r}",
        where=f"{folder}: the schemes are: {', '.join(scheme_names(folder))}",
        fix=f"name one of them, or write annotations/{name}{ENDING}",
    )


def scheme_or_default(folder: Path, name: str) -> CodingScheme:
    """The scheme that decides which facts exclude each other in a layer: its own, else that of ECAT."""
    if not name:
        return ECAT_2018_SCHEME
    try:
        return find_scheme(folder, name)
    except EcatError:
        return ECAT_2018_SCHEME


def read_scheme(path: Path) -> CodingScheme:
    """Read a coding scheme from its file; errors as in :func:`ecat.store.xml.layer_from_xml`."""
    with files.typed_errors(f"cannot read {path.name}", path):
        data = files.read_bytes(path, MAX_BYTES)
    return scheme_from_xml(data, name=path.name)


def write_scheme(scheme: CodingScheme, path: Path, *, overwrite: bool = False) -> None:
    """Write a coding scheme to its file, whole or not at all.

    Raises
    ------
    UsageError : its name is not that of a file.
    ExistsError : there is a file, and ``overwrite`` is false.
    """
    if not is_file_name(scheme.name):
        fix = "take letters, digits, '_', '-', '.' and spaces"
        raise UsageError(f"cannot write scheme {scheme.name!r}", where="not a scheme's name", fix=fix)
    what = f"cannot write {path.name}"
    data = scheme_to_xml(scheme)
    if path.exists() and not overwrite:
        raise ExistsError(
            what,
            where=f"{path}: there is a scheme of that name",
            consequence="it was left as it is",
            fix="take another name",
        )
    new = path.with_name(f".{path.name}.{secrets.token_hex(8)}.new")
    with files.typed_errors(what, path, "nothing was written"):
        files.make_folder(path.parent)
        with files.NewFile(new) as file:
            file.write(data)
        files.sync(new)
        files.rename(new, path)
        files.sync(path.parent)


def _files(folder: Path, name: str) -> Iterator[Path]:
    if is_file_name(name):
        for place in scheme_places(folder):
            yield files.confined(place, f"{name}{ENDING}")
