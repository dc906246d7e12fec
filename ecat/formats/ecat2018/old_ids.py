"""Ids as ECAT numbers them: objects ``o1``, ``o2``, ..., events ``a1``, ``a2``, ... (ECAT 2018 file format §1.2.3)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from ecat.model import Event, Layer

_OLD = {"o": re.compile(r"o[0-9]{1,9}"), "a": re.compile(r"a[0-9]{1,9}")}


def with_old_ids(layer: Layer) -> tuple[Layer, dict[str, str]]:
    """The layer with the next number for what has another id; and the ids that objects had, by those they have."""
    objects, last_object = _numbered("o", (thing.id for thing in layer.objects), layer.object_counter)
    events, last_event = _numbered("a", (event.id for event in layer.events), layer.event_counter)
    counted = replace(layer, object_counter=last_object, event_counter=last_event)
    if not objects and not events:
        return counted, {}
    renamed = replace(
        counted,
        objects=tuple(replace(thing, id=objects.get(thing.id, thing.id)) for thing in layer.objects),
        events=tuple(_event(event, objects, events) for event in layer.events),
        relations=tuple(
            replace(
                relation,
                arguments=tuple(
                    replace(a, target=objects.get(a.target, a.target)) for a in relation.arguments
                ),
            )
            for relation in layer.relations
        ),
    )
    return renamed, {new: old for old, new in objects.items()}


def _numbered(prefix: str, ids: Iterable[str], last: int) -> tuple[dict[str, str], int]:
    """New ids by old ones, for those that need one, and the last number used."""
    others: list[str] = []
    for name in ids:
        if _OLD[prefix].fullmatch(name):
            last = max(last, int(name[1:]))
        else:
            others.append(name)
    return {name: f"{prefix}{last + i}" for i, name in enumerate(others, 1)}, last + len(others)


def _event(event: Event, objects: Mapping[str, str], events: Mapping[str, str]) -> Event:
    return replace(
        event,
        id=events.get(event.id, event.id),
        parent=None if event.parent is None else events.get(event.parent, event.parent),
        references=tuple(replace(r, target=objects.get(r.target, r.target)) for r in event.references),
        links=tuple(replace(link, target=events.get(link.target, link.target)) for link in event.links),
    )
