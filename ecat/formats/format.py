"""What a foreign format is, and what reading and writing report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ecat.progress import Progress


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """What an import made: where, from which format, how many sessions, and what was odd (a line each)."""

    path: Path
    format: str
    sessions: int
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """What an export wrote, and what the format could not carry (a line each)."""

    path: Path
    format: str
    sessions: int
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How to read.

    ``skip_bad_markers`` keeps markers that cannot be read without their values.  ``keep_going`` leaves out
    sessions that cannot be read, instead of importing nothing.
    """

    skip_bad_markers: bool = False
    keep_going: bool = False


class Reader(Protocol):
    """Reads ``source`` into a new session, project or workspace at ``dest``; leaves nothing there on an error."""

    def __call__(self, source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
        """Read."""
        ...


class Writer(Protocol):
    """Writes the session, project or workspace at ``path`` to ``dest``; leaves nothing there on an error."""

    def __call__(self, path: Path, dest: Path, progress: Progress) -> ExportReport:
        """Write."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SideFile:
    """A kind of file that lies beside recordings of a format (settings, a calibration, ...) and can be explained.

    ``sniff`` tells whether a file looks like it without reading much.  ``explain`` reads it and says what it holds, as
    JSON-able data: texts, numbers, lists of texts or of such mappings, mappings of texts; it raises as readers do.
    """

    name: str
    description: str
    sniff: Callable[[Path], bool]
    explain: Callable[[Path], Mapping[str, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One foreign format: its name on the command line, and what it can do.

    ``sniff`` tells whether a path looks like this format without reading much; ``side_files`` are what ``ecat info``
    explains.
    """

    name: str
    description: str
    sniff: Callable[[Path], bool] | None = None
    read: Reader | None = None
    write: Writer | None = None
    side_files: tuple[SideFile, ...] = ()

    @property
    def reads(self) -> bool:
        """Whether ecat imports it."""
        return self.read is not None

    @property
    def writes(self) -> bool:
        """Whether ecat exports it."""
        return self.write is not None
