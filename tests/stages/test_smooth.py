"""The smoother fills short gaps, leaves long ones, and keeps what was observed apart from what was not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.geometry.transforms import Floats
from ecat.stages.plane import fit_table
from ecat.stages.pose import PoseParameters, estimate_poses
from ecat.stages.smooth import SMOOTH, SmoothParameters, smooth_poses
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
    assert sigma[104] > 2 * sigma[90]
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
    made = SMOOTH.run({"poses": poses_of(generated(30))}, SMOOTH.parameters())
    assert tuple(made) == SMOOTH.outputs
