"""`ecat.process`: what is out of date runs, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ecat.annotate import Editor, RejectProposal
from ecat.errors import InputError, LimitError, UsageError
from ecat.model import Clock, KeyFrame, Layer, Manifest, Stream
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.process import process_session, stage_names, stale_tables
from ecat.process.inputs import clock_table
from ecat.sample import sample_session
from ecat.stages import STAGES
from ecat.store import Draft, Session, TableData, create_session, open_session
from ecat.tables import MARKERS_2D, TABLES
from tests.process.films import filmed, find

STAGES_BY_DEFAULT = ("plane", "pose", "relations", "propose")
"""Those that run on a session whose markers came with it, unless smoothing is asked for."""


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample session whose stages have run; tests copy it before they change it."""
    path = tmp_path_factory.mktemp("processed") / "session"
    create_session(path, sample_session(seed=1, actions=("next",))[0])
    process_session(path)
    return path


@pytest.fixture
def session(processed: Path, tmp_path: Path) -> Session:
    """A copy of the processed session."""
    from shutil import copytree

    return open_session(copytree(processed, tmp_path / "session"))


def edit(session: Session, layer: Layer) -> None:
    with session.write() as commit:
        commit.put_layer(layer)


def test_poses_and_table_are_made_with_their_provenance(session: Session) -> None:
    record = session.manifest.table("poses")
    assert record is not None
    assert record.stage == "pose"
    assert set(record.inputs) == {"clock", "table_plane", "markers_2d", "markers_3d"}
    assert record.parameters["prototypes"] == list(session.manifest.prototypes)


def test_every_frame_of_every_box_has_a_row(session: Session) -> None:
    poses = session.poses.to_arrow()
    assert poses.num_rows == 2 * session.manifest.n_frames


def test_a_second_run_does_nothing(session: Session) -> None:
    before = session.manifest
    report = process_session(session.path)
    assert report.ran == ()
    assert report.skipped == STAGES_BY_DEFAULT
    assert session.refresh().manifest == before


def test_force_runs_everything_again_and_gives_the_same_bytes(session: Session) -> None:
    before = session.manifest.table("poses")
    assert process_session(session.path, force=True).ran == STAGES_BY_DEFAULT
    after = session.refresh().manifest.table("poses")
    assert before is not None
    assert after is not None
    assert after.sha256 == before.sha256


def test_a_new_event_makes_nothing_stale(session: Session) -> None:
    layer = session.layer()
    edit(session, replace(layer, events=layer.events[1:]))
    assert list(stale_tables(session.refresh())) == []
    assert process_session(session.path).ran == ()


def test_a_moved_table_polygon_makes_plane_and_poses_stale(session: Session) -> None:
    layer = session.layer()
    table = next(thing for thing in layer.objects if thing.key_frames_3d)
    moved = KeyFrame(
        frame=table.key_frames_3d[0].frame,
        coordinates=tuple(value + 0.01 for value in table.key_frames_3d[0].coordinates),
    )
    objects = tuple(replace(o, key_frames_3d=(moved,)) if o is table else o for o in layer.objects)
    edit(session, replace(layer, objects=objects))
    assert [name for name, _ in stale_tables(session.refresh())] == ["table_plane"]
    assert process_session(session.path).ran == STAGES_BY_DEFAULT
    assert list(stale_tables(session.refresh())) == []


def test_other_prototypes_make_the_stages_run_again(session: Session) -> None:
    assert process_session(session.path, prototypes=NOMINAL_BOXES).ran == STAGES_BY_DEFAULT
    assert session.refresh().manifest.prototypes == tuple(box.to_dict() for box in NOMINAL_BOXES)


def test_the_smoother_runs_when_asked_and_is_kept_up_to_date(session: Session) -> None:
    assert process_session(session.path, smooth=True).ran == ("smooth", "relations")
    assert process_session(session.path, force=True).ran == (
        "plane",
        "pose",
        "smooth",
        "relations",
        "propose",
    )


def test_only_the_named_stage_runs(session: Session) -> None:
    assert process_session(session.path, stages=["pose"], force=True).ran == ("pose",)


def test_an_unknown_stage_is_refused_with_the_names_of_those_there_are(session: Session) -> None:
    with pytest.raises(UsageError, match="no_such_stage") as caught:
        process_session(session.path, stages=["no_such_stage"])
    assert all(name in caught.value.where for name in stage_names())


def bare(path: Path) -> Session:
    """A session with annotations, and without a single marker."""
    draft, _ = sample_session(seed=1, actions=("next",))
    return create_session(path, Draft(manifest=draft.manifest, layers=draft.layers))


