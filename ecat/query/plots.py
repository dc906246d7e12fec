"""The statistics of a project as a page of plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ecat.errors import MissingExtraError, UsageError
from ecat.model.annotation import MACHINE
from ecat.query.statistics import Rows, Statistics
from ecat.store import staged_file

SUFFIXES = (".png", ".svg", ".pdf")
_MOST = 30
"""Bars in one plot; what is rarer is left to the table."""
_INCHES_A_BAR = 0.28
_WIDEST = 40
"""Characters of a label."""
_COLORS = {"observed": "#3b6fb6", "interpolated": "#9dc0e6", "not_known": "#d9d9d9"}


def plot_statistics(statistics: Statistics, dest: Path, title: str) -> None:
    """Draw how many events of which type, how long they are, and where the boxes are known.

    Raises
    ------
    UsageError : a name that says no kind of picture.
    MissingExtraError : Matplotlib is not installed.
    ExistsError : ``dest`` is taken.
    """
    if dest.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"cannot draw {dest.name}",
            where=f"expected a name that ends in {', '.join(SUFFIXES)}",
            fix=f"--plot {dest.stem or 'statistics'}.png",
        )
    plots = [
        plot
        for plot in (
            _Counts(_by_type(_of_people(statistics.parts["events"]))),
            _Lengths(_lengths(_of_people(statistics.parts["lengths"]))),
            _Places(statistics.parts["places"][:_MOST]),
        )
        if plot.bars
    ]
    figure = _figure(plots, title)
    with staged_file(dest, replaces=_head(dest)) as staging:
        figure.savefig(staging, format=dest.suffix[1:].lower(), dpi=150)


def _head(dest: Path) -> bytes:
    return {".png": b"\x89PNG", ".pdf": b"%PDF"}.get(dest.suffix.lower(), b"<?xml")


def _figure(plots: list[Any], title: str) -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError(
            "cannot draw the statistics",
            where="Matplotlib is not installed",
            fix="pip install 'ecat[plots]', or leave out --plot",
        ) from None
    heights = [1.1 + _INCHES_A_BAR * plot.bars for plot in plots] or [1.0]
    figure = Figure(figsize=(8, sum(heights) + 0.6), layout="constrained")
    figure.suptitle(_plain(title))
    if plots:
        grid = figure.subplots(len(plots), 1, squeeze=False, height_ratios=heights)
        for plot, axes in zip(plots, grid[:, 0], strict=True):
            plot.draw(axes)
            axes.spines[["top", "right"]].set_visible(False)
    return figure


def _plain(name: str) -> str:
    """A name as a label: on one line, not longer than there is room, and never a formula."""
    line = " ".join(name.split())
    return (line if len(line) <= _WIDEST else f"{line[: _WIDEST - 1]}…").replace("$", r"\$")


def _of_people(rows: Rows) -> Rows:
    """What people said; where nobody said anything, what was proposed."""
    return [row for row in rows if row["layer"] != MACHINE] or rows


def _by_type(events: Rows) -> dict[str, int]:
    counts: dict[str, int] = {}
    for row in events:
        counts[row["type"] or "(no type)"] = counts.get(row["type"] or "(no type)", 0) + row["events"]
    most = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return dict(most[:_MOST])


def _lengths(rows: Rows) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for row in rows:
        found.setdefault(row["type"] or "(no type)", []).append(row["seconds"])
    most = sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))
    return dict(most[:_MOST])


class _Counts:
    """Bars: events by type."""

    def __init__(self, counts: dict[str, int]) -> None:
        self._counts = counts
        self.bars = len(counts)

    def draw(self, axes: Any) -> None:
        bars = axes.barh(range(self.bars), list(self._counts.values()), color=_COLORS["observed"])
        axes.set_yticks(range(self.bars), map(_plain, self._counts))
        axes.bar_label(bars, padding=3, fmt="{:,.0f}")
        axes.invert_yaxis()
        axes.margins(x=0.1)
        axes.set_title("Events by type, parts included", loc="left")


class _Lengths:
    """A dot for each event, and a line at the median, by type."""

    def __init__(self, lengths: dict[str, list[float]]) -> None:
        self._lengths = lengths
        self.bars = len(lengths)

    def draw(self, axes: Any) -> None:
        spread = np.random.default_rng(0)
        for row, seconds in enumerate(self._lengths.values()):
            height = row + spread.uniform(-0.25, 0.25, len(seconds))
            axes.plot(seconds, height, ".", color=_COLORS["observed"], alpha=0.5, markeredgewidth=0)
            axes.plot([np.median(seconds)] * 2, [row - 0.35, row + 0.35], color="black", linewidth=1.5)
        axes.set_yticks(range(self.bars), map(_plain, self._lengths))
        axes.invert_yaxis()
        axes.set_xlim(left=0)
        axes.set_xlabel("seconds (line: median)")
        axes.set_title("How long actions are", loc="left")


class _Places:
    """Bars of three colours: in what share of the frames it is known where each object is."""

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        self.bars = len(rows)

    def draw(self, axes: Any) -> None:
        left = np.zeros(self.bars)
        for part, color in _COLORS.items():
            share = np.array([row[part] for row in self._rows], float) * 100
            axes.barh(range(self.bars), share, left=left, color=color, label=part.replace("_", " "))
            left += share
        axes.set_yticks(range(self.bars), [_plain(row["object"]) for row in self._rows])
        axes.invert_yaxis()
        axes.set_xlabel("% of frames")
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
        axes.set_title("Where objects are known to be", loc="left")
