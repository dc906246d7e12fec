"""``ecat process``: run the stages that turn a recording into data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.spread import spread_options
from ecat.cli.text import count
from ecat.cli.verb import verb
from ecat.errors import EcatError

if TYPE_CHECKING:
    from ecat.batch import Engine, Outcome


@verb(
    "process",
    examples=(
        "ecat process my_session",
        "ecat process my_project --smooth --jobs 4",
        "ecat process my_session --stage plane --stage pose --force",
        "ecat process my_project --shard 3/8",
        "ecat process my_session --prototypes boxes.json",
    ),
)
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    help="Sessions, projects or workspaces.",
)
@click.option(
    "--stage", "stages", multiple=True, metavar="NAME", help="Run only this stage; may be repeated."
)
@click.option("--smooth", is_flag=True, help="Also smooth the poses in time.")
@click.option("--force", is_flag=True, help="Run stages again whose inputs have not changed.")
@click.option(
    "--prototypes",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Sizes and markers of the boxes, as written by `ecat calibrate`.",
)
@spread_options("Process")
def command(
    out: Output,
    paths: tuple[Path, ...],
    stages: tuple[str, ...],
    smooth: bool,
    force: bool,
    prototypes: Path | None,
    jobs: int | None,
    shard: str | None,
    engine: Engine,
) -> int:
    """Turn recordings into data: the table, and where the boxes are in every frame.

    For each session it is said which stages ran, which were up to date (their inputs and parameters have not
    changed since they ran), and which are not applicable, and why.  Sessions and paths that cannot be
    processed are reported at the end, and the others are processed all the same; the exit code is then 1.
    After an interruption the same command does what is left.

    Jobs of an array each take a --shard of a folder that all of them see.  Boxes are measured by all sessions
    together: where marks are to be found in videos first, the array does that, says so, and when it is run again does
    the rest (at once with --prototypes).
    """
    from ecat import batch, process

    process.require_stages(stages)
    boxes = None if prototypes is None else process.read_prototypes(prototypes)
    share = None if shard is None else batch.parse_shard(shard)
    names, missing = _sessions(paths)
    with out.progress() as progress:
        outcomes = batch.process_sessions(
            list(names),
            jobs=jobs,
            engine=engine,
            shard=share,
            stages=stages or None,
            force=force,
            smooth=smooth,
            prototypes=boxes,
            name=lambda path: names[path],
            progress=progress,
        )
    failed = missing + [(outcome.path, outcome.error) for outcome in outcomes if outcome.error is not None]
    if len(paths) == 1 and len(failed) == 1 and len(outcomes) <= 1:
        raise failed[0][1]
    _report(out, outcomes, failed)
    return 1 if failed else 0


def _sessions(paths: tuple[Path, ...]) -> tuple[dict[Path, str], list[tuple[Path, EcatError]]]:
    """The sessions at the paths, each once, with a name for progress; and the paths where there is none."""
    from ecat.cli.describe import sessions_at

    names: dict[Path, str] = {}
    missing: list[tuple[Path, EcatError]] = []
    seen: set[Path] = set()
    for path in paths:
        try:
            for session in sessions_at(path):
                if (place := session.resolve()) not in seen:
                    seen.add(place)
                    inside = session.relative_to(path)
                    names[session] = str(inside if len(paths) == 1 and inside.parts else session)
        except EcatError as error:
            missing.append((path, error))
    return names, missing


def _report(out: Output, outcomes: list[Outcome], failed: list[tuple[Path, EcatError]]) -> None:
    reports = [outcome.report for outcome in outcomes if outcome.report is not None]
    data: dict[str, Any] = {
        "sessions": [
            {
                "path": str(report.path),
                "ran": list(report.ran),
                "up_to_date": list(report.skipped),
                "not_applicable": dict(report.not_applicable),
                "findings": list(report.findings),
            }
            for report in reports
        ],
        "failures": [{"path": str(path), "error": error.to_dict()} for path, error in failed],
    }
    lines = [line for session in data["sessions"] for line in _lines(session)]
    if not outcomes and not failed:
        lines.append("no sessions: there was nothing to do")
    lines += [f"{path}: {error}" for path, error in failed]
    if failed:
        lines.append(f"{count(len(reports), 'session')} processed, {len(failed):,} failed")
    out.result(data, "\n".join(lines), failed=[error for _, error in failed])


def _lines(session: dict[str, Any]) -> list[str]:
    """``my_session: ran plane; up to date: pose; not applicable: smooth (why)``, and remarks."""
    did = [f"ran {', '.join(session['ran'])}"] if session["ran"] else []
    if session["up_to_date"]:
        did.append(f"up to date: {', '.join(session['up_to_date'])}")
    reasons: dict[str, list[str]] = {}
    for stage, why in session["not_applicable"].items():
        reasons.setdefault(why, []).append(stage)
    did += [f"not applicable: {', '.join(stages)} ({why})" for why, stages in reasons.items()]
    return [f"{session['path']}: {'; '.join(did)}", *(f"  {finding}" for finding in session["findings"])]
