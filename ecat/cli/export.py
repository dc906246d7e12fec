"""``ecat export``: a session, project or workspace in a foreign format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.spread import spread_options
from ecat.cli.transfer import Place, keep_apart, named_values, tell
from ecat.cli.verb import verb
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.batch import Engine


@verb(
    "export",
    examples=(
        "ecat export my_session poses.parquet --format poses",
        "ecat export my_project out --format ecat-2018",
        "ecat export my_project dataset --format lerobot --option fps=15 --jobs 8",
        "ecat export my_project dataset --format lerobot --shard 3/20",
        "ecat export s3://lab/my_project s3://lab/dataset --format lerobot",
    ),
)
@click.argument("path", type=Place(), help="A session, project or workspace; also a URL (s3://...).")
@click.argument("dest", type=Place(), help="The file or folder to write; also a URL.")
@click.option("--format", "format_name", metavar="NAME", required=True, help="The format to write.")
@click.option(
    "--option",
    "-o",
    "options",
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the format; may be repeated.",
)
@spread_options("Write")
def command(
    out: Output,
    path: Path | str,
    dest: Path | str,
    format_name: str,
    options: tuple[str, ...],
    jobs: int | None,
    shard: str | None,
    engine: Engine,
) -> int:
    """Write a session, project or workspace in another format.

    `ecat formats` lists the formats, `ecat formats NAME` explains one and its options.  Sessions that cannot be written
    are named at the end, and the others are written all the same; the exit code is then 1.  After an interruption the
    same command goes on where it was.

    With `--shard` only a share is made, and put by beside the destination.  When all shares are done, the same command
    without `--shard` joins them.
    """
    from ecat import batch
    from ecat.store import remote

    keep_apart(path, dest)
    if remote.is_own_memory(dest):
        raise UsageError(
            f"cannot write {dest}",
            where="what is at memory:// is gone when the command ends",
            fix="s3://bucket/folder, or a folder here",
        )
    share = None if shard is None else batch.parse_shard(shard)
    with out.progress() as progress:
        report = batch.export_sessions(
            path,
            dest,
            format=format_name,
            options=named_values(options),
            jobs=jobs,
            engine=engine,
            shard=share,
            progress=progress,
        )
    tell(out, "exported" if share is None else f"exported share {share}:", report)
    return 1 if report.failures else 0
