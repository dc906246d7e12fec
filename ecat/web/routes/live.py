"""What happens in a session while somebody looks at it."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated, Any, Literal

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError

from ecat.errors import EcatError
from ecat.web.answers import encoded
from ecat.web.live import Hub, Person
from ecat.web.sessions import OpenSession
from ecat.web.shapes import Shape
from ecat.web.site import Site

router = APIRouter()
POLICY_VIOLATION = 1008
Short = Annotated[str, Field(max_length=200)]


class Presence(Shape):
    """Where somebody is, and what they have selected."""

    type: Literal["presence"]
    name: Short = ""
    layer: Short | None = None
    frame: Annotated[int, Field(ge=-(2**31), lt=2**31)] | None = None
    selection: Annotated[list[Short], Field(max_length=100)] | Short | None = None


_PRESENCE: TypeAdapter[Presence] = TypeAdapter(Presence)


@router.websocket("/api/sessions/{sid}/live")
async def live(socket: WebSocket, sid: str) -> None:
    """Tell a page about records, people, checkpoints and videos; be told where its person is."""
    site: Site = socket.app.state.site
    try:
        opened = await site.opened(sid)
    except EcatError:
        await socket.close(POLICY_VIOLATION, "there is no such session")
        return
    await socket.accept()
    person = opened.hub.enter()
    person.messages.put_nowait(_hello(person, opened))
    try:
        async with asyncio.TaskGroup() as both:
            sending = both.create_task(_send(socket, person))
            await _receive(socket, opened.hub, person)
            sending.cancel()
    finally:
        opened.hub.leave(person)


async def _send(socket: WebSocket, person: Person) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while (text := await person.messages.get()) is not None:
            await socket.send_text(text)
        await socket.close(1012, "the server ends, or this page did not keep up")


async def _receive(socket: WebSocket, hub: Hub, person: Person) -> None:
    while True:
        message: dict[str, Any] = dict(await socket.receive())
        if message["type"] == "websocket.disconnect":
            return
        try:
            told = _PRESENCE.validate_json(message.get("text") or message.get("bytes") or b"")
        except ValidationError:
            await socket.close(POLICY_VIOLATION, "not a message that is understood")
            return
        person.name, person.layer, person.frame, person.selection = (
            told.name,
            told.layer,
            told.frame,
            told.selection,
        )
        hub.presence_changed()


def _hello(person: Person, opened: OpenSession) -> str:
    """What the page has to know to find out whether it missed anything between its first look and now."""
    said = {"id": person.id, "revisions": opened.revisions(), "tables_sha256": opened.tables_sha256}
    return encoded({"type": "hello", **said}).decode()
