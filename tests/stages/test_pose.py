"""From marker tables to pose tables, on sessions whose truth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from ecat.errors import InputError
from ecat.geometry.transforms import Floats, Rigid, quaternion_angle, quaternion_from_matrix
from ecat.stages.plane import PlaneParameters, fit_table
from ecat.stages.pose import POSE, PoseParameters, estimate_poses, table_frame
from ecat.stages.sightings import PIXELS
from ecat.tables import POSES, TABLE_PLANE
from tests.stages.recorded import Recorded

Generated = Callable[..., Recorded]


def columns(table: pa.Table, names: str) -> Floats:
    return np.stack(
        [np.asarray(table[name].to_numpy(zero_copy_only=False), float) for name in names.split()], -1
    )


def solve(
    session: Recorded, markers_2d: pa.Table | None = None, markers_3d: pa.Table | None = None
) -> pa.Table:
    assert session.prototype is not None
    plane = fit_table(session.polygon)
    given = session.markers_2d if markers_2d is None and markers_3d is None else markers_2d
    return estimate_poses(
        session.clock, given, markers_3d, plane, PoseParameters(prototypes=(session.prototype,))
    )


def off_mm(session: Recorded, poses: pa.Table) -> Floats:
    """Distance in the camera's frame: fitted and true table frames may differ within the plane."""
    assert session.pose is not None
    assert session.table is not None
    frame = table_frame(fit_table(session.polygon))
    found = frame.apply(columns(poses, "x y z"))
    return 1000 * np.linalg.norm(found - session.table.apply(session.pose.translation), axis=1)


def test_the_table_has_the_declared_columns_and_a_row_per_frame_and_box(generated: Generated) -> None:
    session = generated(40)
    poses = solve(session)
    assert poses.schema.equals(POSES.arrow)
    assert poses["frame"].to_pylist() == list(range(40))
    assert set(poses["source"].to_pylist()) == {"observed"}
    assert set(poses["support"].to_pylist()) == {"table"}


def test_position_and_orientation_are_right(generated: Generated) -> None:
    session = generated(300)
    poses = solve(session)
    assert np.median(off_mm(session, poses)) < 0.6
    assert session.pose is not None
    assert session.table is not None
    frame = table_frame(fit_table(session.polygon))
    found = frame @ Rigid.from_quaternion(columns(poses, "qx qy qz qw"), columns(poses, "x y z"))
    angle = quaternion_angle(
        found.quaternion, quaternion_from_matrix((session.table @ session.pose).rotation)
    )
    assert np.degrees(np.median(angle)) < 0.5
    assert pc.max(poses["residual_px"]).as_py() < 1.5


def test_frames_without_a_face_have_no_pose(generated: Generated) -> None:
    session = generated(60)
    hidden = session.markers_2d.filter((pc.field("frame") < 20) | (pc.field("frame") >= 35))
    poses = solve(session, hidden)
    gap = poses.slice(20, 15)
    for name in ("x", "qw", "source", "support", "n_faces", "residual_px", "sigma_m"):
        assert gap[name].null_count == 15
    assert poses["source"].null_count == 15


def test_a_frame_is_solved_from_its_own_evidence_only(generated: Generated) -> None:
    session = generated(60)
    whole = solve(session)
    part = solve(session, session.markers_2d.filter(pc.field("frame") == 33))
    assert part["source"].null_count == 59
    np.testing.assert_allclose(columns(part, "x y z qz")[33], columns(whole, "x y z qz")[33], atol=1e-6)


def test_lifted_boxes_are_free(generated: Generated) -> None:
    lift = np.zeros((90, 3))
    lift[30:60, 2] = 0.08
    session = generated(90, lift=lift)
    poses = solve(session)
    support = poses["support"].to_pylist()
    assert set(support[:30] + support[60:]) == {"table"}
    assert set(support[30:60]) == {"free"}
    assert np.median(off_mm(session, poses)[30:60]) < 8


def test_corners_in_space_alone_are_enough(generated: Generated) -> None:
    session = generated(60)
    poses = solve(session, None, session.markers_3d)
    assert poses["source"].null_count == 0
    assert poses["residual_px"].null_count == 60
    assert np.median(off_mm(session, poses)) < 0.5


def test_two_and_three_dimensional_corners_are_paired(generated: Generated) -> None:
    """Their rings start at different corners (ECAT 2018 file format §0.3); paired wrongly they would
    contradict.
    """
    session = generated(60)
    poses = solve(session, session.markers_2d, session.markers_3d)
    assert np.median(off_mm(session, poses)) < 0.3


def test_codes_of_no_known_box_are_ignored(generated: Generated) -> None:
    session = generated(20)
    other = session.markers_2d.set_column(
        session.markers_2d.schema.get_field_index("code"),
        "code",
        pa.array(["0" * 25] * session.markers_2d.num_rows),
    )
    assert solve(session, other).num_rows == 0


