"""``ecat learn qsr``: a table of tracks in, a table of relations out, or one error."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ecat.cli.verb import Verb, leaves
from learn.cli import learn
from learn.cli.qsr import NAMES
from learn.features import qsr
from learn.features.qsr import RELATIONS, rows

if TYPE_CHECKING:
    from conftest import Ecat

EVERY = pytest.mark.parametrize("name", RELATIONS)
OPTIONS = {
    "argd": ["--thresholds", "near=1,far=3"],
    "argprobd": ["--thresholds", "near=1:1,far=3:2", "--seed", "5"],
    "mos": ["--quantisation", "0.5"],
    "qtccs": ["--quantisation", "0.5", "--angle", "0.2"],
    "qtcbcs": ["--distance", "3"],
}
PARAMETERS: dict[str, dict[str, Any]] = {
    "argd": {"thresholds": {"near": 1, "far": 3}},
    "mos": {"threshold": 0.5},
    "qtccs": {"threshold": 0.5, "angle": 0.2},
    "qtcbcs": {"distance": 3},
}


def walks(n_tracks: int = 3, n_frames: int = 20) -> pa.Table:
    """Random walks on a grid of three boxes."""
    generator = np.random.default_rng(1)
    n = n_tracks * n_frames
    columns: dict[str, Any] = {
        "track": np.repeat(np.arange(n_tracks), n_frames),
        "frame": np.tile(np.arange(n_frames), n_tracks),
    }
    for k in (1, 2, 3):
        columns |= {f"{axis}{k}": np.cumsum(generator.integers(-1, 2, n)) / 2.0 for axis in "xy"}
        columns |= {f"{axis}{k}": generator.integers(0, 4, n) for axis in "wh"}
    return pa.table(columns)


def write(table: pa.Table, folder: Path) -> Path:
    path = folder / "tracks.parquet"
    pq.write_table(table, path)
    return path


def expected(table: pa.Table, name: str, parameters: dict[str, Any]) -> list[dict[str, Any]]:
    """What the library says of each track."""
    relation, found = RELATIONS[name], list[dict[str, Any]]()
    letters = "xywh" if relation.of_boxes else "xy"
    for track in np.unique(table["track"].to_numpy()).tolist():
        mine = table.filter(pa.array([each == track for each in table["track"].to_pylist()]))
        mine = mine.sort_by("frame")
        objects = [
            np.array([mine[f"{letter}{k}"].to_numpy() for letter in letters], np.float64).T
            for k in range(1, relation.objects + 1)
        ]
        names = qsr.to_names(relation.compute(*objects, **parameters), relation.values_of(parameters))
        frames = mine["frame"].to_pylist()[relation.frames - 1 :]
        found += [
            {"track": track, "frame": frame, name: value} for frame, value in zip(frames, names, strict=True)
        ]
    return found


# --- what is computed


def test_the_help_knows_every_relation() -> None:
    assert set(NAMES) == set(RELATIONS)


@EVERY
def test_values_are_those_of_the_library_for_every_track(
    ecat: Ecat, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    table, dest = walks(), tmp_path / "out.parquet"
    parameters = PARAMETERS.get(name, {})
    if name == "argprobd":
        parameters = {"bands": {"near": (1, 1), "far": (3, 2)}, "generator": qsr.seeded(5)}
    monkeypatch.setattr(rows, "ROWS", 13)  # tracks go on from one batch to the next
    result = ecat(
        "learn", "qsr", write(table, tmp_path), "--relation", name, *OPTIONS.get(name, []), "-o", dest
    )
    assert (result.code, result.err) == (0, "")
    found = pq.read_table(dest)
    assert found.schema.names == ["track", "frame", name]
    assert found.schema.field(name).type == pa.string()
    assert found.to_pylist() == expected(table, name, parameters)


@pytest.mark.parametrize("name", ["cardir", "qtccs", "argprobd"])
@pytest.mark.parametrize("kind", ["integers", "text", "categories"])
def test_the_order_of_rows_and_the_type_of_tracks_do_not_matter(
    ecat: Ecat, tmp_path: Path, name: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "ROWS", 13)
    names = pa.array([f"take {each}" for each in walks()["track"].to_pylist()])
    tracks = {"integers": walks()["track"], "text": names, "categories": names.dictionary_encode()}
    table = walks().set_column(0, "track", tracks[kind])
    shuffled = table.take(pa.array(np.random.default_rng(0).permutation(table.num_rows), pa.int64()))
    results: list[pa.Table] = []
    for k, each in enumerate((table, shuffled)):
        dest = tmp_path / f"{k}.parquet"
        options = ["--relation", name, *OPTIONS.get(name, []), "-o", dest]
        assert ecat("learn", "qsr", write(each, tmp_path), *options).code == 0
        results.append(pq.read_table(dest))
    assert results[0].equals(results[1])
    assert results[0].schema.field("track").type == (pa.int64() if kind == "integers" else pa.string())


def test_a_frame_follows_the_one_before_it_whatever_is_missing_between(ecat: Ecat, tmp_path: Path) -> None:
    table = pa.table(
        {"track": [1, 1, 1], "frame": [0.5, 7.0, 9.0]}
        | {"x1": [0, 1, 2], "y1": [0, 0, 0], "x2": [5, 5, 5], "y2": [0, 0, 1]}
    )
    dest = tmp_path / "out.parquet"
    assert ecat("learn", "qsr", write(table, tmp_path), "--relation", "qtccs", "-o", dest).code == 0
    assert pq.read_table(dest).to_pydict() == {
        "track": [1, 1],
        "frame": [7.0, 9.0],
        "qtccs": ["-,0,0,0", "-,0,0,+"],
    }


@pytest.mark.parametrize("name", ["qtcbs", "qtccs", "qtcbcs"])
@pytest.mark.parametrize("flags", [["--collapse"], ["--validate"], ["--collapse", "--validate"]])
@pytest.mark.parametrize("batch", [7, 1000])
def test_the_frames_of_a_chain_are_places_in_it(
    ecat: Ecat, tmp_path: Path, name: str, flags: list[str], batch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "ROWS", batch)
    table, dest, relation = walks(n_frames=40), tmp_path / "out.parquet", RELATIONS[name]
    x1 = table["x1"].to_numpy().copy()
    x1[[3, 4, 5, 6, 7, 60, 119]] = np.nan
    table = table.set_column(table.schema.get_field_index("x1"), "x1", pa.array(x1))
    assert ecat("learn", "qsr", write(table, tmp_path), "--relation", name, *flags, "-o", dest).code == 0
    said: list[dict[str, Any]] = []
    for track in range(3):
        objects = [
            np.array([table[f"{axis}{k}"].to_numpy() for axis in "xy"]).T[40 * track : 40 * track + 40]
            for k in (1, 2)
        ]
        chain = qsr.chain(
            relation.compute(*objects),
            relation.values,
            collapse="--collapse" in flags,
            validate="--validate" in flags,
        )
        names = qsr.to_names(chain, relation.values)
        said += [{"track": track, "frame": k + 1, name: value} for k, value in enumerate(names)]
    assert pq.read_table(dest).to_pylist() == said


def test_what_is_not_known_is_null_and_counted(ecat: Ecat, tmp_path: Path) -> None:
    table = pa.table(
        {"track": ["a"] * 4, "frame": range(4)}
        | {"x1": [0.0, None, math.nan, 1.0], "y1": [0.0] * 4, "x2": [1.0] * 4, "y2": [1.0] * 4}
    )
    dest = tmp_path / "out.parquet"
    call = ("learn", "qsr", write(table, tmp_path), "--relation", "cardir", "-o", dest)
    assert ecat(*call, "--json").json == {
        "ok": True,
        "path": str(dest),
        "rows": 4,
        "tracks": 1,
        "missing": 2,
        "findings": [],
    }
    assert pq.read_table(dest)["cardir"].to_pylist() == ["sw", None, None, "s"]


def test_places_may_be_numbers_of_any_kind(ecat: Ecat, tmp_path: Path) -> None:
    table = walks()
    half = pa.array(table["x1"].to_numpy().astype(np.float16))
    other = table.set_column(table.column_names.index("x1"), "x1", half)
    other = other.set_column(other.column_names.index("y2"), "y2", table["y2"].cast(pa.float32()))
    found: list[pa.Table] = []
    for number, one in enumerate((table, other, other.take(pa.array(range(60)[::-1])))):
        dest = tmp_path / f"{number}.parquet"
        assert ecat("learn", "qsr", write(one, tmp_path), "--relation", "cardir", "-o", dest).code == 0
        found.append(pq.read_table(dest))
    assert found[0].equals(found[1])
    assert found[0].equals(found[2])


def test_movement_of_another_object(ecat: Ecat, tmp_path: Path) -> None:
    table = pa.table({"track": [0, 0], "frame": [0, 1], "x2": [0, 1], "y2": [0, 0]})
    dest = tmp_path / "out.parquet"
    assert (
        ecat("learn", "qsr", write(table, tmp_path), "--relation", "mos", "--object", "2", "-o", dest).code
        == 0
    )
    assert pq.read_table(dest)["mos"].to_pylist() == ["m"]


def test_a_track_of_one_frame_has_no_movement(ecat: Ecat, tmp_path: Path) -> None:
    table, dest = walks(n_tracks=5, n_frames=1), tmp_path / "out.parquet"
    for flags in ([], ["--collapse"]):
        result = ecat(
            "learn", "qsr", write(table, tmp_path), "--relation", "qtccs", *flags, "-o", dest, "--json"
        )
        assert (result.json["rows"], result.json["tracks"]) == (0, 5)
        assert pq.read_table(dest).num_rows == 0
        dest.unlink()


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        (["near=1,far=3"], {"near", "far"}),
        (["1,3"], {"1", "3"}),
        (["1 3"], {"1", "3"}),
        (["near=1", "3"], {"near", "3"}),
        (['{"near": 1, "far": 3.0}'], {"near", "far"}),
    ],
)
def test_thresholds_may_have_names(ecat: Ecat, tmp_path: Path, texts: list[str], names: set[str]) -> None:
    dest = tmp_path / "out.parquet"
    options = [word for text in texts for word in ("--thresholds", text)]
    source = write(walks(), tmp_path)
    assert ecat("learn", "qsr", source, "--relation", "argd", *options, "-o", dest).code == 0
    assert set(pq.read_table(dest)["argd"].to_pylist()) == names


def test_what_another_relation_takes_may_be_given_where_it_is_nothing(ecat: Ecat, tmp_path: Path) -> None:
    dest = tmp_path / "out.parquet"
    options = ["--relation", "cardir", "--quantisation", "0", "-o", dest]
    assert ecat("learn", "qsr", write(walks(), tmp_path), *options).code == 0


def test_that_objects_without_sizes_are_points_is_said_beside_the_result(ecat: Ecat, tmp_path: Path) -> None:
    bare, dest = write(walks().drop_columns(["w1", "w2", "h2"]), tmp_path), tmp_path / "out.parquet"
    result = ecat("learn", "qsr", bare, "--relation", "rcc8", "-o", dest)
    assert "objects 1, 2 are points" in result.err
    assert "w1, h1, w2, h2" in result.err
    assert ecat("learn", "qsr", bare, "--relation", "cardir", "-o", tmp_path / "c.parquet").err == ""
    found = ecat("learn", "qsr", bare, "--relation", "ra", "-o", tmp_path / "j.parquet", "--json").json
    assert len(found["findings"]) == 1
    sized = write(walks(), tmp_path)
    assert ecat("learn", "qsr", sized, "--relation", "rcc8", "-o", tmp_path / "s.parquet").err == ""


# --- what is refused


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--relation", "argd"], "no thresholds of its own"),
        (["--relation", "argprobd"], "no thresholds of its own"),
        (["--relation", "argd", "--thresholds", "near=x"], "not a number"),
        (["--relation", "argd", "--thresholds", "near=inf"], "finite"),
        (["--relation", "argd", "--thresholds", "near=1,near=2"], "twice"),
        (["--relation", "argd", "--thresholds", "{"], "thresholds"),
        (["--relation", "argd", "--thresholds", "1:2"], "one finite number"),
        (["--relation", "argprobd", "--thresholds", "near=1"], "standard deviation"),
        (["--relation", "argprobd", "--thresholds", "near=1:0"], "deviation"),
        (["--relation", "cardir", "--thresholds", "1"], "leave out --thresholds"),
        (["--relation", "cardir", "--quantisation", "0.1"], "leave out --quantisation"),
        (["--relation", "qtcbs", "--angle", "0.1"], "leave out --angle"),
        (["--relation", "qtccs", "--distance", "0"], "leave out --distance"),
        (["--relation", "cardir", "--collapse"], "leave out collapse"),
        (["--relation", "mos", "--validate"], "leave out collapse"),
        (["--relation", "cardir", "--object", "2"], "leave out --object"),
        (["--relation", "cardir", "--seed", "2"], "leave out --seed"),
        (["--relation", "mos", "--quantisation", "-1"], "0 or more"),
        (["--relation", "mos", "--quantisation", "nan"], "0 or more"),
        (["--relation", "qtccs", "--angle", "4"], "from 0 to pi"),
        (["--relation", "nothing"], "nothing"),
    ],
)
def test_parameters_that_make_no_sense(ecat: Ecat, tmp_path: Path, options: list[str], words: str) -> None:
    dest = tmp_path / "out.parquet"
    result = ecat("learn", "qsr", write(walks(), tmp_path), *options, "-o", dest)
    assert result.code == 2
    assert words in result.err
    assert "try: " in result.err
    assert not dest.exists()


def test_what_is_there_is_not_overwritten(ecat: Ecat, tmp_path: Path) -> None:
    dest = tmp_path / "out.parquet"
    dest.write_text("mine")
    result = ecat("learn", "qsr", write(walks(), tmp_path), "--relation", "cardir", "-o", dest, "--json")
    assert result.json["error"]["error"] == "ExistsError"
    assert dest.read_text() == "mine"


# --- help


@pytest.mark.parametrize("name", [" ".join(path) for path, _ in leaves(learn, ("learn",))])
def test_every_verb_explains_itself_with_examples_that_it_accepts(ecat: Ecat, name: str) -> None:
    command = {" ".join(path): each for path, each in leaves(learn, ("learn",))}[name]
    result = ecat(*name.split(), "--help")
    assert result.code == 0
    assert command.examples
    assert all(example in result.out for example in command.examples)
    if isinstance(command, Verb):
        assert [each.name for each in command.params if not getattr(each, "help", None)] == []
        for example in command.examples:
            command.make_context(name, shlex.split(example)[1 + len(name.split()) :])
