"""Does everything that is named exist: objects, events, joints, sessions, streams, cameras, spans of text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from ecat.check.finding import Finding, Patient, error, note, some, warning

_TABLES = ("markers_2d", "markers_3d", "joints", "poses", "poses_smooth")


def _dangling(place: str, what: str) -> Finding:
    return error("dangling-reference", place, f"{what} does not exist")


def duplicate_ids(patient: Patient) -> Iterator[Finding]:
    """Identifiers are unique in their layer."""
    for layer in patient.layers.values():
        elements = {"object": layer.objects, "event": layer.events, "relation": layer.relations}
        for kind, items in elements.items():
            # a relation without an id gets one of its own
            ids = Counter(item.id for item in items if item.id or kind != "relation")
            twice = sorted(name for name, count in ids.items() if count > 1)
            if twice:
                message = f"{kind} ids that occur more than once: {some(twice)}"
                yield error("duplicate-id", f"layer {layer.name}", message)


def event_references(patient: Patient) -> Iterator[Finding]:
    """Parents, links, roles and references of events name events and objects of their layer."""
    for layer in patient.layers.values():
        events, objects = {e.id for e in layer.events}, {o.id for o in layer.objects}
        for event in layer.events:
            place = f"layer {layer.name}, event {event.id}"
            if event.parent is not None and event.parent not in events:
                yield _dangling(place, f"its parent {event.parent}")
            for link in event.links:
                if link.target not in events:
                    yield _dangling(place, f"event {link.target} of its {link.type} link")
            for role in event.roles:
                # a joint is <object>/<joint>
                target = role.target.split("/")[0] if role.kind == "joint" else role.target
                if target not in (events if role.kind == "event" else objects):
                    yield _dangling(place, f"{role.kind} {role.target} in its role {role.name}")
            for reference in event.references:
                if reference.target not in objects:
                    yield _dangling(place, f"object {reference.target}, referred to by its text,")


def decisions(patient: Patient) -> Iterator[Finding]:
    """What was accepted is there."""
    for layer in patient.layers.values():
        made = {item.id for item in (*layer.events, *layer.relations, *layer.objects)}
        for decision in layer.decisions:
            if decision.verdict == "accepted" and decision.result not in made:
                place = f"layer {layer.name}, decision about {decision.proposal}"
                yield _dangling(place, f"{decision.result or 'nothing'}, which was made of it,")


def parent_cycles(patient: Patient) -> Iterator[Finding]:
    """No event is a part of itself."""
    for layer in patient.layers.values():
        parents = {event.id: event.parent for event in layer.events}
        done: set[str] = set()
        for start in parents:
            path: dict[str, None] = {}
            here: str | None = start
            while here is not None and here in parents and here not in done and here not in path:
                path[here] = None
                here = parents[here]
            done |= path.keys()
            if here in path:
                place = f"layer {layer.name}, event {here}"
                message = "it is a part of itself: its parents lead back to it"
                yield error("parent-cycle", place, message)


def text_spans(patient: Patient) -> Iterator[Finding]:
    """References and predicates mark characters that the text has."""
    for layer in patient.layers.values():
        for event in layer.events:
            for span in (*event.references, *event.predicates):
                if not 0 <= span.start < span.end <= len(event.text):
                    yield error(
                        "bad-span",
                        f"layer {layer.name}, event {event.id}",
                        f"characters {span.start} to {span.end} are marked in a text of {len(event.text)}",
                    )


def relation_references(patient: Patient) -> Iterator[Finding]:
    """Arguments of relations exist, in this session or in the one they name."""
    for layer in patient.layers.values():
        objects = {o.id for o in layer.objects}
        events = {e.id for e in layer.events}
        for i, relation in enumerate(layer.relations):
            place = f"layer {layer.name}, relation {i} ({relation.predicate})"
            for target in relation.targets:
                session, slash, object_id = target.partition("/")
                if not slash:
                    if target not in objects and target not in events:
                        yield _dangling(place, f"its argument {target}")
                else:
                    yield from _foreign(patient, place, session, object_id)


def _foreign(patient: Patient, place: str, session: str, object_id: str) -> Iterator[Finding]:
    there = patient.sibling(session)
    argument = f"its argument {session}/{object_id}"
    if there is None:
        message = f"{argument}: the project has no session {session}"
        yield warning("dangling-session-reference", place, message)
    elif there == "unreadable":
        message = f"{argument} was not looked for: session {session} cannot be read in full"
        yield note("reference-unchecked", place, message)
    elif object_id not in there:
        message = f"{argument}: session {session} has no object {object_id}"
        yield warning("dangling-session-reference", place, message)


def table_references(patient: Patient) -> Iterator[Finding]:
    """Object ids in tables are those of annotated objects."""
    known = {o.id for layer in patient.layers.values() for o in layer.objects}
    for name in _TABLES:
        table = patient.table(name)
        if table is None:
            continue
        ids = {str(value) for value in table["object_id"].unique().drop_null().to_pylist()}
        if patient.unread_layers and ids - known:
            layers = some(patient.unread_layers)
            message = f"objects {some(sorted(ids - known))} were not looked for in layer {layers}, which cannot be read"
            yield note("reference-unchecked", f"table {name}", message)
            continue
        for object_id in sorted(ids - known):
            yield _dangling(f"table {name}", f"object {object_id}")


def stream_references(patient: Patient) -> Iterator[Finding]:
    """Objects name streams, streams name cameras, cameras name cameras of this session."""
    streams = {s.name for s in patient.manifest.streams}
    cameras = {c.name for c in patient.manifest.cameras}
    for stream in patient.manifest.streams:
        # a camera that was never calibrated has a name only
        if stream.camera and cameras and stream.camera not in cameras:
            yield _dangling(f"stream {stream.name}", f"its camera {stream.camera}")
    for camera in patient.manifest.cameras:
        if camera.reference and camera.reference not in cameras:
            yield _dangling(f"camera {camera.name}", f"its reference camera {camera.reference}")
    for layer in patient.layers.values():
        for thing in layer.objects:
            if thing.stream and thing.stream not in streams:
                message = f"it is annotated on {thing.stream}, which is not a stream of the session"
                place = f"layer {layer.name}, object {thing.id}"
                yield warning("dangling-stream", place, message)


REFERENCES = (
    duplicate_ids,
    event_references,
    decisions,
    parent_cycles,
    text_spans,
    relation_references,
    table_references,
    stream_references,
)
