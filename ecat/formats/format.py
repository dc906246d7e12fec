"""What a foreign format is, and what reading and writing report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ecat.errors import EcatError
from ecat.formats.options import NoOptions
from ecat.model import Layer
from ecat.progress import Progress
from ecat.store import Session


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """What an import made: where, from which format, how many sessions, and what was odd (a line each)."""

    path: Path
    format: str
    sessions: int
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """What an export wrote, what the format could not carry (a line each), and which sessions failed, and why."""

    path: Path | str
    format: str
    sessions: int
    findings: tuple[str, ...] = ()
    failures: tuple[tuple[Path | str, EcatError], ...] = ()


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


class LayerReader(Protocol):
    """Reads what another program says about a recording that is a session already; the layer's name does not matter.

    Returns the layer, and what could not be carried over (a line each).  Changes nothing.
    """

    def __call__(self, source: Path, session: Session) -> tuple[Layer, tuple[str, ...]]:
        """Read."""
        ...


class Writer(Protocol):
    """Writes the session, project or workspace at ``path`` to ``dest``; leaves nothing there on an error."""

    def __call__(self, path: Path, dest: Path, options: Any, progress: Progress) -> ExportReport:
        """Write."""
        ...


class PartWriter(Protocol):
    """Writes one session to ``dest``, a file or a folder that is not there yet.

    ``label`` is what the session is called in this export, with ``/`` between folders.  The same session and options
    give the same bytes.  Returns what the format could not carry (a line each); what it leaves behind when it raises
    is removed by the caller.
    """

    def __call__(
        self, session: Session, label: str, dest: Path, options: Any, progress: Progress
    ) -> tuple[str, ...]:
        """Write."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What a :class:`PartWriter` made of the session called ``label``."""

    label: str
    path: Path


class Merger(Protocol):
    """Joins parts, in their order, to one data set at ``dest``, a file or a folder that is not there yet.

    To iterate over them is to wait for one after the other, while those behind are still being made; their number is
    known when all are.

    What was encoded is not encoded again, and memory does not grow with the number of parts.  It may move files out
    of the parts.  Returns findings.
    """

    def __call__(
        self, parts: Sequence[Part], dest: Path, options: Any, progress: Progress
    ) -> tuple[str, ...]:
        """Join."""
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
    explains.  ``read`` makes sessions, ``read_layer`` reads annotations of a session that is there.

    A format is written by ``write``, the whole path at once; or by ``part``, a session at a time, in several processes
    or on several machines (:mod:`ecat.formats.exporting`).  Parts are then joined by ``merge``; without one they are
    the result, a file (or, without ``suffix``, a folder) for each session.  ``options`` is a frozen dataclass of
    :func:`ecat.formats.options.option` fields, handed to both.  ``version`` changes whenever the same input gives
    other bytes.
    """

    name: str
    description: str
    sniff: Callable[[Path], bool] | None = None
    read: Reader | None = None
    read_layer: LayerReader | None = None
    write: Writer | None = None
    part: PartWriter | None = None
    merge: Merger | None = None
    suffix: str = ""
    options: type[Any] = NoOptions
    version: str = "1"
    side_files: tuple[SideFile, ...] = ()

    @property
    def reads(self) -> bool:
        """Whether ecat imports it."""
        return self.read is not None or self.read_layer is not None

    @property
    def writes(self) -> bool:
        """Whether ecat exports it."""
        return self.write is not None or self.part is not None
