"""``ecat restore``: a layer as it was."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.edit import author_option, editing, layer_option, path_argument, report
from ecat.cli.output import Output
from ecat.cli.verb import verb


@verb("restore", examples=("ecat restore my_session 12", "ecat restore my_session 0 --layer ann"))
@path_argument
@click.argument(
    "revision", type=click.IntRange(min=0), help="The revision (`ecat log`); 0 is before the first edit."
)
@layer_option
@author_option
def command(out: Output, path: Path, revision: int, layer: str, author: str | None) -> None:
    """Make a layer what it was at a revision.

    That is an edit like any other: nothing in between is lost, and it can be undone.
    """
    with editing(path, layer, author) as editor:
        report(out, layer, editor.restore(revision))
