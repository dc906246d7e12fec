"""Box prototypes: calibrated from recordings, kept in files."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import EcatError, InputError, LimitError, NotFoundError
from ecat.model.prototype import NOMINAL_BOXES
from ecat.process import calibrate, read_prototypes, write_prototypes
from ecat.process.prototypes import MAX_BYTES
from ecat.sample import sample_session
from ecat.store import Draft, create_session


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
