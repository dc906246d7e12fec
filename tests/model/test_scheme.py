"""The coding scheme that ECAT was shipped with (ECAT 2018 file format §1.10)."""

from __future__ import annotations

from ecat.model import Constraint
from ecat.model.scheme import ECAT_2018_SCHEME

POSTURES = ("STAND", "SIT", "WALK", "RUN", "LIE", "CROUCH", "KNEEL")


def test_the_postures_are_unary_and_exclude_each_other() -> None:
    arity = {predicate.name: predicate.arity for predicate in ECAT_2018_SCHEME.predicates}
    assert {arity[name] for name in POSTURES} == {1}
    exclusive = [c for c in ECAT_2018_SCHEME.constraints if c.kind == "EXCLUSIVE"]
    assert [c.names for c in exclusive] == [POSTURES]


def test_one_looks_and_points_at_one_thing_at_a_time() -> None:
    unique = {c.names: c.unique_argument for c in ECAT_2018_SCHEME.constraints if c.kind == "UNIQUE"}
    assert unique == {("LOOK_AT",): 2, ("POINT_AT",): 2}


def test_links_between_events_are_predicates_over_events() -> None:
    events = [p.name for p in ECAT_2018_SCHEME.predicates if p.target == "event"]
    assert events == ["SUBEVENT", "CAUSE"]


def test_sub_events_lie_within_their_events() -> None:
    tiers = {tier.name: (tier.parent, tier.constraint) for tier in ECAT_2018_SCHEME.tiers}
    assert tiers == {"event": (None, "none"), "sub-event": ("event", "included_in")}


def test_every_constraint_is_about_predicates_of_the_scheme() -> None:
    arity = {predicate.name: predicate.arity for predicate in ECAT_2018_SCHEME.predicates}
    for constraint in ECAT_2018_SCHEME.constraints:
        assert set(constraint.names) <= set(arity)
        assert constraint.unique_argument <= min(arity[name] for name in constraint.names)


def test_every_name_occurs_once() -> None:
    names = [predicate.name for predicate in ECAT_2018_SCHEME.predicates]
    assert len(set(names)) == len(names)


def test_the_names_of_a_constraint_are_separated_by_commas_with_or_without_blanks() -> None:
    assert Constraint(kind="EXCLUSIVE", predicates="SIT, STAND,LIE ").names == ("SIT", "STAND", "LIE")
