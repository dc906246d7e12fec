"""Events: adding, describing, removing, splitting, merging, and their place in the tree."""

from __future__ import annotations

import pytest

from ecat.annotate import Editor, EditRelation, MoveEdge
from ecat.errors import OperationError
from ecat.model import AnnotatedObject, Argument, Event, Layer, Relation, Role, Segment
from ecat.model.scheme import BLOCKS_SCHEME
from ecat.store import Session
from tests.annotate.bench import STEP_NS, Bench, event, op, thing


def test_an_event_has_the_times_of_its_frames(bench: Bench) -> None:
    bench.do(event(3, 9, type="slide", tier="event", text="go"))
    added = bench.event()
    assert added.segments == (Segment(start_frame=3, end_frame=9, start_ns=3 * STEP_NS, end_ns=9 * STEP_NS),)
    assert (added.type, added.tier, added.text, added.author, added.status) == (
        "slide",
        "event",
        "go",
        "ann",
        "confirmed",
    )


def test_an_event_may_have_several_segments(bench: Bench) -> None:
    bench.do(op("add_event", segments=[[20, 30], [3, 9], [9, 12]]))
    assert bench.spans() == [(3, 9), (9, 12), (20, 30)]


@pytest.mark.parametrize(
    ("segments", "problem"),
    [
        ([[9, 9]], "frames 9 to 9 are no stretch"),
        ([[9, 3]], "frames 9 to 3 are no stretch"),
        ([[-1, 3]], "frame -1 is not in the recording"),
        ([[3, 1001]], "frame 1001 is not in the recording"),
        ([[3, 9], [8, 12]], "frames 3 to 9 and 8 to 12 overlap"),
        ([], "an event without a stretch"),
    ],
)
def test_a_stretch_is_one_of_the_recording(bench: Bench, segments: list[list[int]], problem: str) -> None:
    assert problem in bench.refused(op("add_event", segments=segments))


def test_ids_of_removed_events_are_not_given_again(bench: Bench) -> None:
    bench.do(event(0, 1), event(1, 2))
    bench.do(op("remove_event", id="a2"))
    bench.do(event(2, 3))
    assert [e.id for e in bench.layer.events] == ["a1", "a3"]


def test_an_id_may_be_chosen(bench: Bench) -> None:
    bench.do(event(0, 1, id="a7"), event(1, 2, id="first.slide"), event(2, 3))
    assert [e.id for e in bench.layer.events] == ["a7", "first.slide", "a8"]
    assert "is taken" in bench.refused(event(0, 1, id="a7"))
    assert "is no id" in bench.refused(event(0, 1, id="a b"))


def test_roles_are_filled_by_objects_joints_and_events(bench: Bench) -> None:
    bench.do(thing("body", "rig"), thing("cup"), event(0, 5))
    bench.do(event(0, 9, roles={"Agent": "o1/HandRight", "Theme": "o2", "Cause": "a1"}))
    assert bench.event("a2").roles == (
        Role(name="Agent", target="o1/HandRight", kind="joint"),
        Role(name="Theme", target="o2"),
        Role(name="Cause", target="a1", kind="event"),
    )
    assert "there is no object or event o9" in bench.refused(event(0, 1, roles={"Theme": "o9"}))


