"""Curves of quality and speed."""

from __future__ import annotations

import numpy as np
from rerun.chunk import Chunk

from ecat.view.plots import inertial, quality, speed, speeds
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


def test_a_pose_after_the_end_of_the_recording_has_no_speed() -> None:
    rows = table("poses", frame=[0, 1, 2, 99], object_id=["o1"] * 4, x=[0, 1, 2, 3], y=[0] * 4, z=[0] * 4)
    shown = at(list(speeds(rows, scene(3, step_ns=10**9))), "/quality/speed_m_per_s/Shell", "scalars")
    assert shown[1] == [1.0]
    assert 99 not in shown


def readings(n: int, *, step_ns: int | None = 10) -> list[Chunk]:
    rows = table("imu", t_ns=range(3, 3 + n), sensor=["gyroscope"] * n, x=range(n), y=[None] * n, z=[0.5] * n)
    return list(inertial(rows, scene(5, step_ns=step_ns)))


def test_an_inertial_sensor_has_a_curve_for_each_axis_at_its_own_times() -> None:
    chunks = readings(2)
    assert paths(chunks) == {"/imu/gyroscope/x", "/imu/gyroscope/z"}
    (batch,) = [c.to_record_batch() for c in chunks if c.entity_path.endswith("x") and not c.is_static]
    assert np.asarray(batch.column("session_time")).astype(np.int64).tolist() == [3, 4]
    assert readings(2, step_ns=None) == []


def test_a_single_reading_is_a_point() -> None:
    assert at(readings(1), "/imu/gyroscope/x", "marker_sizes")[None] == [4]
