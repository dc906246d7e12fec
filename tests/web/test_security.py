"""Who is let in, and what is said to all others."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest

from ecat.web import Server
from ecat.web.security import MOST_BODY_BYTES, Access, host_name

if TYPE_CHECKING:
    from tests.web.conftest import Browser

PROJECT = "/api/project"


@pytest.fixture
def stranger(served: Server) -> Iterator[httpx.Client]:
    """Somebody who has not been let in."""
    with httpx.Client(base_url=served.address, timeout=30.0) as client:
        yield client


def refused(answer: httpx.Response, status: int = 403) -> None:
    assert answer.status_code == status, answer.text
    if answer.headers["content-type"].startswith("text/html"):
        # what a person sees who opens an old address
        assert answer.request.url.path == "/"
        assert "ecat annotate" in answer.text
        return
    assert set(answer.json()["error"]) >= {"kind", "what", "where", "consequence", "fix"}


def test_nobody_gets_anything_without_a_token(stranger: httpx.Client) -> None:
    for path in (
        "/",
        PROJECT,
        "/api/sessions/slide",
        "/assets/x.js",
        "/index.html",
        "/api/nothing",
        "/?token=",
        "/?token=x",
    ):
        refused(stranger.get(path))
    refused(stranger.post("/api/invitations"))


def test_a_token_is_exchanged_for_a_cookie_that_scripts_and_other_sites_cannot_use(
    served: Server, stranger: httpx.Client
) -> None:
    answer = stranger.get(served.url())
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    said = answer.headers["set-cookie"].lower()
    assert "httponly" in said
    assert "samesite=strict" in said
    assert stranger.get(PROJECT).status_code == 200


def test_a_token_works_once_except_for_whoever_is_in(served: Server, stranger: httpx.Client) -> None:
    url = served.url()
    assert stranger.get(url).status_code == 303
    assert stranger.get(url).status_code == 303
    with httpx.Client(base_url=served.address) as other:
        refused(other.get(url))
        refused(other.get(PROJECT))


def test_a_program_shows_the_token_itself_and_uses_it_up(served: Server, stranger: httpx.Client) -> None:
    token = served.site.access.invite()
    for _ in range(2):
        assert stranger.get(PROJECT, headers={"authorization": f"Bearer {token}"}).status_code == 200
    refused(stranger.get(f"/?token={token}"))
    refused(stranger.get(PROJECT, headers={"authorization": "Bearer nonsense"}))


def test_whoever_is_in_can_invite(reader: Browser, stranger: httpx.Client) -> None:
    path = reader.client.post("/api/invitations").json()["path"]
    assert stranger.get(path).status_code == 303
    assert stranger.get(PROJECT).status_code == 200


def test_a_link_on_another_sites_page_lets_in_by_a_page_of_our_own(
    served: Server, stranger: httpx.Client
) -> None:
    # the strict cookie would not go along with a redirect that another site began
    answer = stranger.get(served.url(), headers={"sec-fetch-site": "cross-site"})
    assert answer.status_code == 200
    assert 'http-equiv="refresh"' in answer.text
    assert stranger.get(PROJECT, headers={"sec-fetch-site": "same-origin"}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "", "127.0.0.1.evil.example", "[::2]:80", "::1", "localhost."]
)
def test_a_name_that_is_not_ours_is_refused(reader: Browser, host: str) -> None:
    refused(reader.get(PROJECT, headers={"host": host}))


@pytest.mark.parametrize("host", ["localhost", "localhost:9000", "LOCALHOST", "127.0.0.1:1", "[::1]:8765"])
def test_through_a_tunnel_the_port_is_another_one(reader: Browser, host: str) -> None:
    assert reader.get(PROJECT, headers={"host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://localhost:1", "", "file://"])
def test_pages_of_other_sites_are_refused(reader: Browser, origin: str) -> None:
    refused(reader.get(PROJECT, headers={"origin": origin}))
    refused(reader.post("/api/invitations", headers={"origin": origin}))


@pytest.mark.parametrize("site", ["cross-site", "same-site", "nonsense"])
def test_what_other_sites_embed_is_refused(reader: Browser, site: str) -> None:
    refused(reader.get("media/color", headers={"sec-fetch-site": site}))
    refused(reader.get("/assets/x.js", headers={"sec-fetch-site": site}))


def test_our_own_page_is_served(reader: Browser, served: Server) -> None:
    headers = {"origin": served.address, "sec-fetch-site": "same-origin"}
    assert reader.get(PROJECT, headers=headers).status_code == 200


def test_every_answer_says_what_a_browser_may_do_with_it(reader: Browser, stranger: httpx.Client) -> None:
    answers = [
        reader.get("/"),
        reader.get(PROJECT),
        reader.get("/api/nothing"),
        stranger.get("/"),
        reader.get("/nothing.js"),
    ]
    for answer in answers:
        policy = answer.headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
    assert {answer.headers.get("cache-control") for answer in answers[:3]} == {"no-store"}


def test_a_body_is_refused_before_it_fills_the_memory(reader: Browser) -> None:
    refused(reader.client.post("/api/invitations", content=bytes(MOST_BODY_BYTES + 1)), 413)

    def endless() -> Iterator[bytes]:
        for _ in range(MOST_BODY_BYTES // 65536 + 2):
            yield bytes(65536)

    refused(reader.client.post("/api/invitations", content=endless()), 413)
    assert reader.get(PROJECT).status_code == 200


def test_a_body_that_claims_to_be_huge_is_not_waited_for(served: Server) -> None:
    with socket.create_connection(("127.0.0.1", served.port), timeout=10) as raw:
        token = served.site.access.invite()
        raw.sendall(
            b"POST /api/invitations HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer " + token.encode()
            + b"\r\nContent-Length: 99999999999999999999999\r\n\r\n"
        )  # fmt: skip
        assert raw.recv(12) in {b"HTTP/1.1 413", b"HTTP/1.1 400"}


@pytest.mark.parametrize(
    "path",
    [
        "/../app.py",
        "/assets/../../app.py",
        "/%2e%2e/app.py",
        "/assets/..%2f..%2fapp.py",
        "/..%5capp.py",
        "/assets/",
        "/assets",
    ],
)
def test_nothing_but_the_page_is_served(reader: Browser, path: str) -> None:
    raw = reader.client.build_request("GET", f"{reader.server.address}/")
    raw.url = httpx.URL(scheme="http", host="127.0.0.1", port=reader.server.port, raw_path=path.encode())
    refused(reader.client.send(raw), 404)


def test_servers_of_one_machine_do_not_take_each_others_cookies() -> None:
    assert Access(place=1).cookie != Access(place=2).cookie
    assert Access(place=1).cookie == Access(place=1).cookie


def test_a_server_for_everybody_is_called_by_address_never_by_a_name_that_could_be_rebound() -> None:
    everywhere, here = Access("0.0.0.0"), Access()
    assert everywhere.is_called("192.168.1.5")
    assert everywhere.is_called(socket.gethostname())
    assert not everywhere.is_called("evil.example")
    assert not here.is_called("192.168.1.5")
    assert Access("192.168.1.5").is_called("192.168.1.5")


def test_the_name_in_a_host_header_is_what_stands_before_its_port() -> None:
    assert [host_name(h) for h in ("a", "a:1", "[::1]", "[::1]:1")] == ["a", "a", "::1", "::1"]


def test_tokens_that_nobody_uses_do_not_pile_up() -> None:
    access = Access()
    first = last = access.invite()
    for _ in range(2000):
        last = access.invite()
    assert access.exchange(first) is None
    assert access.exchange(last) is not None


def test_only_the_first_browser_is_taken_for_whoever_started_the_server(project: Path) -> None:
    with Server(project, port=0, author="ann").running() as server:
        suggested: list[str] = []
        for _ in range(2):
            with httpx.Client(base_url=server.address, timeout=30.0) as browser:
                assert browser.get(server.url()).status_code == 303
                suggested.append(browser.get(PROJECT).json()["author"])
    assert suggested == ["ann", ""]
