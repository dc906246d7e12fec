"""The project and its sessions."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ecat.annotate import Editor, SetScheme
from ecat.errors import NotFoundError
from ecat.store import open_session
from ecat.web.library import Library

if TYPE_CHECKING:
    from tests.web.conftest import Browser


def test_the_project_lists_every_session_with_what_is_in_it(reader: Browser) -> None:
    project = reader.json("/api/project")
    assert (project["name"], project["layer"]) == ("a study", "main")
    (_, slide) = sorted(project["sessions"], key=lambda s: s["id"] == "slide")
    assert slide["name"] == "slide"
    assert slide["n_frames"] == 180
    assert slide["streams"][:2] == ["color", "depth"]
    assert slide["layers"] == ["main"]
    assert slide["n_events"] > 0
    assert slide["n_objects"] > 0
    assert slide["error"] is None


def test_a_session_whose_path_no_address_can_hold_has_an_id_of_its_own(reader: Browser) -> None:
    (other,) = (s["id"] for s in reader.json("/api/project")["sessions"] if s["id"] != "slide")
    assert other.startswith("a-b-other-")
    assert reader.json(f"/api/sessions/{other}")["name"] == "slide"


def test_a_session_alone_is_a_project_of_one(made_once: Path) -> None:
    assert list(Library(made_once / "slide").find()) == ["slide"]


def test_the_same_name_in_two_folders_makes_two_ids(made_once: Path, tmp_path: Path) -> None:
    for folder in ("one", "two", "one two"):
        shutil.copytree(made_once / "slide", tmp_path / folder / "same")
    assert len(Library(tmp_path).find()) == 3


def test_a_session_that_appears_later_is_found(project: Path, browser: Browser) -> None:
    shutil.copytree(project / "slide", project / "later")
    assert browser.json("/api/sessions/later")["name"] == "slide"


def test_a_session_that_cannot_be_read_says_so_and_hides_no_other(project: Path, browser: Browser) -> None:
    (project / "a b" / "other" / "session.json").write_text("{")
    sessions = browser.json("/api/project")["sessions"]
    assert [s["error"] is None for s in sorted(sessions, key=lambda s: s["id"] == "slide")] == [False, True]


def test_an_empty_folder_is_no_project(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        Library(tmp_path)


def test_a_session_says_what_a_page_needs_to_begin(reader: Browser) -> None:
    found = reader.json("")
    assert (found["id"], found["n_frames"], found["clock"], found["video"]) == (
        "slide",
        180,
        "uniform",
        "color",
    )
    assert found["duration_s"] == pytest.approx(5.969)
    assert found["frame_rate_median"] == pytest.approx(179 / 5.969, rel=0.01)
    streams = {stream["name"]: stream for stream in found["streams"]}
    assert (streams["color"]["n_frames"], streams["color"]["width_px"]) == (180, 96)
    assert (streams["depth"]["n_frames"], streams["depth"]["present"]) == (90, True)
    assert streams["infrared"]["proxy"] == {"state": "absent", "progress": None, "url": None, "fps": None}
    (layer,) = found["layers"]
    assert layer["name"] == "main"
    assert layer["n_objects"] == len(reader.json("layers/main")["layer"]["objects"])
    assert {"poses", "joints", "markers_2d"} <= set(found["tables"])
    assert found["problems"] == []


def test_boxes_bodies_cameras_and_the_table_are_told(reader: Browser) -> None:
    found = reader.json("")
    assert {camera["name"] for camera in found["cameras"]} == {"color", "depth"}
    (body,) = found["bodies"]
    assert "HandRight" in body["joints"]
    assert ["WristRight", "HandRight"] in body["bones"]
    assert len(found["boxes"]) == 2
    assert all(0.05 < edge < 0.5 for box in found["boxes"] for edge in box["size_m"])
    plane = found["plane"]
    assert sum(n * n for n in plane["normal"]) == pytest.approx(1)
    assert sum(n * n for n in plane["rotation"]) == pytest.approx(1)
    # the table frame's origin lies on the plane
    assert sum(n * o for n, o in zip(plane["normal"], plane["origin"], strict=True)) == pytest.approx(
        -plane["d"]
    )


def test_a_damaged_table_is_told_and_keeps_nobody_from_annotating(project: Path, browser: Browser) -> None:
    table = project / "slide" / "tables" / "joints.parquet"
    table.write_bytes(table.read_bytes()[:-40])
    found = browser.json("")
    assert found["bodies"] == []
    assert len(found["boxes"]) == 2
    (problem,) = found["problems"]
    assert "joints" in problem


def test_the_scheme_is_that_of_the_layer_or_a_suggestion(project: Path, browser: Browser) -> None:
    assert browser.json("")["scheme"]["name"] == "ecat-sample"
    browser.post("layers/ben", {"author": "ben"})
    suggested = browser.json("?layer=ben")["scheme"]
    assert suggested["name"] == "blocks"
    assert {"grasp", "hold", "move", "release"} <= {kind["name"] for kind in suggested["event_types"]}
    with Editor(open_session(project / "slide"), author="ben") as editor:
        editor.apply(SetScheme(name="ecat-2018"))
    found = browser.json("?layer=main")
    assert found["scheme"]["name"] == "ecat-2018"
    assert {"blocks", "ecat-2018"} <= set(found["schemes"])


@pytest.mark.parametrize(
    "sid", ["nothing", "..", "%2e%2e", "slide%2f..", "a%20b%2Fother", "slide%00", "%ff", "x" * 5000]
)
def test_an_id_is_looked_up_and_never_joined_to_a_path(reader: Browser, sid: str) -> None:
    for rest in ("", "/layers/main", "/media/color", "/columns/poses"):
        answer = reader.get(f"/api/sessions/{sid}{rest}")
        assert answer.status_code in {404, 405}, answer.text
        assert answer.json()["error"]["kind"] in {"NotFoundError", "UsageError"}
