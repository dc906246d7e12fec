"""Which predicates hold at which frame (ECAT 2018 file format §2.10)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.model import AnnotatedObject, CodingScheme, Constraint, KeyFrame, Layer, Relation
from ecat.model.annotation import Argument
from ecat.model.holding import ALWAYS, Stretches, conflicts, intervals, presence
from ecat.model.scheme import ECAT_2018_SCHEME

END = 40
POSTURES = ECAT_2018_SCHEME.constraints[2].names


def fact(text: str, *, polarity: bool = True, end: int | None = None) -> Relation:
    """``"10 LOOK_AT a b"``: from frame 10 on, a looks at b."""
    frame, predicate, *targets = text.split()
    arguments = tuple(Argument(target=target) for target in targets)
    return Relation(
        predicate=predicate, start_frame=int(frame), end_frame=end, polarity=polarity, arguments=arguments
    )


def denial(text: str) -> Relation:
    return fact(text, polarity=False)


def thing(*frames: int) -> AnnotatedObject:
    """An object that is there from the first frame on, absent from the second on, there from the third on ..."""
    keys = tuple(KeyFrame(frame=frame, present=i % 2 == 0) for i, frame in enumerate(frames))
    return AnnotatedObject(id="o", key_frames=keys)


def held(*relations: Relation, **things: AnnotatedObject) -> list[Stretches]:
    """When each of ``relations`` holds; objects that are not given are always there."""
    found = intervals(relations, ECAT_2018_SCHEME, lambda t: presence(things[t]) if t in things else ALWAYS)
    return [found[i] for i in sorted(found)]


# --- presence


def test_an_object_is_there_from_its_first_key_frame_until_an_absence() -> None:
    assert presence(thing(5, 10, 20)) == ((5, 10), (20, None))
    assert presence(thing(-1)) == ((-1, None),)
    assert presence(thing(-1, 10)) == ((-1, 10),)


def test_an_object_without_key_frames_is_always_there() -> None:
    assert presence(AnnotatedObject(id="o")) == ALWAYS


def test_an_absence_at_the_first_frame_counts() -> None:
    assert presence(AnnotatedObject(id="o", key_frames=(KeyFrame(frame=0, present=False),))) == ()


# --- contradiction


def test_a_fact_holds_until_the_end_if_nothing_contradicts_it() -> None:
    assert held(fact("3 SUPPORT a b")) == [((3, None),)]


def test_a_negative_fact_ends_its_exact_counterpart_and_nothing_else() -> None:
    facts = fact("0 LOOK_AT a b"), fact("0 LOOK_AT b a"), fact("0 SUPPORT a b"), denial("9 LOOK_AT a b")
    assert held(*facts) == [((0, 9),), ((0, None),), ((0, None),)]


def test_a_negative_fact_before_the_positive_one_ends_nothing() -> None:
    assert held(denial("0 SIT a"), fact("5 SIT a")) == [((5, None),)]


def test_unique_one_looks_at_one_thing_at_a_time() -> None:
    facts = fact("0 LOOK_AT a b"), fact("5 LOOK_AT a c"), fact("7 LOOK_AT b c"), fact("8 POINT_AT a b")
    assert held(*facts) == [((0, 5),), ((5, None),), ((7, None),), ((8, None),)]


def test_unique_counts_only_the_marked_argument() -> None:
    scheme = CodingScheme(
        name="s", constraints=(Constraint(kind="UNIQUE", predicates="HOLD", unique_argument=1),)
    )
    assert conflicts(scheme, fact("0 HOLD a c"), fact("1 HOLD b c"))
    assert not conflicts(scheme, fact("0 HOLD a c"), fact("1 HOLD a d"))
    assert not conflicts(scheme, fact("0 HOLD a c"), fact("1 HOLD a c"))
    assert not conflicts(scheme, fact("0 HOLD a c"), fact("1 HOLD b"))


def test_exclusive_a_posture_ends_any_other_of_the_same_object() -> None:
    assert held(fact("0 SIT a"), fact("0 SIT b"), fact("5 STAND a")) == [
        ((0, 5),),
        ((0, None),),
        ((5, None),),
    ]


def test_exclusive_is_about_unary_facts() -> None:
    assert not conflicts(ECAT_2018_SCHEME, fact("0 SIT a b"), fact("1 STAND a b"))


def test_predicates_without_a_constraint_hold_side_by_side() -> None:
    assert held(fact("0 SUPPORT a b"), fact("5 SUPPORT a c")) == [((0, None),), ((5, None),)]


def test_saying_a_fact_again_starts_it_anew() -> None:
    assert held(fact("0 SIT a"), fact("5 SIT a")) == [((0, 5),), ((5, None),)]


def test_frames_decide_the_order_then_the_place_in_the_layer() -> None:
    assert held(fact("5 STAND a"), fact("0 SIT a")) == [((5, None),), ((0, 5),)]
    assert held(fact("5 STAND a"), fact("5 SIT a")) == [(), ((5, None),)]


def test_a_fact_with_an_end_holds_as_it_says() -> None:
    facts = fact("0 SIT a", end=30), fact("5 STAND a"), denial("7 SIT a")
    assert held(*facts, a=thing(10)) == [((0, 30),), ((10, None),)]


# --- absence


def test_a_fact_holds_while_all_its_objects_are_there() -> None:
    assert held(fact("0 SUPPORT a b"), a=thing(2, 10, 20), b=thing(0, 25)) == [((2, 10), (20, 25))]


def test_a_fact_about_something_that_never_comes_never_holds() -> None:
    assert held(fact("5 SIT a"), a=thing(0, 5)) == [()]


def test_an_absent_object_is_still_who_it_is() -> None:
    assert held(fact("5 IDENTITY a other/o1"), a=thing(0, 5)) == [((5, None),)]


def test_a_fact_is_contradicted_in_absence_too() -> None:
    assert held(fact("0 SIT a"), denial("12 SIT a"), a=thing(0, 10, 20)) == [((0, 10),)]


# --- properties

OBJECTS = ("a", "b", "c")
UNARY = st.builds(lambda p, t: (p, (t,)), st.sampled_from(("SIT", "STAND", "LIE")), st.sampled_from(OBJECTS))
BINARY = st.builds(
    lambda p, pair: (p, tuple(pair)),
    st.sampled_from(("LOOK_AT", "POINT_AT", "SUPPORT", "IDENTITY")),
    st.permutations(OBJECTS).map(lambda order: order[:2]),
)
FACTS = st.builds(
    lambda said, frame, polarity: fact(f"{frame} {said[0]} {' '.join(said[1])}", polarity=polarity),
    UNARY | BINARY,
    st.integers(-1, END),
    st.sampled_from((True, True, True, False)),
)
THINGS = st.fixed_dictionaries(
    {name: st.lists(st.integers(-1, END), unique=True, max_size=4).map(sorted) for name in OBJECTS}
).map(lambda frames: {name: thing(*found) for name, found in frames.items()})


def is_there(thing: AnnotatedObject, frame: int) -> bool:
    """The last key frame up to now is no absence."""
    keys = [key for key in thing.key_frames if key.frame <= frame]
    return keys[-1].present if keys else not thing.key_frames


def holding_at(relations: Sequence[Relation], things: Mapping[str, AnnotatedObject], frame: int) -> set[int]:
    """§2.10 word for word: the facts up to ``frame``, one after the other."""
    now: list[int] = []
    for i in sorted(range(len(relations)), key=lambda i: relations[i].start_frame):
        new = relations[i]
        if new.start_frame > frame:
            continue
        if new.polarity:
            now = [j for j in now if not conflicts(ECAT_2018_SCHEME, relations[j], new)]
        now = [
            j for j in now if (relations[j].predicate, relations[j].targets) != (new.predicate, new.targets)
        ]
        now += [i] if new.polarity else []
    return {
        i
        for i in now
        if relations[i].predicate == "IDENTITY"
        or all(is_there(things[t], frame) for t in relations[i].targets)
    }


def covers(stretches: Stretches, frame: int) -> bool:
    return any(start <= frame and (end is None or frame < end) for start, end in stretches)


def of(things: Mapping[str, AnnotatedObject]) -> Callable[[str], Stretches]:
    return lambda target: presence(things[target])


@given(st.lists(FACTS, max_size=12), THINGS)
def test_at_every_frame_the_intervals_say_what_the_rules_say(
    relations: list[Relation], things: dict[str, AnnotatedObject]
) -> None:
    found = intervals(relations, ECAT_2018_SCHEME, of(things))
    for frame in range(-1, END + 2):
        now = {i for i, stretches in found.items() if covers(stretches, frame)}
        assert now == holding_at(relations, things, frame), frame


@given(st.lists(FACTS, max_size=12), THINGS)
def test_intervals_of_conflicting_facts_never_overlap(
    relations: list[Relation], things: dict[str, AnnotatedObject]
) -> None:
    found = intervals(relations, ECAT_2018_SCHEME, of(things))
    assert set(found) == {i for i, relation in enumerate(relations) if relation.polarity}
    for i, j in combinations(found, 2):
        if conflicts(ECAT_2018_SCHEME, relations[i], relations[j]):
            frames = range(-1, END + 2)
            assert not any(covers(found[i], frame) and covers(found[j], frame) for frame in frames)


@given(THINGS)
def test_stretches_are_apart_from_each_other_and_not_empty(things: dict[str, AnnotatedObject]) -> None:
    for thing in things.values():
        ends = [frame for stretch in presence(thing) for frame in stretch if frame is not None]
        assert ends == sorted(set(ends))


# --- real data


@pytest.fixture(scope="module")
def movies(shared: Path) -> list[Layer]:
    """Every fourth of some two thousand annotated film clips."""
    from ecat.formats import ImportOptions
    from ecat.formats.ecat2018.session_folder import draft_of

    files = sorted((shared / "ecat_movies").rglob("files.param"))[::4]
    assert files
    return [draft_of(path.parent, ImportOptions(), []).layers[0] for path in files]


def test_nobody_in_the_films_has_two_postures_at_once(movies: list[Layer]) -> None:
    some = 0
    for layer in movies:
        things = {thing.id: thing for thing in layer.objects}
        found = intervals(
            layer.relations, ECAT_2018_SCHEME, lambda t, of=things: presence(of[t]) if t in of else ALWAYS
        )
        last = max((r.start_frame for r in layer.relations), default=0)
        for frame in {last, *(r.start_frame for r in layer.relations)}:
            now = [i for i, stretches in found.items() if covers(stretches, frame)]
            sitting = [layer.relations[i].targets for i in now if layer.relations[i].predicate in POSTURES]
            assert len(set(sitting)) == len(sitting), (layer.name, frame)
            some += len(sitting)
    assert some > 1000
