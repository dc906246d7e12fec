"""``ecat export``: a session, project or workspace in a foreign format."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.transfer import keep_apart, tell
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

    keep_apart(path, dest)
    with out.progress() as progress:
        report = formats.export(path, dest, format=format_name, progress=progress)
    tell(out, "exported", report)
