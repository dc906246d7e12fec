"""What ``ecat import`` and ``ecat export`` share: a destination apart from the source, and the closing report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.formats import ExportReport, ImportReport


class Place(click.ParamType["Path | str"]):
    """A path, or a URL that is left as it is."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path | str:
        """As typed."""
        del param, ctx
        return value if "://" in str(value) else Path(value)


def keep_apart(source: Path | str, dest: Path | str) -> None:
    """Return if ``dest`` is not inside of ``source``, which is left as it is.

    Raises
    ------
    UsageError : it is.
    """
    if isinstance(source, str) and isinstance(dest, str):
        inside = f"{dest}/".startswith(f"{source.rstrip('/')}/")
    else:
        inside = Path(source).resolve() in Path(dest).resolve().parents
    if inside:
        raise UsageError(
            f"cannot write to {dest}",
            where=f"it lies inside of {source}, which is only read",
            fix="choose a destination beside it",
        )


def named_values(options: tuple[str, ...]) -> dict[str, str]:
    """What was given as ``name=value``; of two values for a name, the last counts.

    Raises
    ------
    UsageError : one without ``=``.
    """
    for option in options:
        if "=" not in option:
            raise UsageError(
                f"cannot understand --option {option}",
                where="expected NAME=VALUE",
                fix="--option fps=15",
            )
    return {name.strip(): value for name, _, value in (option.partition("=") for option in options)}


def tell(out: Output, done: str, report: ImportReport | ExportReport) -> None:
    """Say what was ``done`` ("imported"), and every finding and failure on a line of its own."""
    head = f"{done} {count(report.sessions, 'session')} ({report.format}) to {report.path}"
    failures = getattr(report, "failures", ())
    data = {
        "path": str(report.path),
        "format": report.format,
        "sessions": report.sessions,
        "findings": list(report.findings),
        "failures": [{"path": str(path), "error": error.to_dict()} for path, error in failures],
    }
    lines = ["\n  ".join((head, *report.findings)), *(f"{path}: {error}" for path, error in failures)]
    if failures:
        lines.append(f"{count(report.sessions, 'session')} {done}, {len(failures):,} failed")
    out.result(data, "\n".join(lines), failed=[error for _, error in failures])
