"""Decisions about what a machine proposed: the layer of proposals stays as it is, the annotator's gets a copy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.relations import put_relation
from ecat.annotate.operations.shapes import keys_of
from ecat.model import AnnotatedObject, Event, Layer, Relation, Segment
from ecat.model.annotation import Decision, Verdict
from ecat.model.document import Document, owner_of


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptProposal(Operation):
    """Take over an event, with its sub-events, a relation or an object of another layer (``machine/a3``), adjusted if
    so said.

    Objects that it needs come along; sub-events that were rejected do not.  ``same_as`` names what another layer has
    for the same object (``ben/o5``): there is one object for both, which looks as the one accepted, and whatever is
    accepted later and names either names that.
    """

    proposal: str
    start_frame: int | None = None
    end_frame: int | None = None
    type: str | None = None
    same_as: str | None = None

    def perform(self, edit: Edit) -> None:
        """Take it over."""
        layer, element = proposed(edit, self.proposal)
        decided = edit.document.decision(self.proposal)
        if decided is not None and decided.verdict == "accepted":
            raise edit.refusal(f"{self.proposal} was accepted as {decided.result}", "edit that instead")
        copy = _Copy(edit, layer)
        if isinstance(element, AnnotatedObject):
            if (self.start_frame, self.end_frame, self.type) != (None, None, None):
                raise edit.refusal(f"{self.proposal} is an object", "leave frames and type out")
            copy.thing(self, element)
        elif self.same_as is not None:
            raise edit.refusal(f"{self.proposal} is not an object", "leave same_as out")
        elif isinstance(element, Relation):
            copy.relation(self, element)
        else:
            copy.event(self, element)


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectProposal(Operation):
    """Say that a proposed event, with its sub-events, relation or object is not so."""

    proposal: str

    def perform(self, edit: Edit) -> None:
        """Say so."""
        layer, element = proposed(edit, self.proposal)
        parts = Document(layer).tree(element.id) if isinstance(element, Event) else [element]
        for part in parts:
            proposal = f"{layer.name}/{part.id}"
            decided = edit.document.decision(proposal)
            if decided is None or decided.verdict != "accepted":
                decide(edit, proposal, "rejected")
            elif part is element:
                raise edit.refusal(f"{proposal} was accepted as {decided.result}", "remove that first")


def proposed(edit: Edit, proposal: str) -> tuple[Layer, Event | Relation | AnnotatedObject]:
    """The layer and the element that a proposal names.

    Raises
    ------
    OperationError : there is none.
    """
    name, _, inner = proposal.partition("/")
    layer = edit.layer_of(name)
    for element in (*layer.events, *layer.relations, *layer.objects):
        if element.id == inner:
            return layer, element
    raise edit.refusal(f"layer {name} has no event, relation or object {inner}", "name one as machine/a1")


def decide(edit: Edit, proposal: str, verdict: Verdict, result: str = "") -> None:
    """Record a decision."""
    edit.put(Decision(proposal=proposal, verdict=verdict, result=result, author=edit.author))


@dataclass
class _Copy:
    """Takes elements of ``layer`` over; ``names`` are the ids of copies by those of their originals."""

    edit: Edit
    layer: Layer
    names: dict[str, str] = field(default_factory=dict[str, str])

    def relation(self, asked: AcceptProposal, relation: Relation) -> None:
        """Copy a relation."""
        edit = self.edit
        new = replace(
            relation,
            id=edit.new_id("relation"),
            predicate=asked.type or relation.predicate,
            start_frame=_or(asked.start_frame, relation.start_frame),
            end_frame=_or(asked.end_frame, relation.end_frame),
            status="confirmed",
            author=edit.author,
            arguments=tuple(replace(a, target=self.object(a.target)) for a in relation.arguments),
        )
        put_relation(edit, new)
        decide(edit, f"{self.layer.name}/{relation.id}", "accepted", new.id)

    def thing(self, asked: AcceptProposal, theirs: AnnotatedObject) -> None:
        """Copy an object, or give its look to the one that is here for it."""
        edit, own = self.edit, f"{self.layer.name}/{theirs.id}"
        if asked.same_as is not None:
            layer, other = proposed(edit, asked.same_as)
            here = _Copy(edit, layer).known(other.id) or self.known(theirs.id)
        else:
            if edit.document.decision(own) is not None:
                edit.drop("decision", own)
            here = self.known(theirs.id)
            if here is not None and _stands_for_another(edit, here, own):
                here = None
        name = here or self._copied(theirs)
        _look_like(edit, name, theirs)
        if asked.same_as is not None:
            decide(edit, asked.same_as, "rejected", name)
        decide(edit, own, "accepted", name)

    def event(self, asked: AcceptProposal, event: Event) -> None:
        """Copy an event and its sub-events."""
        edit = self.edit
        whole = _adjusted(edit, event.segments, asked.start_frame, asked.end_frame)
        copies: list[tuple[Event, tuple[Segment, ...]]] = []
        for part in Document(self.layer).tree(event.id):
            segments = whole if part is event else _clipped(edit, part.segments, whole)
            decided = edit.document.decision(f"{self.layer.name}/{part.id}")
            lost = part.parent not in self.names if part is not event else False
            if part is not event and (decided is not None or lost or not segments):
                continue
            self.names[part.id] = edit.new_id("event")
            copies.append((part, segments))
        for part, segments in copies:
            kind = asked.type if part is event and asked.type else part.type
            self._put(part, segments, kind)
            decide(edit, f"{self.layer.name}/{part.id}", "accepted", self.names[part.id])

    def _put(self, part: Event, segments: tuple[Segment, ...], kind: str) -> None:
        roles = (replace(r, target=self._role(r.target, r.kind)) for r in part.roles)
        parent = self.names.get(part.parent or "") or self._accepted(part.parent)
        self.edit.put(
            replace(
                part,
                id=self.names[part.id],
                type=kind,
                parent=parent,
                status="confirmed",
                author=self.edit.author,
                segments=segments,
                roles=tuple(role for role in roles if role.target),
                references=tuple(replace(r, target=self.object(r.target)) for r in part.references),
                links=tuple(
                    replace(link, target=name) for link in part.links if (name := self._event(link.target))
                ),
            )
        )

    def _role(self, target: str, kind: str) -> str:
        if kind == "event":
            return self._event(target)
        owner = owner_of(target, kind)
        return self.object(owner) + target[len(owner) :]

    def _event(self, name: str) -> str:
        return self.names.get(name) or self._accepted(name) or ""

    def _accepted(self, name: str | None) -> str | None:
        """What an event of the layer was accepted as before."""
        decided = self.edit.document.decision(f"{self.layer.name}/{name}")
        return decided.result if decided is not None and decided.verdict == "accepted" else None

    def object(self, name: str) -> str:
        """The id here of an object of the layer: its own, unless that is another thing's."""
        if name in self.names or "/" in name:
            return self.names.get(name, name)
        theirs = self._theirs(name)
        here = name if theirs is None else self.known(name)
        if theirs is None or here is not None:
            return here or name
        return self._copied(theirs)

    def _copied(self, theirs: AnnotatedObject) -> str:
        # tables name a thing by its id, so a copy keeps it where it can
        taken = self.edit.document.object(theirs.id) is not None
        name = self.names[theirs.id] = self.edit.new_id("object", None if taken else theirs.id)
        self.edit.put(replace(theirs, id=name))
        return name

    def known(self, name: str) -> str | None:
        """The object here that was decided to be an object of the layer, or that is the same by id, kind and name."""
        decided = self.edit.document.decision(f"{self.layer.name}/{name}")
        if decided is not None and decided.result and self.edit.document.object(decided.result) is not None:
            return decided.result
        theirs, ours = self._theirs(name), self.edit.document.object(name)
        if theirs is None or ours is None or (ours.kind, ours.name) != (theirs.kind, theirs.name):
            return None
        return name

    def _theirs(self, name: str) -> AnnotatedObject | None:
        return next((thing for thing in self.layer.objects if thing.id == name), None)


