"""``<project>.project``: the list of sessions kept by ECAT before July 2018 (§1.1).

Plain text without a BOM, one session name per line, a final line end. ECAT appended a name unless some line
already contained it, and showed the sessions that some line contains; so lists hold stale and repeated names,
which are kept here as they are and told by `findings`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ecat.errors import FormatError, UsageError
from ecat.formats.ecat2018.xml_input import read_input, reading

MAX_BYTES = 16 << 20


@dataclass(frozen=True, slots=True)
class ProjectList:
    """The names in file order, repeats included, and how the lines end."""

    names: tuple[str, ...]
    newline: Literal["\n", "\r\n"] = "\r\n"
    final_newline: bool = True

    def shows(self, session: str) -> bool:
        """Whether ECAT showed that session: some line contains its name (a substring is enough)."""
        return any(session in name for name in self.names)


def read_project_list(source: Path | bytes) -> ProjectList:
    """Read the list; `FormatError` if it is not UTF-8 text, `LimitError` above 16 MiB."""
    what = reading(source, "the project list")
    data = read_input(source, what, MAX_BYTES)
    try:
        text = data.decode().lstrip("\ufeff")  # a text editor may have added a BOM
    except UnicodeDecodeError as error:
        raise FormatError(
            what, where=f"byte {error.start}: not UTF-8", fix="save the list as UTF-8"
        ) from None
    if "\x00" in text:
        raise FormatError(what, where=f"character {text.index(chr(0))}: a NUL byte, so this is no text file")
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = text.split(newline)
    final = len(lines) > 1 and not lines[-1]
    if final or not text:
        lines.pop()
    return ProjectList(tuple(lines), newline, final_newline=final or not lines)


def write_project_list(projects: ProjectList) -> bytes:
    """The file; real lists come back byte for byte."""
    if any(projects.newline in name for name in projects.names):
        raise UsageError(
            "cannot write the project list", where="a name has a line end in it", fix="rename the session"
        )
    text = projects.newline.join(projects.names)
    return (text + projects.newline * bool(projects.final_newline and projects.names)).encode()


def findings(projects: ProjectList, sessions: Collection[str]) -> tuple[str, ...]:
    """What is odd about a list, given the names of the session folders that exist."""
    names, existing = Counter(projects.names), set(sessions)
    repeated = [f"{name!r} is listed {count} times" for name, count in names.items() if count > 1]
    stale = [f"{name!r} is listed but has no folder" for name in names if name not in existing]
    unlisted = [f"{name!r} has a folder but no line" for name in sorted(existing - set(names))]
    return (*repeated, *stale, *unlisted)