def test_stages_do_not_apply_to_a_session_without_markers(tmp_path: Path) -> None:
    before = bare(tmp_path / "bare").manifest
    report = process_session(tmp_path / "bare", smooth=True, prototypes=NOMINAL_BOXES)
    assert (report.ran, report.skipped) == ((), ())
    why = dict(report.not_applicable)
    assert {why.pop(name) for name in ("track", "hull")} == {"no color video in this session"}
    assert {why.pop(name) for name in ("face_planes", "outline")} == {"no depth video in this session"}
    assert list(why) == ["plane", "pose", "smooth", "relations", "propose"]
    assert all(reason.startswith("no markers in this session") for reason in why.values())
    assert open_session(tmp_path / "bare").manifest == before


def test_the_table_is_found_by_depth_alone_where_nothing_is_known_of_the_colour_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, marks = filmed(tmp_path / "s", 1, eyeless=True)
    find(monkeypatch, [marks])
    report = process_session(tmp_path / "s")
    assert report.ran == ("track", "plane", "outline")
    assert report.not_applicable["pose"].startswith("nothing is known of the colour camera")
    session = open_session(tmp_path / "s")
    assert session.manifest.prototypes == ()
    (row,) = session.table("table_plane").to_arrow().to_pylist()
    table = truth.scene.depth_from_table
    assert row["evidence"] == "depth"
    assert (row["nx"], row["ny"], row["nz"]) == pytest.approx(table.rotation[:, 2], abs=0.001)
    assert row["d"] == pytest.approx(-table.rotation[:, 2] @ table.translation, abs=0.001)
    assert process_session(tmp_path / "s").ran == ()
    assert list(stale_tables(session)) == []


def test_boxes_measured_by_the_marks_that_were_found_are_no_reason_to_look_for_marks_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = find(monkeypatch, [filmed(tmp_path / "s", 1)[1]])
    assert process_session(tmp_path / "s").ran == ("track", *STAGES_BY_DEFAULT)
    session = open_session(tmp_path / "s")
    boxes = [BoxPrototype.from_dict(box) for box in session.manifest.prototypes]
    assert 0 < len(boxes) < len(NOMINAL_BOXES)
    assert list(stale_tables(session)) == []
    assert process_session(tmp_path / "s").ran == ()
    assert process_session(tmp_path / "s", prototypes=boxes, measured=True).ran == ()
    assert len(looked_at) == 1
    # boxes that somebody names are those that are looked for
    assert process_session(tmp_path / "s", prototypes=boxes[:1]).ran == ("track", *STAGES_BY_DEFAULT)
    assert process_session(tmp_path / "s").ran == ()


def test_depth_of_an_unknown_camera_is_there_and_measures_nothing(tmp_path: Path) -> None:
    depth = Stream(name="depth", kind="depth", file="media/depth.mkv", depth_unit_m=0.001)

    def write(path: Path) -> None:
        path.write_bytes(b"never looked at")

    manifest = Manifest(name="s", created="2026", streams=(depth,))
    create_session(tmp_path / "s", Draft(manifest=manifest, media={"depth": write}))
    why = process_session(tmp_path / "s").not_applicable
    assert why["face_planes"] == "nothing is known of the depth camera: its calibration is needed to measure"


def test_poses_from_elsewhere_are_smoothed_even_without_markers(session: Session, tmp_path: Path) -> None:
    poses = TableData(data=session.poses.to_arrow())
    with bare(tmp_path / "bare").write() as commit:
        commit.put_table("poses", poses)
    report = process_session(tmp_path / "bare", smooth=True)
    assert report.ran == ("smooth",)
    assert list(report.not_applicable) == [name for name in stage_names() if name != "smooth"]


def test_prototypes_are_kept_by_the_commit_of_the_first_stage_that_uses_them(
    session: Session,
) -> None:
    """Otherwise an interruption would leave boxes that no table was made with."""

    def stop(name: str, done: int, total: int) -> None:
        if name == "pose":
            raise KeyboardInterrupt

    before = session.manifest
    with pytest.raises(KeyboardInterrupt):
        process_session(session.path, prototypes=NOMINAL_BOXES, progress=stop)
    after = session.refresh().manifest
    assert after.revision == before.revision + 1
    assert after.prototypes == tuple(box.to_dict() for box in NOMINAL_BOXES)
    assert {name for name, _ in stale_tables(session)} == {"poses", "relation_proposals", "event_proposals"}


def test_a_table_made_with_other_parameters_is_stale(session: Session) -> None:
    (camera, *others) = session.manifest.cameras
    with session.write() as commit:
        commit.update(cameras=(replace(camera, fx_px=camera.fx_px + 1), *others))
    assert dict(stale_tables(session)) == dict.fromkeys(
        ("event_proposals", "poses", "relation_proposals", "table_plane"), "parameter camera"
    )
    assert process_session(session.path).ran == STAGES_BY_DEFAULT
    assert list(stale_tables(session.refresh())) == []


def test_a_table_whose_file_is_damaged_is_stale_and_made_again(session: Session) -> None:
    (session.path / "tables" / "poses.parquet").write_bytes(b"PAR1")
    assert list(stale_tables(session)) == [("poses", "its file")]
    assert process_session(session.path).ran == ("pose",)
    assert session.refresh().poses.num_rows > 0


