"""Creating, opening and reading a session."""

from __future__ import annotations

import hashlib
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest

from ecat.errors import (
    CorruptError,
    EcatError,
    ExistsError,
    FormatError,
    LimitError,
    NotFoundError,
    SchemaError,
    StaleError,
    UsageError,
)
from ecat.model import LayerRecord, Stream, TableRecord
from ecat.store import Draft, Session, TableData, create_session, manifest, open_session, validate
from ecat.tables import PUBLISHED
from tests.store.sessions import MANIFEST, draft, layer, make, number_of, rows, write


def test_what_was_created_is_there_when_it_is_opened(tmp_path: Path) -> None:
    made = make(tmp_path / "session", 7)
    opened = open_session(tmp_path / "session")
    assert opened.manifest == made.manifest
    assert opened.name == "session"
    assert opened.layer() == layer(7)
    assert opened.poses.to_arrow().equals(rows("poses", 30, 7))
    assert validate(opened, deep=True) == []


def test_a_session_has_all_published_tables_even_without_layers(tmp_path: Path) -> None:
    session = create_session(tmp_path / "session", Draft(manifest=MANIFEST))
    for schema in PUBLISHED:
        assert session.table(schema.name).num_rows == 0
        assert session.table(schema.name).to_arrow().schema.equals(schema.arrow)


def test_the_same_draft_gives_the_same_bytes(tmp_path: Path) -> None:
    one, two = make(tmp_path / "one").path, make(tmp_path / "two").path
    files = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    assert len(files) == 10
    assert all((one / file).read_bytes() == (two / file).read_bytes() for file in files)


def test_the_store_keeps_the_records_itself(tmp_path: Path) -> None:
    bogus = replace(
        MANIFEST,
        layers=(LayerRecord(name="x", file="annotations/x.xml", sha256=""),),
        tables=(TableRecord(name="joints", file="tables/joints.parquet", sha256="", rows=5),),
    )
    session = create_session(tmp_path / "session", Draft(manifest=bogus))
    assert session.manifest.layers == ()
    assert not session.has_table("joints")
    assert "objects" in session.tables
    assert all(session.has_table(name) for name in session.tables)


def test_records_say_what_made_a_table(tmp_path: Path) -> None:
    parameters: dict[str, object] = {"threshold_px": 1.5}
    data = TableData(
        data=rows("poses", 3),
        stage="pose",
        stage_version="2",
        parameters=parameters,
        inputs={"markers_2d": "ab"},
    )
    session = create_session(tmp_path / "session", Draft(manifest=MANIFEST, tables={"poses": data}))
    record = session.manifest.table("poses")
    file = session.path / "tables/poses.parquet"
    assert record == TableRecord(
        name="poses",
        file="tables/poses.parquet",
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        rows=3,
        stage="pose",
        stage_version="2",
        parameters=parameters,
        inputs={"markers_2d": "ab"},
    )
    metadata = session.poses.to_arrow().schema.metadata
    assert metadata[b"ecat.stage"] == b"pose"
    assert metadata[b"ecat.parameters"] == b'{"threshold_px": 1.5}'
    assert metadata[b"ecat.schema_version"] == b"1"


def test_published_tables_carry_the_hash_of_their_xml(session: Session) -> None:
    sha256 = hashlib.sha256((session.path / "annotations/main.xml").read_bytes()).hexdigest()
    assert sha256.encode() in session.events.to_arrow().schema.metadata[b"ecat.inputs"]


# --------------------------------------------------------------------------------------------------- creating


def test_streams_are_copied_with_their_size_and_hash(tmp_path: Path) -> None:
    source = tmp_path / "video.mkv"
    source.write_bytes(b"video" * 1000)
    streams = (
        Stream(name="color", kind="color", file="media/color.mkv"),
        Stream(name="audio", kind="audio", file="media/color.mkv"),
        Stream(name="depth", kind="depth", file="depth.dep"),
    )
    copied = {"color": source, "audio": source}
    session = create_session(
        tmp_path / "session", Draft(manifest=replace(MANIFEST, streams=streams), files=copied)
    )
    color, audio, depth = session.manifest.streams
    assert color.present
    assert color.size_bytes == audio.size_bytes == 5000
    assert color.sha256 == hashlib.sha256(source.read_bytes()).hexdigest()
    assert session.stream_path("audio").read_bytes() == source.read_bytes()
    assert not depth.present
    with pytest.raises(NotFoundError, match=r"depth\.dep was not there when the session was imported"):
        session.stream_path("depth")
    with pytest.raises(NotFoundError, match="the streams are: color, audio, depth"):
        session.stream_path("infrared")


