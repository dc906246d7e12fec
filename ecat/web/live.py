"""Who looks at a session at this moment, and what they are told."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any

from ecat.web.answers import encoded

MOST_WAITING = 2000
"""Messages that a connection may be behind; one that does not read is closed, and catches up when it comes back."""
PRESENCE_EVERY_S = 0.1


@dataclass(eq=False)
class Person:
    """One open page."""

    id: str
    name: str = ""
    layer: str | None = None
    frame: int | None = None
    selection: Any = None
    messages: asyncio.Queue[str | None] = field(default_factory=lambda: asyncio.Queue(MOST_WAITING))

    def to_dict(self) -> dict[str, Any]:
        """What the others see."""
        return {
            "id": self.id,
            "name": self.name,
            "layer": self.layer,
            "frame": self.frame,
            "selection": self.selection,
        }


class Hub:
    """The open pages of one session; used from the event loop only."""

    def __init__(self) -> None:
        self._people: dict[str, Person] = {}
        self._telling: asyncio.TimerHandle | None = None
        self._count = 0

    def __len__(self) -> int:
        return len(self._people)

    def names(self) -> list[str]:
        """Who is here."""
        return [person.name or "somebody" for person in self._people.values()]

    def enter(self) -> Person:
        """Somebody opened a page."""
        self._count += 1
        person = Person(f"p{self._count}")
        self._people[person.id] = person
        self.presence_changed()
        return person

    def leave(self, person: Person) -> None:
        """Their page was closed."""
        if self._people.pop(person.id, None) is not None:
            self.presence_changed()

    def tell(self, message: dict[str, Any]) -> None:
        """Send ``message`` to everybody."""
        text = encoded(message).decode()
        for person in list(self._people.values()):
            self._put(person, text)

    def presence_changed(self) -> None:
        """Tell everybody who is there, soon: cursors move many times a second."""
        if self._telling is None:
            self._telling = asyncio.get_running_loop().call_later(PRESENCE_EVERY_S, self._tell_presence)

    def close(self) -> None:
        """End every connection."""
        for person in list(self._people.values()):
            self._end(person)

    def _tell_presence(self) -> None:
        self._telling = None
        self.tell({"type": "presence", "people": [person.to_dict() for person in self._people.values()]})

    def _put(self, person: Person, text: str) -> None:
        try:
            person.messages.put_nowait(text)
        except asyncio.QueueFull:
            self._people.pop(person.id, None)
            self._end(person)

    @staticmethod
    def _end(person: Person) -> None:
        while not person.messages.empty():
            person.messages.get_nowait()
        person.messages.put_nowait(None)
