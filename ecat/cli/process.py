"""``ecat process``: run the stages that turn a recording into data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output, printable
from ecat.cli.text import count
from ecat.cli.verb import verb
from ecat.errors import EcatError

if TYPE_CHECKING:
    from ecat.progress import Progress


@verb(
    "process",
    examples=(
        "ecat process my_session",
        "ecat process my_project --smooth",
        "ecat process my_session --stage plane --stage pose --force",
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
def command(
    out: Output,
    paths: tuple[Path, ...],
    stages: tuple[str, ...],
    smooth: bool,
    force: bool,
    prototypes: Path | None,
) -> int:
    """Turn recordings into data: the table, and where the boxes are in every frame.

    A stage whose inputs have not changed since it ran is skipped.  Sessions that cannot be processed are
    reported at the end, and the others are processed all the same; the exit code is then 1.
    """
    from ecat import process, store

    sessions = [session for path in paths for session in store.find_sessions(path)]
    boxes = None if prototypes is None else process.read_prototypes(prototypes)
    results: list[dict[str, Any]] = []
    with out.progress() as progress:
        # several sessions show a box better than one does; a single session calibrates its own
        together = (
            process.calibrate_together(sessions, progress) if boxes is None and len(sessions) > 1 else {}
        )
        for i, path in enumerate(sessions):
            try:
                report = process.process_session(
                    path,
                    stages=stages or None,
                    force=force,
                    smooth=smooth,
                    prototypes=boxes if boxes is not None else together.get(path),
                    progress=_within(progress, path.name, i, len(sessions)),
                )
            except EcatError as error:
                if len(sessions) == 1:
                    raise
                results.append({"path": str(path), "error": error.to_dict(), "text": str(error)})
            else:
                done = {"ran": list(report.ran), "skipped": list(report.skipped)}
                results.append({"path": str(path), **done, "findings": list(report.findings)})
    failed = [result for result in results if "error" in result]
    text = "\n".join(line for result in results for line in _lines(result))
    text += (
        f"\n{count(len(results) - len(failed), 'session')} processed, {len(failed):,} failed"
        if failed
        else ""
    )
    out.result(
        {"sessions": [{k: v for k, v in r.items() if k != "text"} for r in results]}, text, ok=not failed
    )
    if failed and out.quiet and not out.as_json:
        for result in failed:
            click.echo(f"ecat: {printable(result['text'])}", err=True)
    return 1 if failed else 0


def _within(progress: Progress, name: str, index: int, n_sessions: int) -> Progress:
    """The same, with the session's name in front where there are several."""
    if n_sessions == 1:
        return progress
    return lambda what, done, total: progress(f"{name} ({index + 1} of {n_sessions}): {what}", done, total)


def _lines(result: dict[str, Any]) -> list[str]:
    if "error" in result:
        return [f"{result['path']}: {result['text']}"]
    did = f"ran {', '.join(result['ran'])}" if result["ran"] else "nothing to do"
    if result["skipped"]:
        did += f"; up to date: {', '.join(result['skipped'])}"
    return [f"{result['path']}: {did}", *(f"  {finding}" for finding in result["findings"])]
