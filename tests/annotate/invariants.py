"""What holds of every layer that operations made, told in another way than the rules tell it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, count, pairwise

from ecat.annotate.rules import MOST_DEPTH
from ecat.model import Event, Layer
from ecat.model.document import Document, owner_of, span
from tests.annotate.bench import N_FRAMES


def broken(layer: Layer) -> Iterator[str]:
    """Everything that a layer breaks."""
    document = Document(layer)
    for event in layer.events:
        yield from chain(
            _times(event), _nested(document, event), _named(document, event), _marked(document, event)
        )
    for fact in layer.relations:
        if any("/" not in target and document.object(target) is None for target in fact.targets):
            yield f"{fact.id} is about what is not there"
    for decision in layer.decisions:
        made = document.event(decision.result) or document.relation(decision.result)
        if decision.verdict == "accepted" and made is None:
            yield f"{decision.proposal} was accepted as what is not there"
    for thing in layer.objects:
        if any(b.frame <= a.frame for a, b in pairwise(thing.key_frames)):
            yield f"{thing.id} has key frames out of order"


def _times(event: Event) -> Iterator[str]:
    if not event.segments:
        yield f"{event.id} is nowhere"
    for segment in event.segments:
        if not 0 <= segment.start_frame < segment.end_frame <= N_FRAMES:
            yield f"{event.id} is not in the recording"
    if any(b.start_frame < a.end_frame for a, b in pairwise(event.segments)):
        yield f"{event.id} overlaps itself"


def _named(document: Document, event: Event) -> Iterator[str]:
    for role in event.roles:
        find = document.event if role.kind == "event" else document.object
        if find(owner_of(role.target, role.kind)) is None:
            yield f"{event.id} has a role for what is not there"
    if any(document.event(link.target) is None for link in event.links):
        yield f"{event.id} is linked to what is not there"


def _marked(document: Document, event: Event) -> Iterator[str]:
    for mark in (*event.references, *event.predicates):
        if not 0 <= mark.start < mark.end <= len(event.text):
            yield f"{event.id} marks characters that it has not"
    if any(document.object(mark.target) is None for mark in event.references):
        yield f"{event.id} refers to what is not there"


def _nested(document: Document, event: Event) -> Iterator[str]:
    if event.parent is None:
        return
    parent = document.event(event.parent)
    if parent is None:
        yield f"{event.id} is a part of what is not there"
        return
    inner, outer = span(event), span(parent)
    if inner and outer and not outer[0] <= inner[0] < inner[1] <= outer[1]:
        yield f"{event.id} is not within {parent.id}"
    here: Event | None = parent
    for depth in count(1):
        if here is None:
            return
        if depth > MOST_DEPTH:
            yield f"{event.id} is too deep, or a part of itself"
            return
        here = document.event(here.parent) if here.parent else None
