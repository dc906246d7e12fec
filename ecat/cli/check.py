"""``ecat check``: what is wrong with a session, and what can be done about it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.check import Finding


@verb(
    "check",
    examples=("ecat check my_session", "ecat check my_project --repair", "ecat check my_session --deep"),
)
@click.argument("path", type=click.Path(path_type=Path), help="A session, project or workspace.")
@click.option(
    "--repair", is_flag=True, help="Mend what can be mended without losing anything, and say what was done."
)
@click.option("--deep", is_flag=True, help="Also read all recorded files and compare their hashes.")
def command(out: Output, path: Path, repair: bool, deep: bool) -> int:
    """Examine a session, project or workspace.

    Finds gaps and drift of the clock, holes in depth, lost and jumping markers, references to what does not
    exist, annotations against the schema, tables made from older inputs, damaged files, leftovers of a crash.

    The exit code is 1 if an error is found (and not repaired), else 0.
    """
    from ecat.check import check
    from ecat.check import repair as mend

    repaired: list[Finding] = []
    with out.progress() as progress:
        found = check(path, deep=deep, progress=progress)
        if repair and any(finding.repair for finding in found):
            repaired = mend(path, found)
            found = check(path, deep=deep, progress=progress)
    ok = not any(finding.severity == "error" for finding in found)
    data = {"findings": [f.to_dict() for f in found], "repaired": [f.to_dict() for f in repaired]}
    out.result(data, _text(found, repaired), ok=ok)
    return 0 if ok else 1


def _text(found: list[Finding], repaired: list[Finding]) -> str:
    lines = [f"repaired: {_where(f)}: {f.repair}" for f in repaired]
    for finding in found:
        lines.append(f"{finding.severity}: {_where(finding)}: {finding.message} [{finding.code}]")
        if finding.repair:
            lines.append(f"  --repair would: {finding.repair}")
    kinds = Counter(finding.severity for finding in found)
    summary = [count(kinds[kind], kind) for kind in ("error", "warning", "note") if kinds[kind]]
    return "\n".join([*lines, ", ".join(summary) or "no findings"])


def _where(finding: Finding) -> str:
    return finding.place if finding.session == "." else f"{finding.session}: {finding.place}"
