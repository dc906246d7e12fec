"""Relations and what contradicts them (ECAT 2018 file format §2.10)."""

from __future__ import annotations

import pytest

from ecat.model import AnnotatedObject, Layer
from ecat.model.scheme import ECAT_2018_SCHEME
from tests.annotate.bench import STEP_NS, Bench, op, relation, thing


@pytest.fixture
def people() -> Bench:
    """Three objects, under the rules of ECAT, and another session with one."""
    bench = Bench(Layer(), ECAT_2018_SCHEME, sessions={"before": Layer(objects=(AnnotatedObject(id="o7"),))})
    bench.do(thing("ann"), thing("bob"), thing("cup"))
    return bench


def facts(bench: Bench) -> list[tuple[str, tuple[str, ...], int, bool]]:
    return [(r.predicate, r.targets, r.start_frame, r.polarity) for r in bench.layer.relations]


def test_a_fact_has_an_id_an_author_and_times(people: Bench) -> None:
    people.do(relation("LOOK_AT", "o1", "o2", start=3, end_frame=9))
    (fact,) = people.layer.relations
    assert (fact.id, fact.author, fact.start_ns, fact.end_ns) == ("r1", "ann", 3 * STEP_NS, 9 * STEP_NS)


def test_of_facts_that_exclude_each_other_at_one_frame_the_new_one_counts(people: Bench) -> None:
    people.do(relation("STAND", "o1"), relation("STAND", "o2"), relation("SIT", "o1"))
    assert facts(people) == [("STAND", ("o2",), 0, True), ("SIT", ("o1",), 0, True)]
    people.do(relation("LOOK_AT", "o1", "o2"), relation("LOOK_AT", "o1", "o3"))
    assert facts(people)[-1] == ("LOOK_AT", ("o1", "o3"), 0, True)
    assert len(facts(people)) == 3


def test_at_another_frame_both_are_kept(people: Bench) -> None:
    people.do(relation("STAND", "o1"), relation("SIT", "o1", start=5))
    assert len(people.layer.relations) == 2


def test_a_denial_takes_the_place_of_what_it_denies(people: Bench) -> None:
    people.do(relation("STAND", "o1"), relation("STAND", "o1", polarity=False))
    assert facts(people) == [("STAND", ("o1",), 0, False)]


def test_the_same_is_not_said_twice(people: Bench) -> None:
    people.do(relation("STAND", "o1"))
    assert "r1 says so already" in people.refused(relation("STAND", "o1"))


def test_facts_can_be_edited_and_removed(people: Bench) -> None:
    people.do(relation("LOOK_AT", "o1", "o2", start=3, end_frame=9))
    people.do(op("edit_relation", id="r1", start_frame=5, arguments=["o1", "o3"], polarity=False))
    (fact,) = people.layer.relations
    assert (fact.start_frame, fact.end_frame, fact.start_ns, fact.targets) == (
        5,
        9,
        5 * STEP_NS,
        ("o1", "o3"),
    )
    people.do(op("edit_relation", id="r1", until_contradicted=True))
    assert (people.layer.relations[0].end_frame, people.layer.relations[0].end_ns) == (None, None)
    people.do(op("remove_relation", id="r1"))
    assert people.layer.relations == ()


def test_an_argument_may_be_an_object_of_another_session(people: Bench) -> None:
    people.do(relation("IDENTITY", "o1", "before/o7"))
    assert facts(people) == [("IDENTITY", ("o1", "before/o7"), 0, True)]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["o9"], "there is no object o9"),
        (["before/o9"], "there is no object before/o9"),
        (["never/o7"], "there is no object never/o7"),
        ([], "has 0 arguments"),
        (["o1"] * 17, "has 17 arguments"),
    ],
)
def test_arguments_are_there(people: Bench, arguments: list[str], problem: str) -> None:
    assert problem in people.refused(relation("NEW", *arguments))


def test_a_predicate_of_the_scheme_takes_its_arguments(people: Bench) -> None:
    assert "STAND takes 1 arguments, not 2" in people.refused(relation("STAND", "o1", "o2"))
    people.do(relation("GIVE", "o1", "o2", "o3"))


@pytest.mark.parametrize(("start", "end"), [(-1, None), (1000, None), (5, 5), (5, 3), (5, 1001)])
def test_a_fact_is_in_the_recording(people: Bench, start: int, end: int | None) -> None:
    people.refused(relation("STAND", "o1", start=start, end_frame=end))
