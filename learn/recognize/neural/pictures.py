"""How a training went, as a picture."""

from __future__ import annotations

from pathlib import Path

from learn.recognize.neural.training import History
from learn.recognize.pictures import picture

_FEW = 30
"""Of so many epochs each is marked: a line of one would not be seen."""


def draw_curves(history: History, dest: Path) -> None:
    """A picture of losses and, if there were sessions for validation, of scores on them, epoch by epoch.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    curves = [("training", "loss", history.losses)]
    if history.scores:
        curves.append(("validation, whole labels", "share of windows right", history.scores))
    with picture(dest, (5 * len(curves), 4), "cannot draw learning curves") as figure:
        from matplotlib.ticker import MaxNLocator

        panels = figure.subplots(1, len(curves), squeeze=False)[0]
        for axes, (title, unit, values) in zip(panels, curves, strict=True):
            axes.plot(range(1, len(values) + 1), values, marker="." if len(values) < _FEW else "")
            axes.set(title=title, xlabel="epoch", ylabel=unit)
            axes.set_xlim(0.5, len(values) + 0.5)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        if history.scores:
            panels[1].set_ylim(0, 1)
            panels[1].axvline(history.best + 1, linestyle=":", color="black", label="what was kept")
            panels[1].legend()