@pytest.mark.parametrize(
    ("stream", "error"),
    [
        (Stream(name="color", file="color.mkv"), UsageError),
        (Stream(name="other", file="media/color.mkv"), UsageError),
        (Stream(name="color", file="media/../../color.mkv"), EcatError),
    ],
)
def test_a_stream_is_copied_into_media_only(tmp_path: Path, stream: Stream, error: type[Exception]) -> None:
    (tmp_path / "video").write_bytes(b"")
    made = Draft(manifest=replace(MANIFEST, streams=(stream,)), files={"color": tmp_path / "video"})
    with pytest.raises(error):
        create_session(tmp_path / "session", made)
    assert {path.name for path in tmp_path.iterdir()} == {"video"}


def test_a_source_that_is_missing_or_a_pipe_is_a_typed_error(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    made = replace(MANIFEST, streams=(Stream(name="color", file="media/color.mkv"),))
    with pytest.raises(NotFoundError, match=r"gone\.mkv"):
        create_session(tmp_path / "session", Draft(manifest=made, files={"color": tmp_path / "gone.mkv"}))
    with pytest.raises(FormatError, match="not a regular file"):
        create_session(tmp_path / "session", Draft(manifest=made, files={"color": tmp_path / "pipe"}))
    assert {path.name for path in tmp_path.iterdir()} == {"pipe"}


def test_a_draft_that_breaks_the_schema_leaves_nothing(tmp_path: Path) -> None:
    for wrong in (
        replace(draft(), tables={"poses": TableData(data=rows("markers_2d", 3))}),
        replace(draft(), manifest=replace(MANIFEST, name="../escape")),
        replace(draft(), manifest=replace(MANIFEST, n_frames=-1)),
        replace(draft(), layers=(layer(name="../../evil"),)),
        replace(draft(), tables={"nonsense": TableData(data=rows("poses", 3))}),
        replace(draft(), tables={"events": TableData(data=rows("events", 3))}),
        replace(draft(), tables={"poses": TableData(data=rows("poses", 3), parameters={"path": Path()})}),
    ):
        with pytest.raises((SchemaError, UsageError)):
            create_session(tmp_path / "session", wrong)
        assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------------------------------------- opening


def test_opening_reads_the_manifest_and_nothing_else(session: Session) -> None:
    shutil.rmtree(session.path / "tables")
    shutil.rmtree(session.path / "annotations")
    assert open_session(session.path).manifest == session.manifest


def test_what_is_no_session_is_not_found(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "project.json").write_text("{}")
    for name, why in (
        ("gone", "does not exist"),
        ("file", "is not a folder"),
        (".", "has no session.json"),
        ("project", "is a project"),
        ("file/below", "does not exist"),
        ("a\0b", "does not exist"),
    ):
        with pytest.raises(NotFoundError, match=why):
            open_session(tmp_path / name)


def test_a_manifest_that_is_no_file_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "session.json")
    with pytest.raises(FormatError, match="not a regular file"):
        open_session(tmp_path)


def test_a_manifest_that_is_too_large_is_not_read(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manifest, "MAX_BYTES", 100)
    with pytest.raises(LimitError, match="more than 100 bytes"):
        open_session(session.path)


# ---------------------------------------------------------------------------------------------------- reading


def test_a_missing_table_names_the_stage_that_makes_it(session: Session) -> None:
    with pytest.raises(NotFoundError, match="stage smooth has not run"):
        session.table("poses_smooth")
    with pytest.raises(NotFoundError, match="the recording has no such data"):
        session.table("joints")
    with pytest.raises(NotFoundError, match="known tables: objects"):
        session.table("nonsense")


def test_a_missing_layer_names_those_that_are_there(session: Session) -> None:
    with pytest.raises(NotFoundError, match="the layers are: main"):
        session.layer("gold")


def test_a_table_with_damaged_content_is_corrupt(session: Session) -> None:
    file = session.path / "tables/poses.parquet"
    good = file.read_bytes()
    for bad in (b"", b"PAR1", good[:-100], good[:200] + bytes(100) + good[300:], b"x" * len(good)):
        file.write_bytes(bad)
        with pytest.raises(CorruptError, match=r"poses\.parquet"):
            session.poses.to_arrow()


def test_a_table_of_another_kind_or_length_is_corrupt(tmp_path: Path, session: Session) -> None:
    other = make(tmp_path / "other", 0, 40)
    file = session.path / "tables/poses.parquet"
    shutil.copy(other.path / "tables/poses.parquet", file)
    with pytest.raises(CorruptError, match="40 rows, expected 30"):
        session.poses.to_arrow()
    file.unlink()
    with pytest.raises(NotFoundError, match=r"poses\.parquet"):
        session.poses.to_arrow()
    os.mkfifo(file)
    with pytest.raises(FormatError, match="not a regular file"):
        session.poses.to_arrow()