def test_corners_that_no_square_has_are_ignored(generated: Generated) -> None:
    session = generated(20)
    at = session.markers_2d.schema.get_field_index("u1_px")
    values = np.array(session.markers_2d["u1_px"].to_numpy())
    values[: len(values) // 2] = 1e300
    broken = session.markers_2d.set_column(at, "u1_px", pa.array(values))
    poses = solve(session, broken)
    assert 0 < poses["source"].null_count < 20


def test_without_a_plane_there_are_no_poses(generated: Generated) -> None:
    session = generated(5)
    with pytest.raises(InputError, match="no rows"):
        estimate_poses(session.clock, session.markers_2d, None, TABLE_PLANE.arrow.empty_table())


def test_the_stage_is_the_function(generated: Generated) -> None:
    session = generated(20)
    assert session.prototype is not None
    plane = fit_table(
        session.polygon, session.markers_2d, None, PlaneParameters(prototypes=(session.prototype,))
    )
    tables = {"clock": session.clock, "table_plane": plane, "markers_2d": session.markers_2d}
    made = POSE.run(tables, {}, POSE.parameters(prototypes=(session.prototype,)))
    assert tuple(made) == POSE.outputs
    assert made["poses"].num_rows == 20


def test_one_box_under_two_names_is_not_moved_out_of_itself(generated: Generated) -> None:
    session = generated(20)
    at = session.markers_2d.schema.get_field_index("object_id")
    other = pa.array(["o7"] * len(session.markers_2d)).dictionary_encode()
    twice = pa.concat_tables([session.markers_2d, session.markers_2d.set_column(at, "object_id", other)])
    once, both = solve(session), solve(session, twice)
    for name in ("o2", "o7"):
        mine = both.filter(pc.field("object_id").cast(pa.string()) == name)
        np.testing.assert_array_equal(columns(mine, "x y z"), columns(once, "x y z"))


def test_each_frame_is_placed_on_the_table_as_it_was_then(generated: Generated) -> None:
    """The camera was moved at frame 20: from there on another row of the plane holds."""
    session = generated(40)
    assert session.prototype is not None
    first = fit_table(session.polygon)
    moved = first.to_pylist()[0] | {"frame": 20, "origin_x": first["origin_x"][0].as_py() + 0.1}
    rows = pa.Table.from_pylist([moved, first.to_pylist()[0]], schema=TABLE_PLANE.arrow)
    parameters = PoseParameters(prototypes=(session.prototype,))
    poses = estimate_poses(session.clock, session.markers_2d, None, rows, parameters)
    once = estimate_poses(session.clock, session.markers_2d, None, first, parameters)
    shift = table_frame(first).rotation.T @ np.array([0.1, 0.0, 0.0])
    np.testing.assert_allclose(columns(poses, "x y z")[:20], columns(once, "x y z")[:20], atol=1e-9)
    np.testing.assert_allclose(columns(poses, "x y")[20:], columns(once, "x y")[20:] - shift[:2], atol=1e-4)


def test_the_covariance_is_told_where_there_is_a_pose(generated: Generated) -> None:
    session = generated(30)
    poses = solve(session, session.markers_2d.filter(pc.field("frame") < 20))
    assert poses["covariance"].null_count == 10
    upper = np.array(poses["covariance"].to_pylist()[:20])
    variances = upper[:, [0, 6, 11]]
    np.testing.assert_allclose(np.sqrt(variances.mean(1)), columns(poses, "sigma_m")[:20, 0])


def test_an_object_without_any_face_that_can_be_one_has_no_rows(generated: Generated) -> None:
    session = generated(20)
    rows = session.markers_2d.to_pylist()
    ghost = dict.fromkeys(PIXELS) | {"object_id": "ghost"}
    markers = pa.Table.from_pylist(
        [one for row in rows for one in (row, row | ghost)], schema=session.markers_2d.schema
    )
    assert solve(session, markers).to_pylist() == solve(session).to_pylist()


def test_stretches_of_frames_are_put_together(generated: Generated, monkeypatch: pytest.MonkeyPatch) -> None:
    session = generated(40)
    early = session.markers_2d.filter(pc.field("frame") < 15)
    whole = solve(session, early)
    monkeypatch.setattr("ecat.stages.pose._FRAMES_AT_ONCE", 6)
    parts = solve(session, early)
    assert parts["frame"].to_pylist() == list(range(40))
    assert parts["source"].to_pylist() == whole["source"].to_pylist()
    np.testing.assert_allclose(columns(parts, "x y z"), columns(whole, "x y z"), atol=1e-9)
