"""What holds of every annotation that operations make: asked of the elements that an edit touched, once it is done.

What was imported against a rule may stay as it is; an edit may not make it worse.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.near import Listed, near
from ecat.errors import NotFoundError, OperationError
from ecat.model import CodingScheme, Event, Relation, Role, Tier
from ecat.model.changes import Change, Kind, from_json
from ecat.model.document import owner_of, span

MOST_DEPTH = 16
"""Levels of sub-events."""
MOST_ARGUMENTS = 16


def perform(edit: Edit, operations: Iterable[Operation]) -> tuple[Change, ...]:
    """Do operations, all of them or none, and return what they changed.

    Raises
    ------
    OperationError : one is not allowed, or together they break a rule; nothing was changed.
    """
    try:
        for operation in operations:
            edit.op = operation.op
            operation.perform(edit)
        require_sound(edit, edit.changes)
    except BaseException:
        edit.roll_back()
        raise
    return edit.changes


def require_sound(edit: Edit, changes: Iterable[Change]) -> None:
    """Return if no rule is broken by ``changes``, which have been made.

    Raises
    ------
    OperationError : the first problem of each element, at most three.
    """
    before: dict[tuple[Kind, str], Change] = {}
    for change in changes:
        before.setdefault((change.kind, change.id), change)
    problems: list[str] = []
    for (kind, name), change in before.items():
        problems += list(_problems(edit, kind, name, change))[:1]
        if len(problems) == 3:
            break
    if problems:
        raise OperationError(
            f"cannot {edit.op.replace('_', ' ')}",
            where=tuple(problems),
            fix="change what is named first, or both in one step",
        )


def _problems(edit: Edit, kind: Kind, name: str, change: Change) -> Iterator[str]:
    now = edit.document.element(kind, name)
    if kind in {"object", "event"} and now is None:
        yield from _users(edit, kind, name)
    elif kind == "event":
        yield from _event(edit, now, None if change.before is None else from_json(Event, change.before))
    elif kind == "relation" and now is not None:
        yield from _relation(edit, now, None if change.before is None else from_json(Relation, change.before))


def _users(edit: Edit, kind: Any, name: str) -> Iterator[str]:
    """Whoever names what is gone."""
    for user_kind, user in edit.document.users(kind, name):
        if user_kind != "decision":
            yield f"{user_kind} {user} names {kind} {name}, which would be gone"


# ---------------------------------------------------------------------------------------------- events


def _event(edit: Edit, event: Event, old: Event | None) -> Iterator[str]:
    yield from _named(edit, event, old)
    yield from _text(event)
    moved = old is None or old.segments != event.segments
    if old is None or moved or old.parent != event.parent:
        yield from _nested(edit, event)
    if moved and event.segments:
        for child in edit.document.children(event.id):
            if not _inside(child, event) and (old is None or _inside(child, old)):
                yield f"sub-event {_shown(child)} would not lie within event {_shown(event)}"
    if edit.scheme is not None:
        yield from _scheme_event(edit, edit.scheme, event, old)


def _named(edit: Edit, event: Event, old: Event | None) -> Iterator[str]:
    """Everything that an event names, and did not name before, is there."""
    known = set[Any]() if old is None else {*old.roles, *old.links, *(r.target for r in old.references)}
    for role in event.roles:
        if role not in known and not _filled(edit, role):
            yield f"event {event.id}, role {role.name}: there is no {role.kind} {role.target}"
    for link in event.links:
        if link not in known and edit.document.event(link.target) is None:
            hint = _hint(edit, "event", link.target)
            yield f"event {event.id}, link {link.type}: there is no event {link.target}{hint}"
    for reference in event.references:
        if reference.target not in known and edit.document.object(reference.target) is None:
            hint = _hint(edit, "object", reference.target)
            yield f"event {event.id}: its text refers to object {reference.target}, which is not there{hint}"


def _hint(edit: Edit, kind: Listed, name: str) -> str:
    """What may have been meant by an id that is not there."""
    meant = near(edit.document, (kind,), name)
    return f"; did you mean {meant}?" if meant else ""


def _filled(edit: Edit, role: Role) -> bool:
    if role.kind == "event":
        return edit.document.event(role.target) is not None
    return edit.document.object(owner_of(role.target, role.kind)) is not None


def _text(event: Event) -> Iterator[str]:
    for marked in (*event.references, *event.predicates):
        if not 0 <= marked.start < marked.end <= len(event.text):
            yield (
                f"event {event.id}: characters {marked.start} to {marked.end} are marked in a text of "
                f"{len(event.text)}"
            )


def _nested(edit: Edit, event: Event) -> Iterator[str]:
    if event.parent is None:
        return
    parent = edit.document.event(event.parent)
    if parent is None:
        hint = _hint(edit, "event", event.parent)
        yield f"event {event.id}: there is no event {event.parent} to be a part of{hint}"
        return
    above = [event.id]
    here: Event | None = parent
    while here is not None and here.parent != here.id and here.id not in above and len(above) <= MOST_DEPTH:
        above.append(here.id)
        here = edit.document.event(here.parent) if here.parent is not None else None
    if here is not None and len(above) <= MOST_DEPTH:
        yield f"event {event.id} would be a part of itself"
    elif len(above) + _height(edit, event) > MOST_DEPTH:
        yield f"event {event.id}: sub-events are at most {MOST_DEPTH} deep"
    if not _inside(event, parent):
        yield f"sub-event {_shown(event)} would not lie within event {_shown(parent)}"


def _height(edit: Edit, event: Event, limit: int = MOST_DEPTH) -> int:
    """Levels of sub-events below an event, counted up to ``limit``."""
    if not limit:
        return 0
    return max((1 + _height(edit, child, limit - 1) for child in edit.document.children(event.id)), default=0)


def _inside(event: Event, parent: Event) -> bool:
    inner, outer = span(event), span(parent)
    return inner is None or outer is None or (outer[0] <= inner[0] and inner[1] <= outer[1])


def _shown(event: Event) -> str:
    extent = span(event)
    return f"{event.id} (frames {extent[0]} to {extent[1]})" if extent else event.id


# ---------------------------------------------------------------------------------------------- relations


def _relation(edit: Edit, relation: Relation, old: Relation | None) -> Iterator[str]:
    if not relation.predicate.strip():
        yield f"relation {relation.id} has no predicate"
    if not 1 <= len(relation.arguments) <= MOST_ARGUMENTS:
        yield f"relation {relation.id} has {len(relation.arguments)} arguments, 1 to {MOST_ARGUMENTS} are one"
    for target in relation.targets:
        if (old is None or target not in old.targets) and not _exists(edit, target):
            yield f"relation {relation.id}: there is no object {target}{_hint(edit, 'object', target)}"
    scheme = edit.scheme
    if scheme is None or (
        old is not None and (old.predicate, old.arguments) == (relation.predicate, relation.arguments)
    ):
        return
    arities = {p.arity for p in scheme.predicates if p.name == relation.predicate and p.target == "object"}
    if arities and len(relation.arguments) not in arities:
        expected = " or ".join(map(str, sorted(arities)))
        yield f"relation {relation.id}: {relation.predicate} takes {expected} arguments, not {len(relation.targets)}"
    elif not arities and scheme.closed:
        yield f"relation {relation.id}: the scheme {scheme.name} has no predicate {relation.predicate}"


def _exists(edit: Edit, target: str) -> bool:
    session, slash, name = target.partition("/")
    if not slash:
        return edit.document.object(target) is not None
    try:
        return any(thing.id == name for thing in edit.session_of(session).objects)
    except (NotFoundError, OperationError):
        return False


# ---------------------------------------------------------------------------------------------- the coding scheme


def _scheme_event(edit: Edit, scheme: CodingScheme, event: Event, old: Event | None) -> Iterator[str]:
    if scheme.closed:
        yield from _closed(scheme, event, old)
    tier = next((tier for tier in scheme.tiers if tier.name == event.tier), None)
    moved = old is None or (old.tier, old.parent, old.segments) != (event.tier, event.parent, event.segments)
    if tier is None or not moved:
        return
    if tier.constraint in {"included_in", "subdivision"}:
        yield from _below(edit, tier, event)
    if tier.constraint in {"no_overlap", "subdivision"}:
        yield from _apart(edit, event)
    if tier.constraint == "subdivision":
        yield from _meeting(edit, event)


def _closed(scheme: CodingScheme, event: Event, old: Event | None) -> Iterator[str]:
    """A closed scheme names every tier, type, role and link."""
    kinds = {kind.name: kind for kind in scheme.event_types}
    if (
        event.tier
        and event.tier not in {t.name for t in scheme.tiers}
        and (old is None or old.tier != event.tier)
    ):
        yield f"event {event.id}: the scheme {scheme.name} has no tier {event.tier}"
    if event.type and event.type not in kinds and (old is None or old.type != event.type):
        yield f"event {event.id}: the scheme {scheme.name} has no type {event.type}"
    allowed = {role.name for role in kinds[event.type].roles} if event.type in kinds else set[str]()
    for role in event.roles:
        if allowed and role.name not in allowed and (old is None or role not in old.roles):
            yield f"event {event.id}: {event.type} has no role {role.name}"
    links = {p.name for p in scheme.predicates if p.target == "event"}
    for link in event.links:
        if link.type not in links and (old is None or link not in old.links):
            yield f"event {event.id}: the scheme {scheme.name} has no link {link.type}"


def _below(edit: Edit, tier: Tier, event: Event) -> Iterator[str]:
    parent = edit.document.event(event.parent) if event.parent is not None else None
    if tier.parent is not None and (parent is None or parent.tier != tier.parent):
        found = "none is around it" if parent is None else f"{parent.id} is on tier {parent.tier or '(none)'}"
        yield (
            f"event {_shown(event)}: on tier {tier.name} it has to be a part of one on tier {tier.parent}, but {found}"
        )


def _meeting(edit: Edit, event: Event) -> Iterator[str]:
    """What an event is divided into has no gaps."""
    extent = span(event)
    others = [
        span(other)
        for other in edit.document.children(event.parent or "")
        if other.tier == event.tier and other != event
    ]
    if extent and others and not any(o and (o[1] == extent[0] or extent[1] == o[0]) for o in others):
        yield f"event {_shown(event)}: on tier {event.tier} it would leave a gap to its neighbours"


def _apart(edit: Edit, event: Event) -> Iterator[str]:
    for segment in event.segments:
        for other in edit.document.overlapping(event.tier, segment.start_frame, segment.end_frame):
            if other.id != event.id:
                yield f"event {_shown(event)}: on tier {event.tier} it would overlap {_shown(other)}"
                return
