"""Learning curves are a picture with a panel for what there is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from learn.recognize.neural.pictures import draw_curves
from learn.recognize.neural.training import History


def test_losses_and_scores_of_validation_are_two_panels(tmp_path: Path, drawn: list[Any]) -> None:
    draw_curves(History([3.0, 2.0], [0.1, 0.2], 1), tmp_path / "curves.png")
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    left, right = drawn[0].axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("loss", "share of windows right")
    assert right.lines[1].get_xdata()[0] == 2


@pytest.mark.parametrize("n", [1, 2, 4, 150])
def test_without_validation_there_is_one_panel_and_epochs_are_whole(
    n: int, tmp_path: Path, drawn: list[Any]
) -> None:
    draw_curves(History([1.0] * n), tmp_path / "curves.png")
    (axes,) = drawn[0].axes
    low, high = axes.get_xlim()
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert ticks
    assert all(tick == round(tick) and 0 <= tick <= n for tick in ticks)
    assert axes.get_ylabel() == "loss"
    assert len(axes.lines[0].get_xdata()) == n
