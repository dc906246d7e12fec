"""A real server in a process of its own, and Debian's Chromium driven by Playwright.

Skipped where there is no Chromium (``$ECAT_CHROMIUM``, or ``/usr/bin/chromium``) or no Playwright: Playwright's own
Chromium plays no H.264.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Generator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import pytest

from ecat.model import AnnotatedObject, Layer
from ecat.sample import sample_session
from ecat.store import Session, create_session, open_session
from tests.page.filming import filmed_session, open_filmed

FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
WAIT_MS = 10_000


def _chromium() -> Path:
    found = Path(os.environ.get("ECAT_CHROMIUM", "/usr/bin/chromium"))
    if not found.exists():
        pytest.skip(f"no Chromium at {found}; ECAT_CHROMIUM names another")
    return found


@dataclass(frozen=True)
class Running:
    """``ecat annotate`` of a folder of sessions."""

    folder: Path
    address: str
    token: str

    def ask(self, path: str, data: bytes | None = None) -> Any:
        """The answer to a GET, or to a POST of ``data``."""
        headers = {"authorization": f"Bearer {self.token}", "content-type": "application/json"}
        request = urllib.request.Request(f"{self.address}{path}", data, headers)
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.load(answer)

    def invite(self) -> str:
        """An address that lets one more browser in."""
        return f"{self.address}{self.ask('/api/invitations', b'')['path']}"


@dataclass(frozen=True)
class Served:
    """One session of a running server, which nobody else touches."""

    server: Running
    path: Path

    @property
    def hash(self) -> str:
        """Where the page shows it."""
        return f"#/session/{self.path.name}"

    def layer(self, name: str = "main") -> Layer:
        """A layer as it is on the disk once it was saved."""
        self.server.ask(f"/api/sessions/{self.path.name}/layers/{name}/save", b"{}")
        return self.session().layer(name)

    def session(self) -> Session:
        """What is on the disk now."""
        return open_session(self.path)


@pytest.fixture(scope="session")
def blank_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of 170 frames or so, in which nobody has said anything but what the objects are."""
    folder = tmp_path_factory.mktemp("page") / "slide"
    draft, _ = sample_session(seed=3, actions=("next",), name="slide")
    objects: tuple[AnnotatedObject, ...] = draft.layers[0].objects
    layer = Layer(name="main", scheme="blocks", object_counter=len(objects), objects=objects)
    create_session(folder, replace(draft, layers=(layer,)))
    return folder


@pytest.fixture(scope="session")
def running(blank_once: Path, tmp_path_factory: pytest.TempPathFactory) -> Generator[Running]:
    """One server for all tests."""
    folder = tmp_path_factory.mktemp("served")
    shutil.copytree(blank_once, folder / "first")
    command = [sys.executable, "-m", "ecat", "annotate", str(folder), "--no-browser", "--json", "--port", "0"]
    # what nobody reads would fill a pipe, and stop the server
    log = tmp_path_factory.mktemp("log") / "stderr.txt"
    with (
        log.open("w") as stderr,
        subprocess.Popen(
            [*command, "--author", "ann"], text=True, stdout=subprocess.PIPE, stderr=stderr
        ) as process,
    ):
        try:
            told = _first_json(process, log)
            yield Running(folder, told["address"], told["token"])
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 0
        finally:
            process.kill()


def _first_json(process: subprocess.Popen[str], log: Path) -> dict[str, Any]:
    assert process.stdout is not None
    text = ""
    for line in process.stdout:
        text += line
        with suppress(ValueError):
            return cast("dict[str, Any]", json.loads(text))
    pytest.fail(f"ecat annotate ended: {log.read_text()}")


@pytest.fixture
def served(blank_once: Path, running: Running, request: pytest.FixtureRequest) -> Served:
    """A copy of the blank session, to do anything to."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", request.node.name)
    name = f"{len(list(running.folder.iterdir()))}-{words[:50]}"
    return Served(running, Path(shutil.copytree(blank_once, running.folder / name)))


@pytest.fixture(scope="session")
def chromium() -> Generator[Any]:
    """The browser."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    executable = _chromium()
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=str(executable), args=list(FLAGS))
        yield browser
        browser.close()