class TestNesting:
    @pytest.fixture
    def tree(self, bench: Bench) -> Bench:
        bench.do(
            event(10, 50), event(10, 30, parent="a1"), event(12, 20, parent="a2"), event(30, 50, parent="a1")
        )
        return bench

    def test_a_sub_event_lies_within_its_parent(self, tree: Bench) -> None:
        problem = tree.refused(event(5, 20, parent="a1"))
        assert problem == "sub-event a5 (frames 5 to 20) would not lie within event a1 (frames 10 to 50)"

    def test_a_parent_is_not_cut_past_its_sub_events(self, tree: Bench) -> None:
        problem = tree.refused(op("move_edge", id="a1", edge="end", frame=40))
        assert problem == "sub-event a4 (frames 30 to 50) would not lie within event a1 (frames 10 to 40)"

    def test_or_they_are_cut_too(self, tree: Bench) -> None:
        tree.do(op("move_edge", id="a1", edge="end", frame=15, children="clip"))
        assert tree.spans("a2") == [(10, 15)]
        assert tree.spans("a3") == [(12, 15)]
        assert tree.document.event("a4") is None

    def test_both_can_be_moved_in_one_step(self, tree: Bench) -> None:
        tree.do(
            op("move_edge", id="a1", edge="end", frame=40), op("move_edge", id="a4", edge="end", frame=40)
        )
        assert tree.spans("a1") == [(10, 40)]

    def test_sub_events_move_along(self, tree: Bench) -> None:
        tree.do(op("move_event", id="a1", frames=-10))
        assert [tree.spans(name) for name in ("a1", "a2", "a3", "a4")] == [
            [(0, 40)], [(0, 20)], [(2, 10)], [(20, 40)],
        ]  # fmt: skip
        assert "frame -1" in tree.refused(op("move_event", id="a1", frames=-1))

    def test_no_event_is_a_part_of_itself(self, tree: Bench) -> None:
        assert "a part of itself" in tree.refused(op("set_parent", id="a1", parent="a1"))
        tree.do(
            op("set_segments", id="a2", segments=[[10, 50]]), op("set_segments", id="a3", segments=[[10, 50]])
        )
        assert "a part of itself" in tree.refused(op("set_parent", id="a1", parent="a3"))

    def test_the_tree_is_not_deeper_than_sixteen(self, bench: Bench) -> None:
        bench.do(event(0, 9))
        for n in range(1, 16):
            bench.do(event(0, 9, parent=f"a{n}"))
        assert "at most 16 deep" in bench.refused(event(0, 9, parent="a16"))
        bench.do(event(0, 9))
        assert "at most 16 deep" in bench.refused(op("set_parent", id="a1", parent="a17"))

    def test_removing_an_event_removes_its_sub_events(self, tree: Bench) -> None:
        tree.do(op("remove_event", id="a1"))
        assert tree.layer.events == ()

    def test_or_they_take_its_place(self, tree: Bench) -> None:
        tree.do(op("remove_event", id="a2", children="keep"))
        assert tree.event("a3").parent == "a1"
        tree.do(op("remove_event", id="a1", children="keep"))
        assert [(e.id, e.parent) for e in tree.layer.events] == [("a3", None), ("a4", None)]

    def test_what_was_imported_outside_of_its_parent_may_stay_so(self, tree: Bench) -> None:
        from dataclasses import replace

        outside = replace(tree.event("a4"), segments=(Segment(start_frame=900, end_frame=950),))
        imported = Bench(Layer(events=(*tree.layer.events[:3], outside)))
        imported.do(op("edit_event", id="a4", text="late"))
        imported.do(op("move_edge", id="a1", edge="end", frame=60))
        assert "would not lie within" in imported.refused(op("move_edge", id="a4", edge="end", frame=940))


class TestEdges:
    def test_an_edge_of_any_segment_moves(self, bench: Bench) -> None:
        bench.do(op("add_event", segments=[[3, 9], [20, 30]]))
        bench.do(op("move_edge", id="a1", edge="start", frame=15, segment=1))
        assert bench.spans() == [(3, 9), (15, 30)]
        assert "overlap" in bench.refused(op("move_edge", id="a1", edge="start", frame=8, segment=1))
        assert "none is number 2" in bench.refused(op("move_edge", id="a1", edge="start", frame=8, segment=2))

    def test_segments_come_and_go(self, bench: Bench) -> None:
        bench.do(event(10, 20))
        bench.do(op("add_segment", id="a1", start_frame=0, end_frame=5))
        assert bench.spans() == [(0, 5), (10, 20)]
        bench.do(op("remove_segment", id="a1", segment=1))
        assert bench.spans() == [(0, 5)]
        assert "no other segment" in bench.refused(op("remove_segment", id="a1", segment=0))


