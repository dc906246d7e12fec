"""``ecat info``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ecat.formats.ecat2018.coordinate_mapping import CoordinateMapping, write_coordinate_mapping
from ecat.formats.ecat2018.glyphs import code_of, write_glyph
from ecat.formats.ecat2018.options import Options, PredicateForm, write_options
from ecat.model import (
    AnnotatedObject,
    Camera,
    Clock,
    Event,
    KeyFrame,
    Layer,
    Manifest,
    ProjectManifest,
    Provenance,
    Relation,
    Segment,
    Stream,
)
from ecat.model.annotation import Argument
from ecat.store import Draft, create_project, create_session

if TYPE_CHECKING:
    from conftest import Ecat

CREATED = "2026-01-01T00:00:00Z"
MANIFEST = Manifest(
    name="Session1",
    created=CREATED,
    n_frames=2649,
    clock=Clock(rule="uniform", start="2017-10-04T22:35:30.583746", duration_ns=88_357_000_000),
    cameras=(
        Camera(
            name="color",
            width_px=1920,
            height_px=1080,
            fx_px=1065.5,
            fy_px=1066.0,
            cx_px=967.1,
            cy_px=548.9,
            mirrored=True,
            source="fitted",
        ),
    ),
    streams=(
        Stream(name="color", kind="color", file="color.avi", codec="mpeg4", camera="color", n_frames=2649),
        Stream(name="skeleton", kind="skeleton", file="rig.xml"),
    ),
    provenance=Provenance(format="ecat-2018", source="Session1", software="ECAT", notes=("one odd thing",)),
)
LAYER = Layer(
    scheme="ecat-2018",
    objects=(
        AnnotatedObject(id="o1", kind="rig"),
        AnnotatedObject(id="o2", kind="marker_box"),
        AnnotatedObject(id="o3", kind="marker_box"),
        AnnotatedObject(
            id="o4", kind="polygon", key_frames=(KeyFrame(frame=0, coordinates=(0, 0, 1, 0, 1, 1)),)
        ),
    ),
    events=tuple(
        Event(id=f"a{i}", type=kind, segments=(Segment(start_frame=i, end_frame=i + 9),))
        for i, kind in enumerate(("slide", "slide", "grasp", ""))
    ),
    relations=(
        Relation(predicate="ON", start_frame=3, arguments=(Argument(target="o2"), Argument(target="o4"))),
    ),
)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "SlideAway"
    source = Provenance(format="ecat-2018", source="SlideAway")
    create_project(folder, ProjectManifest(name="SlideAway", created=CREATED, provenance=source))
    create_session(folder / "Session1", Draft(manifest=MANIFEST, layers=(LAYER,)))
    create_session(folder / "Session2", Draft(manifest=replace(MANIFEST, name="Session2"), layers=(LAYER,)))
    return folder


def test_a_session_in_full(ecat: Ecat, project: Path) -> None:
    result = ecat("info", project / "Session1")
    assert (result.code, result.err) == (0, "")
    assert (
        result.out
        == """\
session Session1
  frames    2,649
  duration  1 min 28.357 s
  clock     uniform, from 2017-10-04T22:35:30.583746
  boxes     not calibrated
  source    Session1 (ecat-2018 by ECAT)

cameras
  color  1920 x 1080 px  f 1065.5, 1066.0 px  c 967.1, 548.9 px  mirrored  fitted

streams
  color     color     missing  mpeg4  2,649 frames
  skeleton  skeleton  missing

layer main, revision 1, coding scheme ecat-2018
  objects    4  2 marker_box, 1 polygon, 1 rig
  events     4  2 slide, 1 grasp
  relations  1  1 ON

tables
  event_links     0  rows  publish
  event_roles     0  rows  publish
  event_segments  4  rows  publish
  events          4  rows  publish
  keyframes       3  rows  publish
  objects         4  rows  publish
  relations       1  rows  publish

notes
  one odd thing
"""
    )


def test_a_project_in_short(ecat: Ecat, project: Path) -> None:
    result = ecat("info", project)
    assert (result.code, result.err) == (0, "")
    assert (
        result.out
        == """\
project SlideAway
  sessions   2
  frames     5,298
  objects    8
  events     8
  relations  2
  duration   2 min 56.714 s
  source     SlideAway (ecat-2018)

sessions
  Session1  2,649  frames  4  objects  4  events  1  relations
  Session2  2,649  frames  4  objects  4  events  1  relations

notes
  none
