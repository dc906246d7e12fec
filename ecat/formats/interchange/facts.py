r"""What is said of an event besides its type, tier and time, as texts under names: for programs with free fields.

=================  ==============================================================================
name               text
=================  ==============================================================================
``text``           as it is
``parent``         the id of the event that it is a part of
``status``         ``proposed``, or nothing
``unsure``         ``true``, or nothing
``author``         as it is
``role:NAME``      what takes part as NAME: ``Shell``, a joint ``Performer 1/HandRight``, an event
                   ``event:a3``; several parted by ``;``
``links``          ``CAUSE a3``, several parted by ``;``
``references``     ``6-11 Shell``: characters of the text and the object that they name
``predicates``     ``0-5 slide``: characters of the text and the action that they name
``property:NAME``  as it is
=================  ==============================================================================

An object goes by its label: its name, where that tells it from every other and has no character that programs use to
part things, else its id.  ``;`` and ``\`` in a part of a list have a ``\`` before them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from itertools import count
from typing import Literal

from ecat.model import AnnotatedObject, Event, Link, Property, Role, TextPredicate, TextReference

ROLE, PROPERTY, EVENT = "role:", "property:", "event:"
FIELDS = ("text", "parent", "status", "unsure", "author", "links", "references", "predicates")
"""Names that do not depend on the annotation."""
_PARTING = re.compile(r"[/;|,()~\\\x00-\x1f]")
_PART = re.compile(r"(?:[^;\\]|\\.)+", re.DOTALL)
_SPAN = re.compile(r"(\d{1,9})-(\d{1,9}) (.*)", re.DOTALL)
_YES = {"true", "yes", "1", "x", "unsure"}


def labels_of(objects: Iterable[AnnotatedObject]) -> dict[str, str]:
    """What each object, by its id, is called in other programs."""
    objects = list(objects)
    names = Counter(thing.name for thing in objects) + Counter(thing.id for thing in objects)

    def good(thing: AnnotatedObject) -> bool:
        name = thing.name
        mine = 2 if name == thing.id else 1
        plain = bool(name) and name == name.strip() and not name.startswith((EVENT, "#"))
        return plain and names[name] == mine and not _PARTING.search(name)

    return {thing.id: thing.name if good(thing) else thing.id for thing in objects}


def joined(parts: Iterable[str]) -> str:
    """Several texts as one."""
    return "; ".join(re.sub(r"([;\\])", r"\\\1", part) for part in parts)


def split(text: str) -> list[str]:
    """The texts that :func:`joined` made one."""
    found: list[str] = _PART.findall(text)
    plain = [part if at == 0 else part.removeprefix(" ") for at, part in enumerate(found)]
    return [re.sub(r"\\(.)", r"\1", part, flags=re.DOTALL) for part in plain if part.strip()]


# ---------------------------------------------------------------------------------------------- telling


def told(event: Event, labels: Mapping[str, str]) -> dict[str, str]:
    """What is said of an event, without what is not said.

    Parameters
    ----------
    labels : of the objects (:func:`labels_of`).
    """
    said = {
        "text": event.text,
        "parent": event.parent or "",
        "status": "" if event.status == "confirmed" else event.status,
        "unsure": "true" if event.unsure else "",
        "author": event.author,
        **_roles(event, labels),
        "links": joined(f"{link.type} {link.target}" for link in event.links),
        "references": joined(f"{r.start}-{r.end} {labels.get(r.target, r.target)}" for r in event.references),
        "predicates": joined(f"{p.start}-{p.end} {p.type}" for p in event.predicates),
        **_properties(event.properties),
    }
    return {name: text for name, text in said.items() if text or name.startswith(PROPERTY)}


def target_of(role: Role, labels: Mapping[str, str]) -> str:
    """What fills a role, as text."""
    if role.kind == "event":
        return f"{EVENT}{role.target}"
    if role.kind == "joint":
        owner, slash, joint = role.target.partition("/")
        return f"{labels.get(owner, owner)}{slash}{joint}"
    return labels.get(role.target, role.target)


def _roles(event: Event, labels: Mapping[str, str]) -> dict[str, str]:
    found: dict[str, list[str]] = {}
    for role in event.roles:
        found.setdefault(f"{ROLE}{role.name}", []).append(target_of(role, labels))
    return {name: joined(targets) for name, targets in found.items()}


def _properties(properties: Iterable[Property]) -> dict[str, str]:
    found: dict[str, str] = {}
    for item in properties:
        found[numbered(f"{PROPERTY}{item.name}", found)] = item.value
    return found


def numbered(name: str, taken: Container[str]) -> str:
    """``name``, or with a number where that is taken, or could be taken for a number."""
    if name not in taken and plain_name(name) == name:
        return name
    return next(made for n in count(1) if (made := f"{name} #{n}") not in taken)


def plain_name(name: str) -> str:
    """What :func:`numbered` was given."""
    return re.sub(r" #\d+$", "", name)


# ---------------------------------------------------------------------------------------------- understanding


def understood(said: Mapping[str, str], object_of: Callable[[str], str]) -> Event:
    """An event, without id, type, tier and time, of which this was said; other names are properties.

    Parameters
    ----------
    object_of : the id of the object with a label.
    """
    text = said.get("text", "")
    known = {*FIELDS}
    status: Literal["proposed", "confirmed"] = (
        "proposed" if said.get("status", "").strip().lower() == "proposed" else "confirmed"
    )
    return Event(
        id="",
        parent=said.get("parent", "").strip() or None,
        status=status,
        unsure=said.get("unsure", "").strip().lower() in _YES,
        author=said.get("author", ""),
        text=text,
        roles=tuple(
            _role(name.removeprefix(ROLE), target, object_of)
            for name, targets in said.items()
            if name.startswith(ROLE)
            for target in split(targets)
        ),
        links=tuple(_links(said.get("links", ""))),
        references=tuple(
            TextReference(start=start, end=end, target=object_of(label))
            for start, end, label in _spans(said.get("references", ""))
        ),
        predicates=tuple(
            TextPredicate(start=start, end=end, type=kind)
            for start, end, kind in _spans(said.get("predicates", ""))
        ),
        properties=tuple(
            Property(name=plain_name(name.removeprefix(PROPERTY)), value=value)
            for name, value in said.items()
            if name not in known and not name.startswith(ROLE)
        ),
    )


def _role(name: str, target: str, object_of: Callable[[str], str]) -> Role:
    if target.startswith(EVENT):
        return Role(name=name, target=target.removeprefix(EVENT), kind="event")
    label, slash, joint = target.partition("/")
    if slash:
        return Role(name=name, target=f"{object_of(label)}/{joint}", kind="joint")
    return Role(name=name, target=object_of(target))


def _links(text: str) -> Iterator[Link]:
    for part in split(text):
        kind, _, target = part.rpartition(" ")
        yield Link(type=kind, target=target)


def _spans(text: str) -> Iterator[tuple[int, int, str]]:
    for part in split(text):
        if found := _SPAN.fullmatch(part):
            yield int(found[1]), int(found[2]), found[3]
