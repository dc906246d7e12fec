"""``ecat export``: a session, project or workspace in a foreign format."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.transfer import keep_apart, named_values, tell
from ecat.cli.verb import verb


@verb(
    "export",
    examples=(
        "ecat export my_session poses.parquet --format poses",
        "ecat export my_project out --format ecat-2018",
        "ecat export my_project dataset --format lerobot --option fps=15",
    ),
)
@click.argument("path", type=click.Path(path_type=Path), help="A session, project or workspace.")
@click.argument("dest", type=click.Path(path_type=Path), help="The file or folder to write.")
@click.option("--format", "format_name", metavar="NAME", required=True, help="The format to write.")
@click.option(
    "--option",
    "-o",
    "options",
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the format; may be repeated.",
)
def command(out: Output, path: Path, dest: Path, format_name: str, options: tuple[str, ...]) -> int:
    """Write a session, project or workspace in another format.

    `ecat formats` lists the formats, `ecat formats NAME` explains one and its options.  Sessions that cannot be written
    are named at the end, and the others are written all the same; the exit code is then 1.
    """
    from ecat import formats

    keep_apart(path, dest)
    with out.progress() as progress:
        report = formats.export(
            path, dest, format=format_name, options=named_values(options), progress=progress
        )
    tell(out, "exported", report)
    return 1 if report.failures else 0