def _stands_for_another(edit: Edit, name: str, proposal: str) -> bool:
    """Whether an object here was decided to be another one than that of ``proposal``."""
    return any(kind == "decision" and user != proposal for kind, user in edit.document.users("event", name))


def _look_like(edit: Edit, name: str, theirs: AnnotatedObject) -> None:
    """Let an object be what another one is, under its own id."""
    edit.put(replace(theirs, id=name))
    for dimensions in (2, 3):
        wanted = keys_of(theirs, dimensions)
        for key in keys_of(edit.object(name), dimensions):
            if key.frame not in {other.frame for other in wanted}:
                edit.drop_key_frame(name, key.frame, dimensions)
        for key in wanted:
            edit.put_key_frame(name, key, dimensions)


def _or(said: int | None, otherwise: int | None) -> int | None:
    return otherwise if said is None else said


def _adjusted(
    edit: Edit, segments: Sequence[Segment], start: int | None, end: int | None
) -> tuple[Segment, ...]:
    """Segments that begin at ``start`` and end at ``end``."""
    if not segments or (start is None and end is None):
        return tuple(segments)
    first, last = segments[0], segments[-1]
    whole = edit.segment(_or(start, first.start_frame) or 0, _or(end, last.end_frame) or 0)
    inner = [s for s in segments if s.end_frame > whole.start_frame and s.start_frame < whole.end_frame]
    spans = [[s.start_frame, s.end_frame] for s in inner] or [[whole.start_frame, whole.end_frame]]
    spans[0][0], spans[-1][1] = whole.start_frame, whole.end_frame
    return edit.segments([(a, b) for a, b in spans])


def _clipped(edit: Edit, segments: Sequence[Segment], whole: Sequence[Segment]) -> tuple[Segment, ...]:
    """What of ``segments`` lies in the span of ``whole``."""
    if not whole:
        return tuple(segments)
    start, end = whole[0].start_frame, whole[-1].end_frame
    found: list[Segment] = []
    for s in segments:
        first, last = max(s.start_frame, start), min(s.end_frame, end)
        if first < last:
            same = (first, last) == (s.start_frame, s.end_frame)
            found.append(s if same else edit.segment(first, last))
    return tuple(found)
