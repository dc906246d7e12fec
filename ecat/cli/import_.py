"""``ecat import``: a foreign recording becomes a session, project or workspace."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.transfer import keep_apart, tell
from ecat.cli.verb import verb


@verb(
    "import",
    examples=(
        "ecat import recordings/SlideAway/Session1 slide_away_1",
        "ecat import recordings/take_7.mkv my_project/take_7",
        "ecat import annotator_workspace/ workspace --format ecat-2018",
        "ecat import annotations.eaf my_session --layer ann",
    ),
)
@click.argument("source", type=click.Path(path_type=Path), help="What to read: a file or a folder.")
@click.argument(
    "dest", type=click.Path(path_type=Path), help="The folder to make; or a session, with --layer."
)
@click.option("--format", "format_name", metavar="NAME", help="Format of SOURCE; found out if not given.")
@click.option(
    "--layer",
    metavar="NAME",
    help="The layer to make of another program's annotations in a session that is there.",
)
@click.option(
    "--skip-bad-markers", is_flag=True, help="Keep markers that cannot be read, without their values."
)
@click.option("--keep-going", is_flag=True, help="Leave out sessions that cannot be read, and say so.")
def command(
    out: Output,
    source: Path,
    dest: Path,
    format_name: str | None,
    layer: str | None,
    skip_bad_markers: bool,
    keep_going: bool,
) -> None:
    """Turn a foreign recording into a session, project or workspace.

    Nothing is left at DEST unless all of SOURCE could be read.  `ecat formats` lists the formats.  In the folder of a
    project, DEST becomes one of its sessions.  Where DEST is a session, annotations become a new layer of it; a layer
    that is there is never replaced.
    """
    from ecat import formats

    keep_apart(source, dest)
    if layer is not None:
        tell(out, "imported", formats.import_layer(source, dest, layer=layer, format=format_name))
        return
    _refuse_session(source, dest)
    _refuse_project(source, dest)
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


def _refuse_session(source: Path, dest: Path) -> None:
    """Say how annotations are added to a session that is there."""
    from ecat.errors import ExistsError
    from ecat.store.manifest import SESSION_FILE

    if (dest / SESSION_FILE).is_file():
        raise ExistsError(
            f"cannot import {source}",
            where=f"{dest}: a session, not the folder of one to be",
            consequence="it was left as it is",
            fix=f"{shell('ecat', 'import', str(source), str(dest))} --layer NAME makes annotations a layer of it",
        )


def _refuse_project(source: Path, dest: Path) -> None:
    """Say at once how a recording is added to a project that is there, before an hour of it is read."""
    from ecat.errors import ExistsError
    from ecat.store.manifest import PROJECT_FILE

    if (dest / PROJECT_FILE).is_file():
        inside = shell("ecat", "import", str(source), str(dest / (source.resolve().stem or "my_session")))
        raise ExistsError(
            f"cannot import {source}",
            where=f"{dest}: a project, not the folder of a session to be",
            consequence="it was left as it is",
            fix=inside,
        )
