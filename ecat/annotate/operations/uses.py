"""What goes with an object or an event that is removed: whatever names it."""

from __future__ import annotations

from dataclasses import replace

from ecat.annotate.operations.base import Edit
from ecat.model import Event
from ecat.model.document import owner_of


def forget_object(edit: Edit, name: str) -> None:
    """Remove the relations of an object, empty the roles and references that name it, and drop what decided for it."""
    drop_decisions(edit, name)
    for kind, user in edit.document.users("object", name):
        if kind == "relation":
            edit.drop("relation", user)
            drop_decisions(edit, user)
        elif kind == "event":
            event = edit.event(user)
            edit.put(
                replace(
                    event,
                    roles=tuple(
                        r for r in event.roles if r.kind == "event" or owner_of(r.target, r.kind) != name
                    ),
                    references=tuple(r for r in event.references if r.target != name),
                )
            )


def forget_event(edit: Edit, name: str) -> None:
    """Remove the links and roles that name an event, and the decision that made it."""
    for kind, user in edit.document.users("event", name):
        if kind == "event":
            event = edit.event(user)
            edit.put(
                replace(
                    event,
                    roles=tuple(r for r in event.roles if r.kind != "event" or r.target != name),
                    links=tuple(link for link in event.links if link.target != name),
                )
            )
    drop_decisions(edit, name)


def drop_decisions(edit: Edit, name: str) -> None:
    """A proposal whose result is removed is open again."""
    for kind, user in edit.document.users("event", name):
        if kind == "decision":
            edit.drop("decision", user)


def rename_event(edit: Edit, old: str, new: str) -> None:
    """Let what names one event name another instead; an event does not name itself."""
    for kind, user in edit.document.users("event", old):
        if kind == "decision":
            decision = edit.document.decision(user)
            if decision is not None:
                edit.put(replace(decision, result=new))
        elif kind == "event" and user != new:
            edit.put(_renamed(edit.event(user), old, new))


def _renamed(event: Event, old: str, new: str) -> Event:
    roles = (replace(r, target=new) if r.kind == "event" and r.target == old else r for r in event.roles)
    links = (replace(link, target=new) if link.target == old else link for link in event.links)
    return replace(
        event,
        parent=new if event.parent == old else event.parent,
        roles=tuple(roles),
        links=tuple(dict.fromkeys(links)),
    )
