"""Who may ask: one-time tokens, the cookie they are exchanged for, and the guard before every request.

What it is to keep out: other sites in the same browser (``Origin``, ``Sec-Fetch-Site``, SameSite cookies), names that
somebody else's name server points at this machine (``Host``; DNS rebinding), other users of the machine (the token),
and whoever finds the address in a history later (it works once).
"""

from __future__ import annotations

import asyncio
import hashlib
import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any, TypeAlias
from urllib.parse import parse_qs

from fastapi import Response

from ecat.errors import EcatError, LimitError
from ecat.web.answers import ForbiddenError, error_answer

Scope: TypeAlias = MutableMapping[str, Any]
Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BODY_BYTES = 8 << 20
BODY_TIMEOUT_S = 30.0
UPLOADS = "/api/uploads/"
"""Files are put below it."""
COOKIE_AGE_S = 7 * 24 * 3600
"""The cookie outlives the browser, not the server: its value dies with the process that gave it."""
MOST_TOKENS = 1000
POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
_HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_CLOSED = """<!doctype html><html lang="en"><meta charset="utf-8"><title>ecat</title>
<h1>This address does not open anything any more</h1>
<p>An address of <code>ecat annotate</code> lets one browser in, once, and as long as the server runs that
printed it.</p>
<p>Open the newest address that it printed, or start it again: <code>ecat annotate PATH</code>. What was
shown as saved is saved.</p>"""
_REFRESH = b'<!doctype html><meta http-equiv="refresh" content="0;url=/"><title>ecat</title>'


class Access:
    """The tokens that were given out and are not used up, and the keys of those who are in.

    Parameters
    ----------
    bound : the address that the server listens on, which is also a name to call it by.
    place : what tells servers of one machine apart, whose cookies a browser would otherwise mix up: the port.
    """

    def __init__(self, bound: str = "127.0.0.1", place: object = "") -> None:
        self._tokens: set[bytes] = set()
        self._keys: set[bytes] = set()
        self._first: bytes | None = None
        self._names = _LOOPBACK | {bound.lower()}
        # listening everywhere, it is called by any of the machine's addresses, none of which can be rebound
        self._any_address = _is_unspecified(bound)
        if self._any_address:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
        self.cookie = f"ecat_{hashlib.sha256(f'{socket.gethostname()} {place}'.encode()).hexdigest()[:8]}"
        self.on_entry: Callable[[], None] = lambda: None
        """Called when a token was used up: whoever invites may want to show the next one."""

    def invite(self) -> str:
        """A token that lets one browser or program in."""
        token = secrets.token_urlsafe(32)
        if len(self._tokens) >= MOST_TOKENS:
            self._tokens.clear()
        self._tokens.add(_digest(token))
        return token

    def exchange(self, token: str) -> str | None:
        """The key for a token, which is used up by that; None for a token that is not one, or no longer."""
        if (digest := _digest(token)) not in self._tokens:
            return None
        self._tokens.discard(digest)
        key = secrets.token_urlsafe(32)
        self._keys.add(_digest(key))
        self._first = self._first or _digest(key)
        self.on_entry()
        return key

    def is_key(self, value: str) -> bool:
        """Whether this is the key of somebody who is in; a token that is shown as one becomes one."""
        digest = _digest(value)
        if digest in self._tokens:
            self._tokens.discard(digest)
            self._keys.add(digest)
            self.on_entry()
        return digest in self._keys

    def admits(self, headers: Mapping[str, str]) -> bool:
        """Whether a request with these headers comes from somebody who is in."""
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self.is_key(bearer.strip())
        digest = self._digest_of_cookie(headers)
        return digest is not None and digest in self._keys

    def is_first(self, headers: Mapping[str, str]) -> bool:
        """Whether a request comes from the first browser that was let in: whoever started the server, most likely."""
        digest = self._digest_of_cookie(headers)
        return digest is not None and digest == self._first

    def _digest_of_cookie(self, headers: Mapping[str, str]) -> bytes | None:
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        except CookieError:
            return None
        return None if cookie is None else _digest(cookie.value)

    def is_called(self, host: str) -> bool:
        """Whether ``host`` of a request, without its port, is a name of this server."""
        name = host.lower()
        return name in self._names or (self._any_address and _is_address(name))


def _digest(value: str) -> bytes:
    # looked up by digest, so that the time of looking tells nothing about the value
    return hashlib.sha256(value.encode("utf-8", "surrogatepass")).digest()


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_unspecified(name: str) -> bool:
    return _is_address(name) and ipaddress.ip_address(name).is_unspecified