def test_boxes_that_were_given_are_kept_even_if_no_stage_has_to_run(session: Session) -> None:
    kept = session.manifest.prototypes
    with session.write() as commit:
        commit.put_prototypes([])
    boxes = [BoxPrototype.from_dict(box) for box in kept]
    assert process_session(session.path, prototypes=boxes).ran == ()
    assert session.refresh().manifest.prototypes == kept


def test_marks_that_no_box_fits_are_one_error(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError("singular")

    (broken,) = (replace(stage, parts=fail) for stage in STAGES if stage.name == "pose")
    monkeypatch.setattr("ecat.stages.STAGES", (broken,))
    with pytest.raises(InputError, match="cannot run the stage pose") as caught:
        process_session(session.path, force=True)
    assert caught.value.fix == f"ecat check {session.path}"


def test_the_clock_has_a_row_per_frame(session: Session) -> None:
    clock = clock_table(session)
    assert clock["frame"].to_pylist() == list(range(session.manifest.n_frames))
    assert clock["t_ns"][0].as_py() == 0
    assert clock["t_ns"][-1].as_py() == session.manifest.clock.duration_ns


def test_a_recorded_clock_has_the_times_of_the_colour_stream(session: Session) -> None:
    n = session.manifest.n_frames
    color = next(stream.name for stream in session.manifest.streams if stream.kind == "color")
    rows = [(5 + 33_000_000 * i, i, color) for i in range(n) if i != 7] + [(0, 7, "other")]
    columns = [list(column) for column in zip(*sorted(rows), strict=True)]
    schema = TABLES["frames"].arrow
    arrays = [pa.array(column).cast(field.type) for column, field in zip(columns, schema, strict=True)]
    frames = TableData(data=pa.Table.from_arrays(arrays, schema=schema))
    before = dict(stale_tables(session))
    with session.write() as commit:
        commit.update(clock=Clock(rule="recorded"))
        commit.put_table("frames", frames)
    t_ns = clock_table(session)["t_ns"].to_pylist()
    assert t_ns == [None if i == 7 else 5 + 33_000_000 * i for i in range(n)]
    assert (before, dict(stale_tables(session))) == (
        {},
        dict.fromkeys(("event_proposals", "poses", "relation_proposals"), "clock"),
    )


def test_marks_far_beyond_the_end_do_not_make_the_recording_longer(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    marks = draft.tables["markers_2d"].data
    assert isinstance(marks, pa.Table)
    frames = marks["frame"].to_pylist()
    frames[-1] = 2**31 - 2
    far = marks.set_column(1, MARKERS_2D.arrow.field("frame"), pa.array(frames, pa.int32()))
    create_session(
        tmp_path / "far", replace(draft, tables={**draft.tables, "markers_2d": TableData(data=far)})
    )
    assert clock_table(open_session(tmp_path / "far")).num_rows == draft.manifest.n_frames


def test_more_frames_than_memory_holds_are_refused(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    create_session(tmp_path / "long", replace(draft, manifest=replace(draft.manifest, n_frames=20_000_000)))
    with pytest.raises(LimitError, match="cannot process"):
        clock_table(open_session(tmp_path / "long"))


def test_what_people_confirmed_among_the_proposals_is_never_overwritten(session: Session) -> None:
    layer = session.layer("machine")
    confirmed = replace(layer.events[0], status="confirmed")
    edit(session, replace(layer, events=(confirmed, *layer.events[1:])))
    report = process_session(session.path, force=True)
    assert session.refresh().layer("machine").events[0] == confirmed
    assert any("people have decided" in finding for finding in report.findings)


def test_what_people_decided_about_in_their_own_layers_is_never_overwritten_either(session: Session) -> None:
    before = session.layer("machine")
    with Editor(session, "ann", "ann") as editor:
        editor.apply(RejectProposal(proposal=f"machine/{before.events[0].id}"))
    report = process_session(session.path, stages=["propose"], force=True)
    assert session.refresh().layer("machine") == before
    assert any("people have decided" in finding for finding in report.findings)
    with Editor(session, "ann", "ann") as editor:
        editor.undo()
    report = process_session(session.path, stages=["propose"], force=True)
    assert not any("people have decided" in finding for finding in report.findings)


def test_boxes_that_cannot_be_measured_are_not_kept_as_if_they_were(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    data = draft.tables["markers_2d"].data
    assert isinstance(data, pa.Table)
    few = {"markers_2d": TableData(data=data.slice(0, 8))}
    create_session(tmp_path / "s", replace(draft, tables=few))
    report = process_session(tmp_path / "s")
    assert any("nominal boxes were used" in finding for finding in report.findings)
    assert open_session(tmp_path / "s").manifest.prototypes == ()
    assert process_session(tmp_path / "s").ran == ()
