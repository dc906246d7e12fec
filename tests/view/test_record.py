"""A whole session as a recording on disk."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.blueprint import Container, View
from rerun.chunk import Chunk, RrdReader

from ecat.errors import StoreError
from ecat.formats import import_source
from ecat.model import Camera, Clock, Manifest, Relation, Stream
from ecat.model.annotation import Argument
from ecat.store import Draft, Session, TableData, create_session, open_session
from ecat.view import blueprint, log_session, recording, save_rrd
from tests.view.chunks import at, table
from tests.view.conftest import draft as small_draft

EVERYTHING = {
    "/about",
    "/events/event/0",
    "/log/events",
    "/quality/residual_px/Shell",
    "/quality/speed_m_per_s/Shell",
    "/relations/ON/Shell/mat",
    "/support/Shell",
    "/world",
    "/world/boxes/Shell",
    "/world/boxes/Shell/axes",
    "/world/camera",
    "/world/camera/color",
    "/world/camera/color/border",
    "/world/camera/color/markers/Shell",
    "/world/camera/color/shapes/mat",
    "/world/paths/Shell",
    "/world/table",
    "/world/table/axes",
    "/world/table/edge",
}


def read(file: Path) -> list[Chunk]:
    chunks = RrdReader(file).stream().to_chunks()
    return [chunk for chunk in chunks if not chunk.entity_path.startswith("/__")]


def test_a_saved_recording_holds_the_whole_session(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "small.rrd"
    save_rrd(session, file)
    chunks = read(file)
    assert {chunk.entity_path for chunk in chunks} == EVERYTHING
    boxes = at(chunks, "/world/boxes/Shell", "centers")
    assert [frame for frame, centers in boxes.items() if not centers] == [4]
    assert at(chunks, "/events/event/0", "state") == {1: ["a1"], 3: [""]}


def test_what_moves_is_on_both_timelines(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "small.rrd"
    save_rrd(session, file)
    moving = [chunk for chunk in read(file) if not chunk.is_static]
    assert all(set(chunk.timeline_names) == {"frame", "session_time"} for chunk in moving)
    (box,) = [chunk for chunk in moving if chunk.entity_path == "/world/boxes/Shell"]
    batch = box.to_record_batch()
    t_ns = np.asarray(batch.column("session_time")).astype(np.int64)
    frames = np.asarray(batch.column("frame"))
    assert t_ns.tolist() == (frames * 100_000_000).tolist()


def test_the_blueprint_travels_with_the_recording(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "small.rrd"
    save_rrd(session, file)
    reader = RrdReader(file)
    assert len(reader.blueprints()) == 1
    assert [entry.application_id for entry in reader.recordings()] == ["ecat"]


def test_rerun_finds_nothing_wrong_with_the_file(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "small.rrd"
    save_rrd(session, file)
    verified = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(file)],
        capture_output=True,
        check=False,
        timeout=60,
    )
    assert verified.returncode == 0, verified.stderr.decode()


def test_a_session_with_nothing_in_it_can_be_shown(bare: Session, tmp_path: Path) -> None:
    file = tmp_path / "bare.rrd"
    save_rrd(bare, file)
    assert {chunk.entity_path for chunk in read(file)} == {"/about", "/world", "/world/camera"}


def test_a_recording_replaces_an_older_one_and_leaves_nothing_beside_it(
    session: Session, tmp_path: Path
) -> None:
    file = tmp_path / "out" / "small.rrd"
    save_rrd(session, file)
    save_rrd(session, file)
    assert list(file.parent.iterdir()) == [file]


def test_where_nothing_can_be_written_the_error_says_so(session: Session, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder", "utf-8")
    with pytest.raises(StoreError):
        save_rrd(session, blocked / "small.rrd")


def test_the_same_state_of_a_session_is_the_same_recording(session: Session) -> None:
    ids = {recording(open_session(session.path)).get_recording_id() for _ in range(2)}
    with session.write() as commit:
        commit.update(name="another state")
    assert len(ids) == 1
    assert recording(session.refresh()).get_recording_id() not in ids


def test_showing_a_session_leaves_the_strictness_of_rerun_as_it_was(session: Session) -> None:
    before = rr.strict_mode()
    stream = recording(session)
    stream.binary_stream()
    log_session(session, stream)
    assert rr.strict_mode() == before


def test_the_document_counts_what_people_said_and_what_was_proposed(tmp_path: Path) -> None:
    small = small_draft()
    (layer,) = small.layers
    proposed = tuple(replace(event, status="proposed") for event in layer.events)
    machine = replace(layer, name="machine", events=proposed, relations=())
    made = create_session(tmp_path / "s", replace(small, layers=(layer, machine)))
    save_rrd(made, tmp_path / "s.rrd")
    (text,) = at(read(tmp_path / "s.rrd"), "/about", "text")[None]
    assert "| Lift it | 1 | 1 |" in text


def names(part: Container | View) -> set[str]:
    if isinstance(part, View):
        return {str(part.name)}
    return {name for inner in part.contents for name in names(inner)}


def test_views_are_only_made_for_what_is_there(session: Session, bare: Session) -> None:
    full, empty = (names(blueprint(shown).root_container) for shown in (session, bare))
    lanes = "Events, relations, support"
    assert full == {"Colour image", "Table", lanes, "Speed, m/s", "Residual, px", "About", "Log"}
    assert empty == {"About"}


def test_a_recording_that_nobody_annotated_shows_what_was_recorded(tmp_path: Path) -> None:
    camera = Camera(name="c", width_px=64, height_px=48, fx_px=50, fy_px=50, cx_px=32, cy_px=24)
    streams = [Stream(name=name, kind=name, camera="c") for name in ("color", "depth", "infrared")]
    imu = table("imu", t_ns=[0, 9], sensor=["gyroscope"] * 2, x=[0, 1], y=[0, 1], z=[0, 1])
    draft = Draft(
        manifest=Manifest(
            name="raw",
            created="2024-01-01T00:00:00",
            n_frames=2,
            clock=Clock(rule="uniform", duration_ns=9),
            cameras=(camera,),
            streams=tuple(replace(s, present=True, file=f"media/{s.name}.mkv") for s in streams),
        ),
        tables={"imu": TableData(data=imu)},
        media={s.name: Path.touch for s in streams},
    )
    shown = blueprint(create_session(tmp_path / "raw", draft))
    assert names(shown.root_container) == {
        "Colour image", "Space", "Depth", "Infrared", "Turning, rad/s", "About"
    }  # fmt: skip


def test_many_lanes_are_spread_over_tabs(tmp_path: Path) -> None:
    small = small_draft()
    (layer,) = small.layers
    facts = tuple(
        Relation(predicate=f"P{i}", start_frame=0, arguments=(Argument(target="o1"),)) for i in range(9)
    )
    made = create_session(tmp_path / "s", replace(small, layers=(replace(layer, relations=facts),)))
    assert {"Events", "Relations", "Support"} <= names(blueprint(made).root_container)


@pytest.mark.slow
def test_a_real_recording_shows_every_face(shared: Path, tmp_path: Path) -> None:
    import_source(shared / "ecat_kinect" / "SlideAway" / "Session1", tmp_path / "session")
    session = open_session(tmp_path / "session")
    save_rrd(session, tmp_path / "session.rrd")
    faces = at(read(tmp_path / "session.rrd"), "/world/camera/color/markers/Stella_Artois", "strips")
    marks = session.table("markers_2d").to_arrow().to_pandas()
    assert sum(map(len, faces.values())) == int(((marks.object_id == "o3") & marks.u0_px.notna()).sum())
