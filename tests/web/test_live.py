"""What an open page is told about the others."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from ecat.annotate import AddEvent, Editor
from ecat.store import TableData, open_session
from ecat.web import Server
from ecat.web.live import MOST_WAITING, Hub

if TYPE_CHECKING:
    from tests.web.conftest import Browser

WITHIN_S = 10.0
T = TypeVar("T")


@contextmanager
def page(server: Server, sid: str = "slide", **options: Any) -> Generator[ClientConnection]:
    """An open page's connection."""
    headers = {"authorization": f"Bearer {server.site.access.invite()}", **options.pop("headers", {})}
    url = f"ws://127.0.0.1:{server.port}/api/sessions/{sid}/live"
    with connect(url, additional_headers=headers, open_timeout=WITHIN_S, **options) as live:
        yield live


def told(
    live: ClientConnection, wanted: Callable[[dict[str, Any]], object], within_s: float = WITHIN_S
) -> dict[str, Any]:
    """The next message that is wanted."""
    while True:
        message: dict[str, Any] = json.loads(live.recv(within_s))
        if wanted(message):
            return message


def of_type(kind: str) -> Callable[[dict[str, Any]], bool]:
    return lambda message: message["type"] == kind


def event(start: int = 1) -> dict[str, Any]:
    return {"op": "add_event", "type": "slide", "segments": [[start, start + 5]]}


def edit(browser: Browser, *operations: dict[str, Any]) -> Any:
    answer = browser.post("layers/main/operations", {"author": "ben", "operations": operations})
    assert answer.status_code == 200, answer.text
    return answer.json()["record"]


def test_a_page_is_told_every_record_in_its_order(browser: Browser) -> None:
    with page(browser.server) as one, page(browser.server) as two:
        told(one, of_type("hello"))
        told(two, of_type("hello"))
        made = [edit(browser, event(start)) for start in range(5)]
        for live in (one, two):
            assert [told(live, of_type("record")) for _ in made] == [
                {"type": "record", "layer": "main", "record": record} for record in made
            ]


def test_a_page_of_another_session_is_not_told(browser: Browser) -> None:
    (other,) = (s["id"] for s in browser.json("/api/project")["sessions"] if s["id"] != "slide")
    with page(browser.server, other) as live:
        told(live, of_type("hello"))
        edit(browser, event())
        with pytest.raises(TimeoutError):
            told(live, of_type("record"), within_s=0.5)


def test_people_see_each_other_come_move_and_go(browser: Browser) -> None:
    with page(browser.server) as one:
        with page(browser.server) as two:
            two.send(
                json.dumps(
                    {"type": "presence", "name": "ben", "layer": "main", "frame": 7, "selection": "a1"}
                )
            )
            seen = told(
                one, lambda m: m["type"] == "presence" and any(p["name"] == "ben" for p in m["people"])
            )
            (ben,) = (person for person in seen["people"] if person["name"] == "ben")
            assert (ben["layer"], ben["frame"], ben["selection"]) == ("main", 7, "a1")
            assert len(seen["people"]) == 2
        gone = told(one, lambda m: m["type"] == "presence" and len(m["people"]) == 1)
        assert gone["people"][0]["name"] == ""


def test_a_page_that_comes_is_told_which_revisions_there_are(browser: Browser) -> None:
    edit(browser, event())
    with page(browser.server) as live:
        hello = told(live, of_type("hello"))
        assert hello["revisions"] == {"main": 1}
        assert hello["id"]


def put_table(path: Path) -> None:
    """What a stage does when it has found something."""
    session = open_session(path)
    with session.write() as commit:
        commit.put_table("poses", TableData(data=session.table("poses").to_arrow().slice(1)))


def test_a_table_that_is_written_right_after_the_session_was_shown_is_told(
    browser: Browser, project: Path
) -> None:
    """Also before anybody looked for the first time whether there is one."""
    shown = browser.json("")["tables_sha256"]
    put_table(project / "slide")
    with page(browser.server) as live:
        noticed = told(live, of_type("hello"))["tables_sha256"] != shown
        assert noticed or told(live, of_type("tables"))["tables"] == ["poses"]


def test_a_page_that_comes_is_told_which_tables_there_are(browser: Browser, project: Path) -> None:
    before = browser.json("")["tables_sha256"]
    with page(browser.server) as live:
        assert told(live, of_type("hello"))["tables_sha256"] == before
        put_table(project / "slide")
        told(live, of_type("tables"))
    with page(browser.server) as live:
        now = told(live, of_type("hello"))["tables_sha256"]
        assert now == browser.json("")["tables_sha256"] != before


