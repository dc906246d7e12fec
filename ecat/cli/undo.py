"""``ecat undo``: take an edit back."""

from __future__ import annotations

from pathlib import Path

from ecat.cli.edit import author_option, back_and_forth, layer_option, path_argument, steps_option
from ecat.cli.output import Output
from ecat.cli.verb import verb


@verb("undo", examples=("ecat undo my_session", "ecat undo my_session --layer ann --steps 3"))
@path_argument
@layer_option
@author_option
@steps_option
def command(out: Output, path: Path, layer: str, author: str | None, steps: int) -> None:
    """Take back your last edit of a layer, or several.

    There is no limit, and it does not matter when the edit was made, or with what.  What somebody else has changed
    since is not undone.
    """
    back_and_forth(out, path, layer, author, steps=steps, redo=False)
