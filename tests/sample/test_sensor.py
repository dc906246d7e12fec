"""Marker and joint tables: what a detector would have found, and nothing that it could not."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from ecat.geometry.boxes import corner_order, from_leftmost, match_codes, pair_corners
from ecat.geometry.transforms import Floats
from ecat.sample import sample_session
from ecat.sample.body import JOINTS
from ecat.sample.scene import HALF_M
from ecat.sample.sensor import MIN_SIDE_PX, NoiseModel
from ecat.tables import TABLES
from tests.sample.samples import Sample


def pixels(markers_2d: pa.Table) -> Floats:
    """Corners (rows, 4, 2) as listed."""
    names = [f"{axis}{i}_px" for i, axis in product(range(4), "uv")]
    return np.column_stack([markers_2d[name].to_numpy() for name in names]).reshape(-1, 4, 2)


def points(markers_3d: pa.Table) -> Floats:
    """Corners (rows, 4, 3) as listed; NaN where null."""
    names = [f"{axis}{i}" for i, axis in product(range(4), "xyz")]
    return np.column_stack([markers_3d[name].to_numpy() for name in names]).reshape(-1, 4, 3)


@cache
def recognised(sample: Sample) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Floats]:
    """Box, frame, face and corners (rows, 4, 2) in the print's order, by the general way to read codes."""
    table = sample.table("markers_2d")
    listed, codes = pixels(table), [str(code) for code in table["code"].to_pylist()]
    known = match_codes(codes, sample.truth.prototypes, mirrored=True)
    carrier, face, turns = np.array([known[code] for code in codes]).T
    box = np.array([sample.truth.object_ids.index(o) for o in table["object_id"].to_pylist()])
    assert (carrier == box).all()
    ring = np.take_along_axis(listed, from_leftmost(listed)[..., None], 1)
    order = np.array([corner_order(k, mirrored=True) for k in range(4)])[turns]
    frame = table["frame"].to_numpy().astype(np.intp)
    return box, frame, face, np.take_along_axis(ring, order[..., None], 1)


@pytest.mark.parametrize("name", ["markers_2d", "markers_3d", "joints"])
def test_tables_have_their_schema_and_are_sorted(sample: Sample, name: str) -> None:
    table = sample.table(name)
    assert table.schema.equals(TABLES[name].arrow, check_metadata=True)
    table.validate(full=True)
    for field in table.schema:
        assert field.nullable or table[field.name].null_count == 0
    keys = table.select(TABLES[name].order).to_pandas().astype({"frame": int})
    keys = keys.apply(lambda column: column.astype(str) if column.dtype == "category" else column)
    pd.testing.assert_frame_equal(keys, keys.sort_values(list(TABLES[name].order)))


def test_every_code_is_that_of_its_box_read_in_the_mirror(sample: Sample) -> None:
    box, _, face, _ = recognised(sample)
    assert {*zip(box.tolist(), face.tolist(), strict=True)} == {*product(range(2), range(3))}


def test_the_truth_reprojects_onto_the_corners_within_the_noise(sample: Sample) -> None:
    box, frame, face, corners = recognised(sample)
    error = corners - sample.truth.pixels[box, frame, face]
    # 0.4 px of noise and rounding to whole pixels
    assert np.abs(error.mean((0, 1))) == pytest.approx(0, abs=0.02)
    assert error.std() == pytest.approx(np.hypot(0.4, 12**-0.5), rel=0.03)
    assert np.abs(error).max() < 3
    assert (corners == np.round(corners)).all()


def test_perfect_sensors_report_the_truth(noiseless: Sample) -> None:
    box, frame, face, corners = recognised(noiseless)
    assert corners == pytest.approx(noiseless.truth.pixels[box, frame, face], abs=0.005)


