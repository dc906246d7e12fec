"""What ``ecat import`` and ``ecat export`` share: a destination apart from the source, and the closing report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.formats import ExportReport, ImportReport


def keep_apart(source: Path, dest: Path) -> None:
    """Return if ``dest`` is not inside of ``source``, which is left as it is.

    Raises
    ------
    UsageError : it is.
    """
    if source.resolve() in dest.resolve().parents:
        raise UsageError(
            f"cannot write to {dest}",
            where=f"it lies inside of {source}, which is only read",
            fix="choose a destination beside it",
        )


def tell(out: Output, done: str, report: ImportReport | ExportReport) -> None:
    """Say what was ``done`` ("imported"), and every finding on a line of its own."""
    head = f"{done} {count(report.sessions, 'session')} ({report.format}) to {report.path}"
    data = {
        "path": str(report.path),
        "format": report.format,
        "sessions": report.sessions,
        "findings": list(report.findings),
    }
    out.result(data, "\n  ".join((head, *report.findings)))
