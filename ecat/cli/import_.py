"""``ecat import``: a foreign recording becomes a session, project or workspace."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.transfer import keep_apart, tell
from ecat.cli.verb import verb


@verb(
    "import",
    examples=(
        "ecat import recordings/SlideAway/Session1 slide_away_1",
        "ecat import annotator_workspace/ workspace --format ecat-2018",
    ),
)
@click.argument("source", type=click.Path(path_type=Path), help="What to read: a file or a folder.")
@click.argument("dest", type=click.Path(path_type=Path), help="The folder to make.")
@click.option("--format", "format_name", metavar="NAME", help="Format of SOURCE; found out if not given.")
@click.option(
    "--skip-bad-markers", is_flag=True, help="Keep markers that cannot be read, without their values."
)
@click.option("--keep-going", is_flag=True, help="Leave out sessions that cannot be read, and say so.")
def command(
    out: Output,
    source: Path,
    dest: Path,
    format_name: str | None,
    skip_bad_markers: bool,
    keep_going: bool,
) -> None:
    """Turn a foreign recording into a session, project or workspace.

    Nothing is left at DEST unless all of SOURCE could be read.  `ecat formats` lists the formats.
    """
    from ecat import formats

    keep_apart(source, dest)
    with out.progress() as progress:
        report = formats.import_source(
            source,
            dest,
            format=format_name,
            skip_bad_markers=skip_bad_markers,
            keep_going=keep_going,
            progress=progress,
        )
    tell(out, "imported", report)
