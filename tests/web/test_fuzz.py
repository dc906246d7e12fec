"""Whatever is sent to whichever address: an answer of the one shape, never a bug, and the session as it was."""

from __future__ import annotations

import json
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import httpx
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ecat.annotate import OPERATIONS
from ecat.store import open_session
from ecat.web.openapi import description

if TYPE_CHECKING:
    from tests.web.conftest import Browser

ROUTES = sorted((path, method) for path, methods in description()["paths"].items() for method in methods)
FEW = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])

names = st.sampled_from(
    [
        "slide",
        "main",
        "color",
        "depth",
        "poses",
        "a1",
        "o1",
        "..",
        ".",
        "",
        "0",
        "-1",
        "1e3",
        "nan",
        "%",
        "\0",
        "a/b",
        "\\",
    ]
)
texts = st.one_of(names, st.text(max_size=20), st.integers().map(str), st.text("./\\%\0", max_size=8))
values: st.SearchStrategy[Any] = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.integers(-3, 200),
        st.floats(),
        texts,
        st.just("x" * 11_000),
    ),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4),
    max_leaves=12,
)
FIELDS = (
    "author base operations op revision id kind type tier parent segments roles text frame object target name value "
    "session start end edge segment coordinates events ids predicate arguments proposal children mode step duration"
)
HEADERS = "range if-range if-none-match accept accept-encoding content-type content-encoding cookie expect"
fields = st.sampled_from(FIELDS.split())
bodies = st.one_of(
    values,
    st.dictionaries(fields, values, max_size=6),
    st.builds(
        lambda said: {"author": "eve", "operations": said},
        st.lists(
            st.builds(
                lambda op, said: {**said, "op": op},
                st.sampled_from(sorted(OPERATIONS)),
                st.dictionaries(fields, values, max_size=5),
            ),
            min_size=1,
            max_size=3,
        ),
    ),
)
header_values = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=30).map(str.strip)
headers = st.dictionaries(
    st.sampled_from(HEADERS.split()),
    st.one_of(
        header_values,
        st.sampled_from(["bytes=0-", "bytes=5-2", "bytes=-0", "bytes=0-0,2-3", "gzip", "application/json"]),
    ),
    max_size=3,
)


@pytest.fixture
def sound(browser: Browser) -> Generator[Browser]:
    """A browser whose server must neither fail nor lose anything."""
    browser.post(
        "layers/main/operations",
        {"author": "ann", "operations": [{"op": "add_event", "type": "kept", "segments": [[1, 2]]}]},
    )
    before = browser.json("layers/main")["layer"]
    yield browser
    after = browser.json("layers/main")["layer"]
    if after != before:  # by operations that happened to be right, which can be undone
        assert browser.post("layers/main/restore", {"author": "eve", "revision": 1}).status_code == 200
    elements = "objects", "events", "relations", "decisions"
    restored = browser.json("layers/main")["layer"]
    assert {name: restored[name] for name in elements} == {name: before[name] for name in elements}


def answered(answer: httpx.Response) -> None:
    """A success, or a refusal of the one shape that is no bug."""
    call = f"{answer.request.method} {answer.request.url}: {answer.text[:500]}"
    assert answer.status_code != 500, call
    assert "Traceback" not in answer.text[:100_000]
    if answer.status_code < 400:
        return
    assert answer.status_code in {400, 403, 404, 405, 409, 413, 416, 422}, call
    error = answer.json()["error"]
    assert {"kind", "what", "where", "consequence", "fix"} <= set(error), call
    assert "bug" not in error["what"], call


def address(path: str, data: st.DataObject) -> str:
    while "{" in path:
        before, _, rest = path.partition("{")
        name, _, after = rest.partition("}")
        usual = {
            "sid": "slide",
            "layer": "main",
            "stream": "color",
            "frame": "3",
            "revision": "0",
            "table": "poses",
        }
        value = data.draw(st.one_of(st.just(usual.get(name, "x")), texts), label=name)
        path = before + quote(value.encode("utf-8", "surrogatepass"), safe="") + after
    return path


@FEW
@given(st.sampled_from(ROUTES), st.dictionaries(fields | names, texts, max_size=3), headers, st.data())
def test_any_question_is_answered(
    sound: Browser, route: tuple[str, str], query: dict[str, str], said: dict[str, str], data: st.DataObject
) -> None:
    path, method = route
    known = (
        {"u": "3", "v": "4", "columns": "frame", "layers": "main,main"} if data.draw(st.booleans()) else {}
    )
    asked = {key: value.encode("utf-8", "surrogatepass") for key, value in {**known, **query}.items()}
    query_text = "&".join(
        f"{quote(key.encode('utf-8', 'surrogatepass'))}={quote(value)}" for key, value in asked.items()
    )
    content = json.dumps(data.draw(bodies)).encode() if method == "post" else None
    url = httpx.URL(
        scheme="http",
        host="127.0.0.1",
        port=sound.server.port,
        raw_path=f"{address(path, data)}?{query_text}".encode(),
    )
    answered(sound.client.request(method, url, content=content, headers=said))


@FEW
@given(st.sampled_from([path for path, method in ROUTES if method == "post"]), bodies)
@example(
    "/api/sessions/{sid}/layers/{layer}/operations", {"author": "\ud800", "operations": [{"op": "add_event"}]}
)
@example("/api/sessions/{sid}/layers/{layer}/operations", {"author": "e", "operations": [{"op": "\ud800"}]})
@example(
    "/api/sessions/{sid}/layers/{layer}/operations",
    {"author": "e\0", "operations": [{"op": "add_event", "type": "x"}]},
)
def test_any_body_is_answered(sound: Browser, path: str, body: object) -> None:
    url = path.replace("{sid}", "slide").replace("{layer}", "main")
    json_body = {"content-type": "application/json"}
    answered(sound.client.post(url, content=json.dumps(body).encode(), headers=json_body))


@FEW
@given(st.sampled_from([path for path, method in ROUTES if method == "post"]), st.binary(max_size=200))
def test_bytes_that_mean_nothing_are_answered(sound: Browser, path: str, content: bytes) -> None:
    url = path.replace("{sid}", "slide").replace("{layer}", "main")
    answered(sound.client.post(url, content=content, headers={"content-type": "application/json"}))


@FEW
@given(
    st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=40),
    st.sampled_from(["GET", "POST", "PUT", "BREW"]),
)
def test_any_address_is_answered(sound: Browser, path: str, method: str) -> None:
    raw = httpx.URL(
        scheme="http",
        host="127.0.0.1",
        port=sound.server.port,
        raw_path=b"/" + path.replace("#", "").encode(),
    )
    answered(sound.client.request(method, raw))


def test_the_session_is_sound_after_all_of_it(sound: Browser, project: Path) -> None:
    sound.post("layers/main/save", {})
    assert any(event.type == "kept" for event in open_session(project / "slide").layer().events)
