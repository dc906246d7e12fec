"""Pictures of how a recogniser does, by Matplotlib, which is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ecat.errors import MissingExtraError
from ecat.store import staged_file
from learn.recognize.kept import HEADS


@contextmanager
def picture(dest: Path, size: tuple[float, float], what: str) -> Generator[Any]:
    """An empty figure of ``size`` (inches), which is written to ``dest`` as PNG when the block has drawn it.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed; ``what`` cannot be done then.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError(
            what, where="Matplotlib is not installed", fix="pip install 'ecat[plots]'"
        ) from None
    figure = Figure(figsize=size, layout="constrained")
    yield figure
    with staged_file(dest, replaces=HEADS[".png"]) as staging:
        figure.savefig(staging, format="png", dpi=110)
