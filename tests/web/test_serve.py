"""The server as a whole: its port, its page, its description."""

from __future__ import annotations

import hashlib
import json
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ecat.errors import NotFoundError, UsageError
from ecat.web import Server
from ecat.web.openapi import description, document
from ecat.web.routes import page
from ecat.web.serve import is_loopback

if TYPE_CHECKING:
    from tests.web.conftest import Browser

ROOT = Path(__file__).resolve().parents[2]


def test_a_port_that_is_taken_is_refused_only_if_it_was_asked_for(
    made_once: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=f":{port}"):
            Server(made_once, port=port)
        monkeypatch.setattr("ecat.web.serve.USUAL_PORT", port)
        with Server(made_once).running() as server:
            assert server.port != port


def test_what_is_no_project_is_not_served(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        Server(tmp_path, port=0)


def test_an_address_that_is_not_this_machines_is_refused(made_once: Path) -> None:
    with pytest.raises(UsageError):
        Server(made_once, host="192.0.2.1", port=0)


def test_only_this_machine_reaches_a_loopback_address() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.1.2.3", "localhost", "::1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.1.5", "example.org")))


def test_the_interpreters_settings_are_given_back(made_once: Path) -> None:
    before, usual_s = sys.getswitchinterval(), 0.02
    sys.setswitchinterval(usual_s)
    with Server(made_once, port=0).running():
        assert sys.getswitchinterval() < usual_s
    assert sys.getswitchinterval() == pytest.approx(usual_s)
    sys.setswitchinterval(before)


def test_small_answers_are_sent_at_once(reader: Browser) -> None:
    # a server without TCP_NODELAY waits 40 ms for an acknowledgement that the client delays
    took = [reader.get("/api/nothing").elapsed.total_seconds() for _ in range(20)]
    assert min(took) < 0.03


def test_the_page_is_served_with_what_it_is_made_of(
    reader: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = reader.get("/")
    if page.INDEX.is_file():
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/html")
        for asset in sorted((page.STATIC / "assets").iterdir()):
            got = reader.get(f"/assets/{asset.name}")
            assert hashlib.sha256(got.content).digest() == hashlib.sha256(asset.read_bytes()).digest()
            assert "immutable" in got.headers["cache-control"]
    monkeypatch.setattr(page, "INDEX", tmp_path / "index.html")
    missing = reader.get("/")
    assert missing.status_code == 503
    assert "npm run build" in missing.text


def test_the_description_is_up_to_date() -> None:
    kept = (ROOT / "web" / "openapi.json").read_text("utf-8")
    assert document() == kept, "python -m ecat.web.openapi > web/openapi.json"


def test_everything_that_is_referred_to_is_described() -> None:
    described = description()
    refs = set[str]()

    def collect(part: object) -> None:
        if isinstance(part, dict):
            for key, value in part.items():
                if key == "$ref":
                    refs.add(str(value))
                collect(value)
        elif isinstance(part, list):
            for value in part:
                collect(value)

    collect(described)
    shapes = {f"#/components/schemas/{name}" for name in described["components"]["schemas"]}
    assert refs <= shapes


def test_answers_are_as_described(reader: Browser) -> None:
    from jsonschema import Draft202012Validator

    described = description()
    for path, url in {
        "/api/project": "/api/project",
        "/api/sessions/{sid}": "/api/sessions/slide",
        "/api/sessions/{sid}/layers/{layer}": "/api/sessions/slide/layers/main",
        "/api/sessions/{sid}/layers/{layer}/history": "/api/sessions/slide/layers/main/history",
        "/api/sessions/{sid}/series": "/api/sessions/slide/series",
        "/api/sessions/{sid}/depth/{stream}/{frame}": "/api/sessions/slide/depth/depth/1?u=4&v=4",
        "/api/surveys": "/api/surveys",
    }.items():
        shape = described["paths"][path]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
        whole = {**shape, "components": described["components"]}
        Draft202012Validator(whole).validate(reader.json(url))
    refusal = {"$ref": "#/components/schemas/Refusal", "components": described["components"]}
    Draft202012Validator(refusal).validate(reader.get("/api/sessions/nothing").json())


def test_the_description_knows_every_operation() -> None:
    from jsonschema import Draft202012Validator

    shapes = description()["components"]
    edit = {"$ref": "#/components/schemas/Edit", "components": shapes}
    good = {"author": "ann", "operations": [{"op": "add_event", "type": "slide", "segments": [[1, 2]]}]}
    Draft202012Validator(edit).validate(good)
    for wrong in ({"op": "nothing"}, {"op": "add_event", "more": 1}, {}):
        assert not Draft202012Validator(edit).is_valid({"author": "ann", "operations": [wrong]})
    assert json.loads(document()) == description()
