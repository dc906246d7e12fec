"""The truth beside a session: complete, in the session's own columns, apart from the session."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from ecat.errors import DiskError, EcatError
from ecat.geometry.transforms import Rigid
from ecat.model.prototype import BoxPrototype
from ecat.sample import ground_truth_tables, write_truth
from ecat.sample.scene import manifest_camera
from ecat.tables import TABLES
from tests.sample.samples import Sample

PHASES = ("reach", "grasp", "hold", "move", "still", "release", "retreat", "end")
_ONE_ROW_PER = {"poses": 2, "faces": 6, "joints": 25}


@pytest.mark.parametrize(("name", "rows"), _ONE_ROW_PER.items())
def test_rows_run_by_frame(sample: Sample, name: str, rows: int) -> None:
    table = ground_truth_tables(sample.truth)[name]
    assert table["frame"].to_pylist() == np.repeat(range(sample.truth.n_frames), rows).tolist()
    assert table["t_ns"].to_pylist() == np.repeat(sample.truth.t_ns, rows).tolist()


@pytest.mark.parametrize("name", ["poses", "joints", "table_plane"])
def test_columns_that_a_sessions_table_has_mean_the_same(sample: Sample, name: str) -> None:
    table, schema = ground_truth_tables(sample.truth)[name], TABLES[name].arrow
    shared = set(table.column_names) & set(schema.names)
    assert len(shared) >= 5
    for column in shared:
        declared = schema.field(column).type
        assert table.schema.field(column).type == getattr(declared, "value_type", declared)


def test_the_poses_are_the_truth(sample: Sample) -> None:
    poses = ground_truth_tables(sample.truth)["poses"].to_pandas()
    for box, object_id in enumerate(sample.truth.object_ids):
        rows = poses[poses["object_id"] == object_id]
        assert (rows[["x", "y", "z"]].to_numpy() == sample.truth.position[box]).all()
        assert (rows[["qx", "qy", "qz", "qw"]].to_numpy() == sample.truth.quaternion[box]).all()
        assert ((rows["support"] == "free").to_numpy() == sample.truth.free[box]).all()
        assert (rows["held_by"].notna().to_numpy() == (sample.truth.holder[box] >= 0)).all()
    assert set(poses["held_by"].dropna()) <= {"HandLeft", "HandRight"}


def test_the_table_plane_is_where_the_boxes_stand(sample: Sample) -> None:
    (row,) = ground_truth_tables(sample.truth)["table_plane"].to_pylist()
    pose = Rigid.from_quaternion(
        np.array([row[name] for name in ("qx", "qy", "qz", "qw")]),
        np.array([row[f"origin_{axis}"] for axis in "xyz"]),
    )
    normal = np.array([row["nx"], row["ny"], row["nz"]])
    foot = np.array([0.2, -0.1, 0.0])
    assert normal @ pose.apply(foot) + row["d"] == pytest.approx(0, abs=1e-12)
    assert normal @ pose.apply(foot + np.array([0, 0, 1])) + row["d"] == pytest.approx(1)
    assert row["d"] == pytest.approx(0.728, abs=0.03)
    assert normal == pytest.approx([0, -0.941, -0.337], abs=0.02)


def test_faces_say_where_each_marker_is_and_why_it_cannot_be_seen(sample: Sample) -> None:
    truth = sample.truth
    faces = ground_truth_tables(truth)["faces"].to_pandas()
    assert set(faces["hidden_by"].dropna()) <= {"turned away", "other box", "hand"}
    assert (faces["hidden_by"].isna().to_numpy() == (truth.hidden == 0).transpose(1, 0, 2).ravel()).all()
    row = faces[(faces["frame"] == 5) & (faces["object_id"] == "o3") & (faces["face"] == "-y")].iloc[0]
    assert [row["u2_px"], row["v2_px"]] == truth.pixels[1, 5, 1, 2].tolist()


def test_states_tile_the_session(sample: Sample) -> None:
    states = ground_truth_tables(sample.truth)["states"].to_pandas()
    for object_id, rows in states.groupby("object_id"):
        assert rows["start_frame"].tolist() == [0, *rows["end_frame"].tolist()[:-1]]
        assert rows["end_frame"].iloc[-1] == sample.truth.n_frames
        assert set(rows["state"]) <= {"moving", "standing"}
        moving = sample.truth.moving[sample.truth.object_ids.index(str(object_id))]
        lengths = rows["end_frame"] - rows["start_frame"]
        assert lengths[rows["state"] == "moving"].sum() == moving.sum()


def test_moves_say_who_holds_what_when(sample: Sample) -> None:
    rows = ground_truth_tables(sample.truth)["moves"].to_pylist()
    holder = np.full(sample.truth.holder.shape, -1)
    for row in rows:
        phases = [row[f"{phase}_frame"] for phase in PHASES]
        assert phases == sorted(phases)
        held = sample.truth.object_ids.index(row["theme"])
        holder[held, row["grasp_frame"] : row["retreat_frame"]] = ["HandLeft", "HandRight"].index(row["hand"])
    assert (holder == sample.truth.holder).all()


def test_prototypes_can_be_read_back(sample: Sample) -> None:
    rows = ground_truth_tables(sample.truth)["prototypes"].to_pylist()
    for object_id, box in zip(sample.truth.object_ids, sample.truth.prototypes, strict=True):
        faces = [row for row in rows if row["object_id"] == object_id]
        read = BoxPrototype.from_dict(
            {"name": faces[0]["name"], "size_m": faces[0]["size_m"], "faces": faces}
        )
        assert read == box


def test_tables_are_written_beside_the_session(sample: Sample, tmp_path: Path) -> None:
    write_truth(tmp_path / "truth", sample.truth)
    tables = ground_truth_tables(sample.truth)
    assert {path.name for path in (tmp_path / "truth").iterdir()} == {f"{name}.parquet" for name in tables}
    assert all(
        pq.read_table(tmp_path / "truth" / f"{name}.parquet") == table for name, table in tables.items()
    )


def test_a_full_disk_is_told(sample: Sample, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: object, **kwargs: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(DiskError, match="cannot write the ground truth"):
        write_truth(tmp_path / "truth", sample.truth)


def test_a_file_in_the_way_is_told(sample: Sample, tmp_path: Path) -> None:
    (tmp_path / "truth").write_text("")
    with pytest.raises(EcatError, match="cannot write the ground truth"):
        write_truth(tmp_path / "truth", sample.truth)


def test_the_manifests_cameras_project_like_the_true_one(sample: Sample) -> None:
    told = sample.draft.manifest.camera("color")
    assert told == manifest_camera(sample.truth.scene.color, "depth")
    assert told is not None
    depth_from_color = Rigid.from_quaternion(np.array(told.rotation), np.array(told.translation_m))
    point = np.array([0.2, 0.3, 1.4])
    x, y, z = depth_from_color.inverse().apply(point)
    seen = [told.cx_px - told.fx_px * x / z, told.cy_px + told.fy_px * y / z]
    assert sample.truth.scene.color.project(point) == pytest.approx(seen)
    # u = 1065.5 X/Z + 54.66/Z + 967.1 in Kinect camera space, whose x is -x
    assert seen[0] == pytest.approx(1065.5 * -0.2 / 1.4 + 54.66 / 1.4 + 967.1)
    assert seen[1] == pytest.approx(-1066.0 * -0.3 / 1.4 - 0.23 / 1.4 + 548.9)
