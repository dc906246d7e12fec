"""People decide about proposals; the layer of proposals itself stays as it is."""

from __future__ import annotations

from typing import Any

import pytest

from ecat.model import (
    AnnotatedObject,
    Argument,
    Event,
    KeyFrame,
    Layer,
    Relation,
    Role,
    Segment,
    TextReference,
)
from ecat.model.annotation import Decision
from tests.annotate.bench import Bench, op, thing


def proposed(name: str, start: int, end: int, **said: Any) -> Event:
    segments = (Segment(start_frame=start, end_frame=end),)
    return Event(id=name, segments=segments, status="proposed", author="ecat propose 2", **said)


THEME = Role(name="Theme", target="o2")
HAND = Role(name="Agent", target="body_1/HandRight", kind="joint")
MACHINE = Layer(
    name="machine",
    objects=(
        AnnotatedObject(id="body_1", name="body_1", kind="rig"),
        AnnotatedObject(id="o2", name="Shell", kind="marker_box"),
    ),
    events=(
        proposed("a1", 10, 50, type="slide_next", tier="event", text="Slide Shell", roles=(THEME,),
                 references=(TextReference(start=6, end=11, target="o2"),)),
        proposed("a2", 10, 20, type="grasp", parent="a1", roles=(HAND, THEME)),
        proposed("a3", 20, 40, type="move", parent="a1", roles=(HAND, THEME)),
        proposed("a4", 60, 70),
    ),
    relations=(
        Relation(id="r1", predicate="ON", start_frame=5, end_frame=30, status="proposed", source="computed",
                 arguments=(Argument(target="o2"), Argument(target="body_1"))),
    ),
)  # fmt: skip


@pytest.fixture
def beside() -> Bench:
    """An annotator's layer that has the box already, beside what the machine proposed."""
    box = AnnotatedObject(id="o2", name="Shell", kind="marker_box", origin="tracked")
    return Bench(Layer(objects=(box,), object_counter=2), layers={"machine": MACHINE})


def accept(name: str, **said: Any) -> dict[str, Any]:
    return op("accept_proposal", proposal=f"machine/{name}", **said)


def reject(name: str) -> dict[str, Any]:
    return op("reject_proposal", proposal=f"machine/{name}")


def decisions(bench: Bench) -> dict[str, tuple[str, str]]:
    return {d.proposal.partition("/")[2]: (d.verdict, d.result) for d in bench.layer.decisions}


def test_an_accepted_event_brings_its_sub_events_roles_and_objects(beside: Bench) -> None:
    beside.do(accept("a1"))
    assert [(e.id, e.type, e.parent, e.status, e.author) for e in beside.layer.events] == [
        ("a1", "slide_next", None, "confirmed", "ann"),
        ("a2", "grasp", "a1", "confirmed", "ann"),
        ("a3", "move", "a1", "confirmed", "ann"),
    ]
    assert beside.event("a2").roles == (HAND, THEME)
    assert beside.event("a1").references[0].target == "o2"
    assert [t.id for t in beside.layer.objects] == ["o2", "body_1"]
    assert decisions(beside) == {name: ("accepted", name) for name in ("a1", "a2", "a3")}
    assert beside.layer.decisions[0] == Decision(
        proposal="machine/a1", verdict="accepted", result="a1", author="ann"
    )


def test_an_object_whose_id_is_taken_by_another_thing_gets_one_of_its_own(beside: Bench) -> None:
    beside.do(thing("mug", id="body_1"), accept("a2"))
    assert beside.event("a1").roles[0].target == "o3/HandRight"
    made = beside.document.object("o3")
    assert made is not None
    assert made.kind == "rig"


def test_it_can_be_adjusted_as_it_is_accepted(beside: Bench) -> None:
    beside.do(accept("a1", start_frame=15, end_frame=30, type="slide_past"))
    assert (beside.event("a1").type, beside.spans("a1")) == ("slide_past", [(15, 30)])
    assert (beside.spans("a2"), beside.spans("a3")) == ([(15, 20)], [(20, 30)])
    assert "are no stretch" in beside.refused(accept("a4", start_frame=80))


def test_sub_events_of_which_nothing_is_left_do_not_come_along(beside: Bench) -> None:
    beside.do(accept("a1", start_frame=25))
    assert [e.type for e in beside.layer.events] == ["slide_next", "move"]


def test_rejected_sub_events_do_not_come_along(beside: Bench) -> None:
    beside.do(reject("a2"), accept("a1"))
    assert [e.type for e in beside.layer.events] == ["slide_next", "move"]
    assert decisions(beside)["a2"] == ("rejected", "")


def test_a_sub_event_that_is_accepted_later_finds_its_parent(beside: Bench) -> None:
    beside.do(reject("a2"), accept("a1"), accept("a2"))
    assert beside.event("a3").parent == "a1"
    assert beside.event("a3").type == "grasp"


def test_an_accepted_relation_is_a_fact(beside: Bench) -> None:
    beside.do(accept("r1", end_frame=40))
    (fact,) = beside.layer.relations
    assert (fact.id, fact.status, fact.start_frame, fact.end_frame) == ("r1", "confirmed", 5, 40)
    assert fact.targets == ("o2", "body_1")
    assert decisions(beside) == {"r1": ("accepted", "r1")}


def test_a_rejection_takes_the_sub_events_along(beside: Bench) -> None:
    beside.do(reject("a1"))
    assert decisions(beside) == dict.fromkeys(("a1", "a2", "a3"), ("rejected", ""))
    assert beside.layer.events == ()


