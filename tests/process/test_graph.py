"""`ecat.process`: what is out of date runs, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecat.errors import LimitError, UsageError
from ecat.model import KeyFrame, Layer
from ecat.process import process_session, stage_names, stale_tables
from ecat.process.graph import clock_table
from ecat.sample import sample_session
from ecat.store import Draft, Session, create_session, open_session


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
    assert report.skipped == ("plane", "pose")
    assert session.refresh().manifest == before


def test_force_runs_everything_again_and_gives_the_same_bytes(session: Session) -> None:
    before = session.manifest.table("poses")
    assert process_session(session.path, force=True).ran == ("plane", "pose")
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
    assert process_session(session.path).ran == ("plane", "pose")
    assert list(stale_tables(session.refresh())) == []


def test_other_prototypes_make_the_stages_run_again(session: Session) -> None:
    from ecat.model.prototype import NOMINAL_BOXES

    assert process_session(session.path, prototypes=NOMINAL_BOXES).ran == ("plane", "pose")
    assert session.refresh().manifest.prototypes == tuple(box.to_dict() for box in NOMINAL_BOXES)


def test_the_smoother_runs_when_asked_and_is_kept_up_to_date(session: Session) -> None:
    assert process_session(session.path, smooth=True).ran == ("smooth",)
    assert process_session(session.path, force=True).ran == ("plane", "pose", "smooth")


def test_only_the_named_stage_runs(session: Session) -> None:
    assert process_session(session.path, stages=["pose"], force=True).ran == ("pose",)


def test_an_unknown_stage_is_refused_with_the_names_of_those_there_are(session: Session) -> None:
    with pytest.raises(UsageError, match="no_such_stage") as caught:
        process_session(session.path, stages=["no_such_stage"])
    assert all(name in caught.value.where for name in stage_names())


def test_a_session_without_marks_is_left_alone(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    bare = Draft(manifest=draft.manifest, layers=draft.layers)
    create_session(tmp_path / "bare", bare)
    report = process_session(tmp_path / "bare")
    assert report.ran == ()
    assert "no marks" in report.findings[0]


def test_the_clock_has_a_row_per_frame(session: Session) -> None:
    clock = clock_table(session)
    assert clock["frame"].to_pylist() == list(range(session.manifest.n_frames))
    assert clock["t_ns"][0].as_py() == 0
    assert clock["t_ns"][-1].as_py() == session.manifest.clock.duration_ns


def test_marks_far_beyond_the_end_do_not_make_the_recording_longer(tmp_path: Path) -> None:
    import pyarrow as pa

    from ecat.store import TableData
    from ecat.tables import MARKERS_2D

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
