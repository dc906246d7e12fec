"""Work behind the page: stages run on what was drawn, skeletons of a file, and that a job can be stopped."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ecat import formats
from ecat.errors import FormatError
from ecat.store import open_session
from ecat.web.jobs import Jobs
from tests.web.test_project import finished, sent

if TYPE_CHECKING:
    from tests.web.conftest import Browser

BOX = {"op": "add_object", "kind": "rectangle", "name": "cup", "frame": 4, "coordinates": [20, 20, 30, 24]}


class TestProcessing:
    def test_shapes_become_followed_shapes_and_hulls(self, browser: Browser, project: Path) -> None:
        said = {"base": 0, "author": "ann", "operations": [BOX]}
        record = browser.post("layers/main/operations", said).json()["record"]
        (added,) = (change["id"] for change in record["changes"] if change["kind"] == "object")
        job = finished(browser, browser.post("process", {"stages": ["plane", "hull"]}))
        assert job["state"] == "done", job
        assert "hull" in job["result"]["ran"]
        tracks = open_session(project / "slide").table("tracks_2d").to_arrow()
        assert added in set(tracks["object_id"].to_pylist())
        again = finished(browser, browser.post("process", {"stages": ["plane", "hull"]}))
        assert "hull" in again["result"]["up_to_date"]

    def test_what_cannot_be_done_says_why(self, browser: Browser) -> None:
        job = finished(browser, browser.post("process", {"stages": ["track"]}))
        assert job["result"]["ran"] == []
        assert "came with the recording" in job["result"]["not_applicable"]["track"]

    def test_an_unknown_stage_is_refused(self, browser: Browser) -> None:
        assert browser.post("process", {"stages": ["hulls"]}).status_code == 400


NTU = "3\n" + "".join(
    "1\n72057594037944738 0 1 1 1 1 0 0.1 0.2 2\n25\n"
    + "".join(
        f"{0.1 * j:.2f} 0.2 {2 + 0.1 * frame:.2f} 1 2 {100 + j} {200 + frame} 1 0 0 0 2\n" for j in range(25)
    )
    for frame in range(3)
)


class TestSkeletons:
    @pytest.fixture
    def rig(self, project: Path, tmp_path: Path) -> Path:
        """A rig file of ECAT's recorder."""
        formats.export(project / "slide", tmp_path / "old", format="ecat-2018")
        (found,) = (tmp_path / "old").glob("rig*.xml")
        return found

    def test_a_rig_file_adds_a_rig_its_joints_and_a_stream(
        self, browser: Browser, project: Path, rig: Path
    ) -> None:
        before = open_session(project / "slide").table("joints").to_arrow()
        upload = sent(browser, rig)
        job = finished(
            browser, browser.post("skeletons", {"author": "ann", "layer": "main", "upload": upload})
        )
        assert job["state"] == "done", job
        (added,) = job["result"]["objects"]
        session = open_session(project / "slide")
        rows = session.table("joints").to_arrow()
        mine = [row for row in rows.to_pylist() if row["object_id"] == added]
        assert rows.num_rows == before.num_rows + len(mine)
        assert {row["body"] for row in mine}.isdisjoint({row["body"] for row in before.to_pylist()})
        assert {row["frame"] for row in mine} <= set(range(session.manifest.n_frames))
        (stream,) = (s for s in session.manifest.streams if s.kind == "skeleton" and s.present)
        assert session.stream_path(stream.name).read_bytes() == rig.read_bytes()
        layer = browser.json("layers/main")["layer"]
        thing = next(o for o in layer["objects"] if o["id"] == added)
        said = {name: thing[name] for name in ("kind", "origin", "semantic_type", "dimensions")}
        assert said == {"kind": "rig", "origin": "provided", "semantic_type": "bodyRig", "dimensions": 3}
        assert {p["name"]: p["value"] for p in thing["properties"]} == {"rigIndex": "3", "source": rig.name}
        assert {b["object_id"] for b in browser.json("")["bodies"]} >= {added}

    def test_skeletons_of_another_recorder_count_frames(
        self, browser: Browser, project: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "S001.skeleton").write_text(NTU)
        upload = sent(browser, tmp_path / "S001.skeleton")
        job = finished(
            browser, browser.post("skeletons", {"author": "ann", "layer": "main", "upload": upload})
        )
        (added,) = job["result"]["objects"]
        rows = open_session(project / "slide").table("joints").to_arrow().to_pylist()
        assert {row["frame"] for row in rows if row["object_id"] == added} == {0, 1, 2}

    def test_a_file_without_skeletons_changes_nothing(
        self, browser: Browser, project: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "other.xml").write_text("<a/>")
        before = open_session(project / "slide").manifest
        upload = sent(browser, tmp_path / "other.xml")
        job = finished(
            browser, browser.post("skeletons", {"author": "ann", "layer": "main", "upload": upload})
        )
        assert (job["state"], job["error"]["error"]) == ("failed", "FormatError")
        assert open_session(project / "slide").manifest.streams == before.streams
        assert browser.json("layers/main")["revision"] == 0


class TestJobs:
    def test_a_job_that_nobody_wants_ends_at_its_next_step(self) -> None:
        jobs, began, goes_on = Jobs(), threading.Event(), threading.Event()

        def work(progress: object) -> dict[str, object]:
            began.set()
            goes_on.wait(10)
            progress("on", 1, 2)  # type: ignore[operator]
            raise AssertionError("it went on")

        job = jobs.start("something", work)
        began.wait(10)
        jobs.stop(job.id)
        goes_on.set()
        jobs.start("the next", lambda _: {"done": True})
        jobs.close()
        assert job.state == "stopped"

    def test_what_goes_wrong_is_told_and_the_next_is_done(self) -> None:
        jobs, over = Jobs(), threading.Event()

        def work(_: object) -> dict[str, object]:
            raise FormatError("cannot read it", where="line 3", consequence="nothing was done", fix="mend it")

        failed = jobs.start("something", work)
        done = jobs.start("the next", lambda _: (over.set(), {})[1])
        assert over.wait(10)
        jobs.close()
        assert failed.state == "failed"
        assert failed.error is not None
        assert failed.error["where"] == "line 3"
        assert done.state in {"done", "running"}

    def test_an_unknown_job_is_an_error(self, reader: Browser) -> None:
        assert reader.get("/api/jobs/nothing").status_code == 404


def test_the_colours_of_depth_have_distances(reader: Browser) -> None:
    found = reader.json("depth/depth/range")
    assert 0.5 < found["near_m"] < found["far_m"] < 2.0
    assert reader.get("depth/color/range").status_code == 400


def test_a_recorded_file_can_be_kept(reader: Browser, made_once: Path) -> None:
    answer = reader.get("files/color")
    assert answer.content == (made_once / "slide" / "media" / "color.mp4").read_bytes()
    assert "attachment" in answer.headers["content-disposition"]
    assert reader.get("files/infrared").status_code == 404
