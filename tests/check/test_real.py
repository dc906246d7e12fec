"""Good recordings raise no alarm, and what is known to be wrong with real ones is found (ECAT 2018 file format §5)."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ecat.check import check
from ecat.formats import import_source

MOVIES = "ecat_movies/Annotation/VanLuanMovieWorkspace/0009_Forrest_Gump"


@pytest.mark.slow
def test_the_kinect_sessions_have_one_frame_without_depth_and_nothing_else(
    shared: Path, tmp_path: Path
) -> None:
    import_source(shared / "ecat_kinect", tmp_path / "kinect")
    (finding,) = check(tmp_path / "kinect")
    assert (finding.severity, finding.code) == ("note", "depth-missing")
    assert finding.session == "SlideAway/Session1"
    assert finding.message.endswith("frame 2402")


def test_a_reference_to_an_object_that_was_deleted_in_another_session(shared: Path, tmp_path: Path) -> None:
    clips = ("0009_Forrest_Gump_00.21.08.776-00.21.35.115", "0009_Forrest_Gump_00.21.35.702-00.21.35.741")
    for clip in clips:
        shutil.copytree(shared / MOVIES / clip, tmp_path / "clips" / clip)
    import_source(tmp_path / "clips", tmp_path / "project", format="ecat-2018")
    (finding,) = check(tmp_path / "project")
    assert (finding.severity, finding.code, finding.session) == (
        "warning",
        "dangling-session-reference",
        clips[1],
    )
    assert finding.message == f"its argument {clips[0]}/o3: session {clips[0]} has no object o3"


def test_an_event_that_ends_with_the_clip_is_inside(shared: Path, tmp_path: Path) -> None:
    clip = "0009_Forrest_Gump_00.05.00.328-00.05.01.873"
    shutil.copytree(shared / "ecat_movies/SampleAnnotation/Forrest_Gump" / clip, tmp_path / "clips" / clip)
    import_source(tmp_path / "clips" / clip, tmp_path / "session")
    assert [f for f in check(tmp_path / "session") if f.code == "outside-recording"] == []