class TestSplitting:
    def test_both_halves_keep_what_is_said(self, bench: Bench) -> None:
        bench.do(thing("cup"), event(10, 50, type="slide", text="cup", roles={"Theme": "o1"}), event(60, 70))
        bench.do(op("split_event", id="a1", frame=30))
        first, second, _ = bench.layer.events
        assert (first.id, second.id) == ("a1", "a3")
        assert (bench.spans("a1"), bench.spans("a3")) == ([(10, 30)], [(30, 50)])
        assert (first.type, first.text, first.roles) == (second.type, second.text, second.roles)

    def test_sub_events_go_with_their_side(self, bench: Bench) -> None:
        bench.do(
            event(10, 50), event(10, 20, parent="a1"), event(20, 40, parent="a1"), event(40, 50, parent="a1")
        )
        bench.do(op("split_event", id="a1", frame=30))
        places = {e.id: (e.parent, bench.spans(e.id)) for e in bench.layer.events}
        assert places == {
            "a1": (None, [(10, 30)]),
            "a5": (None, [(30, 50)]),
            "a2": ("a1", [(10, 20)]),
            "a3": ("a1", [(20, 30)]),
            "a6": ("a5", [(30, 40)]),
            "a4": ("a5", [(40, 50)]),
        }

    def test_segments_go_with_their_side(self, bench: Bench) -> None:
        bench.do(op("add_event", segments=[[0, 10], [20, 30]]))
        bench.do(op("split_event", id="a1", frame=15))
        assert (bench.spans("a1"), bench.spans("a2")) == ([(0, 10)], [(20, 30)])

    @pytest.mark.parametrize("frame", [10, 50, 60])
    def test_only_inside(self, bench: Bench, frame: int) -> None:
        bench.do(event(10, 50))
        assert "is not inside of it" in bench.refused(op("split_event", id="a1", frame=frame))


class TestMerging:
    def test_the_first_gets_everything(self, bench: Bench) -> None:
        bench.do(
            thing("cup"),
            event(0, 10, type="slide"),
            event(10, 20, roles={"Theme": "o1"}),
            event(30, 40, unsure=True),
        )
        bench.do(event(32, 35, parent="a3"), op("link_events", id="a4", type="CAUSE", target="a2"))
        bench.do(op("merge_events", ids=["a1", "a2", "a3"]))
        merged = bench.event("a1")
        assert bench.spans("a1") == [(0, 20), (30, 40)]
        assert (merged.type, merged.unsure, [r.name for r in merged.roles]) == ("slide", True, ["Theme"])
        assert [e.id for e in bench.layer.events] == ["a1", "a4"]
        assert bench.event("a4").parent == "a1"
        assert bench.event("a4").links[0].target == "a1"

    def test_an_event_and_its_part_become_one(self, bench: Bench) -> None:
        bench.do(event(0, 10), event(2, 5, parent="a1"))
        bench.do(op("merge_events", ids=["a2", "a1"]))
        assert (bench.event("a2").parent, bench.spans("a2")) == (None, [(0, 10)])

    def test_one_is_not_several(self, bench: Bench) -> None:
        bench.do(event(0, 10))
        assert "two events or more" in bench.refused(op("merge_events", ids=["a1", "a1"]))


