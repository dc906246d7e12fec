"""Projects made, recordings brought in, sessions put away, all of them edited; never outside of what is served."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from websockets.sync.client import connect

from ecat import formats
from ecat.annotate import AddEvent, Editor
from ecat.store import open_project, open_session
from ecat.store.lock import locked
from ecat.web import Server
from tests.web.conftest import entered

if TYPE_CHECKING:
    from tests.web.conftest import Browser

OVER = {"done", "failed", "stopped"}


def finished(browser: Browser, answer: Any) -> dict[str, Any]:
    """The job that an answer began, when it is over."""
    assert answer.status_code == 202, answer.text
    job = answer.json()
    until = time.monotonic() + 60
    while job["state"] not in OVER:
        assert time.monotonic() < until, job
        time.sleep(0.05)
        job = browser.json(f"/api/jobs/{job['id']}")
    return dict(job)


def sent(browser: Browser, *paths: Path, below: Path | None = None) -> str:
    """The id of an upload with these files, by their names or their paths below a folder."""
    upload = str(browser.post("/api/uploads").json()["id"])
    for path in paths:
        name = path.name if below is None else path.relative_to(below.parent).as_posix()
        answer = browser.client.put(f"/api/uploads/{upload}/{name}", content=path.read_bytes())
        assert answer.json() == {"bytes": path.stat().st_size}
    return upload


@pytest.fixture
def old(project: Path, tmp_path: Path) -> Path:
    """A session folder of ECAT 2018."""
    formats.export(project / "slide", tmp_path / "old", format="ecat-2018")
    return tmp_path / "old"


def ids(browser: Browser) -> set[str]:
    return {session["id"] for session in browser.json("/api/project")["sessions"]}


class TestMaking:
    def test_a_project_is_made_inside_another_and_found(self, browser: Browser, project: Path) -> None:
        assert browser.post("/api/project/projects", {"name": "pilot"}).json() == {"path": "pilot"}
        made = browser.post("/api/project/projects", {"name": "day 2", "inside": "pilot"})
        assert made.json() == {"path": "pilot/day 2"}
        assert open_project(project / "pilot" / "day 2").manifest.name == "day 2"
        assert [p["path"] for p in browser.json("/api/project")["projects"]] == ["", "pilot", "pilot/day 2"]

    @pytest.mark.parametrize("name", ["..", "a/b", "/tmp", ".hidden", "a\\b"])
    def test_a_name_that_leads_elsewhere_makes_nothing(
        self, browser: Browser, project: Path, name: str
    ) -> None:
        before = sorted(project.parent.rglob("*"))
        assert browser.post("/api/project/projects", {"name": name}).status_code == 400
        answer = browser.post("/api/project/projects", {"name": "x", "inside": name})
        assert answer.status_code == 404
        assert sorted(project.parent.rglob("*")) == before

    def test_what_is_there_is_not_made_again(self, browser: Browser) -> None:
        assert browser.post("/api/project/projects", {"name": "slide"}).status_code == 409

    def test_one_session_alone_is_no_project(self, project: Path) -> None:
        with Server(project / "slide", port=0).running() as server, entered(server) as browser:
            assert browser.json("/api/project")["whole"] is False
            assert browser.post("/api/project/projects", {"name": "x"}).status_code == 400
            answer = browser.post("/api/sessions/slide/removal", {"name": "slide"})
            assert answer.status_code == 400
        assert (project / "slide" / "session.json").is_file()


class TestBringingIn:
    def test_a_folder_that_is_sent_becomes_a_session(
        self, browser: Browser, project: Path, old: Path
    ) -> None:
        files = [path for path in old.rglob("*") if path.is_file()]
        upload = sent(browser, *files, below=old)
        job = finished(browser, browser.post("/api/project/imports", {"name": "came", "upload": upload}))
        assert job["state"] == "done", job
        assert job["result"]["id"] == "came"
        assert open_session(project / "came").manifest.provenance.format == "ecat-2018"
        assert browser.client.put(f"/api/uploads/{upload}/more", content=b"x").status_code == 404

    def test_what_cannot_be_read_leaves_nothing(
        self, browser: Browser, project: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "notes.txt").write_text("buy milk")
        before = sorted(project.rglob("*"))
        upload = sent(browser, tmp_path / "notes.txt")
        job = finished(browser, browser.post("/api/project/imports", {"name": "came", "upload": upload}))
        assert (job["state"], job["error"]["error"]) == ("failed", "FormatError")
        assert sorted(project.rglob("*")) == before

    @pytest.mark.parametrize("path", ["../x", "a/../../x", ".x", "a//..", "/etc/x", "a/" * 9 + "x"])
    def test_a_file_cannot_be_put_elsewhere(self, browser: Browser, path: str) -> None:
        upload = browser.post("/api/uploads").json()["id"]
        address = f"/api/uploads/{upload}/{path.replace('/', '%2F')}"
        assert browser.client.put(address, content=b"x").status_code in {400, 404, 405}
        assert browser.server.site.uploads.folder.joinpath(upload).is_dir()
        assert not list(browser.server.site.uploads.folder.joinpath(upload).rglob("x"))

    def test_too_much_is_refused(self, browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("ECAT_UPLOAD_GB", "0.000001")
        upload = browser.post("/api/uploads").json()["id"]
        assert browser.client.put(f"/api/uploads/{upload}/a", content=b"x" * 900).status_code == 200
        assert browser.client.put(f"/api/uploads/{upload}/b", content=b"x" * 900).status_code == 413
        assert browser.client.put(f"/api/uploads/{upload}/c", content=b"x" * 50).status_code == 200

    def test_more_than_a_request_may_have_can_be_sent_as_a_file(
        self, browser: Browser, tmp_path: Path
    ) -> None:
        large = tmp_path / "large.bin"
        large.write_bytes(bytes(9 << 20))
        sent(browser, large)
        answer = browser.client.post("/api/uploads", content=bytes(9 << 20))
        assert answer.status_code == 413

    def test_what_was_sent_goes_with_the_server(self, project: Path, tmp_path: Path) -> None:
        (tmp_path / "a.txt").write_text("a")
        with Server(project, port=0).running() as server, entered(server) as browser:
            folder = server.site.uploads.folder / sent(browser, tmp_path / "a.txt")
            assert folder.is_dir()
        assert not folder.exists()


class TestPuttingAway:
    def test_an_archived_session_can_be_brought_back_as_it_was(self, browser: Browser, project: Path) -> None:
        with Editor(open_session(project / "slide")) as editor:
            editor.apply(AddEvent(segments=((3, 9),)))
        before = open_session(project / "slide").layer("main")
        archived = browser.post("removal", {"name": "slide"}).json()["archived"]
        assert "slide" not in ids(browser)
        assert not (project / "slide").exists()
        (listed,) = browser.json("/api/project/archive")
        assert (listed["id"], listed["place"]) == (archived, "slide")
        assert browser.post(f"/api/project/archive/{archived}/restore").json() == {"id": "slide"}
        assert open_session(project / "slide").layer("main") == before
        assert browser.json("/api/project/archive") == []
        assert browser.json("layers/main")["revision"] == 1

    def test_a_deleted_session_is_gone(self, browser: Browser, project: Path) -> None:
        browser.json("layers/main")
        assert browser.post("removal", {"name": "slide", "keep": False}).json() == {"archived": None}
        assert not (project / "slide").exists()
        assert not (project / ".archive").exists()
        assert browser.get("").status_code == 404

    def test_an_archived_session_is_deleted_by_its_name(self, browser: Browser, project: Path) -> None:
        archived = browser.post("removal", {"name": "slide"}).json()["archived"]
        way = f"/api/project/archive/{archived}/removal"
        assert browser.post(way, {"name": "other"}).status_code == 400
        assert browser.post(way, {"name": "slide"}).status_code == 200
        assert not (project / ".archive").exists()

    def test_the_name_has_to_be_said(self, browser: Browser, project: Path) -> None:
        assert browser.post("removal", {"name": "Slide"}).status_code == 400
        assert (project / "slide" / "session.json").is_file()

    def test_nobody_loses_what_they_are_looking_at(self, browser: Browser, project: Path) -> None:
        cookie = browser.server.site.access.cookie
        headers = [("Cookie", f"{cookie}={browser.client.cookies[cookie]}")]
        url = browser.server.address.replace("http", "ws") + "/api/sessions/slide/live"
        with connect(url, additional_headers=headers) as socket:
            socket.send('{"type": "presence", "name": "ben"}')
            time.sleep(0.2)
            answer = browser.post("removal", {"name": "slide"})
            assert answer.status_code == 409
            assert "ben" in answer.json()["error"]["where"]
        assert (project / "slide" / "session.json").is_file()

    def test_a_session_that_another_program_writes_stays(self, browser: Browser, project: Path) -> None:
        with locked(project / "slide"):
            assert browser.post("removal", {"name": "slide"}).status_code == 409
        assert browser.post("removal", {"name": "slide"}).status_code == 200

    def test_what_took_the_place_of_an_archived_session_stays(self, browser: Browser, project: Path) -> None:
        archived = browser.post("removal", {"name": "slide"}).json()["archived"]
        (project / "slide").mkdir()
        assert browser.post(f"/api/project/archive/{archived}/restore").status_code == 409
        assert len(browser.json("/api/project/archive")) == 1

    def test_a_project_whose_last_session_is_archived_is_empty(self, browser: Browser) -> None:
        for session in browser.json("/api/project")["sessions"]:
            done = browser.post(f"/api/sessions/{session['id']}/removal", {"name": session["name"]})
            assert done.status_code == 200, done.text
        assert ids(browser) == set()


WINDOWS = {
    "op": "add_windows",
    "start": 0,
    "step": 60,
    "duration": 60,
    "tier": "window",
    "existing": "skip",
}


class TestAllSessions:
    def test_operations_are_one_step_of_undo_in_each_session(self, browser: Browser, project: Path) -> None:
        asked = {"author": "ann", "layer": "ann", "operations": [WINDOWS]}
        job = finished(browser, browser.post("/api/project/operations", asked))
        outcomes = job["result"]["sessions"]
        assert [(o["revision"], o["error"]) for o in outcomes] == [(1, None), (1, None)]
        for folder in (project / "slide", project / "a b" / "other"):
            assert len(open_session(folder).layer("ann").events) == 3
        assert browser.post("layers/ann/undo", {"author": "ann"}).status_code == 200
        assert browser.json("layers/ann")["layer"]["events"] == []

    def test_what_stops_one_session_does_not_stop_the_others(self, browser: Browser, project: Path) -> None:
        (project / "a b" / "other" / "session.json").write_text("{")
        asked = {"author": "ann", "layer": "main", "operations": [{"op": "find_references"}], "make": False}
        job = finished(browser, browser.post("/api/project/operations", asked))
        assert sorted(o["error"] is None for o in job["result"]["sessions"]) == [False, True]

    def test_a_layer_is_not_made_where_it_is_not_wanted(self, browser: Browser) -> None:
        asked = {"author": "ann", "layer": "ben", "operations": [{"op": "find_references"}], "make": False}
        job = finished(browser, browser.post("/api/project/operations", asked))
        assert [o["revision"] for o in job["result"]["sessions"]] == [None, None]
        assert browser.get("layers/ben").status_code == 404

    def test_the_machines_layer_is_not_edited(self, browser: Browser) -> None:
        asked = {"author": "ann", "layer": "machine", "operations": [WINDOWS]}
        assert browser.post("/api/project/operations", asked).status_code == 400


class TestOtherSessions:
    @pytest.fixture
    def beside(self, project: Path, old: Path) -> str:
        """Another session in the same folder."""
        formats.import_source(old, project / "earlier")
        return "earlier"

    def test_a_session_names_those_of_its_own_folder(self, browser: Browser, beside: str) -> None:
        assert browser.json("others") == [{"id": beside, "name": beside}]
        objects = browser.json(f"others/{beside}?layer=main")["objects"]
        assert {o["name"] for o in objects} >= {"Shell"}

    @pytest.mark.parametrize("name", ["other", "a%20b", "%2E%2E", "..%2F..", "slide"])
    def test_no_other_folder_can_be_looked_into(self, browser: Browser, name: str) -> None:
        assert browser.get(f"others/{name}").status_code == 404
