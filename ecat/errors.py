"""Every error that ecat raises on purpose, in one tree.

    EcatError
    ├── UsageError              the call itself is wrong                         exit code 2
    ├── InputError              what was read is not what it should be           exit code 1
    │   ├── FormatError         malformed, truncated, or not the claimed format
    │   ├── SchemaError         well-formed, but against the schema
    │   ├── LimitError          larger or deeper than ecat is willing to read
    │   └── OperationError      an edit that the annotation or its coding scheme does not allow
    ├── StoreError              the session or the disk under it                 exit code 1
    │   ├── NotFoundError       nothing there, or not a session
    │   ├── ExistsError         the destination is taken
    │   ├── LockedError         another process is writing
    │   ├── ReadOnlyError       no permission to read or write
    │   ├── StaleError          the write was based on an older revision
    │   ├── ConflictError       others have changed since what was to be undone
    │   ├── CorruptError        the session contradicts its own manifest
    │   └── DiskError           disk full, I/O error
    └── MissingExtraError       an optional library is not installed             exit code 1

An error says four things: what could not be done, where the cause is, what happened to the data, and what to do.
"""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any, ClassVar


class EcatError(Exception):
    """Root of the tree.

    Parameters
    ----------
    what : one line, what could not be done (``cannot import Session1/files.param``).
    where : the place of the cause (``line 12: the root element is <a>, expected <annotation>``), or a line for each
        of several.
    consequence : what became of the data (``the layer was not read``); ``usual_consequence`` if not given.
    fix : what to do about it, a command where there is one; ``usual_fix`` if not given.
    """

    exit_code: ClassVar[int] = 1
    usual_consequence: ClassVar[str] = ""
    usual_fix: ClassVar[str] = ""

    def __init__(
        self, what: str, *, where: str | tuple[str, ...] = "", consequence: str = "", fix: str = ""
    ) -> None:
        super().__init__(what)
        self.what = what
        self.where = one_line(where) if isinstance(where, str) else "\n".join(map(one_line, where))
        self.consequence = consequence or self.usual_consequence
        self.fix = fix or self.usual_fix

    def __str__(self) -> str:
        """A line each, whatever the names in it contain."""
        fix = f"try: {self.fix}" if self.fix else ""
        lines = [one_line(self.what)]
        lines += [f"  {line}" for line in self.where.split("\n") if line]
        lines += [f"  {one_line(line)}" for line in (self.consequence, fix) if line]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, str]:
        """The same as data, for ``--json`` and for HTTP."""
        return {
            "error": type(self).__name__,
            "what": self.what,
            "where": self.where,
            "consequence": self.consequence,
            "fix": self.fix,
        }


class UsageError(EcatError):
    """The call itself is wrong: unknown option, impossible combination."""

    exit_code: ClassVar[int] = 2
    usual_consequence: ClassVar[str] = "nothing was done"


class InputError(EcatError):
    """What was read is not what it should be."""

    usual_consequence: ClassVar[str] = "nothing was taken from it"


class FormatError(InputError):
    """Malformed, truncated, or not of the claimed format."""

    usual_fix: ClassVar[str] = "check that this is the right file, or take a copy of it that is not damaged"


class SchemaError(InputError):
    """Well-formed, but against the schema; ``problems`` lists every finding, each with its path."""

    def __init__(
        self,
        what: str,
        *,
        problems: tuple[str, ...] = (),
        where: str = "",
        consequence: str = "",
        fix: str = "",
    ) -> None:
        super().__init__(what, where=where or "; ".join(problems[:3]), consequence=consequence, fix=fix)
        self.problems = problems

    def to_dict(self) -> dict[str, str]:
        """As of any error, with every problem on a line of its own."""
        return {**super().to_dict(), "problems": "\n".join(self.problems)}


class LimitError(InputError):
    """Larger or deeper than ecat is willing to read."""

    usual_fix: ClassVar[str] = "check that this is the right file"


class OperationError(InputError):
    """An edit that the annotation, or its coding scheme, does not allow."""

    usual_consequence: ClassVar[str] = "nothing was changed"


class StoreError(EcatError):
    """The session on disk, or the disk under it."""


class NotFoundError(StoreError):
    """Nothing there, or not a session."""

    usual_consequence: ClassVar[str] = "nothing was done"


class ExistsError(StoreError):
    """The destination is taken."""


class LockedError(StoreError):
    """Another process is writing to the session."""


class ReadOnlyError(StoreError):
    """No permission to read or to write, or a disk that is mounted read-only."""


class StaleError(StoreError):
    """The write was based on an older revision.

    Of an edit, ``revision`` is that of the layer now, and ``records`` are those since the one it was based on.
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | tuple[str, ...] = "",
        consequence: str = "",
        fix: str = "",
        revision: int | None = None,
        records: tuple[Any, ...] = (),
    ) -> None:
        super().__init__(what, where=where, consequence=consequence, fix=fix)
        self.revision = revision
        self.records = records


class ConflictError(StoreError):
    """Others have changed since what was to be undone or done again."""

    usual_consequence: ClassVar[str] = "nothing was changed"


class CorruptError(StoreError):
    """The session contradicts its own manifest."""


class DiskError(StoreError):
    """Disk full, or an I/O error."""


class MissingExtraError(EcatError):
    """An optional library is not installed; ``fix`` names the extra."""

    usual_consequence: ClassVar[str] = "nothing was done"


def one_line(text: str) -> str:
    """``text`` with control characters, which may break a line or steer a terminal, shown as escapes."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


_DISK_FIXES = {
    errno.ENOSPC: "free some space, then do it again",
    errno.EDQUOT: "free some space, then do it again",
    errno.EFBIG: "write to a disk that takes files of that size, or raise the limit (ulimit -f)",
    errno.ENAMETOOLONG: "use a shorter name",
    errno.ELOOP: "check where the symbolic links of the path lead",
}


def os_error(error: OSError, what: str, path: Path | str, consequence: str = "it was not read") -> EcatError:
    """The typed error for an ``OSError`` met while doing ``what`` at ``path``; ``consequence`` is that of a read."""
    where = f"{path}: {error.strerror or error}"
    kinds: dict[type[OSError], tuple[type[EcatError], str]] = {
        FileNotFoundError: (NotFoundError, "check the path"),
        NotADirectoryError: (NotFoundError, "check the path"),
        IsADirectoryError: (FormatError, "name the file, not the folder that holds it"),
        FileExistsError: (ExistsError, "choose another destination"),
        PermissionError: (ReadOnlyError, "check who owns the folder and may write to it"),
    }
    for kind, (made, fix) in kinds.items():
        if isinstance(error, kind):
            return made(what, where=where, consequence=consequence, fix=fix)
    if error.errno == errno.EROFS:
        fix = "choose a destination on a disk that may be written to"
        return ReadOnlyError(what, where=where, consequence=consequence, fix=fix)
    fix = _DISK_FIXES.get(error.errno or 0, "check the disk, then do it again")
    return DiskError(what, where=where, consequence=consequence, fix=fix)
