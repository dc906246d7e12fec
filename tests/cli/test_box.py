"""``ecat box``: boxes of one's own, in a file that the tracker reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from ecat.cli.box import command
from ecat.errors import FormatError, InputError, UsageError
from ecat.geometry.markers import dictionary_code
from ecat.model.prototype import SHELL, nominal_face
from ecat.process import read_prototypes


def run(*arguments: object) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*map(str, arguments), "--json"], catch_exceptions=False)
    return json.loads(result.stdout)


def test_a_box_has_the_faces_that_were_asked_for(tmp_path: Path) -> None:
    dest = tmp_path / "boxes.json"
    said = run(
        dest,
        "--name",
        "Red",
        "--size",
        0.06,
        "--dictionary",
        "DICT_4X4_50",
        "--face",
        "+z=3:0.045",
        "--face",
        "-x=7",
    )
    (box,) = read_prototypes(dest)
    size = (0.06, 0.06, 0.06)
    assert (box.name, box.size_m) == ("Red", size)
    assert box.faces == (
        nominal_face("+z", dictionary_code("DICT_4X4_50", 3), 0.045, size),
        nominal_face("-x", dictionary_code("DICT_4X4_50", 7), 0.042, size),
    )
    assert said["box"] == box.to_dict()


def test_a_box_need_not_be_a_cube(tmp_path: Path) -> None:
    dest = tmp_path / "boxes.json"
    run(dest, "--name", "Long", "--size", "0.12,0.06,0.04", "--face", "+z=1", "--face", "+x=2")
    (box,) = read_prototypes(dest)
    top, right = box.faces
    assert (top.centre, right.centre) == ((0.0, 0.0, 0.02), (0.06, 0.0, 0.0))
    assert (top.side_m, right.side_m) == (0.042, 0.028)  # 70 % of what there is room for


def test_boxes_join_those_in_the_file_and_replace_their_namesakes(tmp_path: Path) -> None:
    dest = tmp_path / "boxes.json"
    for name, number in (("A", 0), ("B", 1), ("A", 2)):
        said = run(dest, "--name", name, "--size", 0.05, "--face", f"+z={number}")
    codes = {box.name: box.faces[0].code for box in read_prototypes(dest)}
    assert codes == {"B": dictionary_code("DICT_5X5_50", 1), "A": dictionary_code("DICT_5X5_50", 2)}
    assert said["n_boxes"] == 2


def test_glyph_files_are_markers_too(tmp_path: Path) -> None:
    code = SHELL.faces[0].code
    glyph = tmp_path / "426.glyph"
    glyph.write_text("\n".join(code[i : i + 5] for i in range(0, 25, 5)))
    dest = tmp_path / "boxes.json"
    run(dest, "--name", "Shell", "--size", 0.1524, "--face", f"+z={glyph}:0.089")
    assert read_prototypes(dest)[0].faces == (SHELL.faces[0],)
    glyph.write_text("nothing")
    with pytest.raises(FormatError, match="expected 5 lines"):
        run(dest, "--name", "Shell", "--size", 0.1524, "--face", f"+z={glyph}")


def test_markers_are_printed_beside_the_file(tmp_path: Path) -> None:
    dest, sheet = tmp_path / "boxes.json", tmp_path / "red.svg"
    faces = [
        part for i, f in enumerate(("+x", "-x", "+y", "-y", "+z", "-z")) for part in ("--face", f"{f}={i}")
    ]
    assert run(dest, "--name", "Red", "--size", 0.05, *faces, "--print", sheet)["sheets"] == [str(sheet)]
    assert sheet.read_text().count('class="marker"') == 6
    pages = run(
        dest,
        "--name",
        "Large",
        "--size",
        0.16,
        "--face",
        "+x=7",
        "--face",
        "+y=8",
        "--face",
        "+z=9",
        "--print",
        sheet,
    )["sheets"]
    assert pages == [str(tmp_path / f"red-{i}.svg") for i in (1, 2, 3)]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--size", "six", "--face", "+z=0"], "expected one or three lengths"),
        (["--size", "0.06,0.06", "--face", "+z=0"], "expected one or three lengths"),
        (["--size", "0.06", "--face", "top=0"], "--face top=0"),
        (["--size", "0.06", "--face", "+z=0:0.07"], "does not fit"),
        (["--size", "0.06", "--face", "+z=0:1.2.3"], "expected a length"),
        (["--size", "0.06", "--face", "+z=99"], "no marker 99"),
        (["--size", "0.06", "--face", "+z=1", "--dictionary", "DICT"], "no dictionary 'DICT'"),
        (["--size", "0.06", "--face", "+z=1", "--face", "+z=2"], "the same face occurs twice"),
        (["--size", "0.06", "--face", "+z=1", "--face", "-z=1"], "the same code occurs twice"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    tmp_path: Path, arguments: list[str], says: str
) -> None:
    dest = tmp_path / "boxes.json"
    with pytest.raises((UsageError, InputError)) as error:
        run(dest, "--name", "Red", *arguments)
    assert says in str(error.value)
    assert not dest.exists()


def test_two_boxes_with_the_same_marker_are_refused(tmp_path: Path) -> None:
    dest = tmp_path / "boxes.json"
    run(dest, "--name", "A", "--size", 0.05, "--face", "+z=0")
    with pytest.raises(InputError, match=r"A \+z and B -x carry the same marker"):
        run(dest, "--name", "B", "--size", 0.05, "--face", "-x=0")
    assert [box.name for box in read_prototypes(dest)] == ["A"]
