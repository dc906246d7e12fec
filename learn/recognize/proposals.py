"""What was recognised or computed, written into the machine's layer of a session, for people to accept or reject.

Others propose there as well (`ecat process`); each replaces its own proposals, told by their author, and no others'.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from ecat.errors import UsageError
from ecat.model import AnnotatedObject, Event, Layer, Property, Relation, Role, Segment
from ecat.model.annotation import MACHINE, TextReference, with_relation_ids
from ecat.model.document import Document
from ecat.process.inputs import clock_table
from ecat.store import Session
from learn.features.recordings import Recording
from learn.recognize.predict import Action

AUTHOR = "ecat learn recognize"
ROLES = ("Subject", "Object", "Locative")
"""Roles of an event, as the first three slots of a label are called."""
_VERBS = {"push": "pushes", "pull": "pulls", "roll": "rolls", "slide": "slides"}
_PREPOSITIONS = {"Past": "past", "From": "away from", "To": "towards"}
_PERFORMER = "performer"
"""The object that is the performer where nobody annotated one."""


@dataclass(frozen=True)
class Replaced:
    """Of one author's proposals: those that are new, how many of the old were taken out, and how many of them stay, as
    people have decided about them.  Sub-events come with the event that they are part of, and are not counted.
    """

    events: tuple[Event, ...]
    relations: tuple[Relation, ...]
    removed: int
    kept: int

    @property
    def added(self) -> int:
        """How many are new."""
        return _count((*self.events, *self.relations))


def events_of(session: Session, recording: Recording, actions: Sequence[Action]) -> tuple[Event, ...]:
    """Proposed events of actions: type, text, one segment, roles and how sure the recogniser is.  What an action is
    before it gets its locative is a sub-event of it.  Ids are only good for telling which.
    """
    names = {thing.id: thing.name or thing.id for thing in _objects(session)}
    rig = recording.rig or _PERFORMER
    things = {"Performer": rig, "Object_1": recording.objects[0], "Object_2": recording.objects[1]}
    times = _times(session)
    events: list[Event] = []
    for number, action in enumerate(actions, start=1):
        whole = replace(_event(action, things, names, times), id=f"a{number}")
        events.append(whole)
        if action.before is not None:
            part = _event(action.before, things, names, times)
            events.append(replace(part, tier="sub-event", parent=whole.id))
    return tuple(events)


def require_free_layer(session: Session, layer: str) -> None:
    """Return if there may be proposals in a layer: say so before the work, not after it.

    Raises
    ------
    UsageError : the layer is a person's: ``main``, or another than the machine's with more in it than proposals.
    """
    if layer != MACHINE and _is_of_a_person(session, _layer(session, layer)):
        raise UsageError(
            f"cannot propose in layer {layer} of {session.name}",
            where="it is a person's: there may be more in it than proposals",
            fix=f"name another layer, or leave it out for {MACHINE}",
        )


def replace_proposals(
    session: Session,
    author: str,
    events: Iterable[Event] = (),
    relations: Iterable[Relation] = (),
    *,
    layer: str = MACHINE,
) -> Replaced:
    """Make ``events`` and ``relations`` all that ``author`` proposes in a layer, in one commit.

    Proposals of other authors stay as they are.  So do the author's own that people have accepted or rejected, which
    are not proposed a second time, events also not if they have moved by some frames; an event and its sub-events stay
    or go together.  Events may have parents among those of the same author only, each behind its own, and get
    new ids.

    Raises
    ------
    UsageError : the layer is a person's: ``main``, or another than the machine's with more in it than proposals.
    StaleError, LockedError, ReadOnlyError, DiskError : nothing was changed.
    """
    session.refresh()
    require_free_layer(session, layer)
    old = with_relation_ids(_layer(session, layer))
    decided = _decided(session, layer)
    document = Document(old)
    whole = {part.id: one.id for one in old.events if not one.parent for part in document.tree(one.id)}
    settled = {item.id for item in (*old.events, *old.relations) if item.status != "proposed"} | decided
    settled |= {whole[name] for name in settled if name in whole}

    def stays(item: Event | Relation) -> bool:
        return item.author != author or whole.get(item.id, item.id) in settled

    kept_events = tuple(event for event in old.events if stays(event))
    kept_relations = tuple(relation for relation in old.relations if stays(relation))
    number = max(old.event_counter, *_numbers(old.events, "a"), *_numbers_of(decided, "a"))
    new_events = _numbered(_new_events(events, author, kept_events), number)
    last = max(old.relation_counter, *_numbers(old.relations, "r"), *_numbers_of(decided, "r"))
    there = {_meaning(relation) for relation in kept_relations}
    new_relations = [
        replace(one, id=f"r{last + i}", author=author)
        for i, one in enumerate((one for one in relations if _meaning(one) not in there), start=1)
    ]
    made = replace(
        old,
        event_counter=number + len(new_events),
        relation_counter=last + len(new_relations),
        events=(*kept_events, *new_events),
        relations=(*kept_relations, *new_relations),
    )
    made = replace(made, objects=_taking_part(session, made))
    mine = [item for item in (*kept_events, *kept_relations) if item.author == author]
    gone = [item for item in (*old.events, *old.relations) if not stays(item)]
    if new_events or new_relations or gone:
        with session.write() as commit:
            commit.put_layer(made)
    return Replaced(tuple(new_events), tuple(new_relations), _count(gone), _count(mine))


def _event(
    action: Action, things: dict[str, str], names: dict[str, str], times: Callable[[int], int | None]
) -> Event:
    *actors, verb, preposition = action.words
    roles = [Role(name=role, target=things[who]) for role, who in zip(ROLES, actors, strict=True) if who]
    text, references = "", list[TextReference]()
    subject, thing, place = ({role.name: role.target for role in roles}.get(name) for name in ROLES)
    said = [(subject, ""), (None, _VERBS[str(verb)]), (thing, "")]
    if preposition:
        said += [(None, _PREPOSITIONS[preposition]), (place, "")]
    for target, fixed in said:
        if word := fixed or names.get(target or "", target or ""):
            text += " " * bool(text)
            if target:
                references.append(TextReference(start=len(text), end=len(text) + len(word), target=target))
            text += word
    start_ns, end_ns = times(action.start), times(action.end)
    if start_ns is not None and end_ns is not None and end_ns < start_ns:
        start_ns = end_ns = None  # the clock goes back
    properties = [Property("confidence", f"{action.confidence:.2f}")]
    if preposition:
        properties.append(Property("preposition", preposition))
    return Event(
        id="",
        type=f"{verb}_{preposition.lower()}" if preposition else str(verb),
        tier="event",
        status="proposed",
        author=AUTHOR,
        text=text,
        segments=(
            Segment(
                start_frame=action.start,
                end_frame=action.end,
                start_ns=start_ns,
                end_ns=end_ns,
            ),
        ),
        roles=tuple(roles),
        references=tuple(references),
        properties=tuple(properties),
    )


def _layer(session: Session, name: str) -> Layer:
    return session.layer(name) if session.manifest.layer(name) is not None else Layer(name=name)


def _times(session: Session) -> Callable[[int], int | None]:
    """When a frame was; of the one after the last, a usual step later."""
    times: list[int | None] = clock_table(session)["t_ns"].to_pylist()
    n = len(times)

    def at(frame: int) -> int | None:
        if frame < n:
            return times[frame]
        last, before = (times[-1], times[-2]) if n > 1 else (None, None)
        return None if last is None or before is None else last + (last - before)

    return at


def _decided(session: Session, layer: str) -> set[str]:
    """Ids of what is proposed in a layer that people have accepted or rejected."""
    decisions = (d for record in session.manifest.layers for d in session.layer(record.name).decisions)
    return {d.proposal.removeprefix(f"{layer}/") for d in decisions if d.proposal.startswith(f"{layer}/")}


def _is_of_a_person(session: Session, layer: Layer) -> bool:
    """Whether somebody drew, annotated or decided in a layer, or is expected to."""
    record = session.manifest.layer(layer.name)
    items = (*layer.events, *layer.relations)
    return (
        layer.name == "main"
        or bool(layer.decisions)
        or (record is not None and record.journal_bytes > 0)
        or any(item.status != "proposed" or not item.author for item in items)
        or any(thing.key_frames or thing.key_frames_3d for thing in layer.objects)
    )


def _new_events(events: Iterable[Event], author: str, kept: Sequence[Event]) -> list[Event]:
    """Those that no event that stays says already, each with its sub-events."""
    there = {_meaning(event) for event in kept}
    found: list[Event] = []
    said = set[str]()
    for event in (replace(event, author=author) for event in events):
        if event.parent:
            is_said = event.parent in said
        else:
            is_said = _meaning(event) in there or any(_is_the_same(event, one) for one in kept)
        if is_said:
            said.add(event.id)
        else:
            found.append(event)
    return found


def _numbered(events: Sequence[Event], last: int) -> list[Event]:
    """Events with ids that follow a number, also where they are the parents of others."""
    ids = {event.id: f"a{last + i}" for i, event in enumerate(events, start=1)}
    return [
        replace(event, id=f"a{last + i}", parent=ids[event.parent] if event.parent else None)
        for i, event in enumerate(events, start=1)
    ]


def _count(proposals: Iterable[Event | Relation]) -> int:
    """How many there are to decide about: sub-events come with the event that they are part of."""
    return sum(not (isinstance(item, Event) and item.parent) for item in proposals)


def _is_the_same(event: Event, kept: Event) -> bool:
    """Whether an event is one that stays: it says the same, and they overlap by more than half of what both last."""
    said = (event.author, event.tier, event.type, event.roles) == (
        kept.author,
        kept.tier,
        kept.type,
        kept.roles,
    )
    if not (said and event.segments and kept.segments):
        return False
    spans = [(one.segments[0].start_frame, one.segments[-1].end_frame) for one in (event, kept)]
    (start, end), (from_frame, to_frame) = spans
    both = min(end, to_frame) - max(start, from_frame)
    return 2 * both > max(end, to_frame) - min(start, from_frame)


def _meaning(item: Event | Relation) -> Event | Relation:
    """What is said, whatever its id, and how sure who says it is."""
    said = replace(item, id="", author="", status="proposed")
    return replace(said, properties=()) if isinstance(said, Event) else said


def _numbers(items: Iterable[Event | Relation], letter: str) -> list[int]:
    return _numbers_of((item.id for item in items), letter)


def _numbers_of(ids: Iterable[str], letter: str) -> list[int]:
    return [0, *(int(name[1:]) for name in ids if name[:1] == letter and name[1:].isdecimal())]


def _objects(session: Session) -> tuple[AnnotatedObject, ...]:
    """The objects of people's and importers' layer, and those that the machine's has besides."""
    found: dict[str, AnnotatedObject] = {}
    for name in ("main", MACHINE):
        if session.manifest.layer(name) is not None:
            for thing in session.layer(name).objects:
                found.setdefault(thing.id, thing)
    return tuple(found.values())


def _taking_part(session: Session, layer: Layer) -> tuple[AnnotatedObject, ...]:
    """The objects of the machine's layer: those it has, and those that take part now, without their key frames."""
    known = {thing.id: thing for thing in _objects(session)}
    found = {thing.id: thing for thing in layer.objects}
    targets = [
        role.target.split("/")[0] for event in layer.events for role in event.roles if role.kind != "event"
    ]
    targets += [target for relation in layer.relations for target in relation.targets]
    for target in targets:
        if target not in found:
            made = AnnotatedObject(
                id=target, name=target, kind="rig" if target == _PERFORMER else "other", origin="tracked"
            )
            found[target] = replace(known.get(target, made), key_frames=(), key_frames_3d=())
    return tuple(found[name] for name in sorted(found))