class TestPartsOfAnEvent:
    def test_links_come_and_go(self, bench: Bench) -> None:
        bench.do(event(0, 10), event(10, 20), op("link_events", id="a1", type="CAUSE", target="a2"))
        assert [(link.type, link.target) for link in bench.event().links] == [("CAUSE", "a2")]
        assert bench.do(op("link_events", id="a1", type="CAUSE", target="a2")) == ()
        bench.do(op("unlink_events", id="a1", type="CAUSE", target="a2"))
        assert bench.event().links == ()
        assert "itself" in bench.refused(op("link_events", id="a1", type="CAUSE", target="a1"))

    def test_a_removed_event_leaves_no_link_or_role(self, bench: Bench) -> None:
        bench.do(
            event(0, 10),
            event(10, 20, roles={"Cause": "a1"}),
            op("link_events", id="a2", type="CAUSE", target="a1"),
        )
        bench.do(op("remove_event", id="a1"))
        assert (bench.event("a2").links, bench.event("a2").roles) == ((), ())

    def test_a_role_is_filled_anew_in_its_place(self, bench: Bench) -> None:
        bench.do(thing("cup"), thing("box"), event(0, 10, roles={"Theme": "o1", "Landmark": "o2"}))
        bench.do(op("set_role", id="a1", role="Theme", target="o2"))
        assert [(r.name, r.target) for r in bench.event().roles] == [("Theme", "o2"), ("Landmark", "o2")]
        bench.do(op("set_role", id="a1", role="Theme"))
        assert [r.name for r in bench.event().roles] == ["Landmark"]
        assert "is no event, but object" in bench.refused(
            op("set_role", id="a1", role="T", target="o1", kind="event")
        )

    def test_slots_are_roles_a_type_and_an_adjunct(self, bench: Bench) -> None:
        bench.do(thing("ann", "rig"), thing("cup"), thing("box"), event(0, 10))
        bench.do(
            op("set_slots", id="a1", subject="o1", object="o2", locative="o3", verb="slide", adjunct="slowly")
        )
        slots = bench.event()
        assert {r.name: r.target for r in slots.roles} == {"Subject": "o1", "Object": "o2", "Locative": "o3"}
        assert (slots.type, [(p.name, p.value) for p in slots.properties]) == (
            "slide",
            [("adjunct", "slowly")],
        )
        bench.do(op("set_slots", id="a1", locative="", adjunct=""))
        assert [r.name for r in bench.event().roles] == ["Subject", "Object"]
        assert bench.event().properties == ()

    def test_properties_are_free(self, bench: Bench) -> None:
        bench.do(thing("cup"), event(0, 10), op("set_property", target="a1", name="my note", value="<&>"))
        bench.do(op("set_property", target="o1", name="size", value="big"))
        assert (bench.event().properties[0].value, bench.layer.objects[0].properties[0].name) == (
            "<&>",
            "size",
        )
        bench.do(op("set_property", target="a1", name="my note"))
        assert bench.event().properties == ()
        assert "without a name" in bench.refused(op("set_property", target="a1", name=" ", value="x"))


def test_the_type_says_the_tier_and_the_tier_finds_the_parent() -> None:
    bench = Bench(Layer(), BLOCKS_SCHEME)
    bench.do(event(0, 100, type="slide_next"), event(10, 50, type="slide_next"), event(20, 30, type="grasp"))
    assert (bench.event("a3").tier, bench.event("a3").parent) == ("sub-event", "a2")
    assert "none is around it" in bench.refused(event(200, 210, type="grasp"))


class TestEdgesOutsideOfTheRecording:
    """Imported events begin at frame -1, which shows the first image, or end behind the last one."""

    def test_the_other_edge_can_be_moved(self, session: Session) -> None:
        imported = Layer(
            objects=(AnnotatedObject(id="o1", kind="other"),),
            events=(Event(id="a1", segments=(Segment(start_frame=-1, end_frame=10_000),)),),
            relations=(
                Relation(id="r1", predicate="SIT", start_frame=-1, arguments=(Argument(target="o1"),)),
            ),
        )
        with session.write() as commit:
            commit.put_layer(imported)
        with Editor(session, author="ann") as editor:
            editor.apply(MoveEdge(id="a1", edge="end", frame=9))
            editor.apply(EditRelation(id="r1", end_frame=5))
            [segment] = editor.layer.events[0].segments
            assert (segment.start_frame, segment.end_frame) == (-1, 9)
            assert editor.layer.relations[0].end_frame == 5
            with pytest.raises(OperationError, match="move edge"):
                editor.apply(MoveEdge(id="a1", edge="start", frame=-2))
