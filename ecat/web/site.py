"""Everything that a running server has: sessions, who is in, videos, and the layers that are being edited."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from pathlib import Path
from typing import Annotated, Any

from fastapi import Depends
from fastapi.requests import HTTPConnection

from ecat.errors import EcatError
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.web import proxies, scene
from ecat.web.exact import IMAGE_KINDS, ExactImages
from ecat.web.library import Library
from ecat.web.live import Hub
from ecat.web.proxies import Proxies, Proxy
from ecat.web.security import Access
from ecat.web.series import Curves
from ecat.web.times import count_images, image_times_s, median_rate_hz

POLL_S = 1.0


class OpenSession:
    """One session that somebody looks at."""

    def __init__(self, sid: str, site: Site) -> None:
        self.sid = sid
        self.site = site
        self.hub = Hub()
        self._curves: tuple[str, Curves] | None = None
        self._facts: tuple[str, dict[str, Any]] | None = None
        self._computing = threading.Lock()

    @property
    def session(self) -> Session:
        """As it is on disk now."""
        return self.site.library.session(self.sid)

    def revisions(self) -> dict[str, int]:
        """The revision of every layer that is being edited."""
        return {}

    def curves(self) -> Curves:
        """Its curves over time."""
        session = self.session
        with self._computing:
            if self._curves is None or self._curves[0] != session.snapshot.sha256:
                self._curves = session.snapshot.sha256, Curves(session)
            return self._curves[1]

    def facts(self) -> dict[str, Any]:
        """What the page needs to know that takes looking into tables."""
        session = self.session
        with self._computing:
            if self._facts is None or self._facts[0] != session.snapshot.sha256:
                self._facts = session.snapshot.sha256, _facts(session)
            return self._facts[1]

    def proxy_url(self, stream: str) -> str:
        """Where the page gets the video of a stream from."""
        from urllib.parse import quote

        return f"/api/sessions/{self.sid}/media/{quote(stream, safe='')}"

    def proxies(self, *, make: bool) -> dict[str, Proxy]:
        """The proxy of every stream that has images, the annotated one's first."""
        session, found = self.session, dict[str, Proxy]()
        video = annotated_stream(session.manifest)
        for stream in sorted(session.manifest.streams, key=lambda s: s != video):
            with contextlib.suppress(EcatError):
                if stream.present and stream.kind in IMAGE_KINDS:
                    found[stream.name] = self.site.proxies.get(session, stream.name, make=make)
        return found

    def tell_proxy(self, key: str, proxy: Proxy) -> None:
        """Tell the open pages that a proxy has come to something."""
        if not len(self.hub):
            return
        session = self.session
        for stream in session.manifest.streams:
            with contextlib.suppress(EcatError):
                if stream.kind in IMAGE_KINDS and proxies.key_of(session, stream.name) == key:
                    told = proxies.describe(proxy, self.proxy_url(stream.name))
                    self.hub.tell({"type": "proxy", "stream": stream.name, **told})


def _facts(session: Session) -> dict[str, Any]:
    video = annotated_stream(session.manifest)
    rate: float | None = None
    if video is not None:
        with contextlib.suppress(EcatError):
            rate = median_rate_hz(image_times_s(session, video))
    return {
        "frame_rate_median": rate,
        "images": {stream.name: count_images(session, stream) for stream in session.manifest.streams},
        "cameras": [scene.describe_camera(camera) for camera in session.manifest.cameras],
        "bodies": scene.describe_bodies(session),
        "boxes": scene.describe_boxes(session),
        "plane": scene.describe_plane(session),
    }


class Site:
    """What is served.

    Parameters
    ----------
    path : a session, project, workspace or folder of sessions.
    author, layer : what the page suggests.
    """

    def __init__(self, path: Path, access: Access, *, author: str = "", layer: str = "main") -> None:
        self.library = Library(path)
        self.access = access
        self.author = author
        self.layer = layer
        self.exact = ExactImages()
        self.proxies = Proxies()
        self._open: dict[str, OpenSession] = {}
        self._tasks: list[asyncio.Task[None]] = []

    def opened(self, sid: str) -> OpenSession:
        """The session with this id.

        Raises
        ------
        NotFoundError : there is no such session.
        """
        self.library.path(sid)
        return self._open.setdefault(sid, OpenSession(sid, self))

    async def start(self) -> None:
        """Begin to look after what is open."""
        loop = asyncio.get_running_loop()

        def changed(key: str, proxy: Proxy) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._proxy_changed, key, proxy)

        self.proxies.changed = changed

    async def stop(self) -> None:
        """Save what was edited, and end what is under way."""
        for opened in self._open.values():
            opened.hub.close()
        await asyncio.to_thread(self.proxies.close)
        self.exact.close()

    def _proxy_changed(self, key: str, proxy: Proxy) -> None:
        for opened in self._open.values():
            opened.tell_proxy(key, proxy)


def _site(connection: HTTPConnection) -> Site:
    return connection.app.state.site


async def _opened(sid: str, connection: HTTPConnection) -> OpenSession:
    return _site(connection).opened(sid)


async def _site_of(connection: HTTPConnection) -> Site:
    return _site(connection)


TheSite = Annotated[Site, Depends(_site_of)]
TheSession = Annotated[OpenSession, Depends(_opened)]
