"""Listening, and ending in order."""

from __future__ import annotations

import contextlib
import gc
import socket
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import uvicorn

from ecat.errors import EcatError, UsageError
from ecat.web.app import guarded
from ecat.web.security import Access
from ecat.web.site import Site

USUAL_PORT = 8765
_END_WITHIN_S = 5
_KEEP_S = 75
"""Longer than people think between two edits, so that an edit seldom has to connect anew."""
_MOST_MESSAGE_BYTES = 1 << 16
_SWITCH_S = 0.0005
"""How long one thread of Python may keep the others waiting: a table being packed, an edit to be acknowledged."""
_COLLECT_AFTER = 200_000, 20, 20
"""A layer has hundreds of thousands of small objects, none of them garbage: looking for some takes most of the time."""


class Server:
    """A site on a port of this machine.

    Parameters
    ----------
    path : a session, project, workspace or folder of sessions.
    host : the address to listen on.
    port : 0 for any that is free; None for the usual one, or any if that is taken.
    author, layer : what the page suggests.

    Raises
    ------
    NotFoundError : there is no session at ``path``.
    UsageError : the address cannot be listened on.
    """

    def __init__(
        self,
        path: Path,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        author: str = "",
        layer: str = "main",
    ) -> None:
        self._socket = _bound(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        try:
            self.site = Site(path, Access(host, self.port), author=author, layer=layer)
        except BaseException:
            self._socket.close()
            raise
        config = uvicorn.Config(
            guarded(self.site),
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            lifespan="on",
            loop="asyncio",
            http="h11",
            ws="websockets-sansio",
            ws_max_size=_MOST_MESSAGE_BYTES,
            timeout_graceful_shutdown=_END_WITHIN_S,
            timeout_keep_alive=_KEEP_S,
        )
        self._server = uvicorn.Server(config)

    @property
    def address(self) -> str:
        """Where it is, as a browser on this machine calls it."""
        name = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)  # noqa: S104
        return f"http://{f'[{name}]' if ':' in name and not name.startswith('[') else name}:{self.port}"

    def url(self) -> str:
        """An address that lets one browser in."""
        return f"{self.address}/?token={self.site.access.invite()}"

    def run(self) -> None:
        """Serve until interrupted (or :meth:`end`); what was edited is saved when this returns."""
        with _responsive(), contextlib.closing(self._socket), contextlib.suppress(KeyboardInterrupt):
            self._server.run(sockets=[self._socket])

    def end(self) -> None:
        """Let :meth:`run` return, from whichever thread."""
        self._server.should_exit = True

    @contextmanager
    def running(self) -> Generator[Server]:
        """Serve in a thread while the block runs."""
        thread = threading.Thread(target=self.run, name="server")
        thread.start()
        try:
            while not self._server.started:
                if not thread.is_alive():
                    raise EcatError(
                        "cannot serve",
                        where="the server ended as it began; the lines above say why",
                        consequence="nothing was changed",
                        fix="do it again, with another --port",
                    )
                thread.join(0.01)
            yield self
        finally:
            self.end()
            thread.join()


@contextmanager
def _responsive() -> Generator[None]:
    """Settings of the interpreter under which nobody waits for long."""
    switch, collect = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(_SWITCH_S)
    gc.set_threshold(*_COLLECT_AFTER)
    try:
        yield
    finally:
        sys.setswitchinterval(switch)
        gc.set_threshold(*collect)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches what listens on ``host``."""
    return host in {"localhost", "::1"} or host.startswith("127.")


def _bound(host: str, port: int | None) -> socket.socket:
    try:
        return _listening(host, USUAL_PORT if port is None else port)
    except OSError as error:
        if port is None:
            with contextlib.suppress(OSError):
                return _listening(host, 0)
        raise UsageError(
            f"cannot listen on {host}:{port or USUAL_PORT}",
            where=error.strerror or str(error),
            fix="choose another --port, or leave it out",
        ) from error


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # said in full: asyncio sends small answers at once (TCP_NODELAY) only of sockets that say they are TCP
    made = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
        made.listen(128)
    except BaseException:
        made.close()
        raise
    return made
