"""Manifests as JSON: stable bytes, every problem named, and nothing hostile gets through."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import EcatError, FormatError, SchemaError
from ecat.model import Camera, Clock, LayerRecord, Manifest, ProjectManifest, Provenance, Stream, TableRecord
from ecat.store import manifest_schema, project_schema
from ecat.store.manifest import dump_manifest, is_file_name, is_plain_name, parse_manifest

PATH = Path("session/session.json")

FULL = Manifest(
    name="phiên 1",
    created="2020-01-01T00:00:00+07:00",
    n_frames=100,
    clock=Clock(rule="uniform", start="2020-01-01T00:00:00", duration_ns=3_000_000_000),
    cameras=(
        Camera(
            name="color", width_px=1920, height_px=1080, fx_px=1081.37, fy_px=1081.37,
            cx_px=959.5, cy_px=539.5, distortion=(0.1, -0.2), source="nominal",
        ),
    ),
    streams=(Stream(name="color", kind="color", file="media/color.avi", present=True, size_bytes=5),),
    layers=(LayerRecord(name="main", file="annotations/main.xml", sha256="cd"),),
    tables=(
        TableRecord(
            name="poses", file="tables/poses.parquet", sha256="ef", rows=3, stage="pose",
            parameters={"a": [1, 2.5, None, {"b": "c"}]}, inputs={"markers_2d": "00"},
        ),
    ),
    prototypes=({"name": "box", "size_m": [0.1, 0.2, 0.3]},),
    provenance=Provenance(format="ecat-2018", source="Session1", notes=("a note",)),
    foreign={"ecat-2018:x": "y"},
)  # fmt: skip


def plain() -> dict[str, Any]:
    """``FULL`` as JSON data."""
    return json.loads(dump_manifest(FULL, PATH))


def problems(data: dict[str, Any]) -> tuple[str, ...]:
    """What is wrong with ``data``."""
    with pytest.raises(SchemaError) as caught:
        parse_manifest(json.dumps(data).encode(), PATH, Manifest)
    return caught.value.problems


def test_what_is_written_is_read_back() -> None:
    assert parse_manifest(dump_manifest(FULL, PATH), PATH, Manifest) == FULL
    project = ProjectManifest(name="p", created="2020-01-01T00:00:00", kind="workspace")
    assert parse_manifest(dump_manifest(project, PATH), PATH, ProjectManifest) == project


def test_the_bytes_are_stable_and_fit_for_diffs() -> None:
    data = dump_manifest(FULL, PATH)
    assert data == dump_manifest(parse_manifest(data, PATH, Manifest), PATH)
    lines = data.decode().splitlines()
    assert lines[:3] == ["{", '  "schema_version": 1,', '  "name": "phiên 1",']
    assert data.endswith(b"}\n")
    assert list(plain()) == [field.name for field in fields(Manifest)]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_read_back_to_the_last_bit(number: float) -> None:
    camera = replace(FULL.cameras[0], fx_px=number)
    data = dump_manifest(replace(FULL, cameras=(camera,)), PATH)
    assert parse_manifest(data, PATH, Manifest).cameras == (camera,)


def test_the_schemas_describe_what_is_written() -> None:
    jsonschema.validate(plain(), manifest_schema())
    project = dump_manifest(ProjectManifest(name="p", created="2020"), PATH)
    jsonschema.validate(json.loads(project), project_schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(plain() | {"nonsense": 1}, manifest_schema())


def test_every_problem_is_reported_with_its_path() -> None:
    data = plain()
    del data["name"]
    data["cameras"][0] |= {"fx_px": "1", "colour": True}
    data["clock"]["rule"] = "sundial"
    assert {problem.split(":")[0] for problem in problems(data)} == {
        "name",
        "cameras[0].fx_px",
        "cameras[0].colour",
        "clock.rule",
    }


def test_a_newer_version_is_named_as_such() -> None:
    with pytest.raises(SchemaError, match="written by a newer ecat") as caught:
        parse_manifest(json.dumps(plain() | {"schema_version": 2, "new": 1}).encode(), PATH, Manifest)
    assert caught.value.fix == "upgrade ecat"


@pytest.mark.parametrize(
    "data", [b"", b"{", b"[" * 100_000, b'{"a":' * 5000, b"\xff", b'{"name": "\\ud800"}', b"nul", b"{}x"]
)
def test_what_is_not_json_is_a_format_error(data: bytes) -> None:
    with pytest.raises(FormatError) as caught:
        parse_manifest(data, PATH, Manifest)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    "file",
    ["/etc/passwd", "../outside", "media/../../x", "C:/x", "C:x", "\\\\host\\x", "a\\b", "a\0b", "", " "],
)
def test_paths_never_leave_the_session(file: str) -> None:
    data = plain()
    data["streams"][0]["file"] = file
    assert problems(data) == ("streams[0].file: expected a path inside the session's folder",)


def test_tables_and_layers_have_one_place_each() -> None:
    data = plain()
    data["tables"][0]["file"] = "tables/events.parquet"
    data["layers"][0] |= {"name": "../x", "file": "annotations/../x.xml"}
    assert {problem.split(":")[0] for problem in problems(data)} == {"tables[0].file", "layers[0].name"}


def test_names_occur_once_and_counts_are_counts() -> None:
    data = plain()
    data["cameras"] *= 2
    data["n_frames"] = 2**31
    data["tables"][0]["rows"] = -1
    data["clock"]["duration_ns"] = 2**63
    data["name"] = "a/b"
    assert len(problems(data)) == 5


def test_very_many_problems_are_counted_not_listed() -> None:
    data = plain()
    data["cameras"] = [{}] * 5000
    assert len(problems(data)) == 100


def test_what_could_not_be_read_back_is_not_written() -> None:
    for wrong in (
        replace(FULL, cameras=(replace(FULL.cameras[0], cx_px=float("nan")),)),
        replace(FULL, n_frames=-1),
        replace(FULL, prototypes=({"path": PATH.open},)),
        replace(FULL, streams=(Stream(name="x", file="/abs"),)),
    ):
        with pytest.raises(SchemaError):
            dump_manifest(wrong, PATH)


def test_a_name_that_no_document_can_hold_is_named() -> None:
    """Linux names files by bytes; Python shows those that are not UTF-8 as lone surrogates."""
    for wrong in (
        replace(FULL, name="a\udcff"),
        replace(FULL, streams=(Stream(name="a\udcff", file="media/a"),)),
        replace(FULL, foreign={"x": "a\udcff"}),
    ):
        with pytest.raises(FormatError, match="cannot write session") as caught:
            dump_manifest(wrong, PATH)
        assert caught.value.where == "a\\udcff: the name is not UTF-8"
        assert caught.value.fix.startswith("rename")


@pytest.mark.parametrize(
    ("name", "plain_name", "file_name"),
    [
        ("main", True, True),
        ("Đỗ Tuấn 2", True, True),
        ("a.b-c@d+e", True, True),
        (".hidden", True, False),
        ("-x", True, False),
        ("..", False, False),
        ("a/b", False, False),
        ("a\nb", False, False),
        ("", False, False),
        ("x" * 201, True, False),
        ("main\n", False, False),
    ],
)
def test_names(name: str, plain_name: bool, file_name: bool) -> None:
    assert is_plain_name(name) is plain_name
    assert is_file_name(name) is file_name


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just(".."),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path of every value in ``data``."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [path, *(place for key, value in inner for place in places(value, (*path, key)))]


def read_and_write(data: bytes) -> str:
    """Read a manifest and write it again: the message of the one error that is allowed, or nothing."""
    try:
        dump_manifest(parse_manifest(data, PATH, Manifest), PATH)
    except EcatError as error:
        return str(error)
    return ""


@given(data=st.data())
@settings(max_examples=300, deadline=None)
def test_a_hostile_manifest_is_a_value_or_one_typed_error(data: st.DataObject) -> None:
    document: Any = plain()
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(places(document)))
        value = data.draw(JSON)
        if not place:
            document = value
            continue
        owner = document
        for key in place[:-1]:
            owner = owner[key]
        owner[place[-1]] = value
    message = read_and_write(json.dumps(document).encode())
    assert len(message) < 5000


@given(st.binary(max_size=8), st.integers(0, 3000), st.integers(0, 8))
@settings(max_examples=200, deadline=None)
def test_a_manifest_with_damaged_bytes_is_a_value_or_one_typed_error(noise: bytes, at: int, cut: int) -> None:
    data = dump_manifest(FULL, PATH)
    message = read_and_write(data[:at] + noise + data[at + cut :])
    assert len(message) < 5000
