"""Files that lie beside the sessions of ECAT 2018, known by sight and explained."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import FormatError
from ecat.formats import registry
from ecat.formats.ecat2018.body_scheme import KINECT_V2, write_body_scheme
from ecat.formats.ecat2018.coordinate_mapping import CoordinateMapping, write_coordinate_mapping
from ecat.formats.ecat2018.glyphs import code_of, write_glyph
from ecat.formats.ecat2018.options import Exclusive, Options, PredicateForm, write_options
from ecat.formats.ecat2018.program_params import ProgramParams, write_program_params
from tests.formats.recordings.test_ecat_learning import one, written
from tests.formats.recordings.test_ecat_recorder import recording, rig

SIT = PredicateForm("SIT", (1,))


def explained(path: Path) -> dict[str, Any]:
    kind = registry.side_file(path)
    assert kind is not None
    found = {"what": kind.name, **kind.explain(path)}
    json.dumps(found, allow_nan=False)
    return found


def saved(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_options(tmp_path: Path) -> None:
    options = Options(object_predicates=(SIT,), constraints=(Exclusive((SIT,)),), detection_mode="OVERWRITE")
    found = explained(saved(tmp_path / "renamed.xml", write_options(options)))
    assert (found["what"], found["detection_mode"]) == ("ecat-2018 options", "OVERWRITE")
    assert found["interpolation"] == {"Rig": "LEFT_COPY", "Rectangle": "LEFT_COPY", "Glyph": "LEFT_COPY"}
    assert (found["object_predicates"], found["constraints"]) == (["SIT(X)"], ["EXCLUSIVE=SIT(X)"])


def test_program_settings(tmp_path: Path) -> None:
    params = ProgramParams("C:\\here", ("C:\\here", "D:\\there"))
    found = explained(saved(tmp_path / "params.param", write_program_params(params)))
    assert (found["default_workspace"], found["recent_workspaces"]) == ("C:\\here", ["C:\\here", "D:\\there"])


def test_a_coordinate_mapping_whose_middle_is_not_known(tmp_path: Path) -> None:
    near = np.ones((2, 3, 2), np.float32)
    far = np.full((2, 3, 2), 2, np.float32)
    near[1, 1] = far[1, 1] = np.nan
    data = write_coordinate_mapping(CoordinateMapping(near, far))
    found = explained(saved(tmp_path / "CoordinateMapping.dat", data))
    assert [found[name] for name in ("width_px", "height_px", "pixels_without_mapping")] == [3, 2, 1]
    assert found["colour_pixel_of_the_centre"][0] == {"depth_mm": 500, "u_px": None, "v_px": None}


def test_voxml(tmp_path: Path) -> None:
    data = b"<?xml version='1.0'?><!-- a table --><VoxML><Lex><Pred>table</Pred></Lex><Other/></VoxML>"
    found = explained(saved(tmp_path / "t.xml", data))
    assert (found["what"], found["predicate"], found["concavity"]) == ("VoxML entry", "table", None)
    assert (found["used_by_ecat_2018"], found["other_elements"]) == (False, ["<Other/>"])


@pytest.mark.parametrize("glyph", [6, None])
def test_a_glyph(tmp_path: Path, glyph: int | None) -> None:
    cells = code_of(glyph) if glyph is not None else np.ones((5, 5), np.uint8)
    found = explained(saved(tmp_path / "x.GLYPH", write_glyph(cells)))
    assert (found["aruco_original_id"], found["box"]) == ((6, "Pepsi") if glyph else (None, None))
    assert found["as_printed"][0] == ("".join(".#"[cell] for cell in cells[0]))


def test_a_body_scheme(tmp_path: Path) -> None:
    found = explained(saved(tmp_path / "bodyScheme.xml", write_body_scheme(KINECT_V2)))
    assert found["joints"][3] == "Head"
    assert found["bones"][0] == "SpineBase - SpineMid"


def test_skeletons_and_depth_of_the_recorder(tmp_path: Path) -> None:
    folder = recording(tmp_path / "in", "x")
    found = explained(folder / "rig_x.xml")
    assert (found["records"], found["duration_s"]) == (3, 0.34)
    assert found["bodies"] == [{"body": "slot 2", "records": 3}]
    depth = explained(folder / "depth_x.dep")
    assert (depth["width_px"], depth["height_px"], depth["frames"]) == (34, 24, 12)
    assert depth["duration_s"] == pytest.approx(0.363)


def test_of_damaged_skeletons_what_can_be_read_is_told(tmp_path: Path) -> None:
    whole = rig(tmp_path / "rig_a.xml", [0, 33, 66]).read_bytes()
    found = explained(saved(tmp_path / "rig_b.xml", whole[:-200]))
    assert found["records"] == 2
    assert "damaged" in found["findings"][0]


def test_an_event_export(tmp_path: Path) -> None:
    found = explained(written(tmp_path / "pull.txt", one("a"), one("b")))
    assert (found["frames"], found["events"]) == (2, 2)
    assert found["labels"]["verb"] == "pulls"
    assert found["sessions"][0] == {"name": "a", "frames": 1, "events": 1}


def test_a_project_list(tmp_path: Path) -> None:
    assert explained(saved(tmp_path / "p.project", b"Session1\r\nSession2\r\n"))["sessions"] == [
        "Session1",
        "Session2",
    ]


class TestSight:
    @pytest.mark.parametrize(
        "make",
        [
            lambda folder: saved(folder / "a.xml", b"<other/>"),
            lambda folder: saved(folder / "a.txt", b"option"),
            lambda folder: saved(folder / "option.txt", b""),
            lambda folder: saved(folder / "rig_1.xml", b"<annotation/>"),
            lambda folder: saved(folder / "a.mp4", b"\0\0\0\x18ftyp"),
            lambda folder: folder,
            lambda folder: folder / "nothing.dep",
        ],
    )
    def test_anything_else_is_none(self, tmp_path: Path, make: Callable[[Path], Path]) -> None:
        assert registry.side_file(make(tmp_path)) is None

    @pytest.mark.parametrize(
        "name",
        [
            "option.txt",
            "params.param",
            "bodyScheme.xml",
            "rig_1.xml",
            "a.dep",
            "a.glyph",
            "coordinateMapping.dat",
        ],
    )
    def test_a_file_of_a_known_name_that_holds_something_else_is_an_error_that_says_so(
        self, tmp_path: Path, name: str
    ) -> None:
        kind = registry.side_file(saved(tmp_path / name, b"nonsense?"[:3]))
        assert kind is not None
        with pytest.raises(FormatError, match=f"cannot read .*{name}"):
            kind.explain(tmp_path / name)

    def test_the_real_ones(self, shared: Path) -> None:
        program = shared / "ecat_program"
        paths = [program / "option.txt", program / "coordinateMapping.dat", program / "square_table.xml"]
        found = [explained(path)["what"] for path in (*paths, program / "glyphs" / "5.glyph")]
        assert found == [
            "ecat-2018 options",
            "ecat-2018 coordinate mapping",
            "VoxML entry",
            "ecat-2018 glyph",
        ]