def test_what_another_process_does_is_told_too(browser: Browser, project: Path) -> None:
    edit(browser, event())
    with page(browser.server) as live:
        told(live, of_type("hello"))
        with Editor(open_session(project / "slide"), author="carl") as editor:
            editor.apply(AddEvent(type="wave", segments=((1, 2),)))
        assert told(live, of_type("record"))["record"]["author"] == "carl"


def test_a_layer_that_a_stage_writes_anew_is_told(browser: Browser, project: Path) -> None:
    browser.json("layers/main")
    with page(browser.server) as live:
        told(live, of_type("hello"))
        session = open_session(project / "slide")
        with session.write() as commit:
            commit.put_layer(replace(session.layer(), events=()))
        assert told(live, of_type("replaced")) == {"type": "replaced", "layer": "main", "revision": 0}
        assert browser.json("layers/main")["layer"]["events"] == []


def test_a_checkpoint_is_told(browser: Browser) -> None:
    with page(browser.server) as live:
        edit(browser, event())
        browser.post("layers/main/save", {})
        assert told(live, of_type("saved")) == {"type": "saved", "layer": "main", "revision": 1}


def test_a_video_that_is_made_is_told(project: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from tests.web.conftest import entered

    monkeypatch.setenv("ECAT_CACHE", str(tmp_path / "cache"))
    with Server(project, port=0).running() as server, entered(server) as browser, page(server) as live:
        told(live, of_type("hello"))
        assert browser.get("media/color").status_code == 404
        ready = told(
            live, lambda m: m["type"] == "proxy" and m["stream"] == "color" and m["state"] == "ready"
        )
        assert browser.get(ready["url"]).status_code == 200
        assert ready["fps"] == 30


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{",
        "null",
        "[]",
        '{"type": "edit"}',
        '{"type": "presence", "frame": "x"}',
        '{"type": "presence", "more": 1}',
    ],
)
def test_what_is_not_understood_ends_the_connection(browser: Browser, message: str) -> None:
    with page(browser.server) as live:
        live.send(message)
        with pytest.raises(ConnectionClosed):
            told(live, lambda _: False)
    with page(browser.server) as live:  # and nothing else
        assert told(live, of_type("hello"))


def test_a_message_that_is_too_long_ends_the_connection(browser: Browser) -> None:
    with page(browser.server) as live:
        live.send("x" * 200_000)
        with pytest.raises(ConnectionClosed):
            told(live, lambda _: False)


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"},
        {"authorization": "Bearer nonsense"},
        {"sec-fetch-site": "cross-site"},
    ],
)
def test_strangers_and_other_sites_hear_nothing(browser: Browser, headers: dict[str, str]) -> None:
    with pytest.raises(InvalidStatus) as refused, page(browser.server, headers=headers):
        pass
    assert refused.value.response.status_code == 403


def test_a_name_that_is_not_ours_is_refused_here_too(browser: Browser) -> None:
    headers = {"authorization": f"Bearer {browser.server.site.access.invite()}"}
    with socket.create_connection(("127.0.0.1", browser.server.port)) as raw, pytest.raises(InvalidStatus):
        connect("ws://evil.example/api/sessions/slide/live", sock=raw, additional_headers=headers)


def test_there_is_nothing_to_hear_of_a_session_that_is_not_there(browser: Browser) -> None:
    with pytest.raises(InvalidStatus), page(browser.server, "nothing"):
        pass


def test_the_end_of_the_server_is_told(project: Path) -> None:
    with Server(project, port=0).running() as server, page(server) as live:
        told(live, of_type("hello"))
        server.end()
        with pytest.raises(ConnectionClosed) as closed:
            told(live, lambda _: False)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1012


def in_a_loop_of_its_own(work: Coroutine[Any, Any, T]) -> T:
    """What the coroutine returns; whoever ran before in this thread may have left a loop running."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


def test_a_page_that_does_not_read_is_let_go_of() -> None:
    async def run() -> None:
        hub = Hub()
        slow = hub.enter()
        for i in range(MOST_WAITING + 1):
            hub.tell({"i": i})
        assert len(hub) == 0
        assert slow.messages.get_nowait() is None

    in_a_loop_of_its_own(run())


def test_cursors_are_told_together_not_each() -> None:
    async def run() -> int:
        hub = Hub()
        person = hub.enter()
        for _ in range(100):
            hub.presence_changed()
        await asyncio.sleep(0.3)
        return person.messages.qsize()

    assert in_a_loop_of_its_own(run()) == 1
