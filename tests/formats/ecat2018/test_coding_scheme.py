"""``option.txt`` as a coding scheme."""

from __future__ import annotations

from pathlib import Path

from ecat.formats.ecat2018.coding_scheme import coding_scheme
from ecat.formats.ecat2018.options import Exclusive, Options, PredicateForm, Unique, read_options
from ecat.model.scheme import ECAT_2018_SCHEME, Constraint, PredicateType
from ecat.store.xml import scheme_from_xml, scheme_to_xml

SIT, STAND = PredicateForm("SIT", (1,)), PredicateForm("STAND", (1,))
NEAR, CAUSE = PredicateForm("NEAR", (1, 2)), PredicateForm("CAUSE", (1, 2))


def test_the_shipped_file_is_the_scheme_that_ecat_knows(shared: Path) -> None:
    assert coding_scheme(read_options(shared / "ecat_program" / "option.txt")) == ECAT_2018_SCHEME


def test_predicates_keep_arity_and_target_and_count_once() -> None:
    found = coding_scheme(Options(event_predicates=(CAUSE,), object_predicates=(SIT, NEAR, SIT)), name="mine")
    assert found.name == "mine"
    assert found.predicates == (
        PredicateType(name="SIT", arity=1),
        PredicateType(name="NEAR"),
        PredicateType(name="CAUSE", target="event"),
    )


def test_exclusive_predicates_are_one_constraint_and_none_exclude_nothing() -> None:
    found = coding_scheme(Options(constraints=(Exclusive((SIT, STAND)), Exclusive(()))))
    assert found.constraints == (Constraint(kind="EXCLUSIVE", predicates="SIT,STAND"),)


def test_a_slot_counts_where_it_is_printed() -> None:
    """Trap: constraints name slots, which NAME(Y,X) prints the other way round."""
    turned = PredicateForm("NEAR", (2, 1))
    found = coding_scheme(Options(constraints=(Unique(NEAR, (2,)), Unique(turned, (2,)))))
    assert [constraint.unique_argument for constraint in found.constraints] == [2, 1]


def test_a_constraint_on_two_arguments_is_one_for_each() -> None:
    found = coding_scheme(Options(constraints=(Unique(NEAR, (1, 2)),)))
    assert [constraint.unique_argument for constraint in found.constraints] == [1, 2]


def test_it_can_be_written() -> None:
    options = Options(object_predicates=(SIT, STAND, NEAR), constraints=(Exclusive((SIT, STAND)),))
    found = coding_scheme(options)
    assert scheme_from_xml(scheme_to_xml(found), name="scheme") == found
