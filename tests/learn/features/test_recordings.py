"""What features are made of is read from any session: with and without skeleton, poses, markers in space."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import InputError, UsageError
from ecat.geometry.transforms import Rigid
from ecat.process import process_session
from ecat.store import Session, TableData, open_session
from learn.features.points import JOINTS, KINECT_FROM_CAMERA
from learn.features.recordings import (
    Recording,
    _times,  # pyright: ignore[reportPrivateUsage]
    read_export,
    read_session,
)
from learn.features.windows import fit_table
from tests.learn.features import sessions
from tests.learn.features.sessions import SHELL, STELLA
from tests.learn.recognize import made


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return sessions.make(tmp_path_factory.mktemp("s") / "slide", sessions.draft())


@pytest.fixture(scope="module")
def recording(session: Session) -> Recording:
    return read_session(session)


def test_a_processed_session_has_everything(session: Session, recording: Recording) -> None:
    n = session.manifest.n_frames
    assert recording.points.shape == (n, 21, 3)
    assert recording.objects == (SHELL, STELLA)
    assert recording.rig == "o1"
    assert recording.findings == ()
    assert recording.tracks is not None
    assert recording.tracks.shape == (2, n, 3)
    assert np.isfinite(recording.tracks).all()
    assert (recording.tracks[..., 2] >= 0).all()
    assert (recording.tracks[..., 2] < np.pi / 2).all()
    assert recording.t_s is not None
    assert np.median(np.diff(recording.t_s)) == pytest.approx(1 / 30, rel=0.02)


def test_movements_are_those_of_the_stage_that_finds_relations(recording: Recording, tmp_path: Path) -> None:
    assert recording.moves is None
    session = sessions.make(tmp_path / "s", sessions.draft(), process=False)
    process_session(session.path)
    found = read_session(open_session(session.path))
    assert found.moves
    slide = next(event for event in session.layer("main").events if event.type == "slide_next").segments[0]
    assert any(slide.start_frame <= start < end <= slide.end_frame for start, end in found.moves)


def test_joints_are_those_of_the_session_in_the_kinects_axes(session: Session, recording: Recording) -> None:
    rows = session.table("joints").to_arrow().to_pylist()
    hands = [row for row in rows if row["joint"] == "HandLeft" and row["x"] is not None]
    assert len(hands) > 100
    for row in hands[::20]:
        found = recording.points[row["frame"], JOINTS.index("HandLeft")]
        assert found == pytest.approx(np.array([-row["x"], -row["y"], row["z"]]))


def test_the_mover_travels_as_far_as_its_marker(recording: Recording) -> None:
    assert recording.tracks is not None
    track = recording.tracks[1]
    corners = np.median(recording.points[:, 17:21], axis=1)
    known = np.isfinite(corners[:, 0])
    first, last = np.flatnonzero(known)[[0, -1]]
    by_marker = np.linalg.norm(corners[last] - corners[first])
    by_pose = np.linalg.norm(track[last, :2] - track[first, :2])
    assert by_pose > 0.1
    assert by_marker == pytest.approx(by_pose, abs=0.1)  # another face of the box may be seen


def test_markers_follow_from_poses_where_none_were_measured_in_space(
    session: Session, recording: Recording, tmp_path: Path
) -> None:
    poses, plane = (TableOf(session, name) for name in ("poses", "table_plane"))
    bare = sessions.without(sessions.draft(), "markers_3d")
    bare = replace(bare, tables={**bare.tables, "poses": poses.data, "table_plane": plane.data})
    found = read_session(sessions.make(tmp_path / "s", bare, process=False))
    assert sessions.known(found.points[:, 13:]) >= 0.8
    for box in (slice(13, 17), slice(17, 21)):
        off = np.linalg.norm(
            np.median(found.points[:, box], axis=1) - np.median(recording.points[:, box], axis=1), axis=1
        )
        assert np.nanmedian(off) < 0.03 or np.nanmin(off) < 0.02
    rays = found.points[:, 13:, :2] / found.points[:, 13:, 2:]
    for box in (rays[:, :4], rays[:, 4:]):
        one = box[np.isfinite(box).all(axis=(1, 2))]
        across, along = one[:, 2] - one[:, 0], one[:, 3] - one[:, 1]
        # clockwise in the Kinect's image, from the leftmost, as measured ones
        assert (across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0] < 0).all()
        assert (one[..., 0].argmin(axis=1) == 0).all()


def test_of_several_markers_the_one_is_taken_of_which_most_is_known_then_the_largest(tmp_path: Path) -> None:
    def marker(side: float, *, hidden: bool = False) -> dict[str, float | None]:
        corners = zip((0, 0, side, side), (0, side, side, 0), strict=True)
        found: dict[str, float | None] = {}
        for k, (x, y) in enumerate(corners):
            found |= {f"x{k}": None if hidden and k == 2 else x, f"y{k}": y, f"z{k}": 1.0}
        return found

    def three(table: pa.Table) -> pa.Table:
        row = table.slice(0, 1).to_pylist()[0]
        sides = [marker(0.2, hidden=True), marker(0.05), marker(0.1)]
        rows = [row | {"object_id": SHELL, "frame": 0, "order": k} | one for k, one in enumerate(sides)]
        rows += [row | {"object_id": STELLA, "frame": 0, "order": 0} | marker(0.2, hidden=True)]
        return pa.Table.from_pylist(rows, schema=table.schema)

    found = read_session(sessions.make(tmp_path / "s", sessions.draft(markers_3d=three), process=False))
    largest = np.array([[0, 0, 1], [0, 0.1, 1], [0.1, 0.1, 1], [0.1, 0, 1]]) * KINECT_FROM_CAMERA
    assert found.points[0, 13:17] == pytest.approx(largest)
    assert np.isnan(found.points[0, 17:21]).any(axis=1).tolist() == [False, False, True, False]
    assert np.isnan(found.points[1:, 13:]).all()


FPS_15 = np.arange(sessions.draft().manifest.n_frames or 0, dtype=np.int64) * 66_666_667
"""Nanoseconds of the frames of a session."""


def with_times(folder: Path, t_ns: np.ndarray[tuple[int, ...], np.dtype[np.int64]], *lost: int) -> Recording:
    """Of a session whose images were recorded at these times; of some it is not known."""
    return read_session(
        sessions.make(folder, sessions.with_times(sessions.draft(), t_ns, lost), process=False)
    )


@pytest.mark.parametrize(
    "lost", [(50,), (0, 1, 2), (178, 179), tuple(range(1, 180, 2)), tuple(range(2, 180))]
)
def test_frames_without_a_time_take_it_from_the_others_and_that_is_told(
    lost: tuple[int, ...], tmp_path: Path
) -> None:
    found = with_times(tmp_path / "s", FPS_15, *lost)
    assert found.t_s == pytest.approx(FPS_15 / 1e9)
    assert any(f"{len(lost)} of {len(FPS_15)} frames have no time" in said for said in found.findings)


@pytest.mark.parametrize(("place", "t_ns"), [(60, int(FPS_15[10])), (179, 0), (0, 10**17)])
def test_a_time_out_of_order_is_none(place: int, t_ns: int, tmp_path: Path) -> None:
    wrong = FPS_15.copy()
    wrong[place] = t_ns
    found = with_times(tmp_path / "s", wrong)
    assert found.t_s == pytest.approx(FPS_15 / 1e9)
    assert any("1 of 180 frames have no time, or one out of order" in said for said in found.findings)


@pytest.mark.parametrize(
    ("t_ns", "lost"),
    [(FPS_15[::-1], ()), (0 * FPS_15, ()), (FPS_15 % FPS_15[90], ()), (FPS_15, tuple(range(1, 180)))],
    ids=["descending", "all the same", "begins anew", "one"],
)
def test_a_clock_that_is_mostly_out_of_order_is_not_used_and_that_is_told(
    t_ns: np.ndarray[tuple[int, ...], np.dtype[np.int64]], lost: tuple[int, ...], tmp_path: Path
) -> None:
    found = with_times(tmp_path / "s", t_ns, *lost)
    assert found.t_s is None
    assert any("its clock is not used" in said for said in found.findings)


@given(st.lists(st.integers(0, 30), max_size=40), st.lists(st.booleans(), min_size=40, max_size=40))
def test_times_ascend_whatever_they_were(times: list[int], known: list[bool]) -> None:
    t_s = np.where(known[: len(times)], np.array(times, np.float64), np.nan)
    found, told = _times(t_s)
    assert found is None or len(told) == (not np.array_equal(found, t_s))
    if found is not None:
        assert found.shape == t_s.shape
        assert (np.diff(found) > 0).all()
        assert 2 * np.count_nonzero(found == t_s) > np.count_nonzero(np.isfinite(t_s)) - 1


@pytest.mark.parametrize("table", ["joints", "markers_3d", "poses"])
def test_what_is_said_to_be_farther_away_than_anything_is_not_known(
    table: str, session: Session, recording: Recording, tmp_path: Path
) -> None:
    data = session.table(table).to_arrow()
    wrong = np.arange(data.num_rows) % 3 == 0
    for name in data.column_names:
        if name[0] == "x":
            place, kind = data.column_names.index(name), data.schema.field(name).type
            values = np.where(wrong, 1e30, data[name].to_numpy())
            data = data.set_column(place, data.schema.field(name), pa.array(values, kind, from_pandas=True))
    copy = Path(shutil.copytree(session.path, tmp_path / "s"))
    with open_session(copy).write() as commit:
        commit.put_table(table, TableData(data=data))
    found = read_session(open_session(copy))
    assert not (np.abs(found.points) > 1e6).any()
    assert found.tracks is not None
    assert recording.tracks is not None
    assert found.tracks == pytest.approx(recording.tracks, abs=0.05)
    if table != "poses":
        assert sessions.known(found.points) < sessions.known(recording.points)


def test_boxes_whose_poses_are_not_known_are_where_their_markers_are(
    session: Session, recording: Recording, tmp_path: Path
) -> None:
    poses = session.table("poses").to_arrow()
    for name in ("qx", "qy", "qz", "qw"):  # turned in no way
        place, field = poses.column_names.index(name), poses.schema.field(name)
        poses = poses.set_column(place, field, pa.array(np.zeros(poses.num_rows), field.type))
    copy = Path(shutil.copytree(session.path, tmp_path / "s"))
    with open_session(copy).write() as commit:
        commit.put_table("poses", TableData(data=poses))
    found = read_session(open_session(copy))
    assert found.tracks is None
    assert found.objects == recording.objects
    assert np.array_equal(found.points, recording.points, equal_nan=True)


def test_points_of_an_export_that_are_farther_away_than_anything_are_not_known(tmp_path: Path) -> None:
    points = made.scene(1)
    points[7, 3] = 1e30
    (found,) = read_export(made.write(tmp_path / "x.txt", made.session("one", points, [])))
    assert np.isnan(found.points[7, 3]).all()
    assert sessions.known(found.points) == pytest.approx(1 - 1 / (21 * len(points)))


def test_a_session_without_skeleton_says_so(tmp_path: Path) -> None:
    found = read_session(
        sessions.make(tmp_path / "s", sessions.without(sessions.draft(), "joints"), process=False)
    )
    assert not found.has_joints
    assert any("no joints" in said for said in found.findings)
    assert any("no poses" in said for said in found.findings)
    assert sessions.known(found.points[:, 13:]) > 0.4


def test_joints_that_are_missing_are_named_and_others_stand_in(tmp_path: Path) -> None:
    draft = sessions.draft(joints=lambda t: sessions.lost("HandTipLeft")(sessions.lost("ElbowRight")(t)))
    found = read_session(sessions.make(tmp_path / "s", draft, process=False))
    assert any("stand in for HandTipLeft" in said for said in found.findings)
    assert any("missing: ElbowRight" in said for said in found.findings)
    left, hand = JOINTS.index("HandTipLeft"), JOINTS.index("HandLeft")
    assert found.points[:, left] == pytest.approx(found.points[:, hand], nan_ok=True)
    assert np.isnan(found.points[:, JOINTS.index("ElbowRight")]).all()


def test_one_box_is_refused_by_name(tmp_path: Path) -> None:
    one = sessions.make(tmp_path / "s", sessions.draft(markers_3d=sessions.only(SHELL)), process=False)
    with pytest.raises(InputError) as error:
        read_session(one)
    assert "o2 (Shell)" in error.value.where
    assert error.value.fix


def test_of_three_boxes_two_are_chosen_and_the_choice_is_told(tmp_path: Path) -> None:
    three = sessions.make(tmp_path / "s", sessions.with_a_third(sessions.draft()), process=False)
    found = read_session(three)
    assert found.objects == (SHELL, STELLA)
    assert any("o9 (Corona)" in said and "--objects" in said for said in found.findings)
    assert read_session(three, ("Corona", "o3")).objects == ("o9", STELLA)
    for wrong in (("Corona", "Pilsner"), ("o9", "o9"), ("o9",)):
        with pytest.raises(UsageError, match="features"):
            read_session(three, wrong)


def test_gaps_are_filled_only_if_asked_and_only_where_something_is_known(recording: Recording) -> None:
    holes = recording.points.copy()
    holes[20:30, 3] = np.nan
    holes[:, 5] = np.nan
    found = replace(recording, points=holes).filled()
    assert np.isfinite(found.points[20:30, 3]).all()
    assert np.isnan(found.points[:, 5]).all()
    assert np.isnan(holes[20:30, 3]).all()


def test_leveling_turns_about_the_line_of_sight_and_finds_the_markers_plane() -> None:
    points = made.scene(1)
    truth = fit_table(points)
    roll = 0.2
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    tilt = np.arctan(made.SLOPE)
    normal = turn @ np.array([0, np.cos(tilt), -np.sin(tilt)]) * KINECT_FROM_CAMERA
    across = np.cross(normal, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    rotation = np.stack([np.cross(across, normal), -across, normal], axis=1)
    plane = Rigid(rotation, turn @ np.array([0, made.HEIGHT, 0]) * KINECT_FROM_CAMERA)
    seen = Recording("s", points @ turn.T, None, None, ("a", "b"), planes=((0, plane),))
    ((start, found, table),) = seen.leveled()
    assert start == 0
    assert table is not None
    assert (table.slope, table.height) == pytest.approx((truth.slope, truth.height), abs=1e-6)
    assert found == pytest.approx(points)


def test_a_camera_that_was_moved_parts_the_recording(recording: Recording) -> None:
    ((_, plane),) = recording.planes
    parts = replace(recording, planes=((0, plane), (50, plane))).leveled()
    assert [(start, len(points)) for start, points, _ in parts] == [(0, 50), (50, len(recording.points) - 50)]


def test_exports_are_read_with_or_without_labels(tmp_path: Path) -> None:
    path = made.write(tmp_path / "pushto.txt", made.session("one", made.scene(1), []))
    (found,) = read_export(path)
    assert found.name == "pushto/one"
    assert found.points == pytest.approx(made.scene(1), abs=1e-4)
    assert found.tracks is None


class TableOf:
    """A table of a session, to be put into another."""

    def __init__(self, session: Session, name: str) -> None:
        from ecat.store import TableData

        self.data = TableData(data=session.table(name).to_arrow())
