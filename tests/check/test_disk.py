"""What is found wrong with a folder on disk, and what is done about it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ecat.annotate import AddEvent, Editor, SetScheme, write_scheme
from ecat.check import Finding, check, repair
from ecat.errors import NotFoundError
from ecat.model import AnnotatedObject, CodingScheme, Layer, Manifest, ProjectManifest, Stream, Tier
from ecat.model.prototype import NOMINAL_BOXES
from ecat.process.graph import parameters_of, recorded
from ecat.process.inputs import input_hashes
from ecat.stages import STAGES
from ecat.store import Draft, TableData, create_project, create_session, open_session
from ecat.tables import PUBLISHED

if TYPE_CHECKING:
    from conftest import Case

CREATED = "2026-01-01T00:00:00Z"


@pytest.fixture
def project(tmp_path: Path, case: Case) -> Path:
    """A project of two healthy sessions; one refers to an object of the other, and has a video and poses."""
    create_project(tmp_path / "project", ProjectManifest(name="project", created=CREATED))
    video = tmp_path / "video.avi"
    video.write_bytes(b"RIFF")
    color = replace(case.manifest.streams[0], file="media/video.avi")
    tables = {name: TableData(data=table) for name, table in case.tables.items()}
    draft = Draft(
        manifest=replace(case.manifest, streams=(color, *case.manifest.streams[1:])),
        layers=(case.layer,),
        tables=tables,
        files={"color": video},
    )
    session = create_session(tmp_path / "project" / "Session1", draft)
    stage = next(stage for stage in STAGES if "poses" in stage.outputs)
    poses = TableData(
        data=case.tables["poses"],
        stage=stage.name,
        stage_version=str(stage.version),
        parameters=recorded(stage, parameters_of(session, stage, NOMINAL_BOXES)),
        inputs=input_hashes(session, stage),
    )
    with session.write() as commit:
        commit.put_prototypes([box.to_dict() for box in NOMINAL_BOXES])
        commit.put_table("poses", poses)
    other = Layer(objects=(AnnotatedObject(id="o7"),))
    create_session(
        tmp_path / "project" / "Other",
        Draft(manifest=Manifest(name="Other", created=CREATED), layers=(other,)),
    )
    return tmp_path / "project"


@pytest.fixture
def session(project: Path) -> Path:
    return project / "Session1"


def only(findings: list[Finding]) -> Finding:
    (finding,) = findings
    return finding


def rewrite(file: Path, old: str, new: str) -> None:
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new), "utf-8")


def test_healthy_sessions_have_no_findings(project: Path, session: Path) -> None:
    assert check(project) == []
    assert check(session, deep=True) == []


def test_where_there_is_no_session_there_is_nothing_to_check(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        check(tmp_path / "nowhere")


def test_findings_of_a_project_name_the_session(project: Path, session: Path) -> None:
    (session / "media/video.avi").unlink()
    assert [finding.session for finding in check(project)] == ["Session1"]


def test_a_reference_to_a_session_that_was_removed(project: Path, session: Path) -> None:
    (project / "Other").rename(project / "Renamed")
    assert only(check(session)).code == "dangling-session-reference"


def test_a_file_of_a_stream_that_is_gone(session: Path) -> None:
    (session / "media/video.avi").unlink()
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("error", "stream-damaged", "stream color")


def test_a_file_of_a_stream_that_was_cut_short(session: Path) -> None:
    (session / "media/video.avi").write_bytes(b"RI")
    assert only(check(session)).message == "2 bytes, expected 4"


def test_a_file_of_a_stream_with_other_content_is_found_by_reading_it(session: Path) -> None:
    (session / "media/video.avi").write_bytes(b"RIFX")
    assert check(session) == []
    assert only(check(session, deep=True)).message == "its content has changed"


def test_a_manifest_that_cannot_be_read_is_found_with_every_problem(session: Path) -> None:
    content = json.loads((session / "session.json").read_text("utf-8"))
    (session / "session.json").write_text(
        json.dumps(content | {"n_frames": "many", "revision": None}), "utf-8"
    )
    findings = check(session)
    assert {finding.code for finding in findings} == {"session-unreadable"}
    assert {finding.message.split(":")[0] for finding in findings} == {"n_frames", "revision"}


def test_a_broken_session_does_not_hide_the_others(project: Path, session: Path) -> None:
    (project / "Other" / "session.json").write_text("{", "utf-8")
    (session / "media/video.avi").unlink()
    assert [finding.code for finding in check(project)] == [
        "session-unreadable",
        "stream-damaged",
        "reference-unchecked",
    ]


def test_annotations_edited_by_hand_are_taken_over(session: Path) -> None:
    rewrite(session / "annotations/main.xml", "Pepsi", "Shell")
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("error", "layer-edited", "layer main")
    assert repair(session, [finding]).done == [finding]
    assert check(session) == []
    assert open_session(session).objects.to_arrow()["name"].to_pylist() == [
        "Shell",
        "Shell",
        "Performer",
        "table",
    ]


@pytest.fixture
def edited(session: Path) -> Path:
    """A session whose layer has a history."""
    with Editor(open_session(session), author="ann") as editor:
        editor.apply(AddEvent(segments=((0, 5),)))
    return session


def test_a_session_that_people_annotate_has_no_findings(edited: Path) -> None:
    with Editor(open_session(edited), author="bob") as editor:
        editor.apply(AddEvent(segments=((0, 5),)))
        assert check(edited, deep=True) == []
        editor.apply(AddEvent(segments=((5, 8),)))
    assert check(edited, deep=True) == []


def test_a_journal_that_does_not_fit_its_layer_is_set_aside(edited: Path) -> None:
    journal = edited / "annotations" / "main.journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-2] + b"?\n")
    layer = open_session(edited).layer()
    finding = only(check(edited))
    assert (finding.code, finding.place) == ("journal-misfit", "layer main, journal")
    assert "revision 1 does not end at byte" in finding.message
    assert repair(edited, [finding]).failed == []
    assert check(edited, deep=True) == []
    assert open_session(edited).layer() == layer
    assert [path.name for path in journal.parent.glob("*.old")] != []
    with Editor(open_session(edited)) as editor:
        assert editor.history() == []
        editor.apply(AddEvent(segments=((0, 5),)))
    assert check(edited, deep=True) == []


def test_a_journal_that_is_gone_is_done_without(edited: Path) -> None:
    (edited / "annotations" / "main.journal.jsonl").unlink()
    finding = only(check(edited))
    assert finding.code == "journal-misfit"
    assert repair(edited, [finding]).failed == []
    assert check(edited, deep=True) == []


def test_a_hand_edit_of_a_layer_with_a_history_is_a_step_of_it(edited: Path) -> None:
    rewrite(edited / "annotations" / "main.xml", 'end_frame="5"', 'end_frame="6"')
    finding = only(check(edited))
    assert finding.code == "layer-edited"
    assert repair(edited, [finding]).failed == []
    assert check(edited, deep=True) == []
    with Editor(open_session(edited)) as editor:
        assert [record.op for record in editor.history()] == ["add_event", "replace"]


def test_a_layer_is_compared_with_the_coding_scheme_beside_it(edited: Path) -> None:
    scheme = CodingScheme(name="mine", tiers=(Tier(name="hand"),))
    write_scheme(scheme, edited / "annotations" / "mine.scheme.xml")
    with Editor(open_session(edited)) as editor:
        editor.apply([SetScheme(name="mine"), AddEvent(segments=((0, 5),), tier="foot")])
    assert {finding.code for finding in check(edited)} == {"off-scheme"}


def test_annotations_are_examined_as_they_were_edited(session: Path) -> None:
    rewrite(session / "annotations/main.xml", 'parent="a1"', 'parent="a8"')
    assert [finding.code for finding in check(session)] == ["layer-edited", "dangling-reference"]


def test_annotations_against_the_schema_are_found_with_every_problem(session: Path) -> None:
    rewrite(session / "annotations/main.xml", 'kind="rig"', 'kind="robot" wings="2"')
    rewrite(session / "annotations/main.xml", 'start_frame="10"', 'start_frame="ten"')
    findings = check(session)
    assert {finding.code for finding in findings} >= {"layer-unreadable"}
    assert not any(finding.repair for finding in findings)
    assert any("wings" in finding.message for finding in findings)


def test_annotations_that_are_not_xml(session: Path) -> None:
    (session / "annotations/main.xml").write_text("<annotation>", "utf-8")
    findings = [finding for finding in check(session) if finding.code == "layer-unreadable"]
    assert "line 1" in only(findings).message


def test_a_damaged_table_of_the_annotations_is_published_anew(session: Path) -> None:
    (session / "tables/events.parquet").write_bytes(b"PAR1")
    finding = only(check(session))
    assert (finding.code, finding.place) == ("table-damaged", "table events")
    repair(session, [finding])
    assert check(session) == []


def test_a_damaged_table_of_a_stage_can_be_made_anew(session: Path) -> None:
    (session / "tables/poses.parquet").write_bytes(b"PAR1")
    finding = only(check(session))
    assert (finding.code, finding.repair) == ("table-damaged", "run the stage that made it again")
    assert finding.fix == f"ecat check {session} --repair"


def test_a_damaged_table_that_was_imported_cannot_be_made_anew(session: Path) -> None:
    (session / "tables/markers_2d.parquet").unlink()
    finding = only(check(session))
    assert (finding.code, finding.repair) == ("table-damaged", "")
    assert "ecat import RECORDING NEW_FOLDER" in finding.fix


def test_damage_that_hides_in_the_middle_of_a_table_is_found_by_reading_it(session: Path) -> None:
    file = session / "tables/markers_2d.parquet"
    data = bytearray(file.read_bytes())
    data[200] ^= 0xFF
    file.write_bytes(bytes(data))
    assert "table markers_2d" in {finding.place for finding in check(session, deep=True)}


def change_manifest(session: Path, edit: Any) -> None:
    content = json.loads((session / "session.json").read_text("utf-8"))
    edit(content)
    (session / "session.json").write_text(json.dumps(content), "utf-8")


def test_tables_of_the_annotations_from_another_revision_are_published_anew(session: Path) -> None:
    def age(content: dict[str, Any]) -> None:
        for record in content["tables"]:
            if record["name"] == "events":
                record["inputs"] = {"main": "0" * 64}

    change_manifest(session, age)
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("error", "table-stale", "table events")
    repair(session, [finding])
    assert check(session) == []


def test_a_table_made_from_an_older_table_is_stale(session: Path, case: Case) -> None:
    case.keep("markers_2d", lambda row: row["frame"] != 50)
    with open_session(session).write() as commit:
        commit.put_table("markers_2d", TableData(data=case.tables["markers_2d"]))
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("warning", "table-stale", "table poses")
    assert finding.message == "changed since it was made: markers_2d"
    assert finding.repair == "run the stage that made it again"


def test_a_table_made_with_other_parameters_is_stale(session: Path) -> None:
    opened = open_session(session)
    color, depth = opened.manifest.cameras
    with opened.write() as commit:
        commit.update(cameras=(replace(color, cx_px=0.0), depth))
    finding = only(check(session))
    assert (finding.code, finding.message) == ("table-stale", "changed since it was made: parameter camera")


def test_a_manifest_that_lost_its_tables(session: Path) -> None:
    change_manifest(session, lambda content: content.update(tables=[]))
    found = check(session)
    published = {f.place.removeprefix("table ") for f in found if f.code == "table-missing"}
    assert published == {schema.name for schema in PUBLISHED}
    unlisted = {f.place for f in found if f.code == "table-unlisted"}
    assert unlisted == {f"table {name}" for name in ("frames", "markers_2d", "markers_3d", "poses")}
    repair(session, found)
    assert {f.code for f in check(session)} == {"table-unlisted", "clock-missing"}


def test_files_in_the_tables_folder_that_are_no_tables_of_ecat_are_no_finding(session: Path) -> None:
    (session / "tables/mine.parquet").write_bytes(b"PAR1")
    assert check(session) == []


@pytest.mark.parametrize("size", [None, 4])
@pytest.mark.parametrize(
    ("make", "what"), [(Path.mkdir, "a folder"), (os.mkfifo, "a pipe or a device")], ids=["folder", "pipe"]
)
def test_a_stream_that_is_no_file(
    session: Path, make: Callable[[Path], None], what: str, size: int | None
) -> None:
    def forget(content: dict[str, Any]) -> None:
        content["streams"][0]["size_bytes"] = size

    change_manifest(session, forget)
    (session / "media/video.avi").unlink()
    make(session / "media/video.avi")
    for deep in (False, True):
        finding = only(check(session, deep=deep))
        assert (finding.severity, finding.code, finding.place) == ("error", "stream-damaged", "stream color")
        assert finding.message == f"media/video.avi is {what}, not a file"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("distortion", [0.1, 0.2]),
        ("rotation", [0, 0, 0, 0]),
        ("fx_px", 0),
        ("fy_px", -500),
        ("cx_px", 1e308),
        ("translation_m", [0, 0, 1e9]),
    ],
)
def test_cameras_that_cannot_be(session: Path, field: str, value: Any) -> None:
    change_manifest(session, lambda content: content["cameras"][1].update({field: value}))
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("error", "camera-value", "camera depth")
    assert finding.message.startswith(f"cameras[1].{field}: expected ")


@pytest.mark.parametrize("size", [[0, 1, 1], [-1, 1, 1], [11, 1, 1]])
def test_prototypes_that_cannot_be(session: Path, size: list[float]) -> None:
    change_manifest(session, lambda content: content["prototypes"][2].update(size_m=size))
    finding = only(check(session))
    assert (finding.code, finding.place) == ("prototype-value", "session.json")
    assert finding.message.startswith("prototypes[2].size_m: expected three positive lengths")


def test_objects_are_not_missed_where_a_layer_cannot_be_read(session: Path) -> None:
    (session / "annotations/main.xml").write_text("<annotation>", "utf-8")
    found = check(session)
    assert {f.code for f in found} == {"layer-unreadable", "reference-unchecked"}
    notes = [f for f in found if f.code == "reference-unchecked"]
    assert {f.place for f in notes} == {"table markers_2d", "table markers_3d", "table poses"}
    assert notes[0].message == "objects o1, o2 were not looked for in layer main, which cannot be read"


def test_a_path_with_spaces_is_quoted_in_what_to_do(session: Path) -> None:
    place = session.rename(session.parent / "my session")
    (place / "media/video.avi").unlink()
    (place / "tables/poses.parquet").unlink()
    assert f"ecat check '{place}' --repair" in [finding.fix for finding in check(place)]


def test_files_that_an_interrupted_write_left_behind_are_removed(session: Path) -> None:
    leftover = session / "tables" / ".poses.parquet.0123456789abcdef.new"
    leftover.write_bytes(b"half")
    finding = only(check(session))
    assert (finding.severity, finding.code, finding.place) == ("warning", "leftover", leftover.name)
    repair(session, [finding])
    assert not leftover.exists()
    assert check(session) == []


@pytest.mark.parametrize("name", ["Session2", "Session1"])
def test_sessions_that_an_interrupted_import_left_behind_are_removed(project: Path, name: str) -> None:
    leftover = project / f".{name}.0123456789abcdef.partial"
    leftover.mkdir()
    (leftover / "session.json").write_text("{", "utf-8")
    finding = only(check(project))
    assert (finding.code, finding.session, finding.place) == ("leftover", ".", leftover.name)
    repair(project, [finding])
    assert not leftover.exists()


def test_leftovers_deep_in_a_workspace_are_removed(project: Path) -> None:
    leftover = project / ".Session2.0123456789abcdef.partial"
    leftover.mkdir()
    finding = only(check(project.parent))
    assert finding.session == "project"
    repair(project.parent, [finding])
    assert check(project.parent) == []


def test_a_project_manifest_that_cannot_be_read(project: Path) -> None:
    (project / "project.json").write_text('{"kind": "heap", "name": "x", "created": ""}', "utf-8")
    finding = only(check(project))
    assert (finding.code, finding.place) == ("project-unreadable", "project.json")
    assert finding.message.startswith("kind: ")


def test_an_interrupted_commit_is_finished_and_noted(session: Path) -> None:
    data = (session / "session.json").read_bytes()
    commit_id = "0123456789abcdef"
    (session / f".session.json.{commit_id}.new").write_bytes(data)
    record = {"id": commit_id, "files": {"session.json": hashlib.sha256(data).hexdigest()}}
    (session / "commit.json").write_text(json.dumps(record), "utf-8")
    finding = only(check(session))
    assert (finding.severity, finding.code) == ("note", "interrupted-commit")
    assert check(session) == []


def test_an_interrupted_commit_that_cannot_be_finished_is_an_error(session: Path) -> None:
    (session / "commit.json").write_text(
        '{"id": "0123456789abcdef", "files": {"session.json": "0"}}', "utf-8"
    )
    finding = only(check(session))
    assert (finding.severity, finding.code) == ("error", "session-unreadable")


def test_streams_that_were_not_there_at_import_are_no_finding(session: Path) -> None:
    absent = Stream(name="infrared", kind="infrared", file="infrared.avi", present=False)
    opened = open_session(session)
    with opened.write() as commit:
        commit.update(streams=(*opened.manifest.streams, absent))
    assert check(session) == []
