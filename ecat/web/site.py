"""Everything that a running server has: sessions, who is in, videos."""

from __future__ import annotations

import asyncio
import contextlib
import traceback
from collections.abc import AsyncGenerator, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

from fastapi import Depends
from fastapi.requests import HTTPConnection

from ecat.annotate import Record
from ecat.errors import ConflictError, EcatError, UsageError
from ecat.model.annotation import MACHINE
from ecat.web.exact import ExactImages
from ecat.web.jobs import Jobs
from ecat.web.layers import SharedLayer
from ecat.web.library import Library
from ecat.web.proxies import Proxies, Proxy
from ecat.web.security import Access
from ecat.web.sessions import OpenSession
from ecat.web.uploads import Uploads

T = TypeVar("T")
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
        self.jobs = Jobs()
        self.uploads = Uploads()
        self._open: dict[str, OpenSession] = {}
        self._leaving: set[str] = set()
        self._tasks: list[asyncio.Task[None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None

    async def opened(self, sid: str) -> OpenSession:
        """The session with this id.

        Raises
        ------
        NotFoundError : there is no such session.
        ConflictError : it is being taken out of the project.
        """
        if sid not in self._open:
            await asyncio.to_thread(self.library.path, sid)
            made = await asyncio.to_thread(OpenSession, sid, self)
            if sid in self._leaving:
                raise ConflictError(
                    f"cannot open session {sid}", where="it is being put away just now", fix="restore it"
                )
            self._open.setdefault(sid, made)
        return self._open[sid]

    @asynccontextmanager
    async def leaving(self, sid: str) -> AsyncGenerator[list[str]]:
        """Let go of a session for as long as the block runs, unless there are people in it: their names."""
        opened = self._open.get(sid)
        people = [] if opened is None else opened.hub.names()
        if people or sid in self._leaving:
            yield people or ["somebody"]
            return
        self._leaving.add(sid)
        try:
            await self._forget(sid)
            yield []
        finally:
            self._leaving.discard(sid)

    async def _forget(self, sid: str) -> None:
        opened = self._open.pop(sid, None)
        if opened is not None:
            await opened.close()

    async def edit(
        self, sid: str, layer: str, author: str, operations: list[dict[str, Any]], *, make: bool
    ) -> Record | None:
        """Do operations in a session that nobody need look at; None where there is no such layer, and none is made."""
        known = sid in self._open
        opened = await self.opened(sid)
        try:
            session = await asyncio.to_thread(lambda: opened.session)
            if not make and session.manifest.layer(layer) is None:
                return None
            return await (await opened.layer(layer, make=make)).edit(operations, None, author)
        finally:
            if not known and not len(opened.hub):
                await self._forget(sid)

    def wait_for(self, work: Coroutine[Any, Any, T]) -> T:
        """The result of something that the event loop has to do; from another thread."""
        assert self._loop is not None, "the server runs"
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def start(self) -> None:
        """Begin to look after what is open."""
        loop = self._loop = asyncio.get_running_loop()

        def changed(key: str, proxy: Proxy) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._proxy_changed, key, proxy)

        self.proxies.changed = changed
        self._tasks = [asyncio.create_task(self._look()), asyncio.create_task(self._warm_up())]

    async def stop(self) -> None:
        """Save what was edited, and end what is under way."""
        for task in self._tasks:
            task.cancel()
        await asyncio.to_thread(self.jobs.close)
        self.uploads.close()
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


def require_peoples(layer: str) -> None:
    """Return if a layer is one that people edit.

    Raises
    ------
    UsageError : it is the machine's.
    """
    if layer == MACHINE:
        raise UsageError(
            f"cannot edit layer {layer}",
            where="it holds what stages propose, and is written anew when they run",
            fix="accept or reject its proposals in a layer of your own",
        )


async def _peoples(layer: str) -> None:
    require_peoples(layer)


TheSite = Annotated[Site, Depends(_site_of)]
TheSession = Annotated[OpenSession, Depends(_opened)]
TheLayer = Annotated[SharedLayer, Depends(_layer)]
EDITED = [Depends(_peoples)]
"""Of routes that change a layer."""
