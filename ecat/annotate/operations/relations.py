"""Operations on relations (ECAT 2018 file format §2.10)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.uses import drop_decisions
from ecat.model import Argument, Relation
from ecat.model.holding import conflicts
from ecat.model.scheme import ECAT_2018_SCHEME


@dataclass(frozen=True, slots=True, kw_only=True)
class AddRelation(Operation):
    """A predicate holds (``polarity``) of objects, or is denied, from a frame on; without an end, until contradicted.

    An argument is the id of an object, or ``<session>/<object id>``.  Facts from the same frame on that contradict the
    new one are removed.
    """

    predicate: str
    arguments: tuple[str, ...]
    start_frame: int
    end_frame: int | None = None
    polarity: bool = True
    id: str | None = None

    def perform(self, edit: Edit) -> None:
        """Add it."""
        relation = Relation(
            id=edit.new_id("relation", self.id),
            predicate=self.predicate,
            start_frame=self.start_frame,
            end_frame=self.end_frame,
            polarity=self.polarity,
            author=edit.author,
            arguments=tuple(Argument(target=target) for target in self.arguments),
        )
        put_relation(edit, relation)


@dataclass(frozen=True, slots=True, kw_only=True)
class EditRelation(Operation):
    """Change what is given of a relation; ``until_contradicted`` takes its end away."""

    id: str
    predicate: str | None = None
    arguments: tuple[str, ...] | None = None
    start_frame: int | None = None
    end_frame: int | None = None
    polarity: bool | None = None
    until_contradicted: bool = False

    def perform(self, edit: Edit) -> None:
        """Change it."""
        relation = edit.relation(self.id)
        said = {n: getattr(self, n) for n in ("predicate", "start_frame", "end_frame", "polarity")}
        new = replace(relation, **{name: value for name, value in said.items() if value is not None})
        if self.arguments is not None:
            new = replace(new, arguments=tuple(Argument(target=target) for target in self.arguments))
        if self.until_contradicted:
            new = replace(new, end_frame=None)
        put_relation(edit, new)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveRelation(Operation):
    """Remove a relation."""

    id: str

    def perform(self, edit: Edit) -> None:
        """Remove it."""
        edit.relation(self.id)
        drop_decisions(edit, self.id)
        edit.drop("relation", self.id)


def put_relation(edit: Edit, relation: Relation) -> None:
    """Add or replace a relation, and remove what contradicts it at the same frame.

    Raises
    ------
    OperationError : its stretch is empty or not in the recording; it says what another one says.
    """
    old = edit.document.relation(relation.id)
    if old is None or (old.start_frame, old.end_frame) != (relation.start_frame, relation.end_frame):
        kept = () if old is None else (old.start_frame, *(() if old.end_frame is None else (old.end_frame,)))
        relation = replace(relation, **_times(edit, relation, kept))
    scheme = edit.scheme or ECAT_2018_SCHEME
    for other in _of_the_same(edit, relation):
        if other.start_frame != relation.start_frame or other.id == relation.id:
            continue
        same = (other.predicate, other.targets) == (relation.predicate, relation.targets)
        if same and other.polarity == relation.polarity:
            raise edit.refusal(f"relation {other.id} says so already", "edit that one instead")
        both = other.polarity and relation.polarity
        if same or (both and conflicts(scheme, other, relation)):
            drop_decisions(edit, other.id)
            edit.drop("relation", other.id)
    edit.put(relation)


def _times(edit: Edit, relation: Relation, kept: Collection[int]) -> dict[str, int | None]:
    start = relation.start_frame
    if relation.end_frame is None:
        return {"start_ns": edit.t_ns(start if start in kept else edit.frame(start)), "end_ns": None}
    segment = edit.segment(start, relation.end_frame, kept=kept)
    return {"start_ns": segment.start_ns, "end_ns": segment.end_ns}


def _of_the_same(edit: Edit, relation: Relation) -> list[Relation]:
    """The relations that share an object of this session with ``relation``."""
    found: dict[str, Relation] = {}
    for target in relation.targets:
        for kind, name in edit.document.users("object", target):
            if kind == "relation":
                found[name] = edit.relation(name)
    return list(found.values())
