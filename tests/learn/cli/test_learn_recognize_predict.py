"""``ecat learn recognize predict``: a trained run and sessions in, proposals in their machine's layer out."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pytest

from ecat.store import open_session
from learn.recognize.dataset import read_exports
from learn.recognize.model import Settings, save, train
from learn.recognize.proposals import AUTHOR
from tests.learn.features import sessions
from tests.learn.features.sessions import SHELL
from tests.learn.recognize import made

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    save(train(read_exports(made.exports(folder / "exports")), Settings(n_trees=3)), folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sessions.make(tmp_path_factory.mktemp("s") / "slide", sessions.draft()).path


def test_what_is_recognised_is_proposed_shown_and_taken_out_again(
    run: Path, processed: Path, tmp_path: Path, ecat: Ecat
) -> None:
    session = shutil.copytree(processed, tmp_path / "slide")
    result = ecat("learn", "recognize", "predict", session, "--run", run, "--json")
    assert result.code == 0, result.err
    (found,) = result.json["sessions"]
    assert found["findings"] == []
    assert found["added"] == len(found["proposed"]) > 0
    one = found["proposed"][0]
    assert {"type", "text", "start_frame", "end_frame", "subject", "object", "confidence"} <= set(one)
    assert 0 < one["confidence"] <= 1
    parts = [(each, part) for each in found["proposed"] for part in each["parts"]]
    assert parts
    for each, part in parts:
        assert each["start_frame"] == part["start_frame"] < part["end_frame"] < each["end_frame"]
        assert each["type"].startswith(f"{part['type']}_")
    listed = ecat("proposal", "list", session, "--json").json["proposals"]
    assert [row["what"] for row in listed] == [each["text"] for each in found["proposed"]]
    again = ecat("learn", "recognize", "predict", session, "--run", run)
    assert "earlier proposal" in again.out
    removed = ecat("learn", "recognize", "predict", session, "--remove", "--json").json["sessions"][0]
    assert (removed["added"], removed["removed"]) == (0, found["added"])
    assert ecat("proposal", "list", session, "--json").json["proposals"] == []


def test_a_session_without_skeleton_is_recognised_by_its_boxes_and_that_is_said(
    run: Path, tmp_path: Path, ecat: Ecat
) -> None:
    session = sessions.make(tmp_path / "slide", sessions.without(sessions.draft(), "joints")).path
    result = ecat("learn", "recognize", "predict", session, "--run", run)
    assert result.code == 0, result.err
    assert "no joints" in result.out
    assert "who acts (Subject) is less sure" in result.err
    quiet = ecat("learn", "recognize", "predict", session, "--run", run, "--quiet")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert [event.author for event in open_session(session).layer("machine").events].count(AUTHOR) > 0


def test_stretches_in_which_a_box_is_not_seen_are_left_out_and_that_is_said(
    run: Path, tmp_path: Path, ecat: Ecat
) -> None:
    def hidden(table: pa.Table) -> pa.Table:
        frame = table["frame"].to_numpy()
        lost = (table["object_id"].cast(pa.string()).to_numpy() == SHELL) & (frame >= 40) & (frame < 120)
        return table.filter(pa.array(~lost))

    draft = sessions.draft(markers_3d=hidden, markers_2d=hidden)
    session = sessions.make(tmp_path / "slide", draft).path
    found = ecat("learn", "recognize", "predict", session, "--run", run, "--json").json["sessions"][0]
    assert f"{SHELL} (Shell) is not seen for" in found["findings"][0]
    assert not [one for one in found["proposed"] if one["start_frame"] < 110 and one["end_frame"] > 50]


def test_sessions_that_cannot_be_recognised_are_named_and_the_others_done(
    run: Path, processed: Path, tmp_path: Path, ecat: Ecat
) -> None:
    project = tmp_path / "project"
    shutil.copytree(processed, project / "good")
    one = sessions.draft(markers_3d=sessions.only(SHELL))
    sessions.make(project / "one", one, process=False)
    result = ecat("learn", "recognize", "predict", project, "--run", run, "--json")
    assert result.code == 1
    assert [Path(each["path"]).name for each in result.json["sessions"]] == ["good"]
    assert "two boxes are needed" in result.json["failures"][0]["error"]["where"]
    assert not open_session(project / "one").manifest.layer("machine")
    quiet = ecat("learn", "recognize", "predict", project, "--run", run, "--quiet")
    assert (quiet.code, quiet.out) == (1, "")
    assert "two boxes are needed" in quiet.err


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ((), 2),
        (("--run", "RUN", "--remove"), 2),
        (("--run", "nowhere"), 1),
        (("--run", "RUN", "--objects", "a", "b"), 2),
    ],
)
def test_a_wrong_call_is_one_error_and_changes_nothing(
    arguments: tuple[str, ...], code: int, run: Path, tmp_path: Path, ecat: Ecat
) -> None:
    session = sessions.make(tmp_path / "slide", sessions.draft(), process=False)
    words = [run if word == "RUN" else word for word in arguments]
    result = ecat("learn", "recognize", "predict", session.path, *words, "--json")
    assert result.code == code
    assert result.json["error"]["fix"]
    assert open_session(session.path).manifest == session.manifest


def test_a_session_shorter_than_a_window_is_refused(run: Path, tmp_path: Path, ecat: Ecat) -> None:
    draft = sessions.draft(
        markers_3d=sessions.until(15), markers_2d=sessions.until(15), joints=sessions.until(15)
    )
    clock = replace(draft.manifest.clock, duration_ns=500_000_000)
    manifest = replace(draft.manifest, n_frames=15, clock=clock)
    layer = replace(draft.layers[0], events=(), relations=())
    short = sessions.make(tmp_path / "s", replace(draft, manifest=manifest, layers=(layer,)), process=False)
    result = ecat("learn", "recognize", "predict", short.path, "--run", run, "--json")
    assert result.code == 1
    assert "15 frames" in result.json["error"]["where"]


@pytest.mark.slow
def test_real_sessions_are_recognised_by_their_boxes(shared: Path, tmp_path: Path, ecat: Ecat) -> None:
    """Of the slides past in a recording without skeleton, most are found, with the box that moves."""
    from ecat.formats import import_source
    from ecat.process import process_session

    exports = tmp_path / "exports"
    exports.mkdir()
    for name in ("pushto", "pushfrom", "selfslidepast", "selfslidefrom", "selfslideto"):
        (exports / f"{name}.txt").symlink_to((shared / "actions_ch4" / "xml" / f"{name}.txt").resolve())
    save(train(read_exports(exports), Settings(n_trees=10)), tmp_path / "run")
    import_source(shared / "ecat_kinect" / "SlidePast" / "Session1", tmp_path / "s")
    process_session(tmp_path / "s", stages=["plane", "pose"])
    result = ecat("learn", "recognize", "predict", tmp_path / "s", "--run", tmp_path / "run", "--json")
    assert result.code == 0, result.err
    proposed = result.json["sessions"][0]["proposed"]
    session = open_session(tmp_path / "s")
    names = {thing.id: thing.name for thing in session.layer("main").objects}
    right = 0
    for event in session.layer("main").events:
        start, end = event.segments[0].start_frame, event.segments[0].end_frame
        over = [one for one in proposed if one["start_frame"] < end and start < one["end_frame"]]
        movers = {names[one.get("object", one["subject"])] for one in over}
        right += any(event.text.startswith(f"Slide {mover} ") for mover in movers)
    assert right >= 15  # of 22
