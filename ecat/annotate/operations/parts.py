"""Operations on what takes part in an event, and on its links to other events."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.events import role_of, type_tier
from ecat.annotate.operations.objects import with_property
from ecat.model import Link, Role

ADJUNCT = "adjunct"
"""The property that holds the adjunct of an event's slots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkEvents(Operation):
    """A typed link (``CAUSE``, ...) from one event to another."""

    id: str
    type: str
    target: str

    def perform(self, edit: Edit) -> None:
        """Add it."""
        event, target = edit.event(self.id), edit.event(self.target)
        if event.id == target.id:
            raise edit.refusal(f"event {event.id} and itself", "name two events")
        if any((link.type, link.target) == (self.type, self.target) for link in event.links):
            return
        edit.put(replace(event, links=(*event.links, Link(type=self.type, target=self.target))))


@dataclass(frozen=True, slots=True, kw_only=True)
class UnlinkEvents(Operation):
    """Remove a link."""

    id: str
    type: str
    target: str

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        event = edit.event(self.id)
        kept = tuple(link for link in event.links if (link.type, link.target) != (self.type, self.target))
        if len(kept) == len(event.links):
            there = ", ".join(f"{link.type} to {link.target}" for link in event.links) or "none"
            raise edit.refusal(
                f"event {self.id} has no link {self.type} to {self.target}", f"name one that it has: {there}"
            )
        edit.put(replace(event, links=kept))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetRole(Operation):
    """Say what takes part in an event as ``role``; without ``target``, that nothing does.

    ``kind`` follows from the target where it is left out.
    """

    id: str
    role: str
    target: str | None = None
    kind: Literal["object", "joint", "event"] | None = None

    def perform(self, edit: Edit) -> None:
        """Set it."""
        event = edit.event(self.id)
        new: tuple[Role, ...] = ()
        if self.target is not None:
            found = role_of(edit, self.role, self.target)
            if self.kind not in {None, found.kind}:
                raise edit.refusal(
                    f"role {self.role}: {self.target} is no {self.kind}, but {found.kind}",
                    "leave the kind out, or name another one",
                )
            new = (found,)
        edit.put(replace(event, roles=with_role(event.roles, self.role, new)))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSlots(Operation):
    """An event as a tuple of slots: who does what to what, where, and how.

    Subject, Object and Locative are roles, filled by the id of an object, joint or event; the verb is the type; the
    adjunct is free text.  An empty text empties a slot.
    """

    id: str
    subject: str | None = None
    object: str | None = None
    locative: str | None = None
    verb: str | None = None
    adjunct: str | None = None

    def perform(self, edit: Edit) -> None:
        """Fill them."""
        event = edit.event(self.id)
        for name in ("subject", "object", "locative"):
            target = getattr(self, name)
            if target is not None:
                role = name.capitalize()
                new = (role_of(edit, role, target),) if target else ()
                event = replace(event, roles=with_role(event.roles, role, new))
        if self.verb is not None:
            event = replace(event, type=self.verb, tier=event.tier or type_tier(edit, self.verb))
        if self.adjunct is not None:
            properties = with_property(event.properties, ADJUNCT, self.adjunct or None)
            event = replace(event, properties=properties)
        edit.put(event)


def with_role(roles: tuple[Role, ...], name: str, new: tuple[Role, ...]) -> tuple[Role, ...]:
    """``roles`` with the one called ``name`` replaced in its place by ``new``."""
    at = next((i for i, role in enumerate(roles) if role.name == name), len(roles))
    return (*roles[:at], *new, *(role for role in roles[at:] if role.name != name))
