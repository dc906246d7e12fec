"""The smoother fills short gaps, leaves long ones, and keeps what was observed apart from what was not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from ecat.errors import InputError
from ecat.geometry.smoothing import Smoothness, smooth_track
from ecat.geometry.transforms import (
    Floats,
    Rigid,
    matrix_from_rotvec,
    quaternion_angle,
    quaternion_from_matrix,
)
from ecat.stages.plane import fit_table
from ecat.stages.pose import PoseParameters, estimate_poses
from ecat.stages.smooth import SMOOTH, TURN, SmoothParameters, pose_covariances, smooth_poses
from ecat.tables import POSES_SMOOTH
from tests.stages.recorded import Recorded

Generated = Callable[..., Recorded]


def poses_of(session: Recorded, hidden: range = range(0)) -> pa.Table:
    assert session.prototype is not None
    shown = session.markers_2d.filter((pc.field("frame") < hidden.start) | (pc.field("frame") >= hidden.stop))
    parameters = PoseParameters(prototypes=(session.prototype,))
    return estimate_poses(session.clock, shown, None, fit_table(session.polygon), parameters)


def place(poses: pa.Table) -> Floats:
    return np.stack([np.asarray(poses[a].to_numpy(zero_copy_only=False), float) for a in "xyz"], -1)


def test_a_short_gap_is_interpolated_with_growing_doubt(generated: Generated) -> None:
    session = generated(300)
    smoothed = smooth_poses(poses_of(session, range(100, 110)))
    assert smoothed.schema.equals(POSES_SMOOTH.arrow)
    assert set(smoothed["source"].to_pylist()[100:110]) == {"interpolated"}
    assert smoothed["n_faces"].to_pylist()[100:110] == [None] * 10
    assert smoothed["residual_px"].to_pylist()[100:110] == [None] * 10
    sigma = np.asarray(smoothed["sigma_m"].to_numpy(zero_copy_only=False), float)
    # most of what is stated is the place of markers that were never measured, and does not grow
    assert sigma[104] > sigma[101] > sigma[90]
    assert sigma[104] > 1.05 * sigma[90]
    whole = place(poses_of(session))
    assert np.linalg.norm(place(smoothed)[100:110] - whole[100:110], axis=1).max() < 0.02


def test_a_long_gap_stays_open(generated: Generated) -> None:
    smoothed = smooth_poses(poses_of(generated(120), range(40, 70)))
    sources = smoothed["source"].to_pylist()
    assert sources[40:70] == [None] * 30
    assert set(sources[:40] + sources[70:]) == {"observed"}
    assert smoothed["x"].null_count == 30


def test_nothing_is_continued_before_the_first_or_after_the_last_observation(generated: Generated) -> None:
    session = generated(60)
    early = smooth_poses(poses_of(session, range(5)))
    late = smooth_poses(poses_of(session, range(55, 60)))
    assert early["source"].to_pylist()[:5] == [None] * 5
    assert late["source"].to_pylist()[55:] == [None] * 5


def test_the_limit_is_a_parameter(generated: Generated) -> None:
    poses = poses_of(generated(120), range(40, 50))
    assert smooth_poses(poses, SmoothParameters(max_gap_s=0.2))["source"].null_count == 10


def test_noise_shrinks_and_motion_stays(generated: Generated) -> None:
    session = generated(300, noise_px=0.5)
    assert session.pose is not None
    poses = poses_of(session)
    smoothed = smooth_poses(poses)
    # table frames differ within the plane, so deviations are compared after removing the common part
    off = [
        np.linalg.norm((d := place(p) - session.pose.translation) - np.median(d, 0), axis=1)
        for p in (poses, smoothed)
    ]
    assert np.sqrt((off[1] ** 2).mean()) < np.sqrt((off[0] ** 2).mean())
    turn = np.stack([smoothed[q].to_numpy() for q in ("qx", "qy", "qz", "qw")], -1)
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1)


def test_without_a_clock_frames_are_counted(generated: Generated) -> None:
    poses = poses_of(generated(60), range(20, 25))
    at = poses.schema.get_field_index("t_ns")
    timeless = poses.set_column(at, poses.schema.field(at), pa.nulls(60, pa.int64()))
    assert smooth_poses(timeless)["source"].null_count == 0


def test_an_empty_table_stays_empty(generated: Generated) -> None:
    assert smooth_poses(poses_of(generated(10)).slice(0, 0)).num_rows == 0


def test_the_stage_is_the_function(generated: Generated) -> None:
    made = SMOOTH.run({"poses": poses_of(generated(30))}, {}, SMOOTH.parameters())
    assert tuple(made) == SMOOTH.outputs


def test_frames_18_microseconds_apart_are_smoothed_all_the_same(generated: Generated) -> None:
    """A recording whose duration is in the wrong unit."""
    poses = poses_of(generated(100))
    at = poses.schema.get_field_index("t_ns")
    hasty = poses.set_column(at, poses.schema.field(at), pa.array(range(0, 1_800_000, 18_000), pa.int64()))
    smoothed = smooth_poses(hasty)
    assert smoothed["source"].null_count == 0
    assert np.isfinite(place(smoothed)).all()


def leaning(poses: pa.Table, wrong: range) -> pa.Table:
    """The same poses with, in every frame, a second one that leans the other way; where ``wrong``, it comes first."""
    rows = poses.to_pylist()
    for i, row in enumerate(rows):
        turn = Rigid.from_quaternion(np.array([row[q] for q in TURN]), np.zeros(3)).rotation
        lean = matrix_from_rotvec(np.array([0.5 + 0.1 * (i % 2), -0.3, 0.0])) @ turn
        other = [row[axis] for axis in "xyz"] + quaternion_from_matrix(lean).tolist()
        own = [row[key] for key in (*"xyz", *TURN)]
        first, second = (other, own) if i in wrong else (own, other)
        row.update(zip((*"xyz", *TURN), first, strict=True), alternative=second)
    return pa.Table.from_pylist(rows, schema=poses.schema)


def test_time_decides_between_two_poses_that_explain_a_frame_alike(generated: Generated) -> None:
    poses = poses_of(generated(60))
    plain = smooth_poses(poses)
    decided = smooth_poses(leaning(poses, range(20, 26)))
    turns = [np.stack([p[q].to_numpy() for q in TURN], -1) for p in (plain, decided)]
    assert quaternion_angle(turns[0], turns[1]).max() < 1e-3
    assert decided["alternative"].null_count == 60


def test_the_covariance_grows_in_a_gap(generated: Generated) -> None:
    smoothed = smooth_poses(poses_of(generated(120), range(50, 60)))
    spread = pose_covariances(smoothed)
    assert (np.linalg.eigvalsh(spread) > 0).all()
    trace = np.einsum("nii->n", spread[:, :3, :3])
    assert trace[55] > trace[51] > trace[45]
    sigma = np.asarray(smoothed["sigma_m"].to_numpy(zero_copy_only=False), float)
    np.testing.assert_allclose(sigma, np.sqrt(trace / 3))


def test_errors_that_stay_the_same_are_not_smoothed_away(generated: Generated) -> None:
    """Poses that scatter by far less than they may be off are off together."""
    poses = poses_of(generated(120, noise_px=0.01))
    before, after = (
        np.median(p["sigma_m"].to_numpy(zero_copy_only=False)) for p in (poses, smooth_poses(poses))
    )
    assert after > 0.6 * before


def test_poses_without_covariance_are_smoothed_by_their_sigmas(generated: Generated) -> None:
    poses = poses_of(generated(60))
    at = poses.schema.get_field_index("covariance")
    field = poses.schema.field(at)
    bare = poses.set_column(at, field, pa.nulls(60, field.type))
    assert np.abs(place(smooth_poses(bare)) - place(smooth_poses(poses))).max() < 0.004


def test_nothing_is_bridged_where_the_camera_was_moved_and_nothing_ties(generated: Generated) -> None:
    session = generated(120)
    poses = poses_of(session, range(55, 65))
    plane = fit_table(session.polygon)
    rows = [plane.to_pylist()[0] | {"frame": frame, "tie": None} for frame in (0, 60)]
    cut = pa.Table.from_pylist(rows, schema=plane.schema)
    assert smooth_poses(poses)["source"].null_count == 0
    apart = smooth_poses(poses, table_plane=cut)
    assert apart["source"].null_count == 10
    assert apart["frame"].equals(poses["frame"])
    tied = pa.Table.from_pylist([row | {"tie": "boxes"} for row in rows], schema=plane.schema)
    assert smooth_poses(poses, table_plane=tied).equals(smooth_poses(poses))


def test_a_long_recording_is_smoothed_in_windows_as_if_it_were_smoothed_at_once(
    generated: Generated, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To within a thousandth of the stated sigma, with a gap at a seam."""
    poses = poses_of(generated(1500), range(995, 1005))
    whole = smooth_poses(poses)
    at_once: list[int] = []

    def counted(
        t_s: Floats, values: Floats, covariance: Floats, smoothness: Smoothness
    ) -> tuple[Floats, Floats]:
        at_once.append(len(t_s))
        return smooth_track(t_s, values, covariance, smoothness)

    monkeypatch.setattr("ecat.stages.smooth.smooth_track", counted)
    monkeypatch.setattr("ecat.stages.smooth._WINDOW", 100)
    monkeypatch.setattr("ecat.stages.smooth._MARGIN_S", 3.0)
    parts = smooth_poses(poses)
    assert len(at_once) == 2 * 15
    assert max(at_once) <= 100 + 2 * 91
    for name in ("frame", "t_ns", "object_id", "source", "support", "n_faces"):
        assert parts[name].to_pylist() == whole[name].to_pylist()
    sigma = np.asarray(whole["sigma_m"].to_numpy(zero_copy_only=False), float)
    assert (np.linalg.norm(place(parts) - place(whole), axis=1) < 1e-3 * sigma).all()
    turns = [np.stack([p[q].to_numpy() for q in TURN], -1) for p in (parts, whole)]
    assert (quaternion_angle(*turns) < 1e-3 * whole["sigma_rad"].to_numpy()).all()
    np.testing.assert_allclose(pose_covariances(parts), pose_covariances(whole), rtol=1e-3, atol=1e-12)


