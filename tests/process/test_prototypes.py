"""Box prototypes: calibrated from recordings, kept in files."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import EcatError, InputError, LimitError, NotFoundError, SchemaError
from ecat.model.prototype import NOMINAL_BOXES
from ecat.process import (
    calibrate,
    calibrate_together,
    process_session,
    read_prototypes,
    write_prototypes,
)
from ecat.process.prototypes import MAX_BOXES, MAX_BYTES, recordings_of
from ecat.sample import sample_session
from ecat.stages.calibrate import Recording
from ecat.store import Draft, Session, create_session, open_session
from tests.process.films import filmed, find


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    write_prototypes(tmp_path / "boxes.json", NOMINAL_BOXES)
    assert read_prototypes(tmp_path / "boxes.json") == NOMINAL_BOXES


def test_writing_again_replaces_the_file(tmp_path: Path) -> None:
    write_prototypes(tmp_path / "boxes.json", NOMINAL_BOXES)
    write_prototypes(tmp_path / "boxes.json", NOMINAL_BOXES[:1])
    assert read_prototypes(tmp_path / "boxes.json") == NOMINAL_BOXES[:1]
    assert [path.name for path in tmp_path.iterdir()] == ["boxes.json"]


def test_calibration_finds_the_sample_s_boxes_within_two_millimetres(tmp_path: Path) -> None:
    draft, truth = sample_session(seed=3)
    create_session(tmp_path / "session", draft)
    found = {box.name: box for box in calibrate([tmp_path / "session"])}
    for true in truth.prototypes:
        box = found[true.name]
        for face in true.faces:
            best = min(abs(f.side_m - face.side_m) for f in box.faces)
            assert best < 0.002


def test_a_session_without_marks_cannot_calibrate(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    create_session(tmp_path / "bare", Draft(manifest=draft.manifest, layers=draft.layers))
    with pytest.raises(InputError, match="cannot calibrate"):
        calibrate([tmp_path / "bare"])


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"boxes": []}', '{"boxes": 3}', '{"boxes": [{}]}', "\x00", "[" * 100_000]
)
def test_another_file_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "boxes.json").write_text(text)
    with pytest.raises(InputError, match="prototype"):
        read_prototypes(tmp_path / "boxes.json")


@pytest.mark.parametrize(
    ("version", "fix"),
    [(2, "upgrade ecat"), (0, "calibrate the boxes again"), ("1", "calibrate the boxes again")]
    + [(value, "calibrate the boxes again") for value in (None, True, 1.0, [1])],
)
def test_a_file_of_another_version_is_refused(tmp_path: Path, version: object, fix: str) -> None:
    boxes = [box.to_dict() for box in NOMINAL_BOXES]
    (tmp_path / "boxes.json").write_text(json.dumps({"version": version, "boxes": boxes}))
    with pytest.raises(SchemaError, match="cannot read the prototypes") as caught:
        read_prototypes(tmp_path / "boxes.json")
    assert caught.value.fix == fix


def test_every_problem_of_every_box_is_named(tmp_path: Path) -> None:
    boxes = [box.to_dict() for box in NOMINAL_BOXES]
    boxes[0]["size_m"] = [0.1, 0, 0.1]
    boxes[2]["faces"] *= 3334
    (tmp_path / "boxes.json").write_text(json.dumps({"version": 1, "boxes": boxes}))
    with pytest.raises(SchemaError) as caught:
        read_prototypes(tmp_path / "boxes.json")
    assert caught.value.problems == (
        "boxes[0].size_m: expected three positive lengths in metres, at most 10",
        "boxes[2].faces: expected a non-empty list of at most 6 faces, found 10,002",
    )


def test_more_boxes_than_anybody_has_are_refused(tmp_path: Path) -> None:
    (tmp_path / "boxes.json").write_text(json.dumps({"version": 1, "boxes": [{}] * (MAX_BOXES + 1)}))
    with pytest.raises(LimitError, match="cannot read the prototypes"):
        read_prototypes(tmp_path / "boxes.json")


def test_boxes_are_measured_on_the_table_that_depth_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [filmed(tmp_path / name, 1, with_depth=name == "deep") for name in ("deep", "flat")]
    truth = found[0][0]
    find(monkeypatch, [found[0][1]])
    for name in ("deep", "flat"):
        process_session(tmp_path / name, stages=["track"])
    (deep,), (flat,) = (recordings_of(open_session(tmp_path / name)) for name in ("deep", "flat"))
    height = truth.scene.depth_from_table.inverse().apply(deep.polygon)[:, 2]
    assert np.abs(height).max() < 0.001
    assert not len(flat.polygon)
    assert deep.markers_2d.equals(flat.markers_2d)
    (tmp_path / "deep" / "media" / "depth.mkv").unlink()
    with pytest.raises(EcatError, match="cannot read stream depth"):
        recordings_of(open_session(tmp_path / "deep"))


def test_marks_of_an_unknown_camera_measure_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find(monkeypatch, [filmed(tmp_path / "s", 1, eyeless=True)[1]])
    process_session(tmp_path / "s", stages=["track"])
    assert recordings_of(open_session(tmp_path / "s")) == []


def test_sessions_that_have_boxes_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    boxes = tuple(box.to_dict() for box in NOMINAL_BOXES)
    create_session(tmp_path / "a", replace(draft, manifest=replace(draft.manifest, prototypes=boxes)))
    monkeypatch.setattr("ecat.process.prototypes.recordings_of", None)
    assert calibrate_together([tmp_path / "a"]) == {}


def test_of_many_sessions_only_those_that_are_used_are_read_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is depth, the table is looked for in all of it."""
    for name in "abcd":
        create_session(tmp_path / name, sample_session(seed=1, actions=("next",), name=name)[0])
    (tmp_path / "b" / "tables" / "markers_2d.parquet").write_bytes(b"PAR1")
    read: list[str] = []

    def noted(session: Session) -> list[Recording]:
        read.append(session.name)
        return recordings_of(session)

    monkeypatch.setattr("ecat.stages.calibrate.ENOUGH", 2)
    monkeypatch.setattr("ecat.process.prototypes.recordings_of", noted)
    found = calibrate_together([tmp_path / name for name in "abcd"])
    assert len(read) == 2
    assert "b" not in read
    assert {path.name for path in found} == set("abcd")
    assert len(set(found.values())) == 1


def test_a_damaged_session_does_not_keep_the_others_from_being_calibrated(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in "ab"]
    for path in paths:
        create_session(path, sample_session(seed=1, actions=("next",))[0])
    alone = calibrate([paths[0]])
    (paths[1] / "tables" / "markers_2d.parquet").write_bytes(b"PAR1")
    assert calibrate_together(paths) == dict.fromkeys(paths, alone)


def test_a_missing_file_and_a_huge_one_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        read_prototypes(tmp_path / "none.json")
    (tmp_path / "huge.json").write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(LimitError):
        read_prototypes(tmp_path / "huge.json")


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(),
        lambda x: st.lists(x) | st.dictionaries(st.text(), x),
    )
)
def test_any_json_gives_prototypes_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, value: object
) -> None:
    path = tmp_path_factory.mktemp("any") / "boxes.json"
    path.write_text(json.dumps({"version": 1, "boxes": [value]}))
    with contextlib.suppress(EcatError):
        assert read_prototypes(path)