"""
    )


def test_what_is_printed_does_not_depend_on_where_it_lies(ecat: Ecat, project: Path, tmp_path: Path) -> None:
    first = ecat("info", project).out, ecat("info", project / "Session1").out
    moved = project.rename(tmp_path / "elsewhere")
    assert (ecat("info", moved).out, ecat("info", moved / "Session1").out) == first


def test_a_session_as_data(ecat: Ecat, project: Path) -> None:
    found = ecat("info", project / "Session1", "--json").json
    assert found["ok"] is True
    assert (found["kind"], found["name"], found["frames"], found["duration_s"]) == (
        "session",
        "Session1",
        2649,
        88.357,
    )
    assert found["layers"][0]["objects"] == {"rig": 1, "marker_box": 2, "polygon": 1}
    assert {"name": "events", "rows": 4, "stage": "publish"} in found["tables"]


def test_a_project_as_data_lists_every_session(ecat: Ecat, project: Path) -> None:
    found = ecat("info", project, "--json").json
    assert [session["path"] for session in found["sessions"]] == ["Session1", "Session2"]
    assert found["totals"]["events"] == 8


def test_a_long_project_is_cut_for_people(ecat: Ecat, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecat.cli.info.MOST_SESSIONS", 1)
    assert "  and 1 more; --json lists all\n" in ecat("info", project).out


def test_any_folder_of_sessions_will_do(ecat: Ecat, project: Path) -> None:
    (project / "project.json").unlink()
    assert ecat("info", project).out.startswith("folder SlideAway\n")


def test_a_broken_session_does_not_hide_the_others(ecat: Ecat, project: Path) -> None:
    (project / "Session2" / "session.json").write_text("{", "utf-8")
    result = ecat("info", project)
    assert result.code == 0
    assert "  Session2  cannot read session.json\n" in result.out


def test_a_session_without_a_clock(ecat: Ecat, tmp_path: Path) -> None:
    create_session(tmp_path / "s", Draft(manifest=Manifest(name="clip", created=CREATED)))
    lines = ecat("info", tmp_path / "s").out.splitlines()
    assert lines[:6] == [
        "session clip",
        "  frames    unknown",
        "  duration  unknown",
        "  clock     unknown",
        "  boxes     not calibrated",
        "  source    unknown",
    ]


def test_recordings_that_do_not_say_their_length_are_not_of_length_0(ecat: Ecat, tmp_path: Path) -> None:
    create_session(tmp_path / "p" / "bare", Draft(manifest=Manifest(name="bare", created=CREATED)))
    printed = ecat("info", tmp_path / "p").out
    assert "  frames     unknown" in printed
    assert "  bare  unknown  frames" in printed


def test_where_there_is_nothing(ecat: Ecat, tmp_path: Path) -> None:
    result = ecat("info", tmp_path / "nowhere")
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("ecat: cannot find sessions in nowhere\n")


class TestFiles:
    """What lies beside the recordings of another program."""

    def test_as_text(self, ecat: Ecat, tmp_path: Path) -> None:
        options = Options(
            object_predicates=(PredicateForm("SIT", (1,)), PredicateForm("NEAR", (1, 2))), show_markers=True
        )
        (tmp_path / "option.txt").write_bytes(write_options(options))
        result = ecat("info", tmp_path / "option.txt")
        assert (result.code, result.err) == (0, "")
        assert (
            result.out
            == """\
file option.txt
  what                  ecat-2018 options
                        settings of ECAT 2018: its predicates, which exclude each other, how shapes are interpolated
  detection mode        ADD_SEPARATE
  glyph prototype path  unknown
  show markers          yes
  show rig              SHOW_ALL

interpolation
  Rig        LEFT_COPY
  Rectangle  LEFT_COPY
  Glyph      LEFT_COPY

object predicates
  SIT(X)
  NEAR(X,Y)
"""
        )

    def test_numbers_have_their_unit_or_what_they_count(self, ecat: Ecat, tmp_path: Path) -> None:
        mapping = CoordinateMapping(np.ones((2, 3, 2), np.float32), np.ones((2, 3, 2), np.float32))
        (tmp_path / "coordinateMapping.dat").write_bytes(write_coordinate_mapping(mapping))
        lines = ecat("info", tmp_path / "coordinateMapping.dat").out.splitlines()
        assert "  near                    500 mm" in lines
        assert "    500  mm  1.0  px  1.0  px" in lines

    def test_as_data(self, ecat: Ecat, tmp_path: Path) -> None:
        (tmp_path / "5.glyph").write_bytes(write_glyph(code_of(5)))
        found = ecat("info", tmp_path / "5.glyph", "--json").json
        assert [found[key] for key in ("ok", "kind", "name", "what")] == [
            True,
            "file",
            "5.glyph",
            "ecat-2018 glyph",
        ]
        assert found["holds"]["aruco_original_id"] == 5

    def test_of_any_other_file_it_says_what_it_wants(self, ecat: Ecat, tmp_path: Path) -> None:
        (tmp_path / "notes.txt").write_text("hello")
        result = ecat("info", tmp_path / "notes.txt")
        assert result.code == 1
        assert "it is a file, not a folder" in result.err