def test_what_is_after_a_long_gap_is_smoothed_as_if_it_were_alone(generated: Generated) -> None:
    seen = poses_of(generated(130)).to_pylist()
    hidden = poses_of(generated(130), range(40, 80)).to_pylist()
    rows = [
        row | {"object_id": name}
        for both in zip(hidden, seen, strict=True)
        for name, row in zip("ab", both, strict=True)
    ]
    poses = pa.Table.from_pylist(rows, schema=poses_of(generated(1)).schema)
    after = (pc.field("object_id").cast(pa.string()) == "a") & (pc.field("frame") >= 80)

    smoothed, alone = smooth_poses(poses).filter(after), smooth_poses(poses.filter(after))

    np.testing.assert_allclose(place(smoothed), place(alone), rtol=0, atol=1e-12)
    np.testing.assert_allclose(pose_covariances(smoothed), pose_covariances(alone), rtol=1e-9, atol=1e-15)


def test_every_frame_of_every_object_comes_once_out_of_the_windows(
    generated: Generated, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = poses_of(generated(130)).to_pylist()
    rows = [row | {"object_id": name} for row in one for name in ("a", "b")]
    poses = pa.Table.from_pylist(rows, schema=poses_of(generated(1)).schema)
    monkeypatch.setattr("ecat.stages.smooth._WINDOW", 30)
    smoothed = smooth_poses(poses)
    for name in ("frame", "object_id"):
        assert smoothed[name].to_pylist() == poses[name].to_pylist()


def test_poses_that_lack_rows_are_refused(generated: Generated) -> None:
    one = poses_of(generated(30))
    at = one.schema.get_field_index("object_id")
    other = pa.array(["other"] * one.num_rows).cast(one.schema.field("object_id").type)
    for rows in (slice(0, 29), slice(1, 30)):
        both = pa.concat_tables([one, one.set_column(at, one.schema.field(at), other)[rows]])
        with pytest.raises(InputError, match="row for each frame"):
            smooth_poses(both)
