"""``ecat redo``: make an edit again that was taken back."""

from __future__ import annotations

from pathlib import Path

from ecat.cli.edit import author_option, back_and_forth, layer_option, path_argument, steps_option
from ecat.cli.output import Output
from ecat.cli.verb import verb


@verb("redo", examples=("ecat redo my_session", "ecat redo my_session --layer ann --steps 3"))
@path_argument
@layer_option
@author_option
@steps_option
def command(out: Output, path: Path, layer: str, author: str | None, steps: int) -> None:
    """Make the edit again that you took back last, or several."""
    back_and_forth(out, path, layer, author, steps=steps, redo=True)
