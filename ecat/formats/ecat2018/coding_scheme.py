"""The coding scheme that ``option.txt`` holds: its predicates and which facts exclude each other (§1.10, §2.10)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from ecat.formats.ecat2018.options import Exclusive, Options, PredicateForm, Unique
from ecat.model.scheme import ECAT_2018_SCHEME, CodingScheme, Constraint, PredicateType


def coding_scheme(options: Options, *, name: str = ECAT_2018_SCHEME.name) -> CodingScheme:
    """The predicates and constraints of ``options`` as a coding scheme; the file that ECAT was shipped with gives
    :data:`ecat.model.scheme.ECAT_2018_SCHEME`.

    ECAT had no tiers: events were one list, and a link made one a part of another, so the tiers are those two.  A
    predicate that stands in the file twice counts once.  Arguments count in the order in which the predicate is
    printed, which is that of a relation's arguments.  How shapes between key frames are interpolated is a setting of
    the program and no part of what may be said: ``options.interpolation_modes`` keeps it.
    """
    said = (
        *_predicates(options.object_predicates, "object"),
        *_predicates(options.event_predicates, "event"),
    )
    constraints = (each for constraint in options.constraints for each in _constraints(constraint))
    return CodingScheme(
        name=name,
        tiers=ECAT_2018_SCHEME.tiers,
        predicates=tuple(dict.fromkeys(said)),
        constraints=tuple(dict.fromkeys(constraints)),
    )


def _predicates(
    forms: tuple[PredicateForm, ...], target: Literal["object", "event"]
) -> Iterator[PredicateType]:
    return (PredicateType(name=form.name, arity=len(form.slots), target=target) for form in forms)


def _constraints(constraint: Unique | Exclusive) -> Iterator[Constraint]:
    """One for each argument that has to be unique; of exclusive predicates one for all."""
    if isinstance(constraint, Exclusive):
        names = ",".join(form.name for form in constraint.predicates)
        if names:
            yield Constraint(kind="EXCLUSIVE", predicates=names)
        return
    form = constraint.predicate
    for argument, slot in enumerate(form.slots, start=1):
        if slot in constraint.slots:
            yield Constraint(kind="UNIQUE", predicates=form.name, unique_argument=argument)