@dataclass
class Window:
    """A page in a browser profile of its own, and what it complained of."""

    page: Any
    complaints: list[str]

    def press(self, *keys: str) -> None:
        """Press keys one after the other, each when what the one before did has been saved."""
        for key in keys:
            self.page.keyboard.press(key)
            self.settle()

    def settle(self) -> None:
        """Wait until everything that was done has been acknowledged and is shown."""
        self.page.wait_for_function("() => window.ecat.save === 'saved'", timeout=WAIT_MS)
        self._painted()

    def at(self, frame: int) -> None:
        """Put the cursor at a frame."""
        self.page.evaluate("(frame) => window.ecat.seek(frame)", frame)
        self._painted()

    def _painted(self) -> None:
        """Wait for the next picture: a hand acts upon what it sees."""
        self.page.evaluate("() => new Promise(requestAnimationFrame)")

    def closed(self, test_id: str) -> None:
        """Wait until a dialog has been closed: what it asked for begins then, and not with the click."""
        self.find(test_id).wait_for(state="detached")
        self.settle()

    def find(self, test_id: str) -> Any:
        """The element with a ``data-testid``."""
        return self.page.get_by_test_id(test_id)

    def says(self, expression: str) -> Any:
        """The value of an expression about the page's state, ``app``."""
        return self.page.evaluate(f"() => {{ const app = window.ecat; return {expression}; }}")

    def until(self, condition: str) -> None:
        """Wait until an expression about ``app`` is true."""
        self.page.wait_for_function(
            f"() => {{ const app = window.ecat; return {condition}; }}", timeout=WAIT_MS
        )

    def new_layer(self, name: str) -> None:
        """Begin a layer, and go on in it."""
        self.find("layer-button").click()
        self.find("new-layer").click()
        self.find("prompt-input").fill(name)
        self.find("prompt-yes").click()
        self.until(f"app.activeLayer === '{name}'")
        self.page.keyboard.press("Escape")
        self.closed("layers")

    def opened(self) -> None:
        """Wait until the session is there."""
        self.page.wait_for_selector("#workspace", timeout=WAIT_MS)
        self.settle()


@pytest.fixture
def window(chromium: Any) -> Generator[Callable[..., Window]]:
    """Open a window with a session, in a profile of its own."""
    with ExitStack() as stack:

        def open_(
            served: Served, *, author: str | None = None, address: str | None = None, **options: Any
        ) -> Window:
            context = chromium.new_context(viewport={"width": 1280, "height": 720}, **options)
            stack.callback(context.close)
            # a name that was chosen counts as long as the server suggests the same one as then: nobody, to most
            settings = json.dumps({"author": author or "ann", "suggested": ""})
            context.add_init_script(
                f"localStorage.getItem('ecat.settings') ?? localStorage.setItem('ecat.settings', {settings!r})"
            )
            page = context.new_page()
            made = Window(page, [])
            page.on("pageerror", lambda error: made.complaints.append(str(error)))
            page.on("console", lambda message: _note(made, message))
            page.goto(served.server.invite())
            page.goto(f"{served.server.address}/{address or served.hash}")
            made.opened()
            return made

        yield open_


def _note(window: Window, message: Any) -> None:
    # an answer that refuses is the business of the test; what the page itself does wrong never is
    if message.type == "error" and "Failed to load resource" not in message.text:
        window.complaints.append(message.text)


@pytest.fixture
def annotating(served: Served, window: Callable[..., Window]) -> Generator[Window]:
    """The blank session, opened; the page may not have complained of anything in the end."""
    made = window(served)
    yield made
    assert made.complaints == []


@pytest.fixture(scope="session")
def filmed_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with small videos whose images tell their number, some events, and what a machine proposes."""
    return filmed_session(tmp_path_factory.mktemp("stage"))


@pytest.fixture
def filmed(served: Served, filmed_once: Path) -> Served:
    """A copy of it on the running server."""
    copy = shutil.copytree(filmed_once, served.path.with_name(f"{served.path.name}-filmed"))
    return replace(served, path=Path(copy))


@pytest.fixture
def stage(filmed: Served, window: Callable[..., Window]) -> Generator[Window]:
    """The filmed session with its videos ready, opened."""
    made = open_filmed(window, filmed)
    yield made
    assert made.complaints == []
