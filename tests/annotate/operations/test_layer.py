"""Windows along a recording, and what a coding scheme allows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.model import CodingScheme, EventType, Layer, PredicateType, RoleType, Tier
from tests.annotate.bench import Bench, event, op, relation, thing


def windows(start: int, step: int, duration: int, **said: Any) -> dict[str, Any]:
    return op("add_windows", start=start, step=step, duration=duration, **said)


class TestWindows:
    @given(st.integers(0, 60), st.integers(1, 30), st.integers(1, 60), st.integers(1, 60))
    def test_there_are_as_many_as_fit(self, start: int, step: int, duration: int, n: int) -> None:
        bench = Bench(Layer(), n_frames=n)
        if start + duration > n:
            assert "no window" in bench.refused(windows(start, step, duration))
            return
        bench.do(windows(start, step, duration))
        spans = [(e.segments[0].start_frame, e.segments[0].end_frame) for e in bench.layer.events]
        # ECAT 2018 file format §2.13
        assert len(spans) == (n - start - duration) // step + 1
        assert spans == [(start + i * step, start + i * step + duration) for i in range(len(spans))]

    def test_the_windows_of_the_learning_data(self) -> None:
        bench = Bench(Layer(), n_frames=100)
        bench.do(windows(0, 5, 20, type="slide", text="cup"))
        assert len(bench.layer.events) == 17
        assert {(e.type, e.text) for e in bench.layer.events} == {("slide", "cup")}

    @pytest.mark.parametrize(("existing", "left"), [("add", 3), ("skip", 2), ("replace", 2), ("clear", 2)])
    def test_what_is_there_already(self, existing: str, left: int) -> None:
        bench = Bench(Layer(), n_frames=40)
        bench.do(event(0, 20, text="mine"))
        bench.do(windows(0, 20, 20, text="new", existing=existing))
        assert len(bench.layer.events) == left
        texts = [e.text for e in bench.layer.events]
        assert ("mine" in texts) == (existing in {"add", "skip"})
        assert texts.count("new") == (1 if existing == "skip" else 2)

    def test_only_the_very_same_span_is_the_same(self) -> None:
        bench = Bench(Layer(), n_frames=40)
        bench.do(event(0, 19), op("add_event", segments=[[0, 5], [10, 20]]))
        bench.do(windows(0, 20, 20, existing="skip"))
        assert len(bench.layer.events) == 4

    def test_other_tiers_are_left_alone(self) -> None:
        bench = Bench(Layer(), n_frames=40)
        bench.do(event(0, 20, tier="left hand"), windows(0, 20, 20, existing="clear", tier="right hand"))
        assert [e.tier for e in bench.layer.events] == ["left hand", "right hand", "right hand"]

    @pytest.mark.parametrize("wrong", [(0, 0, 5), (0, 5, 0), (-1, 5, 5)])
    def test_nonsense_is_refused(self, bench: Bench, wrong: tuple[int, int, int]) -> None:
        assert "windows from" in bench.refused(windows(*wrong))

    def test_of_a_recording_without_a_known_length_there_are_none(self) -> None:
        assert "how long" in Bench(Layer(), n_frames=0).refused(windows(0, 5, 20))


SCHEME = CodingScheme(
    name="hands",
    tiers=(
        Tier(name="act"),
        Tier(name="left", constraint="no_overlap"),
        Tier(name="part", parent="act", constraint="included_in"),
        Tier(name="phase", parent="act", constraint="subdivision"),
    ),
    event_types=(EventType(name="slide", tier="act", roles=(RoleType(name="Theme"),)),),
    predicates=(PredicateType(name="STAND", arity=1), PredicateType(name="CAUSE", target="event")),
)


class TestSchemes:
    @pytest.fixture
    def hands(self) -> Bench:
        bench = Bench(Layer(), SCHEME)
        bench.do(thing("cup"), event(0, 100, tier="act"))
        return bench

    def test_events_of_a_tier_may_not_overlap(self, hands: Bench) -> None:
        hands.do(event(10, 20, tier="left"), event(20, 30, tier="left"), event(15, 25))
        assert "would overlap a2" in hands.refused(event(5, 11, tier="left"))
        assert "would overlap a3" in hands.refused(op("move_edge", id="a2", edge="end", frame=21))
        assert "would overlap" in hands.refused(op("edit_event", id="a4", tier="left"))

    def test_several_segments_may_lie_between(self, hands: Bench) -> None:
        hands.do(op("add_event", segments=[[0, 10], [20, 30]], tier="left"), event(10, 20, tier="left"))

    def test_events_of_a_tier_may_have_to_be_parts(self, hands: Bench) -> None:
        hands.do(event(10, 20, tier="part"))
        assert hands.event("a2").parent == "a1"
        assert "part of one on tier act, but none is around it" in hands.refused(event(90, 110, tier="part"))
        hands.do(event(200, 300))
        assert "a3 is on tier (none)" in hands.refused(event(210, 220, tier="part", parent="a3"))
        assert "a part of one on tier act" in hands.refused(op("set_parent", id="a2"))

    def test_phases_lie_apart_in_their_act(self, hands: Bench) -> None:
        hands.do(event(0, 50, tier="phase"))
        assert "would overlap a2" in hands.refused(event(49, 60, tier="phase"))
        hands.do(event(50, 100, tier="phase"), op("split_event", id="a3", frame=80))
        assert [hands.spans(name) for name in ("a2", "a3", "a4")] == [[(0, 50)], [(50, 80)], [(80, 100)]]

    def test_and_leave_no_gap(self, hands: Bench) -> None:
        hands.do(event(0, 50, tier="phase"))
        assert "would leave a gap" in hands.refused(event(60, 100, tier="phase"))
        hands.do(event(50, 100, tier="phase"), op("move_edge", id="a2", edge="end", frame=40))
        assert [hands.spans(name) for name in ("a2", "a3")] == [[(0, 40)], [(40, 100)]]
        hands.do(op("move_edge", id="a3", edge="start", frame=60))
        assert [hands.spans(name) for name in ("a2", "a3")] == [[(0, 60)], [(60, 100)]]

    def test_an_open_scheme_lets_other_things_be_said(self, hands: Bench) -> None:
        hands.do(event(0, 9, type="pour", tier="else", roles={"Source": "o1"}), relation("ON", "o1", "o1"))

    @pytest.mark.parametrize(
        ("asked", "problem"),
        [
            (event(0, 9, tier="else"), "has no tier else"),
            (event(0, 9, type="pour"), "has no type pour"),
            (event(0, 9, type="slide", roles={"Source": "o1"}), "slide has no role Source"),
            (relation("ON", "o1"), "has no predicate ON"),
            (op("link_events", id="a1", type="BEFORE", target="a2"), "has no link BEFORE"),
        ],
    )
    def test_a_closed_one_does_not(self, asked: dict[str, Any], problem: str) -> None:
        bench = Bench(Layer(), replace(SCHEME, closed=True))
        bench.do(thing("cup"), event(0, 9, type="slide", roles={"Theme": "o1"}), event(20, 29, tier="act"))
        assert problem in bench.refused(asked)
        bench.do(op("link_events", id="a1", type="CAUSE", target="a2"), relation("STAND", "o1"))

    def test_what_was_said_under_no_scheme_may_stay(self) -> None:
        free = Bench(Layer())
        free.do(thing("cup"), event(0, 9, type="pour", tier="left"), event(5, 12, tier="left"))
        strict = Bench(free.layer, replace(SCHEME, closed=True))
        strict.do(op("edit_event", id="a1", text="said later"))
        assert "would overlap" in strict.refused(op("move_edge", id="a1", edge="end", frame=8))
