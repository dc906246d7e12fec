"""A project with a recorded session, a real server on a free port, and browsers of it."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.model import ProjectManifest, Stream
from ecat.process import process_session
from ecat.sample import sample_session
from ecat.store import Draft, create_project, create_session
from ecat.store.media import ColorWriter, DepthWriter
from ecat.web import Server

WIDTH, HEIGHT = 96, 64
DEPTH_WIDTH, DEPTH_HEIGHT = 48, 32
MM_PER_ROW = 20
BITS = 8
COLOR = Stream(name="color", kind="color", camera="color", width_px=WIDTH, height_px=HEIGHT)
DEPTH = Stream(name="depth", kind="depth", width_px=DEPTH_WIDTH, height_px=DEPTH_HEIGHT)


def burnt(k: int) -> NDArray[np.uint8]:
    """Image (height, width, 3) in which the number ``k`` can be read: a square for each bit."""
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    for bit in range(BITS):
        image[8:24, 4 + 11 * bit : 14 + 11 * bit] = 255 if k >> bit & 1 else 0
    return image


def read_number(image: NDArray[np.uint8]) -> int:
    """The number in an image (height, width, 3), whatever size it has become."""
    rows, columns = image.shape[0] / HEIGHT, image.shape[1] / WIDTH
    return sum(
        1 << bit
        for bit in range(BITS)
        if image[round(16 * rows), round((9 + 11 * bit) * columns)].mean() > 128
    )


def depth_image(k: int) -> NDArray[np.uint16]:
    """Image (height, width) uint16 in millimetres: 1 m and more by row and number, nothing in the first column."""
    rows = 1000 + MM_PER_ROW * np.arange(DEPTH_HEIGHT, dtype=np.uint16)[:, None] + k
    image = np.broadcast_to(rows, (DEPTH_HEIGHT, DEPTH_WIDTH)).astype(np.uint16)
    image[:, 0] = 0
    return image


def _draft(folder: Path, name: str) -> Draft:
    """A generated session (boxes, a body, an annotated layer), with small videos of colour and depth."""
    draft, _ = sample_session(seed=3, actions=("next",), name=name)
    n = draft.manifest.n_frames
    color, depth = folder / "color.mp4", folder / "depth.mkv"
    with ColorWriter(color, WIDTH, HEIGHT) as writer:
        for k in range(n):
            # not at a constant rate, so that the recording is no proxy of itself
            writer.write(burnt(k), k * 33_000_000 + (k % 3) * 4_000_000)
    with DepthWriter(depth, DEPTH_WIDTH, DEPTH_HEIGHT) as writer:
        for k in range(n // 2):
            writer.write(depth_image(k), k * 66_000_000)
    streams = (
        replace(COLOR, file="media/color.mp4", n_frames=n),
        replace(DEPTH, file="media/depth.mkv", n_frames=n // 2),
        Stream(name="infrared", kind="infrared", file="media/gone.mkv"),
        Stream(name="skeleton", kind="skeleton", file="media/rig.xml"),
    )
    manifest = replace(draft.manifest, streams=streams)
    return replace(draft, manifest=manifest, files={"color": color, "depth": depth})


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of two sessions: ``slide``, processed, and ``a b/other``, which no address can name as it is."""
    base = tmp_path_factory.mktemp("web")
    folder = base / "study"
    create_project(folder, ProjectManifest(name="a study", created="2024-03-05T10:00:00"))
    create_session(folder / "slide", _draft(base, "slide"))
    process_session(folder / "slide", stages=["plane", "pose"])
    (folder / "a b").mkdir()
    shutil.copytree(folder / "slide", folder / "a b" / "other")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Generator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ECAT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@dataclass(frozen=True)
class Browser:
    """Somebody who was let in."""

    server: Server
    client: httpx.Client

    def get(self, path: str, **options: Any) -> httpx.Response:
        """Ask for an address below that of session ``slide``, or for an absolute one."""
        return self.client.get(self._url(path), **options)

    def post(self, path: str, json: object = None, **options: Any) -> httpx.Response:
        """Post to an address below that of session ``slide``, or to an absolute one."""
        return self.client.post(self._url(path), json=json, **options)

    def json(self, path: str) -> Any:
        """The answer to a GET that has to succeed."""
        answer = self.get(path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    @staticmethod
    def _url(path: str) -> str:
        if path.startswith("/"):
            return path
        return f"/api/sessions/slide{'' if path[:1] in {'', '?'} else '/'}{path}"


@contextlib.contextmanager
def entered(server: Server) -> Generator[Browser]:
    """A browser that has opened an address of the server."""
    with httpx.Client(base_url=server.address, timeout=30.0) as client:
        assert client.get(server.url()).status_code == 303
        yield Browser(server, client)


@pytest.fixture(scope="session")
def served(made_once: Path) -> Generator[Server]:
    """A server for tests that only look."""
    with Server(made_once, port=0, author="ann", layer="main").running() as server:
        yield server


@pytest.fixture(scope="session")
def reader(served: Server) -> Generator[Browser]:
    """A browser for tests that only look."""
    with entered(served) as browser:
        yield browser


@pytest.fixture
def project(made_once: Path, tmp_path: Path) -> Path:
    """A copy of the project, to do anything to."""
    return Path(shutil.copytree(made_once, tmp_path / "study"))


@pytest.fixture
def server(project: Path) -> Generator[Server]:
    """A server of the copy."""
    with Server(project, port=0, author="ann").running() as made:
        yield made


@pytest.fixture
def browser(server: Server) -> Generator[Browser]:
    """A browser of the copy's server."""
    with entered(server) as made:
        yield made
