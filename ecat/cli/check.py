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
    from ecat.check import Finding, Repairs


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
    Each finding says what --repair would do about it, or what else can be done.

    The exit code is 1 if an error is found (and not repaired) or a repair failed, else 0.
    """
    from ecat.check import Repairs, check
    from ecat.check import repair as mend
    from ecat.cli.describe import require_folder

    require_folder(path)
    repairs = Repairs([], [])
    with out.progress() as progress:
        found = check(path, deep=deep, progress=progress)
        if repair and any(finding.repair for finding in found):
            repairs = mend(path, found, progress)
            found = check(path, deep=deep, progress=progress)
    ok = not repairs.failed and not any(finding.severity == "error" for finding in found)
    data = {
        "findings": [f.to_dict() for f in found],
        "repaired": [f.to_dict() for f in repairs.done],
        "failures": [{"finding": f.to_dict(), "error": reason.to_dict()} for f, reason in repairs.failed],
    }
    out.result(data, _text(found, repairs), ok=ok)
    return 0 if ok else 1


def _text(found: list[Finding], repairs: Repairs) -> str:
    lines = [f"repaired: {_where(f)}: {f.repair}" for f in repairs.done]
    lines += [f"not repaired: {_where(f)}: {reason}" for f, reason in repairs.failed]
    for finding in found:
        lines.append(f"{finding.severity}: {_where(finding)}: {finding.message} [{finding.code}]")
        if finding.repair:
            lines.append(f"  --repair would {finding.repair}: {finding.fix}")
        else:
            lines.append(f"  --repair leaves it as it is; {finding.fix}")
    kinds = Counter(finding.severity for finding in found)
    summary = [count(kinds[kind], kind) for kind in ("error", "warning", "note") if kinds[kind]]
    return "\n".join([*lines, ", ".join(summary) or "no findings"])


def _where(finding: Finding) -> str:
    return finding.place if finding.session == "." else f"{finding.session}: {finding.place}"
