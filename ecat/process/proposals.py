"""Proposals of the stages as an annotation layer of their own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ecat.model import AnnotatedObject, Event, Layer, Property, Relation, Role, Segment
from ecat.model.annotation import MACHINE, Argument, TextPredicate, TextReference, with_relation_ids
from ecat.model.prototype import BoxPrototype
from ecat.process.inputs import annotated_objects, box_objects
from ecat.store import Session

PROPOSED = {"markers_2d", "relation_proposals", "event_proposals"}
"""Tables that the layer is made of."""
_ACTION, _PART = "event", "sub-event"
_Row = Mapping[str, Any]


def machine_layer(
    relation_proposals: pa.Table | None,
    event_proposals: pa.Table | None,
    objects: Sequence[AnnotatedObject],
    tracked: Sequence[AnnotatedObject] = (),
) -> Layer:
    """The layer ``machine``: everything proposed, nothing confirmed.

    ``objects`` are those of the layer that the tables' ids come from; the ones that take part are repeated, without
    their key frames.  ``tracked`` are those that nobody annotated; all of them are kept.  An action that was
    interrupted has a segment for each stretch.
    """
    objects = (*objects, *tracked)
    events = _events(event_proposals.to_pylist() if event_proposals else [], objects)
    relations = tuple(
        _relation(row) for row in (relation_proposals.to_pylist() if relation_proposals else [])
    )
    named = {thing.id for thing in tracked}
    named |= {target for relation in relations for target in relation.targets}
    named |= {role.target.split("/")[0] for event in events for role in event.roles}
    known = {thing.id: replace(thing, key_frames=(), key_frames_3d=()) for thing in objects}
    kept = tuple(
        known.get(
            name,
            AnnotatedObject(
                id=name, name=name, kind="rig" if name.startswith("body_") else "other", origin="tracked"
            ),
        )
        for name in sorted(named)
    )
    made = Layer(
        name=MACHINE, object_counter=len(kept), event_counter=len(events), objects=kept, events=events,
        relations=relations,
    )  # fmt: skip
    return with_relation_ids(made)


def _relation(row: _Row) -> Relation:
    from ecat.stages.relations import RELATIONS

    return Relation(
        predicate=row["predicate"],
        start_frame=row["start_frame"],
        end_frame=row["end_frame"],
        start_ns=row["start_ns"],
        end_ns=row["end_ns"],
        polarity=row["polarity"],
        source="computed",
        status="proposed",
        author=f"ecat {RELATIONS.name} {RELATIONS.version}",
        arguments=tuple(Argument(target=target) for target in row["arguments"]),
    )


def _events(rows: Sequence[_Row], objects: Sequence[AnnotatedObject]) -> tuple[Event, ...]:
    """Actions in their order, each followed by its parts."""
    parts: dict[str, list[_Row]] = {row["event_id"]: [] for row in rows if row["parent"] is None}
    for row in rows:
        if row["parent"] is not None:
            parts[row["parent"]].append(row)
    names = {thing.id: thing.name for thing in objects}
    events: list[Event] = []
    for row in rows:
        if row["parent"] is None:
            events.append(_action(row, parts[row["event_id"]], names))
            events += [_part(part) for part in parts[row["event_id"]]]
    return tuple(events)


def _action(row: _Row, parts: Sequence[_Row], names: Mapping[str, str]) -> Event:
    text: str = row["text"]
    roles = [Role(name="Agent", target=row["hand"].split("/")[0])] if row["hand"] else []
    references: list[TextReference] = []
    for role, object_id in (("Theme", row["object_id"]), ("Landmark", row["landmark"])):
        if object_id is None:
            continue
        roles.append(Role(name=role, target=object_id))
        name = names.get(object_id, "")
        # the text names the theme before the landmark
        at = text.find(name, references[-1].end if references else 0) if name else -1
        if at >= 0:
            references.append(TextReference(start=at, end=at + len(name), target=object_id))
    verb = row["type"].split("_")[0]
    return Event(
        **_common(row),
        tier=_ACTION,
        text=text,
        segments=_segments(parts or [row]),
        roles=tuple(roles),
        references=tuple(references),
        predicates=(TextPredicate(start=0, end=len(verb), type=verb),),
    )


def _part(row: _Row) -> Event:
    agent = (Role(name="Agent", target=row["hand"], kind="joint"),) if row["hand"] else ()
    return Event(
        **_common(row),
        tier=_PART,
        parent=row["parent"],
        segments=_segments([row]),
        roles=(*agent, Role(name="Theme", target=row["object_id"])),
    )


def _common(row: _Row) -> dict[str, Any]:
    from ecat.stages.propose import PROPOSE

    return {
        "id": row["event_id"],
        "type": row["type"],
        "status": "proposed",
        "author": f"ecat {PROPOSE.name} {PROPOSE.version}",
        "properties": (Property(name="confidence", value=f"{row['confidence']:.2f}"),),
    }


def _segments(rows: Iterable[_Row]) -> tuple[Segment, ...]:
    """The stretches that intervals cover, those that meet or overlap as one."""
    found: list[Segment] = []
    for row in sorted(rows, key=lambda row: (row["start_frame"], row["end_frame"])):
        stretch = Segment(**{name: row[name] for name in ("start_frame", "end_frame", "start_ns", "end_ns")})
        if found and stretch.start_frame <= found[-1].end_frame:
            if stretch.end_frame > found[-1].end_frame:
                found[-1] = replace(found[-1], end_frame=stretch.end_frame, end_ns=stretch.end_ns)
        else:
            found.append(stretch)
    return tuple(found)


def decisions(session: Session) -> int:
    """How many events and relations of the layer ``machine`` are no longer mere proposals: people accepted or rejected
    them in layers of their own, or they were confirmed in place.
    """
    if session.manifest.layer(MACHINE) is None:
        return 0
    proposed = session.layer(MACHINE)
    decided = {
        f"{MACHINE}/{item.id}"
        for item in (*proposed.events, *proposed.relations)
        if item.status != "proposed"
    }
    for record in session.manifest.layers:
        decided |= {decision.proposal for decision in session.layer(record.name).decisions}
    return sum(proposal.startswith(f"{MACHINE}/") for proposal in decided)


def proposed_layer(
    session: Session, made: Mapping[str, pa.Table], prototypes: Sequence[BoxPrototype]
) -> Layer:
    """The layer ``machine`` of a session: of tables just ``made``, and otherwise of those that it has."""

    def table(name: str) -> pa.Table | None:
        if name in made:
            return made[name]
        return session.table(name).to_arrow() if session.has_table(name) else None

    objects = annotated_objects(session)
    record = session.manifest.table("markers_2d")
    marks = table("markers_2d") if "markers_2d" in made or (record is not None and record.stage) else None
    seen = set() if marks is None else {str(name) for name in pc.unique(marks["object_id"]).to_pylist()}
    tracked = tuple(
        AnnotatedObject(id=name, name=box.name, kind="marker_box", origin="tracked", dimensions=3)
        for name, box in zip(box_objects(objects, prototypes), prototypes, strict=True)
        if name in seen.difference(thing.id for thing in objects)
    )
    layer = machine_layer(table("relation_proposals"), table("event_proposals"), objects, tracked)
    return layer if session.manifest.layer(MACHINE) is None else with_others(layer, session.layer(MACHINE))


def with_others(layer: Layer, old: Layer) -> Layer:
    """A layer just made, and behind its proposals those of the ``old`` one that others than the stages made.

    These get new ids, as the stages number theirs from one.  Where they mean an event of a stage, they go on to mean it
    if the stage says the same again, and otherwise do not mean anything.
    """
    events = [event for event in old.events if _is_of_others(event.author)]
    relations = [relation for relation in old.relations if _is_of_others(relation.author)]
    again = {replace(event, id=""): event.id for event in layer.events}
    ids = {event.id: again.get(replace(event, id="")) for event in old.events}
    ids |= {event.id: f"a{layer.event_counter + number}" for number, event in enumerate(events, 1)}
    there = {thing.id for thing in layer.objects}
    taking_part = {role.target.split("/")[0] for event in events for role in event.roles}
    taking_part |= {target for relation in relations for target in relation.targets}
    objects = (thing for thing in old.objects if thing.id in taking_part - there)
    joined = replace(
        layer,
        event_counter=layer.event_counter + len(events),
        objects=tuple(sorted((*layer.objects, *objects), key=lambda thing: thing.id)),
        events=(*layer.events, *(_renamed(event, ids) for event in events)),
        relations=(*layer.relations, *(replace(relation, id="") for relation in relations)),
    )
    return with_relation_ids(replace(joined, object_counter=len(joined.objects)))


def _is_of_others(author: str) -> bool:
    from ecat.stages.propose import PROPOSE
    from ecat.stages.relations import RELATIONS

    return not author.startswith((f"ecat {PROPOSE.name} ", f"ecat {RELATIONS.name} "))


def _renamed(event: Event, ids: Mapping[str, str | None]) -> Event:
    """An event of others, where events have these ids now; None where there is such an event no more."""
    roles = [
        replace(role, target=target)
        for role in event.roles
        if (target := role.target if role.kind != "event" else ids.get(role.target)) is not None
    ]
    links = [
        replace(link, target=target) for link in event.links if (target := ids.get(link.target)) is not None
    ]
    parent = ids.get(event.parent) if event.parent else None
    return replace(event, id=ids[event.id] or "", parent=parent, roles=tuple(roles), links=tuple(links))
