"""``ecat export``: a session, project or workspace in a foreign format."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import verb


@verb(
    "export",
    examples=(
        "ecat export my_session poses.parquet --format poses",
        "ecat export my_project out --format ecat-2018",
    ),
)
@click.argument("path", type=click.Path(path_type=Path), help="A session, project or workspace.")
@click.argument("dest", type=click.Path(path_type=Path), help="The file or folder to write.")
@click.option("--format", "format_name", metavar="NAME", required=True, help="The format to write.")
def command(out: Output, path: Path, dest: Path, format_name: str) -> None:
    """Write a session, project or workspace in another format.

    `ecat formats` lists the formats.
    """
    from ecat import formats

    with out.progress() as progress:
        report = formats.export(path, dest, format=format_name, progress=progress)
    lines = [f"exported {count(report.sessions, 'session')} ({report.format}) to {dest}"]
    data = {
        "path": str(report.path),
        "format": report.format,
        "sessions": report.sessions,
        "findings": list(report.findings),
    }
    out.result(data, "\n".join(lines + [f"  {finding}" for finding in report.findings]))
