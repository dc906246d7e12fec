"""``ecat stats``: what is in a project."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import cell, columns, count, duration
from ecat.cli.transfer import Place
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.query import Statistics

TITLES = {
    "events": "Events",
    "annotated": "Frames in an action",
    "objects": "Objects",
    "relations": "Relations",
    "places": "Where boxes are known to be (share of frames)",
}


@verb(
    "stats",
    examples=(
        "ecat stats my_project",
        "ecat stats my_project --plot stats.png",
        "ecat stats my_project --json",
    ),
)
@click.argument("path", type=Place(), help="A session, project or workspace; also a URL (s3://...).")
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw them, too: a .png, .svg or .pdf file, which is replaced if it is one.",
)
def command(out: Output, path: Path | str, plot: Path | None) -> int:
    """Say what is in a project: counts, durations, coverage, and how far annotators agree."""
    from ecat import query
    from ecat.store import remote

    with out.progress() as progress, remote.all_at_hand(path) as folder:
        found = query.statistics(folder, progress=progress)
        if plot is not None:
            query.plot_statistics(found, plot, folder.resolve().name)
    data: dict[str, Any] = {name: rows for name, rows in found.parts.items() if name != "lengths"}
    data["agreement"] = found.agreement
    errors = [error for _, error in found.failures]
    data["failures"] = [{"path": str(folder), "error": error.to_dict()} for folder, error in found.failures]
    out.result(data, _text(found) + (f"\n\ndrawn to {plot}" if plot else ""), failed=errors)
    return 1 if found.failures else 0


def _text(found: Statistics) -> str:
    [sessions] = found.parts["sessions"]
    length = f", {duration(sessions['duration_s'])}" if sessions["duration_s"] else ""
    lacking = f"{sessions['without_clock']:,} without a clock, {sessions['not_annotated']:,} not annotated"
    parts = [
        f"{count(sessions['sessions'], 'session')}, {sessions['frames'] or 0:,} frames{length}; {lacking}"
    ]
    for name, title in TITLES.items():
        parts += _table(title, found.parts[name])
    parts += _table("Agreement of annotators, frame by frame", found.agreement)
    parts += [f"{folder}: {error}" for folder, error in found.failures]
    return "\n\n".join(parts)


def _table(title: str, rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    head = [name.replace("_", " ") for name in rows[0]]
    cells = [[_cell(name, value) for name, value in row.items()] for row in rows]
    return [f"{title}\n{columns([head, *cells], indent=2)}"]


def _cell(name: str, value: Any) -> str:
    if name == "type" and not value:
        return "(no type)"
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:g}" if isinstance(value, float) else cell(str(value))
