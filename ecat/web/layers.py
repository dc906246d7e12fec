"""A layer that several people edit at once: one editor for all of them, and everybody is told."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from ecat.annotate import Editor, Record, operations_from_list
from ecat.errors import EcatError
from ecat.model import Layer, LayerRecord
from ecat.model.changes import LISTS, header, to_json
from ecat.store import Session
from ecat.web.answers import encoded
from ecat.web.live import Hub

IDLE_S = 2.0
"""After so long without an edit, XML and tables are written."""
IDLE_SHARE = 5
"""Or after so many times as long as that took last: what is written meanwhile makes an edit wait a little."""
AT_LEAST_EVERY_S = 60.0
"""They are also written so often while somebody edits without a pause."""
AGAIN_AFTER_S = 10.0


class SharedLayer:
    """One layer of an open session.

    Methods that are coroutines are used from the event loop; the editor's work is done in threads, edits of one layer
    one after the other, so that records are told in their order.
    """

    def __init__(self, session: Session, name: str, hub: Hub, author: str) -> None:
        self.name = name
        self._hub = hub
        self._editor = Editor(session, name, author)
        self._told = self._editor.revision
        self._turn = asyncio.Lock()
        self._packed: tuple[int, bytes] | None = None
        self._packing = threading.Lock()
        self._idle: asyncio.TimerHandle | None = None
        self._edited_s: float | None = None
        self._took_s = 0.0
        self._saving: asyncio.Task[None] | None = None

    @property
    def revision(self) -> int:
        """How many steps the layer's history has."""
        return self._editor.revision

    def was_replaced(self, now: LayerRecord) -> bool:
        """Whether a layer without a history, such as a stage writes, is another one than was opened."""
        opened = self._editor.session.manifest.layer(self.name)
        return (
            not self.revision
            and not now.journal_revision
            and opened is not None
            and now.sha256 != opened.sha256
        )

    def counts(self) -> dict[str, int]:
        """How many objects, events and relations there are now."""
        ids = self._editor.document.ids
        return {f"n_{name}": len(ids(kind)) for name, kind in LISTS.items() if name != "decisions"}

    # ------------------------------------------------------------------------------------------ looking

    def answer(self, author: str | None) -> bytes:
        """The layer as it is now, as JSON: see :class:`ecat.web.shapes.LayerAnswer`."""
        self._refresh()
        with self._packing:
            if self._packed is None or self._packed[0] != self._editor.revision:
                self._packed = self._pack()
            revision, layer = self._packed
        return self._wrapped(revision, layer, author)

    def answer_at(self, revision: int, author: str | None) -> bytes:
        """The layer as it was at a revision."""
        return self._wrapped(revision, encoded(layer_json(self._editor.at(revision))), author)

    @property
    def layer(self) -> Layer:
        """The layer as it is now."""
        self._refresh()
        return self._editor.layer

    def history(self, start: int, limit: int) -> dict[str, Any]:
        """Records from ``start`` on, at most ``limit``."""
        self._refresh()
        records = self._editor.history(start, limit)
        return {"revision": self._editor.revision, "records": [record.to_dict() for record in records]}

    @property
    def scheme(self) -> Any:
        """The layer's coding scheme, None without one."""
        self._refresh()
        return self._editor.scheme

    def saved(self) -> dict[str, int]:
        """The last revision, and the last that XML and tables contain."""
        return {"revision": self._editor.revision, "saved_revision": self._editor.saved_revision}

    def _refresh(self) -> None:
        """Take over what other processes did; the pages are told when it is next looked."""
        with contextlib.suppress(EcatError):  # the next edit says what is wrong
            self._editor.refresh()

    def _pack(self) -> tuple[int, bytes]:
        while True:
            before = self._editor.revision
            layer = self._editor.layer
            if before == self._editor.revision:
                return before, encoded(layer_json(layer))

    def _wrapped(self, revision: int, layer: bytes, author: str | None) -> bytes:
        said = {
            "revision": revision,
            "saved_revision": self._editor.saved_revision,
            "can_undo": self._editor.can_undo(author),
            "can_redo": self._editor.can_redo(author),
        }
        return encoded(said)[:-1] + b',"layer":' + layer + b"}"

    # ------------------------------------------------------------------------------------------ editing

    async def apply(self, operations: list[dict[str, Any]], base: int | None, author: str) -> bytes:
        """Do operations as one step; errors as of :meth:`ecat.annotate.Editor.apply`."""
        return self._said(await self.edit(operations, base, author), author)

    async def edit(self, operations: list[dict[str, Any]], base: int | None, author: str) -> Record:
        """The same, for the record."""

        def work() -> Record:
            return self._editor.apply(operations_from_list(operations), base=base, author=author)

        return await self._step(work)

    async def undo(self, base: int | None, author: str) -> bytes:
        """Undo the author's last step."""
        return self._said(await self._step(lambda: self._editor.undo(base=base, author=author)), author)

    async def redo(self, base: int | None, author: str) -> bytes:
        """Do again what the author undid last."""
        return self._said(await self._step(lambda: self._editor.redo(base=base, author=author)), author)

    async def restore(self, revision: int, author: str) -> bytes:
        """Go back to a revision."""
        return self._said(await self._step(lambda: self._editor.restore(revision, author=author)), author)

    async def _step(self, work: Callable[[], Record]) -> Record:
        async with self._turn:
            try:
                return await asyncio.to_thread(work)
            finally:
                # what others did was taken over, also where this could not be done
                await self._tell_news()

    def _said(self, record: Record, author: str) -> bytes:
        said = {
            "record": record.to_dict(),
            "can_undo": self._editor.can_undo(author),
            "can_redo": self._editor.can_redo(author),
        }
        return encoded(said)

    async def look(self) -> None:
        """Tell what other processes have done since, if they did anything."""
        async with self._turn:
            await asyncio.to_thread(self._refresh)
            await self._tell_news()

    async def _tell_news(self) -> None:
        since, last = self._told, self._editor.revision
        if last == since:
            return
        records = await asyncio.to_thread(self._editor.history, since + 1, last - since)
        for record in records:
            self._hub.tell({"type": "record", "layer": self.name, "record": record.to_dict()})
        self._told = last
        self._save_soon()

    # ------------------------------------------------------------------------------------------ saving

    async def save(self) -> None:
        """Write XML and tables as of now, and tell so."""
        before, begun_s = self._editor.saved_revision, time.monotonic()
        await asyncio.to_thread(self._editor.save)
        self._edited_s, self._took_s = None, time.monotonic() - begun_s
        if self._editor.saved_revision != before:
            self._hub.tell({"type": "saved", "layer": self.name, "revision": self._editor.saved_revision})

    async def close(self) -> None:
        """Save for the last time."""
        if self._idle is not None:
            self._idle.cancel()
        if self._saving is not None:
            await self._saving
        try:
            await self.save()
        except EcatError as error:
            print(f"ecat: {error}", file=sys.stderr)  # noqa: T201 - nobody else is left to be told

    def _save_soon(self, after_s: float = 0.0) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        after_s = max(after_s, IDLE_S, IDLE_SHARE * self._took_s)
        self._edited_s = self._edited_s or now
        if self._idle is not None:
            self._idle.cancel()
        at = max(min(now + after_s, self._edited_s + AT_LEAST_EVERY_S), now)
        self._idle = loop.call_at(at, self._begin_saving)

    def _begin_saving(self) -> None:
        self._idle = None
        if self._saving is None or self._saving.done():
            self._saving = asyncio.create_task(self._save_quietly())
        else:
            self._save_soon()

    async def _save_quietly(self) -> None:
        try:
            await self.save()
        except EcatError as error:
            # every step is in the journal; the page shows that the XML is behind
            self._hub.tell({"type": "problem", "layer": self.name, "what": str(error)})
            self._edited_s = None
            self._save_soon(AGAIN_AFTER_S)


def layer_json(layer: Layer) -> dict[str, Any]:
    """A layer as the page holds it: elements as in changes, without fields that have their default."""
    elements = {name: [to_json(item) for item in getattr(layer, name)] for name in LISTS}
    return {"name": layer.name, **header(layer), **elements}
