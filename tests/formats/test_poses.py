"""Poses of a session or a project as one Parquet file."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ecat.errors import NotFoundError
from ecat.formats import export
from ecat.formats.poses import SCHEMA
from ecat.model import AnnotatedObject, Layer, Manifest
from ecat.store import Draft, TableData, create_session
from ecat.tables import POSES


def poses(name: str, *, x: float = 0.5, turn: float = pi / 2) -> TableData:
    """Two frames of one box: observed and turned about the table's normal, then not known."""
    half = turn / 2
    values: dict[str, list[object]] = {
        "t_ns": [0, 10],
        "frame": [0, 1],
        "object_id": ["o1", "o1"],
        **{axis: [number, None] for axis, number in zip("xyz", (x, 0.25, 0.0762), strict=True)},
        **{
            q: [number, None]
            for q, number in zip(
                ("qx", "qy", "qz", "qw"), (0.0, 0.0, np.sin(half), np.cos(half)), strict=True
            )
        },
        "source": ["observed", None],
        "support": ["table", None],
        "n_faces": [2, None],
        "residual_px": [0.6, None],
        "sigma_m": [0.001, None],
        "sigma_rad": [0.01, None],
        "covariance": [[1e-6] * 21, None],
        "alternative": [None, None],
    }
    schema = POSES.arrow
    arrays = [
        pa.array(values[f.name], pa.string() if pa.types.is_dictionary(f.type) else f.type) for f in schema
    ]
    plain = pa.table(dict(zip(schema.names, arrays, strict=True)))
    return TableData(data=plain, stage=name, stage_version="1")


def session(path: Path, **tables: TableData) -> Path:
    layer = Layer(objects=(AnnotatedObject(id="o1", name="Shell", kind="marker_box"),))
    manifest = Manifest(name=path.name, created="2026-01-01T00:00:00+00:00", n_frames=2)
    create_session(path, Draft(manifest=manifest, layers=(layer,), tables=tables))
    return path


def test_a_row_per_frame_and_box_with_angles(tmp_path: Path) -> None:
    source = session(tmp_path / "SlideAway" / "Session1", poses=poses("pose"))
    report = export(source, tmp_path / "out.parquet", format="poses")
    found = pq.read_table(tmp_path / "out.parquet")
    assert report.sessions == 1
    assert found.schema.equals(SCHEMA, check_metadata=True)
    first, second = found.to_pylist()
    assert first == {
        "action": "SlideAway", "session": "Session1", "t_ns": 0, "frame": 0, "object": "Shell",
        "x": 0.5, "y": 0.25, "z": 0.0762,
        "rotation": pytest.approx(pi / 2), "roll": pytest.approx(0), "pitch": pytest.approx(0),
        "observed": True, "residual": 0.6, "source": "observed",
    }  # fmt: skip
    assert [second[name] for name in ("x", "rotation", "residual", "observed")] == [None, None, None, False]


def test_every_column_says_its_unit_and_frame_of_reference(tmp_path: Path) -> None:
    source = session(tmp_path / "s", poses=poses("pose"))
    export(source, tmp_path / "out.parquet", format="poses")
    said = {
        field.name: tuple((field.metadata or {})[key].decode() for key in (b"meaning", b"unit", b"reference"))
        for field in pq.read_schema(tmp_path / "out.parquet")
    }
    assert [name for name in SCHEMA.names if said[name][0]] == SCHEMA.names
    assert {name: said[name][1:] for name in ("t_ns", "x", "rotation", "residual")} == {
        "t_ns": ("ns", ""),
        "x": ("m", "table"),
        "rotation": ("rad", "table"),
        "residual": ("px", "colour image"),
    }


def test_long_recordings_are_written_a_few_frames_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = session(tmp_path / "s", poses=poses("pose"))
    export(source, tmp_path / "whole.parquet", format="poses")
    monkeypatch.setattr("ecat.formats.poses._FRAMES_AT_ONCE", 1)
    export(source, tmp_path / "parts.parquet", format="poses")
    assert pq.read_metadata(tmp_path / "parts.parquet").num_row_groups == 2
    assert pq.read_table(tmp_path / "parts.parquet").equals(pq.read_table(tmp_path / "whole.parquet"))


def test_smoothed_poses_are_a_format_of_their_own_and_never_taken_for_the_others(tmp_path: Path) -> None:
    source = session(tmp_path / "s", poses=poses("pose"), poses_smooth=poses("smooth", x=0.75))
    export(source, tmp_path / "out.parquet", format="poses")
    export(source, tmp_path / "smooth.parquet", format="poses-smooth")
    assert pq.read_table(tmp_path / "out.parquet")["x"].to_pylist() == [0.5, None]
    assert pq.read_table(tmp_path / "smooth.parquet")["x"].to_pylist() == [0.75, None]


def test_asking_for_smoothed_poses_says_how_to_make_them(tmp_path: Path) -> None:
    source = session(tmp_path / "s", poses=poses("pose"))
    with pytest.raises(NotFoundError) as caught:
        export(source, tmp_path / "out.parquet", format="poses-smooth")
    assert caught.value.fix.endswith("--smooth")


def test_sessions_without_poses_are_left_out_and_told(tmp_path: Path) -> None:
    session(tmp_path / "p" / "a", poses=poses("pose"))
    session(tmp_path / "p" / "b")
    report = export(tmp_path / "p", tmp_path / "out.parquet", format="poses")
    assert (report.sessions, report.findings) == (1, ("b: no table poses yet; left out",))


def test_without_any_poses_there_is_no_file(tmp_path: Path) -> None:
    before = sorted(session(tmp_path / "s").rglob("*"))
    with pytest.raises(NotFoundError, match="cannot export the poses") as caught:
        export(tmp_path / "s", tmp_path / "out.parquet", format="poses")
    assert caught.value.fix == f"ecat process {tmp_path / 's'}"
    assert sorted((tmp_path / "s").rglob("*")) == before
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


def test_an_older_export_is_replaced(tmp_path: Path) -> None:
    source = session(tmp_path / "s", poses=poses("pose"))
    (tmp_path / "out.parquet").write_text("PAR1, and older")
    export(source, tmp_path / "out.parquet", format="poses")
    assert pq.read_table(tmp_path / "out.parquet").num_rows == 2
