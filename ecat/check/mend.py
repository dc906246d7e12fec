"""Repair what can be repaired without losing anything."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ecat import process
from ecat.check import disk
from ecat.check.finding import Finding
from ecat.errors import EcatError, InputError
from ecat.progress import Progress, silent
from ecat.store import adopt_edited_layers, begin_journal, open_session, rebuild_layer, remove_leftovers

ORDER = (disk.REMOVE, disk.REBUILD, disk.NEW_JOURNAL, disk.ADOPT, disk.REPUBLISH, disk.RERUN)
"""Each repair needs what the ones before it have mended."""


@dataclass(frozen=True, slots=True)
class Repairs:
    """What was repaired, and what could not be, with the reason."""

    done: list[Finding]
    failed: list[tuple[Finding, EcatError]]


def repair(path: Path, findings: Sequence[Finding], progress: Progress = silent) -> Repairs:
    """Do what the findings of :func:`ecat.check.check` of ``path`` say can be done, in atomic commits.

    What fails in one session does not stop the repair of others.
    """
    todo = [finding for finding in findings if finding.repair]
    repairs = Repairs([], [])
    folders = list(dict.fromkeys(finding.session for finding in todo))
    for i, folder in enumerate(folders):
        progress("repairing", i, len(folders))
        mine = [finding for finding in todo if finding.session == folder]
        for kind in ORDER:
            wanted = [finding for finding in mine if finding.repair == kind]
            if not wanted:
                continue
            try:
                _repair(path / folder, kind, wanted)
            except EcatError as reason:
                repairs.failed.extend((finding, reason) for finding in wanted)
            else:
                repairs.done.extend(wanted)
    return repairs


def _repair(folder: Path, kind: str, findings: Iterable[Finding]) -> None:
    if kind == disk.REMOVE:
        remove_leftovers(folder)
    elif kind == disk.REBUILD:
        session = open_session(folder)
        for name in dict.fromkeys(finding.place.removeprefix("layer ") for finding in findings):
            rebuild_layer(session, name)
    elif kind == disk.NEW_JOURNAL:
        session = open_session(folder)
        for finding in findings:
            begin_journal(session, finding.place.removeprefix("layer ").removesuffix(", journal"))
    elif kind == disk.ADOPT:
        adopt_edited_layers(open_session(folder))
    elif kind == disk.REPUBLISH:
        with open_session(folder).write() as commit:
            commit.update()  # nothing new; but whatever is put publishes the tables
    elif kind == disk.RERUN:
        _run_again(folder, findings)


def _run_again(folder: Path, findings: Iterable[Finding]) -> None:
    """Make damaged tables anew, then whatever is stale."""
    makers = process.made_by(open_session(folder))
    tables = {finding.place.removeprefix("table "): finding.code for finding in findings}
    damaged = [makers[name] for name, code in tables.items() if code == "table-damaged"]
    reports = [process.process_session(folder, stages=damaged, force=True)] if damaged else []
    reports.append(process.process_session(folder, stages=list(makers.values())))
    impossible = {stage: why for report in reports for stage, why in report.not_applicable.items()}
    if wanting := sorted(impossible.keys() & {makers[name] for name in tables}):
        raise InputError(
            f"cannot run the stage {wanting[0]} on {folder.name}",
            where=impossible[wanting[0]],
            consequence="its table was left as it is",
            fix="take the file from a copy of the session, or import the recording again",
        )
