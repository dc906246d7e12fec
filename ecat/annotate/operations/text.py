"""Operations on the text of an event: the objects it refers to, the actions it names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from ecat.annotate.operations.base import Edit, Operation
from ecat.model import AnnotatedObject, TextPredicate, TextReference

Marked = TypeVar("Marked", TextReference, TextPredicate)


@dataclass(frozen=True, slots=True, kw_only=True)
class AddReference(Operation):
    """Characters ``[start, end)`` of an event's text refer to an object; what was marked there is marked no more."""

    id: str
    start: int
    end: int
    target: str

    def perform(self, edit: Edit) -> None:
        """Add it."""
        event = edit.event(self.id)
        edit.object(self.target)
        new = TextReference(start=self.start, end=self.end, target=self.target)
        kept = (r for r in event.references if r.end <= self.start or self.end <= r.start)
        edit.put(replace(event, references=tuple(sorted((*kept, new), key=lambda r: r.start))))


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveReference(Operation):
    """Characters ``[start, end)`` of an event's text refer to nothing."""

    id: str
    start: int
    end: int

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        event = edit.event(self.id)
        kept = tuple(r for r in event.references if (r.start, r.end) != (self.start, self.end))
        if len(kept) == len(event.references):
            there = ", ".join(f"{r.start} to {r.end}" for r in event.references) or "none"
            raise edit.refusal(
                f"event {self.id}: characters {self.start} to {self.end} refer to nothing",
                f"name a stretch that does: {there}",
            )
        edit.put(replace(event, references=kept))


@dataclass(frozen=True, slots=True, kw_only=True)
class FindReferences(Operation):
    """Mark the names of objects in the texts of events (all of them, by default), as whole words, in any case.

    Every occurrence is marked; of names that overlap the longest is; references that a person set stay.
    """

    ids: tuple[str, ...] | None = None

    def perform(self, edit: Edit) -> None:
        """Find them."""
        things = [thing for name in edit.document.ids("object") if (thing := edit.document.object(name))]
        for name in edit.document.ids("event") if self.ids is None else self.ids:
            event = edit.event(name)
            found = find_references(event.text, things, event.references)
            edit.put(replace(event, references=found))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPredicates(Operation):
    """The words of an event's text that name actions."""

    id: str
    predicates: tuple[TextPredicate, ...]

    def perform(self, edit: Edit) -> None:
        """Set them."""
        predicates = tuple(sorted(self.predicates, key=lambda p: p.start))
        edit.put(replace(edit.event(self.id), predicates=predicates))


def find_references(
    text: str, things: Sequence[AnnotatedObject], known: Sequence[TextReference] = ()
) -> tuple[TextReference, ...]:
    """The references of a text to ``things`` by their names, besides those that are ``known``, in order."""
    names: dict[str, str] = {}
    for thing in things:
        # of two things with one name the first is meant
        words = thing.name.split()
        if words:
            names.setdefault(" ".join(words).casefold(), thing.id)
    if not names:
        return tuple(known)
    longest = sorted(names, key=len, reverse=True)
    pattern = "|".join(r"\s+".join(map(re.escape, name.split(" "))) for name in longest)
    found = list(known)
    for match in re.finditer(rf"(?<!\w)(?:{pattern})(?!\w)", text, re.IGNORECASE):
        start, end = match.span()
        name = names.get(" ".join(match[0].split()).casefold())
        if name is not None and all(end <= r.start or r.end <= start for r in known):
            found.append(TextReference(start=start, end=end, target=name))
    return tuple(sorted(found, key=lambda r: (r.start, r.end)))


def moved_spans(marked: tuple[Marked, ...], old: str, new: str) -> tuple[Marked, ...]:
    """Spans of an old text in the new one; those whose characters were edited are dropped."""
    before = _alike(old, new)
    after = min(_alike(old[::-1], new[::-1]), min(len(old), len(new)) - before)
    shift = len(new) - len(old)
    moved: list[Marked] = []
    for item in marked:
        if item.end <= before:
            moved.append(item)
        elif item.start >= len(old) - after:
            moved.append(replace(item, start=item.start + shift, end=item.end + shift))
    return tuple(moved)


def _alike(first: str, second: str) -> int:
    """How many characters two texts begin with alike."""
    pairs = enumerate(zip(first, second, strict=False))
    return next((i for i, (a, b) in pairs if a != b), min(len(first), len(second)))
