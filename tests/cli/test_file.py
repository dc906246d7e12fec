"""Files that go with a session: kept, exported, removed; skeletons become joints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ecat.check import check
from ecat.store import open_session

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.fixture
def rig(ecat: Ecat, session: Path, tmp_path: Path) -> Path:
    """A rig file of ECAT's recorder."""
    assert ecat("export", session, tmp_path / "old", "--format", "ecat-2018").code == 0
    (found,) = (tmp_path / "old").glob("rig*.xml")
    return found


def test_a_file_is_kept_with_the_session_and_exported_with_it(
    ecat: Ecat, session: Path, tmp_path: Path
) -> None:
    (tmp_path / "consent form.pdf").write_bytes(b"%PDF")
    added = ecat("file", "add", session, tmp_path / "consent form.pdf", "--json").json
    assert (added["stream"], added["objects"]) == ("consent form.pdf", [])
    opened = open_session(session)
    assert opened.stream_path("consent form.pdf").read_bytes() == b"%PDF"
    assert opened.stream("consent form.pdf").size_bytes == 4
    assert ecat("check", session, "--deep").code == 0
    assert ecat("export", session, tmp_path / "out", "--format", "ecat-2018").code == 0
    assert (tmp_path / "out" / "consent form.pdf").read_bytes() == b"%PDF"


def test_files_of_the_same_name_are_told_apart(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "notes.txt").write_text(folder)
        assert ecat("file", "add", session, tmp_path / folder / "notes.txt").code == 0
    opened = open_session(session)
    names = ("notes.txt", "notes_2.txt", "notes_3.txt")
    assert [opened.stream_path(name).read_text() for name in names] == ["a", "b", "c"]


def test_a_rig_file_adds_an_object_its_joints_and_itself(ecat: Ecat, session: Path, rig: Path) -> None:
    before = open_session(session).table("joints").to_arrow().num_rows
    added = ecat("file", "add", session, rig, "--author", "ann", "--json").json
    (name,) = added["objects"]
    opened = open_session(session)
    rows = opened.table("joints").to_arrow()
    mine = [row for row in rows.to_pylist() if row["object_id"] == name]
    assert rows.num_rows == before + len(mine)
    assert len(mine) > 0
    thing = next(thing for thing in opened.layer().objects if thing.id == name)
    assert (thing.kind, thing.origin, thing.semantic_type) == ("rig", "provided", "bodyRig")
    assert opened.stream(added["stream"]).kind == "skeleton"
    assert check(session, deep=True) == check(session)
    assert not [finding for finding in check(session) if finding.severity == "error"]
    assert ecat("undo", session, "--author", "ann").code == 0, "the object; joints of nobody stay"


def test_a_rig_that_cannot_be_added_leaves_no_object(
    ecat: Ecat, session: Path, rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    before = open_session(session).layer()
    monkeypatch.setattr("ecat.formats.skeletons.put_skeletons", fail)
    assert ecat("file", "add", session, rig).code == 1
    assert open_session(session).layer().objects == before.objects


@pytest.mark.parametrize("content", ["", "<BodyDataSequence/>", "<BodyDataSequence><Body_Data>"])
def test_a_rig_file_that_holds_nobody_changes_nothing(
    ecat: Ecat, session: Path, tmp_path: Path, content: str
) -> None:
    (tmp_path / "rig_1.xml").write_text(content)
    before = open_session(session).manifest.streams
    result = ecat("file", "add", session, tmp_path / "rig_1.xml", "--json")
    assert result.code == (1 if content else 0), "an empty file is a file"
    assert (open_session(session).manifest.streams == before) == bool(content)


def test_a_file_is_taken_out_again(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    before = open_session(session).manifest.streams
    ecat("file", "add", session, tmp_path / "notes.txt")
    assert ecat("file", "remove", session, "notes.txt").code == 0
    opened = open_session(session)
    assert opened.manifest.streams == before
    assert not (session / "media" / "notes.txt").exists()
    assert ecat("check", session, "--deep").code == 0


def test_a_recording_is_not_removed(ecat: Ecat, session: Path) -> None:
    result = ecat("file", "remove", session, "color", "--json")
    assert (result.code, result.json["error"]["error"]) == (2, "UsageError")
    assert "it is a recording (color)" in result.json["error"]["where"]


def test_a_file_that_something_is_drawn_in_is_not_removed(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.png").write_bytes(b"?")
    ecat("file", "add", session, tmp_path / "plan.png")
    added = ecat("object", "add", session, "--kind", "point", "--stream", "plan.png", "--json").json["added"][
        0
    ]
    result = ecat("file", "remove", session, "plan.png", "--json")
    assert result.json["error"]["where"] == f"layer main: {added} is drawn in it"
    assert result.json["error"]["fix"] == f"ecat object edit MY_SESSION {added} --stream ANOTHER"
    assert (session / "media" / "plan.png").exists()


@pytest.mark.parametrize("name", [".hidden", "a:b.txt"])
def test_a_file_needs_a_name_that_every_system_can_have(
    ecat: Ecat, session: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("x")
    assert ecat("file", "add", session, tmp_path / name).code == 2


def test_a_file_that_is_not_there_changes_nothing(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    before = open_session(session).manifest
    result = ecat("file", "add", session, tmp_path / "nothing.txt", "--json")
    assert (result.code, result.json["error"]["error"]) == (1, "NotFoundError")
    assert ecat("file", "remove", session, "nothing.txt").code == 1
    assert open_session(session).manifest == before
