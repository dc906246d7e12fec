"""Trajectories of the TUM benchmark, read back by NumPy as its users do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ecat.errors import NotFoundError
from ecat.formats.robotics.tum import FORMAT, lines
from ecat.model import Clock, Manifest
from ecat.sample import GroundTruth
from ecat.store import Draft, Session, TableData, create_session
from tests.formats.robotics.scenes import FILLED, HIDDEN, bare, exported, table


def test_every_block_is_where_it_was_whenever_that_is_known(
    filmed: tuple[Session, GroundTruth], out: Path
) -> None:
    session, truth = filmed
    exported(FORMAT, session, out)
    assert sorted(path.name for path in out.iterdir()) == ["Shell.txt", "Stella_Artois.txt"]
    for k, name in enumerate(("Shell", "Stella_Artois")):
        rows = np.loadtxt(out / f"{name}.txt")
        kept = [f for f in range(truth.n_frames) if k or f not in HIDDEN]
        np.testing.assert_array_equal(rows[:, 1:4], truth.position[k, kept])
        np.testing.assert_array_equal(rows[:, 4:], truth.quaternion[k, kept])
        np.testing.assert_allclose(rows[:, 0] * 1e9, truth.t_ns[kept], atol=100)


def test_what_was_filled_in_can_be_left_out(session: Session, tmp_path: Path) -> None:
    told = exported(FORMAT, session, tmp_path / "all")
    fewer = exported(FORMAT, session, tmp_path / "seen", interpolated="false")
    n_all, n_seen = (len(np.loadtxt(tmp_path / name / "Shell.txt")) for name in ("all", "seen"))
    assert n_all - n_seen == len(FILLED)
    assert any("4 interpolated poses cannot be told" in line for line in told)
    assert any("4 interpolated poses were left out" in line for line in fewer)
    assert any(f"{len(HIDDEN)} frames without a known pose" in line for line in told)


def test_wall_times_begin_in_the_year_of_the_recording(session: Session, out: Path) -> None:
    exported(FORMAT, session, out, times="wall")
    first = (out / "Shell.txt").read_text().splitlines()[2].split()[0]
    assert np.datetime64(int(first.replace(".", "")), "ns").astype(str).startswith("2024-03-05T10:00:00")


@given(
    st.lists(st.integers(0, 2**62), min_size=1, max_size=20),
    st.data(),
)
def test_a_line_tells_its_time_and_numbers_exactly(t_ns: list[int], data: st.DataObject) -> None:
    rows = data.draw(arrays(np.float64, (len(t_ns), 7), elements=st.floats(-1e6, 1e6)))
    for t, row, line in zip(t_ns, rows, lines(np.array(t_ns), rows), strict=True):
        when, *numbers = line.split()
        whole, _, part = when.partition(".")
        assert int(whole) * 10**9 + int(part) == t
        assert [float(number) for number in numbers] == row.tolist()


def test_a_moving_camera_has_a_file_of_its_own(tmp_path: Path, out: Path) -> None:
    poses = table(
        "camera_poses",
        t_ns=[0, None, 20, 30],
        frame=[None, 1, 2, 3],
        camera=["color"] * 4,
        x=[0.0, 1.0, None, 3.0],
        **{name: [0.0] * 4 for name in ("y", "z", "qx", "qy", "qz")},
        qw=[1.0] * 4,
    )
    manifest = Manifest(
        name="m", created="2024-01-01T00:00:00", n_frames=4, clock=Clock(rule="uniform", duration_ns=30)
    )
    tables = {"camera_poses": TableData(data=poses)}
    session = create_session(tmp_path / "s", Draft(manifest=manifest, tables=tables))
    told = exported(FORMAT, session, out)
    rows = np.loadtxt(out / "camera_color.txt")
    assert rows[:, 1].tolist() == [0, 1, 3]
    assert np.rint(rows[:, 0] * 1e9).tolist() == [0, 10, 30]
    assert any("1 unknown poses have no line" in line for line in told)


def test_a_session_without_poses_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(NotFoundError) as caught:
        exported(FORMAT, bare(tmp_path / "s"), out)
    assert "ecat process" in caught.value.fix
