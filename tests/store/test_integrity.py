"""A session is compared with its manifest, and edits made by hand are taken over."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from ecat.errors import CorruptError, FormatError, NotFoundError
from ecat.model import Stream
from ecat.store import (
    Draft,
    Journal,
    Session,
    adopt_edited_layers,
    create_session,
    integrity,
    leftovers,
    open_session,
    rebuild_layer,
    remove_leftovers,
    validate,
)
from ecat.store.xml import layer_to_xml
from tests.store.sessions import MANIFEST, append, layer, make, number_at


def damage(path: Path, old: bytes, new: bytes) -> None:
    """Replace some bytes of a file."""
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new))


def test_a_healthy_session_has_no_faults(session: Session) -> None:
    assert validate(session) == validate(session, deep=True) == []


def test_every_missing_file_is_named(tmp_path: Path) -> None:
    video = tmp_path / "video"
    video.write_bytes(b"video")
    streams = (Stream(name="color", file="media/color.avi"), Stream(name="depth", file="media/gone.dep"))
    made = Draft(manifest=replace(MANIFEST, streams=streams), layers=(layer(),), files={"color": video})
    session = create_session(tmp_path / "session", made)
    for name in ("media", "tables", "annotations"):
        shutil.rmtree(session.path / name)
    faults = {fault.file for fault in validate(session)}
    manifest = session.manifest
    assert faults == {record.file for record in (*manifest.tables, *manifest.layers)} | {"media/color.avi"}


def test_a_changed_stream_is_found_by_its_size_or_in_depth(tmp_path: Path) -> None:
    video = tmp_path / "video"
    video.write_bytes(b"video")
    made = Draft(manifest=replace(MANIFEST, streams=(Stream(name="c", file="media/c"),)), files={"c": video})
    session = create_session(tmp_path / "session", made)
    (session.path / "media/c").write_bytes(b"Video")
    assert validate(session) == []
    assert [str(fault) for fault in validate(session, deep=True)] == ["media/c: its content has changed"]
    (session.path / "media/c").write_bytes(b"longer video")
    assert [str(fault) for fault in validate(session)] == ["media/c: 12 bytes, expected 5"]


def test_a_table_of_another_commit_is_found(tmp_path: Path, session: Session) -> None:
    other = make(tmp_path / "other", 1)
    shutil.copy(other.path / "tables/events.parquet", session.path / "tables/events.parquet")
    shutil.copy(other.path / "tables/poses.parquet", session.path / "tables/poses.parquet")
    assert [fault.file for fault in validate(session)] == ["tables/events.parquet"]
    assert [fault.file for fault in validate(session, deep=True)] == [
        "tables/events.parquet",
        "tables/poses.parquet",
    ]


def test_a_manifest_whose_tables_are_of_other_layers_is_found(session: Session) -> None:
    sha256 = session.manifest.layers[0].sha256
    file = session.path / "session.json"
    # the layer's record comes first, then those of the tables that were made from it
    head, tail = file.read_bytes().split(b'"tables"')
    file.write_bytes(head + b'"tables"' + tail.replace(sha256.encode(), b"0" * 64))
    problems = {fault.problem for fault in validate(open_session(session.path))}
    assert "made from other revisions of the layers than the manifest has" in problems


def test_an_edited_layer_is_found_and_taken_over(session: Session) -> None:
    damage(session.path / "annotations/main.xml", b">0<", b">edited by hand<")
    assert [fault.file for fault in validate(session)] == ["annotations/main.xml"]
    assert adopt_edited_layers(session) == ["main"]
    assert validate(session, deep=True) == []
    assert session.layer().events[0].text == "edited by hand"
    assert session.events.to_pandas()["text"].tolist() == ["edited by hand"]
    assert session.manifest.layers[0].revision == 2
    assert adopt_edited_layers(session) == []
    assert session.manifest.revision == 2


def test_an_edit_that_is_no_layer_any_more_changes_nothing(session: Session) -> None:
    damage(session.path / "annotations/main.xml", b"</", b"<")
    with pytest.raises(FormatError, match="main"):
        adopt_edited_layers(session)
    assert open_session(session.path).manifest == session.manifest


class TestRebuilding:
    """The XML of a layer, made from its journal."""

    @pytest.fixture
    def lost(self, session: Session) -> Session:
        """A session with a history, and without the XML of its layer."""
        append(session, 3)
        made = open_session(session.path)
        (session.path / "annotations/main.xml").unlink()
        return made

    def test_what_was_lost_is_as_it_was(self, lost: Session) -> None:
        rebuild_layer(lost, "main")
        assert validate(open_session(lost.path), deep=True) == []
        assert open_session(lost.path).manifest == lost.manifest
        assert len(lost.layer().events) == 4

    def test_a_layer_that_is_written_otherwise_by_now_is_taken_over(
        self, lost: Session, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        revision = lost.manifest.revision
        # as by a later version of ecat
        monkeypatch.setattr(integrity, "layer_to_xml", lambda it: layer_to_xml(it) + b"<!-- version 9 -->")
        rebuild_layer(lost, "main")
        session = open_session(lost.path)
        assert validate(session, deep=True) == []
        assert session.manifest.revision == revision + 1
        assert len(session.layer().events) == 4
        assert len(list(Journal(session.path, "main").records())) == 3, "nobody edited anything"

    def test_there_has_to_be_such_a_layer(self, session: Session) -> None:
        with pytest.raises(NotFoundError):
            rebuild_layer(session, "gold")

    def test_a_layer_without_a_journal_is_left_alone(self, session: Session) -> None:
        (session.path / "annotations/main.xml").write_bytes(b"?")
        with pytest.raises(CorruptError, match="cannot use the journal of layer main"):
            rebuild_layer(session, "main")
        assert (session.path / "annotations/main.xml").read_bytes() == b"?"


def test_leftovers_are_ignored_then_removed(session: Session) -> None:
    left = [
        session.path / ".session.json.0123456789abcdef.new",
        session.path / "annotations" / ".main.xml.0123456789abcdef.new",
        session.path / "tables" / ".poses.parquet.0123456789abcdef.new",
    ]
    keep = [session.path / ".gitignore", session.path / "tables" / ".new", session.path / "notes.new"]
    for path in (*left, *keep):
        path.write_bytes(b"half a fi")
    assert number_at(session.path) == 0
    assert leftovers(session.path) == sorted(left)
    assert remove_leftovers(session.path) == sorted(left)
    assert leftovers(session.path) == []
    assert all(path.exists() for path in keep)


def test_leftovers_of_a_writer_at_work_are_not_removed(session: Session) -> None:
    with session.write() as commit:
        commit.put_layer(layer(1))
        other = open_session(session.path)
        assert leftovers(other.path) != []
        assert remove_leftovers(other.path) == []
    assert number_of_text(session) == "1"


def number_of_text(session: Session) -> str:
    """The text of the one event."""
    return session.layer().events[0].text