def test_perfect_sensors_find_exactly_the_faces_in_view_that_are_large_enough(noiseless: Sample) -> None:
    truth = noiseless.truth
    box, frame, face, _ = recognised(noiseless)
    found = np.zeros(truth.hidden.shape, bool)
    found[box, frame, face] = True
    large = (np.ptp(truth.pixels, axis=-2) >= MIN_SIDE_PX).all(-1)
    assert (found == ((truth.hidden == 0) & large)).all()


def test_ordinary_sensors_miss_some_faces_and_invent_none(sample: Sample) -> None:
    truth = sample.truth
    box, frame, face, _ = recognised(sample)
    assert (truth.hidden[box, frame, face] == 0).all()
    assert len(set(zip(box, frame, face, strict=True))) == len(face)
    assert 0.7 < len(face) / (truth.hidden == 0).sum() < 0.95


def test_each_box_is_lost_for_several_frames_at_times(sample: Sample) -> None:
    table = sample.table("markers_2d")
    for object_id in sample.truth.object_ids:
        seen = np.unique(table["frame"].to_numpy()[np.array(table["object_id"].to_pylist()) == object_id])
        assert 3 <= np.diff(seen).max() < 250
        assert len(seen) > 0.55 * sample.truth.n_frames


def test_faces_are_listed_by_size(sample: Sample) -> None:
    table = sample.table("markers_2d").select(["frame", "object_id", "order"]).to_pandas()
    table["area"] = np.ptp(pixels(sample.table("markers_2d")), axis=1).prod(-1)
    for _, marker in table.groupby(["frame", "object_id"], observed=True):
        assert marker["order"].tolist() == list(range(len(marker)))
        assert (np.diff(marker["area"]) <= 0).all()


def test_corners_run_clockwise_on_screen_from_the_least_u_plus_v(sample: Sample) -> None:
    ring = pixels(sample.table("markers_2d"))
    side = np.roll(ring, -1, 1) - ring
    turn = side[..., 0] * np.roll(side[..., 1], -1, 1) - side[..., 1] * np.roll(side[..., 0], -1, 1)
    assert (turn > 0).all()  # v points down
    assert (np.argmin(ring.sum(-1), 1) == 0).all()


def test_corners_in_space_run_the_same_way_from_another_start(sample: Sample) -> None:
    flat, deep = sample.table("markers_2d"), sample.table("markers_3d")
    assert flat.drop_columns([c for c in flat.column_names if c.endswith("_px")]) == deep.drop_columns(
        [f"{axis}{i}" for i, axis in product(range(4), "xyz")]
    )
    space = points(deep)
    complete = np.isfinite(space).all((-1, -2))
    # Kinect camera space has x and y the other way round
    assert (np.argmin(-space[complete][..., 0] - space[complete][..., 1], 1) == 0).all()
    paired = pair_corners(pixels(flat), space, sample.truth.scene.color)
    shifts = np.bincount(paired[complete][:, 0], minlength=4) / complete.sum()
    assert shifts[0] < 0.5
    error = sample.truth.scene.color.project(np.take_along_axis(space, paired[..., None], 1)) - pixels(flat)
    assert np.nanmedian(np.abs(error)) < 1


def test_some_corners_in_space_are_missing_whole_and_come_first(sample: Sample) -> None:
    missing = np.isnan(points(sample.table("markers_3d")))
    corner = np.all(missing, axis=-1)
    assert (corner == np.any(missing, axis=-1)).all()
    assert 0.005 < corner.mean() < 0.015
    assert np.all(corner[corner.sum(1) == 1, 0])


def test_depth_is_noisy_and_sometimes_that_of_the_background(sample: Sample) -> None:
    truth = sample.truth
    box, frame, face, _ = recognised(sample)
    true = truth.scene.depth_from_table.apply(truth.corners[box, frame, face])
    space = points(sample.table("markers_3d"))
    distance = np.sqrt(((space[:, :, None] - true[:, None]) ** 2).sum(-1)).min(-1)
    distance = distance[np.isfinite(distance)]
    assert 0.001 < np.median(distance) < 0.004
    assert 0.003 < (distance > 0.02).mean() < 0.02


