"""What people ask about an annotation while they edit it."""

from __future__ import annotations

import getpass
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ecat.model import Event, Layer, Relation, Segment
from ecat.model.annotation import MACHINE, Decision
from ecat.model.holding import ALWAYS, intervals, presence
from ecat.store import Session
from ecat.store.schemes import scheme_or_default


def default_author() -> str:
    """Who is logged in, as far as the machine tells."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # an account without a name, as in some containers
        return "unknown"


def holding_at(session: Session, layer: Layer, frame: int) -> set[str]:
    """Ids of the relations that hold at ``frame`` (ECAT 2018 file format §2.10)."""
    there = {thing.id: presence(thing) for thing in layer.objects}
    held = intervals(
        layer.relations,
        scheme_or_default(session.path, layer.scheme),
        lambda name: there.get(name, ALWAYS if "/" in name else ()),
    )
    return {
        layer.relations[index].id
        for index, stretches in held.items()
        if any(start <= frame and (end is None or frame < end) for start, end in stretches)
    }


def proposals(session: Session, layer: str) -> list[dict[str, Any]]:
    """What the layer ``machine`` proposes, and what ``layer`` decided about it.

    Returns
    -------
    one dictionary each: ``proposal`` (the id to accept or reject), ``kind``, ``what``, ``frames``, ``confidence``,
    ``decision`` and ``result`` (None if there is none).  Sub-events come with the event that they are part of.
    """
    if session.manifest.layer(MACHINE) is None:
        return []
    proposed = session.layer(MACHINE)
    decided: dict[str, Decision] = {}
    if session.manifest.layer(layer) is not None:
        decided = {decision.proposal: decision for decision in session.layer(layer).decisions}
    return [_row(item, decided) for item in _items(proposed)]


def _items(layer: Layer) -> Iterable[Event | Relation]:
    yield from (event for event in layer.events if event.parent is None)
    yield from layer.relations


def _row(item: Event | Relation, decided: Mapping[str, Decision]) -> dict[str, Any]:
    name = f"{MACHINE}/{item.id}"
    decision = decided.get(name)
    if isinstance(item, Event):
        kind, what, confidence = "event", item.text or item.type, _property(item, "confidence")
        frames = _frames(item.segments)
    else:
        kind, confidence = "relation", None
        what = " ".join((item.predicate, *item.targets))
        frames = f"{item.start_frame}:{'' if item.end_frame is None else item.end_frame}"
    return {
        "proposal": name,
        "kind": kind,
        "what": what,
        "frames": frames,
        "confidence": confidence,
        "decision": decision.verdict if decision else None,
        "result": decision.result or None if decision else None,
    }


def _frames(segments: Sequence[Segment]) -> str:
    return ", ".join(f"{s.start_frame}:{s.end_frame}" for s in segments)


def _property(event: Event, name: str) -> str | None:
    return next((p.value for p in event.properties if p.name == name), None)