def host_name(host: str) -> str:
    """``Host`` without its port, and an IPv6 address without its brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if ":" in host else host


class Guard:
    """The application behind the checks; what it refuses never reaches it, and every answer gets the headers."""

    def __init__(self, app: App, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
        answer = self._refusal(scope, headers)
        if scope["type"] == "websocket":
            if answer is not None:
                await send({"type": "websocket.close", "code": 1008, "reason": "forbidden"})
                return
            await self._app(scope, receive, send)
            return
        send = _with_headers(send, scope["path"])
        if answer is None and scope["method"] not in {"GET", "HEAD"} and not _is_file(scope):
            try:
                receive = await _whole_body(headers, receive)
            except EcatError as error:
                answer = error_answer(error)
        if answer is not None:
            await answer(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _refusal(self, scope: Scope, headers: Mapping[str, str]) -> Response | None:
        host, origin, path = headers.get("host", ""), headers.get("origin"), scope["path"]
        what = f"cannot {scope.get('method', 'open')} {path}"
        if not self._access.is_called(host_name(host)):
            return _refused(
                what,
                f"Host: {host}: not a name of this server",
                "open the address that ecat annotate printed",
            )
        if origin is not None and origin.partition("://")[2] != host:
            return _refused(
                what, f"Origin: {origin}: another site's page", "use the page that ecat annotate serves"
            )
        if path == "/" and scope["type"] == "http":
            if (tokens := parse_qs(scope["query_string"].decode("latin-1")).get("token")) is not None:
                return self._entered(tokens[-1], headers)
        elif headers.get("sec-fetch-site", "none") not in {"same-origin", "none"}:
            return _refused(
                what, "asked for by another site's page", "use the page that ecat annotate serves"
            )
        if self._access.admits(headers):
            return None
        if path == "/" and scope["type"] == "http":
            return _closed_door()
        return _refused(
            what,
            "neither a cookie of this server nor its token",
            "open the address that ecat annotate printed",
        )

    def _entered(self, token: str, headers: Mapping[str, str]) -> Response:
        key = self._access.exchange(token)
        if key is None and not self._access.admits(headers):
            return _closed_door()
        # a link on another site's page: a redirect would still count as that site's, and go without the cookie
        foreign = headers.get("sec-fetch-site", "none") in {"cross-site", "same-site"}
        answer = (
            Response(_REFRESH, media_type="text/html")
            if foreign
            else Response(status_code=303, headers={"location": "/"})
        )
        if key is not None:
            answer.set_cookie(
                self._access.cookie, key, max_age=COOKIE_AGE_S, path="/", httponly=True, samesite="strict"
            )
        return answer


def _closed_door() -> Response:
    """What a person sees who has no key: a page, not data."""
    return Response(_CLOSED, 403, media_type="text/html; charset=utf-8")


def _refused(what: str, where: str, fix: str) -> Response:
    return error_answer(ForbiddenError(what, where=where, fix=fix), status=403)


def _with_headers(send: Send, path: str) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {key.lower() for key, _ in message["headers"]}
            extra = dict(_HEADERS)
            if path.startswith("/api/") or path == "/":
                extra["cache-control"] = "no-store"
            message["headers"] = [
                *message["headers"],
                *((k.encode(), v.encode()) for k, v in extra.items() if k.encode() not in present),
            ]
        await send(message)

    return sending


def _is_file(scope: Scope) -> bool:
    """Whether the body is a file, which goes to the disk as it comes and has limits of its own."""
    return scope["method"] == "PUT" and scope["path"].startswith(UPLOADS)


async def _whole_body(headers: Mapping[str, str], receive: Receive) -> Receive:
    """A ``receive`` with the whole body, which has been read within the limits.

    Raises
    ------
    LimitError : it is longer than :data:`MOST_BODY_BYTES`, or does not come.
    """
    too_long = LimitError(
        "cannot take the request",
        where=f"its body has more than {MOST_BODY_BYTES:,} bytes",
        consequence="nothing was done",
        fix="send it in parts",
    )
    length = headers.get("content-length", "0")
    if length.isdecimal() and int(length[:20]) > MOST_BODY_BYTES:
        raise too_long
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_TIMEOUT_S):
            while True:
                message = await receive()
                if message["type"] != "http.request":
                    break
                body += message.get("body", b"")
                if len(body) > MOST_BODY_BYTES:
                    raise too_long
                if not message.get("more_body", False):
                    break
    except TimeoutError:
        where = f"its body did not come within {BODY_TIMEOUT_S:g} s"
        raise LimitError("cannot take the request", where=where, consequence="nothing was done") from None
    handed = False

    async def again() -> Message:
        nonlocal handed
        if handed:
            return await receive()
        handed = True
        return {"type": "http.request", "body": bytes(body), "more_body": False}

    return again
