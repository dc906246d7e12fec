"""``ecat learn features``: sessions and exports in, a table of a named set out, or one error."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow.parquet as pq
import pytest

from learn.features.sets import SETS
from tests.learn.features import sessions
from tests.learn.recognize import made

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sessions.make(tmp_path_factory.mktemp("s") / "slide", sessions.draft()).path


@pytest.fixture
def exports(tmp_path: Path) -> Path:
    return made.exports(tmp_path / "exports", 2)


def test_the_sets_are_listed_with_their_columns(ecat: Ecat) -> None:
    listed = ecat("learn", "features", "--list", "--json").json["sets"]
    assert [row["set"] for row in listed] == list(SETS)
    assert {row["set"]: row["columns"] for row in listed}["ch5-qualitative"] == 13
    assert all(len(row["names"]) == row["columns"] for row in listed)
    text = ecat("learn", "features", "--list").out
    assert all(one.name in text and one.what in text for one in SETS.values())


def test_one_set_is_listed_with_the_names_of_its_columns(ecat: Ecat) -> None:
    text = ecat("learn", "features", "--list", "--set", "ch4-qsr25").out
    assert all(column in text for column in SETS["ch4-qsr25"].columns())
    assert "6 o1_centroid and o2_centroid" in " ".join(text.split())
    assert "ch5" not in text


def test_features_of_a_session_are_a_table_that_says_what_it_is(
    processed: Path, tmp_path: Path, ecat: Ecat
) -> None:
    dest = tmp_path / "f.parquet"
    result = ecat(
        "learn", "features", processed, "--set", "ch5-qualitative", "--every", 2, "-o", dest, "--json"
    )
    assert result.code == 0, result.err
    table = pq.read_table(dest)
    assert table.column_names == ["session", "frame", *SETS["ch5-qualitative"].columns()]
    assert table["frame"].to_pylist()[:3] == [0, 2, 4]
    assert result.json["rows"] == table.num_rows == result.json["sessions"]["slide"]
    assert table.schema.metadata[b"ecat:features"] == b"ch5-qualitative"


def test_what_was_fitted_to_training_recordings_is_applied_to_others(
    exports: Path, tmp_path: Path, ecat: Ecat
) -> None:
    train, test, planes = tmp_path / "train.parquet", tmp_path / "test.parquet", tmp_path / "planes.json"
    first = ecat(
        "learn", "features", exports / "pushto.txt", "--set", "ch4-pcas18", "--fit", planes, "-o", train
    )
    assert first.code == 0, first.err
    said = planes.read_bytes()
    other = exports / "deeper" / "pullpast.txt"
    second = ecat(
        "learn", "features", other, "--set", "ch4-qsr25", "--transform", planes, "-o", test, "--json"
    )
    assert second.code == 0, second.err
    assert second.json["sessions"] == {"pullpast/pullpast1": 45, "pullpast/pullpast2": 45}
    assert planes.read_bytes() == said


def test_recordings_that_lack_something_are_named_and_the_others_written(
    processed: Path, tmp_path: Path, ecat: Ecat
) -> None:
    project, dest = tmp_path / "project", tmp_path / "f.parquet"
    shutil.copytree(processed, project / "good")
    bare = sessions.without(sessions.draft(), "joints")
    sessions.make(project / "bare", bare, process=False)
    result = ecat("learn", "features", project, "--set", "ch4-raw", "-o", dest, "--json")
    assert result.code == 1
    assert list(result.json["sessions"]) == ["good"]
    assert "no joints" in result.json["failures"][0]["where"]
    assert dest.exists()
    quiet = ecat("learn", "features", project, "--set", "ch4-raw", "-o", tmp_path / "g.parquet", "--quiet")
    assert (quiet.code, quiet.out) == (1, "")
    assert "no joints" in quiet.err


def test_what_is_the_same_of_many_recordings_is_said_once(tmp_path: Path, ecat: Ecat) -> None:
    bare = sessions.without(sessions.draft(), "joints")
    made_one = sessions.make(tmp_path / "project" / "s0", bare).path
    for number in range(1, 5):
        shutil.copytree(made_one, tmp_path / "project" / f"s{number}")
    command = ("learn", "features", tmp_path / "project", "--set", "ch5-network")
    result = ecat(*command, "-o", tmp_path / "f.parquet", "--json")
    (said,) = result.json["findings"]
    assert said.startswith("s0, s1, s2 and 2 more: there are no joints")


def test_recordings_of_one_name_are_called_by_their_paths(
    processed: Path, tmp_path: Path, ecat: Ecat
) -> None:
    work, dest = tmp_path / "work", tmp_path / "f.parquet"
    for copy in ("a/one", "b/one", "b/two"):
        shutil.copytree(processed, work / copy)
    sources = (work, work / "b" / "one")  # one of them is named twice
    result = ecat("learn", "features", *sources, "--set", "ch5-network", "-o", dest, "--json")
    assert result.code == 0, result.err
    n = pq.read_table(dest).num_rows // 3
    assert result.json["sessions"] == {"a/one": n, "b/one": n, "b/two": n}
    assert set(pq.read_table(dest)["session"].to_pylist()) == set(result.json["sessions"])


def test_exports_of_one_name_are_called_by_their_paths(tmp_path: Path, ecat: Ecat) -> None:
    exports, dest = tmp_path / "ex", tmp_path / "f.parquet"
    for folder in ("a", "b/c"):
        made.write(exports / folder / "push.to.txt", made.session("one", made.scene(1), []))
    made.write(exports / "alone.txt", made.session("one", made.scene(1), []))
    result = ecat("learn", "features", exports, "--set", "ch4-raw", "-o", dest, "--json")
    assert result.code == 0, result.err
    assert set(result.json["sessions"]) == {"a/push.to/one", "b/c/push.to/one", "alone/one"}


def test_two_recordings_of_one_name_in_one_export_are_refused(tmp_path: Path, ecat: Ecat) -> None:
    export, dest = tmp_path / "push.txt", tmp_path / "f.parquet"
    made.write(export, *(made.session("one", made.scene(box), []) for box in (1, 2)))
    result = ecat("learn", "features", export, "--set", "ch4-raw", "-o", dest, "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "InputError")
    assert "push/one" in result.json["error"]["where"]
    assert not dest.exists()


def test_an_error_names_its_recording(tmp_path: Path, ecat: Ecat) -> None:
    bad, gap = made.scene(1), made.scene(2)
    bad[:, 17:] = np.nan
    gap[7, 11] = np.nan
    scenes = {"good": made.scene(1), "bad": bad, "gap": gap}
    export = made.write(tmp_path / "ex.txt", *(made.session(name, one, []) for name, one in scenes.items()))
    for name, words in (("ch4-qsr25", {"ex/bad", "ex/gap"}), ("ch5-network", {"ex/bad"})):
        call = ("learn", "features", export, "--set", name, "--fit", tmp_path / f"{name}.json")
        result = ecat(*call, "-o", tmp_path / f"{name}.parquet", "--json")
        assert result.code == 1
        said = [f"{one['what']} {one['where']}" for one in result.json["failures"]]
        assert len(said) == len(words)
        assert all(any(word in text for text in said) for word in words)
    one_box = sessions.draft(markers_3d=sessions.only(sessions.SHELL))
    wrong = sessions.make(tmp_path / "project" / "wrong", one_box, process=False).path
    result = ecat("learn", "features", wrong, "--set", "ch5-network", "-o", tmp_path / "f.parquet", "--json")
    assert result.code == 1
    assert str(wrong) in result.json["error"]["where"]


def test_a_transform_is_replaced_only_together_with_its_features(
    exports: Path, tmp_path: Path, ecat: Ecat
) -> None:
    planes, dest = tmp_path / "planes.json", tmp_path / "f.parquet"
    call = ("learn", "features", "--set", "ch4-pcas18", "--fit", planes, "-o", dest)
    assert ecat(*call, exports / "pushto.txt").code == 0
    before = planes.read_bytes(), dest.read_bytes()
    assert ecat(*call, exports / "deeper" / "pullpast.txt").code == 1
    assert (planes.read_bytes(), dest.read_bytes()) == before
    planes.write_text("mine", "utf-8")
    dest.unlink()
    assert ecat(*call, exports / "pushto.txt").code == 1
    assert planes.read_text("utf-8") == "mine"
    assert not dest.exists()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--set", "ch5-network", "-o", "OUT"), 2, "SOURCE"),
        (("SESSION", "-o", "OUT"), 2, "--set"),
        (("SESSION", "--set", "ch5-network"), 2, "-o FILE"),
        (("SESSION", "--set", "ch7", "-o", "OUT"), 2, "ch5-network"),
        (("SESSION", "--set", "ch4-qsr25", "-o", "OUT"), 2, "--fit"),
        (("SESSION", "--set", "ch4-raw", "--fit", "t.json", "-o", "OUT"), 2, "no transform"),
        (("SESSION", "--set", "ch4-qsr25", "--fit", "a", "--transform", "b", "-o", "OUT"), 2, "one of them"),
        (("SESSION", "--set", "ch4-qsr25", "--transform", "none.json", "-o", "OUT"), 1, "none.json"),
        (("SESSION", "--set", "ch5-network", "--objects", "Shell", "x", "-o", "OUT"), 2, "Stella Artois"),
        (("nowhere", "--set", "ch5-network", "-o", "OUT"), 1, "nowhere"),
        (("EXPORTS", "--set", "ch5-network", "-o", "OUT"), 2, "table"),
    ],
)
def test_a_wrong_call_is_one_error_and_leaves_no_file(
    arguments: tuple[str, ...],
    code: int,
    said: str,
    processed: Path,
    exports: Path,
    tmp_path: Path,
    ecat: Ecat,
) -> None:
    dest = tmp_path / "f.parquet"
    places = {"SESSION": processed, "OUT": dest, "EXPORTS": exports}
    result = ecat("learn", "features", *(places.get(word, word) for word in arguments), "--json")
    assert result.code == code
    assert said in str(result.json["error"])
    assert not dest.exists()


def test_other_files_beside_exports_are_left_out_and_named(exports: Path, tmp_path: Path, ecat: Ecat) -> None:
    (exports / "README.txt").write_text("hello", "utf-8")
    result = ecat("learn", "features", exports, "--set", "ch4-raw", "-o", tmp_path / "f.parquet", "--json")
    assert result.code == 0, result.err
    assert len(result.json["findings"]) == 1
    assert "README.txt was left out" in result.json["findings"][0]


@pytest.mark.parametrize(("named", "error"), [("", "NotFoundError"), ("notes.txt", "FormatError")])
def test_a_file_that_is_no_export_is_one_error(named: str, error: str, tmp_path: Path, ecat: Ecat) -> None:
    (tmp_path / "notes.txt").write_text("hello", "utf-8")
    source = tmp_path / named
    result = ecat("learn", "features", source, "--set", "ch4-raw", "-o", tmp_path / "f.parquet", "--json")
    assert (result.code, result.json["error"]["error"]) == (1, error)
    assert "notes.txt" in str(result.json["error"])
