"""Curves of quality and speed."""

from __future__ import annotations

import numpy as np
from rerun.chunk import Chunk

from ecat.view.plots import quality, speed, speeds
from tests.view.chunks import at, paths, scene, table


def curves(*, step_ns: int | None) -> list[Chunk]:
    """A box that moves 1 mm per frame and is not seen at frame 3."""
    rows = table(
        "poses",
        frame=[0, 1, 2, 3, 4],
        object_id=["o1"] * 5,
        x=[0.0, 0.001, 0.002, None, 0.004],
        y=[0.0] * 3 + [None, 0.0],
        z=[0.0] * 3 + [None, 0.0],
        residual_px=[0.5, 0.6, 0.7, None, 0.9],
        sigma_m=[0.001, 0.002, None, None, None],
        n_faces=[1, 2, 3, None, 1],
    )
    shown = scene(5, step_ns=step_ns)
    return [*quality(rows, shown), *speeds(rows, shown)]


def test_speed_is_in_metres_per_second() -> None:
    shown = at(curves(step_ns=10_000_000), "/quality/speed_m_per_s/Shell", "scalars")
    assert list(shown) == [1, 2, 3, 4]
    assert np.allclose(shown[1], [0.1])
    assert shown[2] == []
    assert np.allclose(shown[3], [0.1])


def test_without_a_clock_there_is_no_speed() -> None:
    assert not any("speed" in path for path in paths(curves(step_ns=None)))


def test_a_frame_without_a_value_leaves_a_gap() -> None:
    shown = at(curves(step_ns=None), "/quality/residual_px/Shell", "scalars")
    assert shown == {0: [0.5], 1: [0.6], 2: [0.7], 3: [], 4: [0.9]}


def test_sigma_is_in_millimetres() -> None:
    assert at(curves(step_ns=None), "/quality/sigma_mm/Shell", "scalars") == {0: [1.0], 1: [2.0], 2: []}


def test_a_curve_without_a_value_is_not_sent() -> None:
    assert list(quality(table("poses", frame=[0], object_id=["o1"]), scene())) == []


def test_speed_at_the_ends_is_unknown() -> None:
    assert np.isnan(speed(np.zeros((2, 3)), np.arange(2.0))).all()