def test_joints_are_near_the_truth_and_inferred_where_they_are_hidden(sample: Sample) -> None:
    truth = sample.truth
    table = sample.table("joints").to_pandas().astype({"joint": str, "state": str})
    assert len(table) == truth.n_frames * 25
    joint = table["joint"].map(JOINTS.index).to_numpy()
    true = truth.scene.depth_from_table.apply(truth.joints)[table["frame"], joint]
    error = table[["x", "y", "z"]].to_numpy() - true
    inferred = table["state"].to_numpy() == "inferred"
    assert (inferred == truth.joint_hidden[table["frame"], joint]).all()
    assert error[~inferred].std() == pytest.approx(0.004, rel=0.05)
    assert error[inferred].std() == pytest.approx(0.02, rel=0.05)
    projected = truth.scene.color.project(table[["x", "y", "z"]].to_numpy())
    assert table[["u_px", "v_px"]].to_numpy() == pytest.approx(projected, abs=0.01)
    assert set(table["joint"][inferred]) >= {"KneeLeft", "KneeRight"}
    assert "Head" not in set(table["joint"][inferred])


def test_the_noise_changes_what_is_seen_but_not_what_happens() -> None:
    quiet, truth = sample_session(seed=4, actions=["away"])
    loud, same = sample_session(seed=4, actions=["away"], noise=NoiseModel(corner_px=2.0, missed=0.4))
    assert (truth.position == same.position).all()
    assert (truth.joints == same.joints).all()
    found = [Sample(draft, truth).table("markers_2d").num_rows for draft in (quiet, loud)]
    assert found[0] > 1.2 * found[1]


# ------------------------------------------------------------------------------------------- visibility


def test_a_face_is_turned_away_when_the_camera_is_behind_its_plane(sample: Sample) -> None:
    truth = sample.truth
    for b, box in enumerate(truth.prototypes):
        for f, face in enumerate(box.faces):
            sign, axis = face.face
            normal = np.array([float(f"{sign}1") * (axis == name) for name in "xyz"])
            to_eye = truth.scene.eye - truth.position[b]
            height = np.einsum("ni,nij,j->n", to_eye, truth.poses.rotation[b], normal) - HALF_M
            assert ((truth.facing[b, :, f] > 0) == (height > 0)).all()
            assert (truth.hidden[b, height <= 0, f] == 1).all()


def test_only_a_box_on_the_sight_line_hides_a_face(sample: Sample) -> None:
    """March along the sight lines of the hidden faces' corners and look for the other box."""
    truth = sample.truth
    steps = np.linspace(0.5, 0.999, 400)[:, None, None]
    for b in (0, 1):
        frames, faces = np.nonzero(truth.hidden[b] == 2)
        other = truth.poses.rotation[1 - b][frames], truth.position[1 - b][frames]
        corners = truth.corners[b, frames, faces]
        middles = (corners + np.roll(corners, 1, 1)) / 2
        blocked = np.zeros(len(frames), bool)
        for target in [*corners.swapaxes(0, 1), *middles.swapaxes(0, 1), corners.mean(1)]:
            on_line = truth.scene.eye + steps * (target - truth.scene.eye)
            inside = np.abs(np.einsum("nij,sni->snj", other[0], on_line - other[1]))
            blocked |= (inside < HALF_M + 1e-3).all(-1).any(0)
        assert blocked.all()


def test_the_hand_hides_faces_only_while_it_is_close(sample: Sample) -> None:
    truth = sample.truth
    by_hand = (truth.hidden == 3).any((0, 2))
    busy = np.zeros(truth.n_frames, bool)
    for move in truth.moves:
        for carry in move.carries:
            busy[carry.reach : carry.end] = True
    assert by_hand.any()
    assert by_hand[~busy].mean() < 0.1
