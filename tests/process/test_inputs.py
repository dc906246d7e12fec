"""What stages are given: sane numbers, and a camera that is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import EcatError, InputError
from ecat.model import Camera, Manifest
from ecat.process import process_session
from ecat.process.inputs import StageImages, StoredRows, sane, session_camera
from ecat.sample import sample_session
from ecat.stages import STAGES
from ecat.stages.rows import stretches
from ecat.store import Draft, Session, TableData, create_session, open_session
from tests.process.films import filmed

CAMERA = Camera(name="color", width_px=640, height_px=480, fx_px=500, fy_px=500, cx_px=320, cy_px=240)


def camera_of(path: Path, **fields: Any) -> object:
    manifest = Manifest(name="s", created="2026", cameras=(replace(CAMERA, **fields),))
    return session_camera(create_session(path / "s", Draft(manifest=manifest)))


@pytest.mark.parametrize("terms", [0, 4, 5, 8, 12, 14])
def test_lenses_of_every_length_that_opencv_knows_are_taken(tmp_path: Path, terms: int) -> None:
    assert camera_of(tmp_path, distortion=((0.1,) * min(terms, 8) + (0.0,) * (terms - 8)))


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"distortion": (0.1,) * 12}, "distortion: ecat's lens model has the first 8"),
        ({"distortion": (0.1,) * 3}, "distortion: expected 0, 4, 5, 8, 12, 14 coefficients, found 3"),
        ({"fx_px": 0.0}, "fx_px: expected a positive focal length in pixels, found 0"),
        ({"rotation": (0.0, 0.0, 0.0, 0.0)}, "rotation: expected a unit quaternion"),
    ],
)
def test_values_that_no_camera_has_are_one_error_that_names_the_field(
    tmp_path: Path, fields: dict[str, Any], problem: str
) -> None:
    with pytest.raises(InputError, match="cannot use the camera of s") as caught:
        camera_of(tmp_path, **fields)
    assert f"session.json: cameras[0].{problem}" in caught.value.where


def test_numbers_that_are_no_place_are_missing() -> None:
    table = pa.table({"frame": [1, 2, 3, 4], "x": [1e308, -1e7, 0.5, None], "y": [np.inf, 1.0, -2.0, 3.0]})
    assert sane(table).to_pydict() == {
        "frame": [1, 2, 3, 4],
        "x": [None, None, 0.5, None],
        "y": [None, 1.0, -2.0, 3.0],
    }


@pytest.mark.parametrize("value", [1e308, -1e308, 1e18, 1e6, 0.0])
@pytest.mark.parametrize("name", ["markers_2d", "markers_3d"])
def test_absurd_marks_lead_to_poses_or_to_one_error_and_to_no_warning(
    tmp_path: Path, name: str, value: float
) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    data = draft.tables[name].data
    assert isinstance(data, pa.Table)
    columns = {column: data[column].to_pylist() for column in data.column_names}
    for column in ("u0_px", "v2_px", "x1", "z3"):
        if column in columns:
            columns[column] = [value if i % 3 == 0 else x for i, x in enumerate(columns[column])]
    arrays = [pa.array(columns[field.name], field.type) for field in data.schema]
    table = TableData(data=pa.Table.from_arrays(arrays, schema=data.schema))
    create_session(tmp_path / "s", replace(draft, tables={**draft.tables, name: table}))
    try:
        report = process_session(tmp_path / "s", smooth=True)
    except EcatError as error:
        assert error.where  # noqa: PT017  either is right, anything else is not
    else:
        assert report.ran == ("plane", "pose", "smooth", "relations", "propose")


def test_rows_of_a_session_are_those_of_the_table_in_whatever_order_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = create_session(tmp_path / "s", sample_session(seed=1, actions=("next",))[0])
    monkeypatch.setattr("ecat.process.inputs._ROWS_READ", 20)
    whole = session.table("markers_2d").to_arrow()
    rows = StoredRows(session, "markers_2d")
    last = int(np.asarray(whole["frame"].to_numpy()).max())

    assert rows.select(("frame", "code")).equals(whole.select(["frame", "code"]))
    for first, end in (
        (0, 5),
        (5, 10),
        (3, 9),
        (last, last + 1),
        (0, last + 1),
        (last + 1, last + 9),
        (4, 4),
    ):
        frame = np.asarray(whole["frame"].to_numpy())
        assert (
            rows.between(first, end).to_pylist()
            == whole.filter(pa.array((frame >= first) & (frame < end))).to_pylist()
        ), (first, end)


def test_frames_far_apart_are_not_read_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    marks = draft.tables["markers_2d"].data
    assert isinstance(marks, pa.Table)
    frame = pa.array(np.arange(marks.num_rows, dtype=np.int32) * 100_000)
    marks = marks.set_column(marks.schema.get_field_index("frame"), marks.schema.field("frame"), frame)
    session = create_session(
        tmp_path / "s", replace(draft, tables={**draft.tables, "markers_2d": TableData(data=marks)})
    )
    asked: list[object] = []
    table = Session.table

    def counted(self: Session, name: str, **bounds: Any) -> Any:
        asked.append(bounds)
        return table(self, name, **bounds)

    monkeypatch.setattr(Session, "table", counted)
    rows = StoredRows(session, "markers_2d")
    assert sum(part.num_rows for part in stretches(rows, 1000)) == marks.num_rows
    assert len(asked) < 10


@pytest.mark.skipif(
    not Path("/proc/self/fd").is_dir(), reason="only Linux tells which files a process has open"
)
def test_between_stages_no_video_stays_open_and_the_next_one_reads_it_all_the_same(tmp_path: Path) -> None:
    filmed(tmp_path / "s", 3, with_depth=True)
    session = open_session(tmp_path / "s")
    (stage,) = (stage for stage in STAGES if stage.name == "outline")

    def is_open() -> bool:
        names = [link.readlink().name for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
        return "depth.mkv" in names

    with StageImages(session) as images:
        depth = images.of(stage)["depth"]
        before = np.array(list(depth.read([1, 5])))
        assert is_open()
        images.rest()
        assert not is_open()
        assert images.of(stage)["depth"] is depth
        assert np.array_equal(np.array(list(depth.read([1, 5]))), before)
    assert not is_open()
