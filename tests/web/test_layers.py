"""Editing a layer over HTTP."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ecat.annotate import AddEvent, Editor
from ecat.store import open_session
from ecat.web import Server
from ecat.web.layers import layer_json

if TYPE_CHECKING:
    from tests.web.conftest import Browser

LAYER = "layers/ben"


@pytest.fixture
def ben(browser: Browser) -> Browser:
    """With an empty layer ``ben``."""
    assert browser.post(LAYER, {"author": "ben"}).status_code == 200
    return browser


def edit(browser: Browser, *operations: dict[str, Any], base: int | None = None, author: str = "ben") -> Any:
    body = {"author": author, "base": base, "operations": operations}
    return browser.post(f"{LAYER}/operations", body)


def slide(start: int = 10, end: int = 40) -> dict[str, Any]:
    return {"op": "add_event", "type": "slide", "segments": [[start, end]]}


def test_a_layer_is_served_as_it_is(reader: Browser, made_once: Path) -> None:
    answer = reader.json("layers/main")
    assert (answer["revision"], answer["saved_revision"], answer["can_undo"]) == (0, 0, False)
    with Editor(open_session(shutil.copytree(made_once / "slide", made_once.parent / "copy"))) as editor:
        assert answer["layer"] == layer_json(editor.layer)


def test_a_large_layer_is_packed_for_those_who_can_unpack(ben: Browser) -> None:
    edit(ben, *[{"op": "add_event", "text": "x" * 1000, "segments": [[i, i + 1]]} for i in range(100)])
    packed = ben.get(LAYER)
    plain = ben.get(LAYER, headers={"accept-encoding": "identity"})
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert packed.json() == plain.json()


def test_a_layer_has_to_be_made_first(browser: Browser, project: Path) -> None:
    assert browser.get(LAYER).status_code == 404
    assert edit(browser, slide()).status_code == 404
    assert "ben" not in {layer.name for layer in open_session(project / "slide").manifest.layers}
    for _ in range(2):  # making it again finds it
        assert browser.post(LAYER, {"author": "ben"}).json()["layer"]["events"] == []
    assert browser.get(LAYER).status_code == 200


@pytest.mark.parametrize("name", ["..", "%2e%2e", "a%2Fb", "a%5Cb", "x%00", "x" * 300, "%ff", ".hidden%0a"])
def test_no_name_of_a_layer_leads_elsewhere(browser: Browser, project: Path, name: str) -> None:
    before = sorted(path.name for path in (project / "slide").rglob("*"))
    assert browser.post(f"layers/{name}", {"author": "ben"}).status_code in {400, 404, 405}
    assert sorted(path.name for path in (project / "slide").rglob("*")) == before


def test_an_edit_is_answered_with_its_record_and_is_on_the_disk(ben: Browser, project: Path) -> None:
    answer = edit(ben, slide(), base=0)
    assert answer.status_code == 200
    said = answer.json()
    assert (said["can_undo"], said["can_redo"]) == (True, False)
    record = said["record"]
    assert (record["revision"], record["author"], record["operation"]) == (1, "ben", slide())
    assert [change["kind"] for change in record["changes"]] == ["layer", "event"]
    journal = (project / "slide" / "annotations" / "ben.journal.jsonl").read_text()
    assert '"type":"slide"' in journal


def test_several_operations_are_one_step_all_or_none(ben: Browser) -> None:
    assert (
        edit(ben, slide(), {"op": "add_object", "kind": "point", "name": "cup"}).json()["record"]["revision"]
        == 1
    )
    refused = edit(ben, slide(50, 60), {"op": "remove_event", "id": "nothing"})
    assert refused.status_code == 422
    assert refused.json()["error"]["kind"] == "OperationError"
    layer = ben.json(LAYER)
    assert (layer["revision"], len(layer["layer"]["events"])) == (1, 1)
    assert ben.post(f"{LAYER}/undo", {"author": "ben"}).status_code == 200
    assert ben.json(LAYER)["layer"]["events"] == []


def test_an_edit_of_what_has_changed_meanwhile_is_a_conflict_that_tells_what_was_done(ben: Browser) -> None:
    edit(ben, slide(), base=0, author="ann")
    answer = edit(ben, slide(), base=0)
    assert answer.status_code == 409
    said = answer.json()
    assert (said["error"]["kind"], said["revision"]) == ("StaleError", 1)
    assert [record["author"] for record in said["records"]] == ["ann"]
    assert edit(ben, slide(50, 60), base=1).status_code == 200


def test_each_undoes_their_own_steps(ben: Browser) -> None:
    edit(ben, slide(), author="ann")
    edit(ben, slide(50, 60))
    undone = ben.post(f"{LAYER}/undo", {"author": "ann"}).json()
    assert undone["record"]["operation"] == {"op": "undo", "undoes": 1}
    assert (undone["can_undo"], undone["can_redo"]) == (False, True)
    assert ben.post(f"{LAYER}/undo", {"author": "ann"}).status_code == 422
    assert ben.post(f"{LAYER}/redo", {"author": "ann", "base": 2}).status_code == 409
    assert ben.post(f"{LAYER}/redo", {"author": "ann", "base": 3}).status_code == 200
    assert len(ben.json(LAYER)["layer"]["events"]) == 2
    assert ben.json(f"{LAYER}?author=ben")["can_undo"] is True
    assert ben.json(f"{LAYER}?author=nobody")["can_undo"] is False


def test_undoing_what_others_changed_since_is_a_conflict(ben: Browser) -> None:
    made = edit(ben, slide(), author="ann").json()["record"]["changes"][-1]["id"]
    edit(ben, {"op": "edit_event", "id": made, "text": "better"})
    answer = ben.post(f"{LAYER}/undo", {"author": "ann"})
    assert (answer.status_code, answer.json()["error"]["kind"]) == (409, "ConflictError")


def test_proposals_are_decided_about_and_not_edited(browser: Browser) -> None:
    assert browser.post("layers/machine", {"author": "ben"}).status_code == 400
    answer = browser.post("layers/machine/operations", {"author": "ben", "operations": [slide()]})
    assert answer.status_code in {400, 404}
    assert browser.get("layers/machine").status_code == 404


def test_every_revision_can_be_looked_at_and_restored(ben: Browser) -> None:
    for i in range(3):
        edit(ben, slide(10 * i, 10 * i + 5))
    assert [len(ben.json(f"{LAYER}/at/{n}")["layer"]["events"]) for n in range(4)] == [0, 1, 2, 3]
    assert ben.get(f"{LAYER}/at/4").status_code == 400
    assert ben.post(f"{LAYER}/restore", {"author": "ben", "revision": 1}).status_code == 200
    answer = ben.json(LAYER)
    assert (answer["revision"], len(answer["layer"]["events"])) == (4, 1)
    assert ben.post(f"{LAYER}/restore", {"author": "ben", "revision": 99}).status_code == 400


def test_the_history_is_read_in_parts(ben: Browser) -> None:
    for i in range(5):
        edit(ben, slide(10 * i, 10 * i + 5))
    part = ben.json(f"{LAYER}/history?start=2&limit=2")
    assert (part["revision"], [record["revision"] for record in part["records"]]) == (5, [2, 3])
    assert len(ben.json(f"{LAYER}/history")["records"]) == 5
    assert ben.json(f"{LAYER}/history?start=9")["records"] == []
    for wrong in ("start=0", "limit=-1", "limit=99999999", "start=x"):
        assert ben.get(f"{LAYER}/history?{wrong}").status_code == 422


def test_saving_writes_xml_and_tables(ben: Browser, project: Path) -> None:
    edit(ben, slide())
    assert ben.post(f"{LAYER}/save", {}).json() == {"revision": 1, "saved_revision": 1}
    assert b'type="slide"' in (project / "slide" / "annotations" / "ben.xml").read_bytes()
    events = open_session(project / "slide").events.to_pandas()
    assert list(events[events.layer == "ben"].type) == ["slide"]


def test_an_edit_is_saved_when_its_author_pauses(ben: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecat.web.layers.IDLE_S", 0.05)
    edit(ben, slide())
    for _ in range(200):
        if ben.json(LAYER)["saved_revision"] == 1:
            return
        time.sleep(0.02)
    pytest.fail("it was not saved")


def test_ending_the_server_saves(project: Path) -> None:
    from tests.web.conftest import entered

    with Server(project, port=0).running() as server, entered(server) as browser:
        browser.post(LAYER, {"author": "ben"})
        edit(browser, slide())
        xml = project / "slide" / "annotations" / "ben.xml"
        assert b"slide" not in xml.read_bytes()
    assert b"slide" in xml.read_bytes()


def test_what_another_process_does_is_taken_over(ben: Browser, project: Path) -> None:
    with Editor(open_session(project / "slide"), "ben", "carl") as editor:
        editor.apply(AddEvent(type="wave", segments=((1, 2),)))
    answer = edit(ben, slide(), base=0)
    assert answer.status_code == 409
    assert [record["author"] for record in answer.json()["records"]] == ["carl"]


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("operations", {}),
        ("operations", {"author": "ben"}),
        ("operations", {"author": "", "operations": [slide()]}),
        ("operations", {"author": "b" * 201, "operations": [slide()]}),
        ("operations", {"author": "ben", "operations": []}),
        ("operations", {"author": "ben", "operations": [1]}),
        ("operations", {"author": "ben", "operations": "all"}),
        ("operations", {"author": "ben", "operations": [{"op": "nothing"}]}),
        ("operations", {"author": "ben", "operations": [{**slide(), "more": 1}]}),
        ("operations", {"author": "ben", "operations": [slide(50, 10)]}),
        ("operations", {"author": "ben", "operations": [slide(0, 10**9)]}),
        ("operations", {"author": "ben", "operations": [slide(0, 10**30)]}),
        ("operations", {"author": "ben", "operations": [slide()], "base": -1}),
        ("operations", {"author": "ben", "operations": [slide()], "more": 1}),
        ("operations", [slide()]),
        ("undo", {}),
        ("undo", {"author": None}),
        ("restore", {"author": "ben"}),
        ("restore", {"author": "ben", "revision": "x"}),
        ("save", {"author": "ben"}),
    ],
)
def test_what_is_not_understood_is_refused_and_changes_nothing(ben: Browser, path: str, body: object) -> None:
    answer = ben.post(f"{LAYER}/{path}", body)
    assert answer.status_code == 422, answer.text
    assert set(answer.json()["error"]) >= {"kind", "what", "where", "consequence", "fix"}
    assert ben.json(LAYER)["revision"] == 0


def test_a_body_that_is_not_json_is_refused(ben: Browser) -> None:
    json = {"content-type": "application/json"}
    for content in (
        b"",
        b"{",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"author": "\\ud800", "operations": []}',
        b"NaN",
    ):
        answer = ben.client.post(f"/api/sessions/slide/{LAYER}/operations", content=content, headers=json)
        assert answer.status_code in {400, 422}, (content[:20], answer.text)
        assert "traceback" not in answer.text.lower()
    plain = ben.client.post(
        f"/api/sessions/slide/{LAYER}/operations", content=b"{}", headers={"content-type": "text/plain"}
    )
    assert plain.status_code == 422
