"""``ecat redo``: make an edit again that was taken back."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.edit import author_option, back_and_forth, layer_option, path_argument
from ecat.cli.output import Output
from ecat.cli.verb import verb


@verb("redo", examples=("ecat redo my_session", "ecat redo my_session --layer ann --steps 3"))
@path_argument
@layer_option
@author_option
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="How many edits; fewer if there are no more.",
)
def command(out: Output, path: Path, layer: str, author: str | None, steps: int) -> None:
    """Make the edit again that you took back last, or several."""
    back_and_forth(out, path, layer, author, steps=steps, redo=True)
