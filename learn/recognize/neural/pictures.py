"""How a training went, as a picture."""

from __future__ import annotations

from pathlib import Path

from ecat.errors import MissingExtraError
from ecat.store import staged_file
from learn.recognize.neural.training import History


def draw_curves(history: History, dest: Path) -> None:
    """A picture of losses, and of scores on sessions for validation if there were any, epoch by epoch.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError(
            "cannot draw learning curves",
            where="Matplotlib is not installed",
            fix="pip install 'ecat[plots]'",
        ) from None
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(range(1, len(history.losses) + 1), history.losses)
    left.set(title="loss of training", xlabel="epoch")
    right.plot(range(1, len(history.scores) + 1), history.scores)
    right.set(title="whole labels right, of validation", xlabel="epoch", ylim=(0, 1))
    if history.scores:
        right.axvline(history.best + 1, linestyle=":", color="black")
    else:
        right.text(0.5, 0.5, "no sessions for validation", ha="center", transform=right.transAxes)
    with staged_file(dest, replaces=b"\x89PNG") as staging:
        figure.savefig(staging, format="png", dpi=110)
