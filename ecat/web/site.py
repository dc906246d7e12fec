"""Everything that a running server has: sessions, who is in, videos."""

from __future__ import annotations

import asyncio
import contextlib
import traceback
from pathlib import Path
from typing import Annotated

from fastapi import Depends
from fastapi.requests import HTTPConnection

from ecat.errors import EcatError, UsageError
from ecat.model.annotation import MACHINE
from ecat.web.exact import ExactImages
from ecat.web.layers import SharedLayer
from ecat.web.library import Library
from ecat.web.proxies import Proxies, Proxy
from ecat.web.security import Access
from ecat.web.sessions import OpenSession

POLL_S = 1.0
"""How soon what another process does to a layer is seen."""


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

    async def opened(self, sid: str) -> OpenSession:
        """The session with this id.

        Raises
        ------
        NotFoundError : there is no such session.
        """
        if sid not in self._open:
            await asyncio.to_thread(self.library.path, sid)
            self._open.setdefault(sid, OpenSession(sid, self))
        return self._open[sid]

    async def start(self) -> None:
        """Begin to look after what is open."""
        loop = asyncio.get_running_loop()

        def changed(key: str, proxy: Proxy) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._proxy_changed, key, proxy)

        self.proxies.changed = changed
        self._tasks = [asyncio.create_task(self._look()), asyncio.create_task(self._warm_up())]

    async def stop(self) -> None:
        """Save what was edited, and end what is under way."""
        for task in self._tasks:
            task.cancel()
        for opened in self._open.values():
            await opened.close()
        await asyncio.to_thread(self.proxies.close)
        self.exact.close()

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(POLL_S)
            for opened in list(self._open.values()):
                try:
                    await opened.look()
                except Exception:  # noqa: BLE001 - a fault of one look must not end all later ones
                    traceback.print_exc()

    async def _warm_up(self) -> None:
        """Read the only session while its page is on the way."""
        with contextlib.suppress(EcatError):  # whoever asks is told
            paths = await asyncio.to_thread(self.library.find)
            if len(paths) == 1:
                opened = await self.opened(*paths)
                layer = await opened.first_layer(None)
                await asyncio.to_thread(opened.facts)
                if layer is not None:
                    await asyncio.to_thread(layer.answer, None)

    def _proxy_changed(self, key: str, proxy: Proxy) -> None:
        for opened in self._open.values():
            opened.tell_proxy(key, proxy)


def _site(connection: HTTPConnection) -> Site:
    return connection.app.state.site


async def _opened(sid: str, connection: HTTPConnection) -> OpenSession:
    return await _site(connection).opened(sid)


async def _site_of(connection: HTTPConnection) -> Site:
    return _site(connection)


async def _layer(sid: str, layer: str, connection: HTTPConnection) -> SharedLayer:
    return await (await _site(connection).opened(sid)).layer(layer)


async def _peoples(layer: str) -> None:
    if layer == MACHINE:
        raise UsageError(
            f"cannot edit layer {layer}",
            where="it holds what stages propose, and is written anew when they run",
            fix="accept or reject its proposals in a layer of your own",
        )


TheSite = Annotated[Site, Depends(_site_of)]
TheSession = Annotated[OpenSession, Depends(_opened)]
TheLayer = Annotated[SharedLayer, Depends(_layer)]
EDITED = [Depends(_peoples)]
"""Of routes that change a layer."""
