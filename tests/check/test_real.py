"""Good recordings raise no alarm; what is wrong with real ones is found (ECAT 2018 file format §5)."""

from __future__ import annotations

import shutil
from pathlib import Path

from ecat.check import check
from ecat.formats import import_source

MOVIES = "ecat_movies/Annotation/VanLuanMovieWorkspace/0009_Forrest_Gump"


def test_the_kinect_sessions(shared: Path, tmp_path: Path) -> None:
    """One frame without depth; and their recorder wrote some of its buffers twice."""
    import_source(shared / "ecat_kinect", tmp_path / "kinect")
    found = check(tmp_path / "kinect")
    missing, *repeats = (finding for finding in found if finding.code != "clock-unknown")
    assert len(found) - len(repeats) - 1 == 3  # no session has recorded times
    assert (missing.severity, missing.code, missing.session) == (
        "note",
        "depth-missing",
        "SlideAway/Session1",
    )
    assert missing.message.endswith("frame 2402")
    sessions = ["SlideAway/Session1", "SlideNext/Session2", "SlidePast/Session1"]
    assert [(f.code, f.session) for f in repeats] == [("frame-repeat", session) for session in sessions]


def test_a_reference_to_an_object_that_was_deleted_in_another_session(shared: Path, tmp_path: Path) -> None:
    clips = ("0009_Forrest_Gump_00.21.08.776-00.21.35.115", "0009_Forrest_Gump_00.21.35.702-00.21.35.741")
    for clip in clips:
        shutil.copytree(shared / MOVIES / clip, tmp_path / "clips" / clip)
    import_source(tmp_path / "clips", tmp_path / "project", format="ecat-2018")
    found = [finding for finding in check(tmp_path / "project") if finding.session == clips[1]]
    (finding,) = (finding for finding in found if finding.code != "clock-unknown")
    assert (finding.severity, finding.code) == ("warning", "dangling-session-reference")
    assert finding.message == f"its argument {clips[0]}/o3: session {clips[0]} has no object o3"


def test_an_event_that_ends_with_the_clip_is_inside(shared: Path, tmp_path: Path) -> None:
    clip = shared / MOVIES / "0009_Forrest_Gump_00.10.26.925-00.10.30.260"  # frames 0 to 80 of 80
    import_source(clip, tmp_path / "session")
    assert [finding for finding in check(tmp_path / "session") if finding.code == "outside-recording"] == []