def test_a_rejection_can_be_taken_back_by_accepting(beside: Bench) -> None:
    beside.do(reject("a4"), accept("a4"))
    assert decisions(beside) == {"a4": ("accepted", "a1")}


def test_nothing_is_accepted_twice(beside: Bench) -> None:
    beside.do(accept("a4"))
    assert "was accepted as a1" in beside.refused(accept("a4"))
    assert "was accepted as a1" in beside.refused(reject("a4"))


def test_a_proposal_whose_result_is_removed_is_open_again(beside: Bench) -> None:
    beside.do(accept("a4"), accept("r1"))
    beside.do(op("remove_event", id="a1"), op("remove_relation", id="r1"))
    assert decisions(beside) == {}
    beside.do(accept("a4"))


def test_the_result_of_a_merge_stands_for_both(beside: Bench) -> None:
    beside.do(accept("a1"), accept("a4"), op("merge_events", ids=["a1", "a4"]))
    assert decisions(beside)["a4"] == ("accepted", "a1")


def test_what_was_not_proposed_is_an_error(beside: Bench) -> None:
    assert "has no event, relation or object a9" in beside.refused(accept("a9"))


# --- two people's views of an object, of which a third layer takes one


def cup(name: str, u: float, label: str) -> AnnotatedObject:
    keys = tuple(KeyFrame(frame=f, coordinates=(u, 0.0, 10.0, 10.0)) for f in (0, int(u)))
    return AnnotatedObject(id=name, name=label, kind="rectangle", key_frames=keys)


HOLDS = Role(name="Theme", target="o5")
BEN = Layer(name="ben", objects=(cup("o5", 7, "mug"),), events=(proposed("a1", 3, 9, roles=(HOLDS,)),))


@pytest.fixture
def gold() -> Bench:
    """An empty layer beside two in which one thing is ``ann/o1`` and ``ben/o5``."""
    return Bench(Layer(), layers={"ann": Layer(name="ann", objects=(cup("o1", 5, "cup"),)), "ben": BEN})


def take(proposal: str, **said: Any) -> dict[str, Any]:
    return op("accept_proposal", proposal=proposal, **said)


def whole(bench: Bench) -> dict[str, tuple[str, tuple[int, ...]]]:
    return {o.id: (o.name, tuple(key.frame for key in o.key_frames)) for o in bench.layer.objects}


def test_one_of_two_views_of_an_object_is_taken_and_the_other_is_known_to_be_the_same(gold: Bench) -> None:
    gold.do(take("ann/o1", same_as="ben/o5"))
    assert whole(gold) == {"o1": ("cup", (0, 5))}
    gold.do(take("ben/a1"))
    assert gold.event().roles == (Role(name="Theme", target="o1"),)


def test_a_view_that_is_preferred_later_takes_the_place_of_the_first(gold: Bench) -> None:
    gold.do(take("ann/o1", same_as="ben/o5"), take("ben/a1"))
    gold.do(take("ben/o5", same_as="ann/o1"))
    assert whole(gold) == {"o1": ("mug", (0, 7))}
    assert gold.event().roles == (Role(name="Theme", target="o1"),)
    assert [(d.proposal, d.verdict, d.result) for d in gold.layer.decisions if d.proposal != "ben/a1"] == [
        ("ben/o5", "accepted", "o1"),
        ("ann/o1", "rejected", "o1"),
    ]


def test_an_object_that_an_event_brought_along_is_the_one_decided_about(gold: Bench) -> None:
    gold.do(take("ben/a1"))
    assert whole(gold) == {"o5": ("mug", (0, 7))}
    gold.do(take("ann/o1", same_as="ben/o5"))
    assert whole(gold) == {"o5": ("cup", (0, 5))}


def test_both_views_are_two_objects(gold: Bench) -> None:
    gold.do(take("ann/o1"), take("ben/o5"))
    assert whole(gold) == {"o1": ("cup", (0, 5)), "o5": ("mug", (0, 7))}


def test_both_views_are_two_objects_also_after_one_was_taken_for_both(gold: Bench) -> None:
    gold.do(take("ann/o1", same_as="ben/o5"))
    gold.do(take("ben/o5"))
    assert whole(gold) == {"o1": ("cup", (0, 5)), "o5": ("mug", (0, 7))}


def test_both_views_are_two_objects_also_under_one_id_and_name() -> None:
    layers = {name: Layer(name=name, objects=(cup("o1", u, "cup"),)) for name, u in (("ann", 5), ("ben", 7))}
    bench = Bench(Layer(), layers=layers)
    bench.do(take("ann/o1"), take("ben/o1"))
    assert whole(bench) == {"o1": ("cup", (0, 5)), "o2": ("cup", (0, 7))}


def test_what_is_decided_about_an_object_goes_with_it(gold: Bench) -> None:
    gold.do(take("ann/o1", same_as="ben/o5"))
    gold.do(op("remove_object", id="o1"))
    assert gold.layer.decisions == ()
    gold.do(op("reject_proposal", proposal="ann/o1"))
    assert gold.layer.objects == ()


def test_an_object_has_no_frames_to_adjust_and_an_event_no_other_view(gold: Bench) -> None:
    assert "is an object" in gold.refused(take("ann/o1", end_frame=3))
    assert "is not an object" in gold.refused(take("ben/a1", same_as="ann/o1"))