def test_a_link_out_of_the_session_is_not_followed(tmp_path: Path, session: Session) -> None:
    for name, read in (
        ("tables", session.poses.to_arrow),
        ("annotations", session.layer),
        ("tables", lambda: write(session, 1)),
    ):
        outside = tmp_path / f"outside_{name}"
        if not outside.exists():
            (session.path / name).rename(outside)
            (session.path / name).symlink_to(outside)
        before = {path: path.stat().st_mtime_ns for path in outside.iterdir()}
        with pytest.raises(SchemaError, match="leads out of the session"):
            read()
        assert {path: path.stat().st_mtime_ns for path in outside.iterdir()} == before


def test_rows_of_an_xml_that_was_edited_by_hand_are_not_served(session: Session) -> None:
    file = session.path / "annotations/main.xml"
    file.write_bytes(file.read_bytes().replace(b">0<", b">changed<"))
    with pytest.raises(CorruptError, match="out of date"):
        session.events.to_arrow()
    with pytest.raises(CorruptError, match="edited outside of ecat"):
        session.layer()
    assert session.poses.num_rows == 30


# ---------------------------------------------------------------------------------------------- two revisions


def test_a_session_object_has_its_own_commits(session: Session) -> None:
    write(session, 1)
    assert session.manifest.revision == 2
    assert number_of(session) == 1
    assert session.manifest.layers[0].revision == 2


def test_what_another_commit_replaced_is_stale_until_refreshed(session: Session) -> None:
    reader = open_session(session.path)
    view = reader.poses
    write(session, 1)
    for read in (
        view.to_arrow,
        reader.poses.to_arrow,
        reader.layer,
        reader.events.to_arrow,
    ):
        with pytest.raises(StaleError, match="opened at revision 1, now at 2"):
            read()
    assert number_of(reader.refresh()) == 1
    with pytest.raises(StaleError):
        view.to_arrow()


def test_what_another_commit_left_alone_reads_on(session: Session) -> None:
    reader = open_session(session.path)
    with session.write() as commit:
        commit.put_table("joints", TableData(data=rows("joints", 3)))
    assert number_of(reader) == 0


def test_a_write_based_on_an_older_revision_is_refused(session: Session) -> None:
    late = open_session(session.path)
    write(session, 1)
    with pytest.raises(StaleError, match="opened at revision 1, now at 2"):
        write(late, 5)
    with pytest.raises(StaleError), session.write(expected_revision=1):
        pytest.fail("the block of a stale write must not run")
    with late.write(expected_revision=2) as commit:
        commit.put_prototypes([{"name": "box"}])
    assert late.manifest.prototypes == ({"name": "box"},)
    assert late.manifest.revision == 3
    assert number_of(late) == 1


def test_a_manifest_edited_by_hand_makes_a_write_stale(session: Session) -> None:
    file = session.path / "session.json"
    file.write_text(file.read_text().replace('"n_frames": 2400', '"n_frames": 2401'))
    with pytest.raises(StaleError):
        write(session, 1)


def test_a_second_layer_is_published_beside_the_first(session: Session) -> None:
    with session.write() as commit:
        commit.put_layer(layer(5, "gold"))
    assert session.events.to_pandas()["layer"].tolist() == ["gold", "main"]
    assert session.layer("gold") == layer(5, "gold")
    assert [record.revision for record in session.manifest.layers] == [1, 1]


def test_published_tables_follow_the_clock(session: Session) -> None:
    before = session.events.to_arrow()["start_ns"][0].as_py()
    with session.write() as commit:
        commit.update(clock=replace(MANIFEST.clock, duration_ns=160_000_000_000))
    assert session.events.to_arrow()["start_ns"][0].as_py() == 2 * before


def test_the_last_of_two_puts_counts(session: Session) -> None:
    with session.write() as commit:
        commit.put_table("poses", TableData(data=rows("poses", 5)))
        commit.put_table("poses", TableData(data=rows("poses", 6)))
        commit.put_layer(layer(1))
        commit.put_layer(layer(2))
    assert session.poses.to_arrow().num_rows == 6
    assert session.layer() == layer(2)
    assert session.manifest.layers[0].revision == 2


def test_what_the_store_keeps_itself_is_not_updated(session: Session) -> None:
    for wrong in ("revision", "tables", "layers", "schema_version", "nonsense"):
        with pytest.raises(UsageError, match=wrong), session.write() as commit:
            commit.update(**{wrong: 3})
    with pytest.raises(UsageError, match="follows from the layers"), session.write() as commit:
        commit.put_table("events", TableData(data=pa.table({})))


def test_an_occupied_destination_is_left_as_it_is(session: Session) -> None:
    with pytest.raises(ExistsError, match="there is something already"):
        make(session.path, 3)
    assert number_of(open_session(session.path)) == 0
