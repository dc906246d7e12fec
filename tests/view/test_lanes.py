"""Events, relations and the state of the boxes as lanes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import Chunk

from ecat.view.lanes import (
    assign_lanes,
    changes,
    event_label,
    event_log,
    events,
    nesting,
    relations,
    spans,
    supports,
)
from ecat.view.scene import PALETTE, pale, rgba
from tests.view.chunks import at, paths, scene, table

SPANS = st.lists(
    st.tuples(st.integers(0, 40), st.integers(1, 12), st.integers(0, 3)).map(
        lambda s: (s[0], s[0] + s[1], s[2])
    ),
    max_size=40,
)


@given(SPANS)
def test_no_two_events_of_a_lane_overlap_and_deeper_ones_lie_below(found: list[tuple[int, int, int]]) -> None:
    lanes = assign_lanes([(start, end) for start, end, _ in found], [depth for _, _, depth in found])
    for (a, lane_a), (b, lane_b) in combinations(zip(found, lanes, strict=True), 2):
        if lane_a == lane_b:
            assert a[1] <= b[0] or b[1] <= a[0]
            assert a[2] == b[2]
        if a[2] < b[2]:
            assert lane_a < lane_b


@given(SPANS)
def test_there_are_no_more_lanes_than_events_at_once(found: list[tuple[int, int, int]]) -> None:
    lanes = assign_lanes([(start, end) for start, end, _ in found], [0] * len(found))
    most = max((sum(start <= t < end for start, end, _ in found) for t in range(60)), default=0)
    assert len(set(lanes)) == most
    assert set(lanes) == set(range(most))


def test_depth_is_that_of_the_longest_way_down() -> None:
    assert nesting([("a", "b"), ("b", "c"), ("a", "c")]) == {"a": 0, "b": 1, "c": 2}


def test_a_circle_of_parts_is_flat() -> None:
    assert nesting([("a", "b"), ("b", "a")]) == {"a": 0, "b": 0}


def test_a_chain_of_ten_thousand_parts_is_no_deeper_than_it_is() -> None:
    assert nesting((f"{i}", f"{i + 1}") for i in range(10_000))["10000"] == 10_000


@pytest.mark.parametrize(
    ("marked", "changed"),
    [
        ([(2, 5, "a")], [(2, "a"), (5, "")]),
        ([(0, 2, "a"), (2, 4, "b")], [(0, "a"), (2, "b"), (4, "")]),
        ([(0, 2, "a"), (5, 6, "a")], [(0, "a"), (2, ""), (5, "a"), (6, "")]),
        ([(0, 9, "a"), (2, 4, "a"), (9, 10, "a")], [(0, "a"), (10, "")]),
        ([(0, 9, "a"), (4, 6, "b")], [(0, "a"), (4, "b"), (6, "")]),
        ([], []),
    ],
)
def test_a_lane_changes_where_something_starts_and_where_nothing_follows(
    marked: list[tuple[int, int, str]], changed: list[tuple[int, str]]
) -> None:
    assert changes(marked) == changed


def test_an_open_interval_lasts_to_the_end_and_every_interval_has_a_frame() -> None:
    assert spans(table("events", start_frame=[3, 4], end_frame=[None, 4]), 10) == [(3, 10), (4, 5)]


def test_an_event_is_called_by_its_text_its_type_or_its_id() -> None:
    event = {"text": "", "type": "", "event_id": "a1", "status": "confirmed", "unsure": False}
    assert event_label(event) == "a1"
    assert event_label(event | {"type": "slide"}) == "slide"
    assert event_label(event | {"text": " Slide it ", "type": "slide"}) == "Slide it"
    assert event_label(event | {"status": "proposed", "unsure": True}) == "proposed: a1 ?"


def annotated(layers: tuple[str, ...] = ("main",)) -> list[Chunk]:
    """In each layer: e1 with two stretches, its part e2, and e3 which overlaps e1."""
    rows = [(layer, *row) for layer in layers for row in (("e1", 0, 8), ("e2", 1, 3), ("e3", 6, 9))]
    tables = {
        "events": table(
            "events",
            layer=[row[0] for row in rows],
            event_id=[row[1] for row in rows],
            type=["slide"] * len(rows),
            text=[f"text of {row[1]}" for row in rows],
            tier=["action"] * len(rows),
            status=["confirmed"] * len(rows),
            unsure=[False] * len(rows),
            start_frame=[row[2] for row in rows],
            end_frame=[row[3] for row in rows],
        ),
        "event_segments": table(
            "event_segments",
            layer=[layer for layer in layers for _ in range(2)],
            event_id=["e1"] * 2 * len(layers),
            start_frame=[0, 5] * len(layers),
            end_frame=[2, 8] * len(layers),
        ),
        "event_links": table(
            "event_links",
            layer=list(layers),
            event_id=["e1"] * len(layers),
            type=["SUBEVENT"] * len(layers),
            target=["e2"] * len(layers),
        ),
    }
    return list(events(tables, scene()))


def test_overlapping_events_and_sub_events_lie_in_lanes_of_their_own() -> None:
    chunks = annotated()
    assert paths(chunks) == {f"/events/action/{lane}" for lane in range(3)}
    assert at(chunks, "/events/action/0", "state") == {0: ["e1"], 2: [""], 5: ["e1"], 8: [""]}
    assert at(chunks, "/events/action/1", "state") == {6: ["e3"], 9: [""]}
    assert at(chunks, "/events/action/2", "state") == {1: ["e2"], 3: [""]}


def test_lanes_show_what_happens_in_words() -> None:
    chunks = annotated()
    assert at(chunks, "/events/action/0", "values")[None] == ["e1"]
    assert at(chunks, "/events/action/0", "labels")[None] == ["text of e1"]


def test_every_annotator_has_lanes_of_their_own() -> None:
    assert {path.split("/")[2] for path in paths(annotated(("ann", "bob")))} == {"ann", "bob"}


def test_what_a_stage_proposes_lies_apart_and_is_paler() -> None:
    rows = table(
        "events",
        layer=["main", "machine"],
        event_id=["e1", "e1"],
        type=["grasp"] * 2,
        text=[""] * 2,
        tier=["action"] * 2,
        status=["confirmed", "proposed"],
        unsure=[False] * 2,
        start_frame=[1, 2],
        end_frame=[4, 5],
    )
    tables = {"events": rows, "event_segments": table("event_segments"), "event_links": table("event_links")}
    chunks = list(events(tables, scene()))
    assert paths(chunks) == {"/events/action/0", "/proposed/events/action/0"}
    said, proposed = "/events/action/0", "/proposed/events/action/0"
    assert at(chunks, proposed, "labels")[None] == at(chunks, said, "labels")[None] == ["grasp"]
    assert at(chunks, said, "colors")[None] == [rgba(PALETTE[0])]
    assert at(chunks, proposed, "colors")[None] == [rgba(pale(PALETTE[0]))]


@pytest.mark.parametrize("status", ["confirmed", "proposed"])
def test_as_many_types_as_there_are_of_movements_have_colours_of_their_own(status: str) -> None:
    n = 16
    rows = table(
        "events",
        layer=["main"] * n,
        event_id=[f"e{i}" for i in range(n)],
        type=[f"type {i}" for i in range(n)],
        text=[""] * n,
        tier=["action"] * n,
        status=[status] * n,
        unsure=[False] * n,
        start_frame=list(range(n)),
        end_frame=list(range(1, n + 1)),
    )
    tables = {"events": rows, "event_segments": table("event_segments"), "event_links": table("event_links")}
    top = "/proposed/events" if status == "proposed" else "/events"
    colors = at(list(events(tables, scene())), f"{top}/action/0", "colors")[None]
    assert len(set(colors)) == n


def recognised() -> dict[str, pa.Table]:
    """What two programs propose at once, in sentences that begin alike."""
    rows = table(
        "events",
        layer=["machine"] * 4,
        event_id=["e1", "e2", "e3", "e4"],
        type=["push", "push_to", "push", "slide_next"],
        text=["Ann pushes Shell", "Ann pushes Shell towards o2", "Ann pushes o2", "Slide Shell next to o2"],
        tier=["event"] * 4,
        status=["proposed"] * 4,
        unsure=[False] * 4,
        author=["ecat learn recognize"] * 3 + ["ecat propose 4"],
        start_frame=[0, 2, 5, 0],
        end_frame=[2, 4, 8, 4],
    )
    return {"events": rows, "event_segments": table("event_segments"), "event_links": table("event_links")}


def test_who_proposes_has_lanes_of_their_own() -> None:
    chunks = list(events(recognised(), scene()))
    by_model, by_rules = (
        f"/proposed/events/{author}/event/0" for author in ("ecat_learn_recognize", "ecat_propose_4")
    )
    assert paths(chunks) == {by_model, by_rules}
    assert at(chunks, by_rules, "state") == {0: ["e4"], 4: [""]}


def test_lanes_show_the_type_of_a_proposal_and_the_log_its_sentence() -> None:
    tables = recognised()
    lane = "/proposed/events/ecat_learn_recognize/event/0"
    assert at(list(events(tables, scene())), lane, "labels")[None] == ["push", "push_to", "push"]
    said = at(list(event_log(tables["events"], scene())), "/log/events", "text")
    assert said[5] == ["proposed: Ann pushes o2  [5, 8)  ecat learn recognize"]


def test_equal_types_have_equal_colours_whatever_the_sentence() -> None:
    colors = at(
        list(events(recognised(), scene())), "/proposed/events/ecat_learn_recognize/event/0", "colors"
    )
    push, push_to, again = colors[None]
    assert push == again != push_to


def test_the_log_has_a_line_for_each_event_at_its_start() -> None:
    rows = table(
        "events",
        event_id=["b", "a"],
        text=["", "x"],
        type=[""] * 2,
        status=["confirmed"] * 2,
        unsure=[False] * 2,
        start_frame=[4, 1],
        end_frame=[None, 2],
    )
    assert at(list(event_log(rows, scene())), "/log/events", "text") == {1: ["x  [1, 2)"], 4: ["b  [4, 10)"]}
    assert list(event_log(table("events"), scene())) == []


def facts(**columns: Sequence[object]) -> list[Chunk]:
    n = len(columns["start_frame"])
    usual = {
        "layer": ["main"] * n,
        "predicate": ["ON"] * n,
        "arguments": [["o1", "table 1"]] * n,
        "polarity": [True] * n,
        "status": ["confirmed"] * n,
    }
    return list(relations(table("relations", **usual | columns), scene()))


def test_a_fact_has_a_lane_that_tells_when_it_holds() -> None:
    shown = at(facts(start_frame=[1, 3], end_frame=[3, None]), "/relations/ON/Shell/table_1", "state")
    assert shown == {1: ["holds"], 10: [""]}


def test_a_denied_fact_is_not_one_that_holds() -> None:
    shown = at(
        facts(start_frame=[1, 3], end_frame=[3, 5], polarity=[True, False]),
        "/relations/ON/Shell/table_1",
        "state",
    )
    assert shown == {1: ["holds"], 3: ["denied"], 5: [""]}


def test_a_relation_without_arguments_keeps_its_predicate_as_path() -> None:
    assert paths(facts(start_frame=[0], end_frame=[1], arguments=[[]])) == {"/relations/ON"}


def test_proposed_facts_of_a_predicate_share_lanes_and_are_in_words() -> None:
    chunks = facts(
        start_frame=[0, 1, 5],
        end_frame=[3, 4, 8],
        arguments=[["o1", "o2"], ["o2", "o1"], ["o1", "o2"]],
        polarity=[True, False, True],
        status=["proposed"] * 3,
    )
    lanes = "/proposed/relations/ON"
    assert at(chunks, f"{lanes}/0", "state") == {0: ["Shell, o2"], 3: [""], 5: ["Shell, o2"], 8: [""]}
    assert at(chunks, f"{lanes}/1", "state") == {1: ["not: o2, Shell"], 4: [""]}


def test_however_many_proposals_hold_at_once_their_lanes_can_be_overlooked() -> None:
    n = 50
    many = facts(
        start_frame=[0] * n,
        end_frame=[9] * n,
        arguments=[[f"o{i}"] for i in range(n)],
        status=["proposed"] * n,
    )
    assert len(paths(many)) == 4


def test_the_support_of_a_box_is_nothing_where_there_is_no_pose() -> None:
    known = {name: [1.0, 1.0, None, 1.0, 1.0] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")}
    rows = table(
        "poses",
        frame=[0, 1, 2, 3, 7],
        object_id=["o1"] * 5,
        source=["observed", "observed", None, "interpolated", "observed"],
        support=["table", "free", None, "table", "table"],
        **known,
    )
    shown = at(list(supports(rows, scene())), "/support/Shell", "state")
    assert shown == {0: ["table"], 1: ["free"], 2: [""], 3: ["interpolated"], 4: [""], 7: ["table"], 8: [""]}


def test_lanes_follow_the_session_clock() -> None:
    clocked = list(
        relations(
            table(
                "relations",
                layer=["m"],
                predicate=["P"],
                arguments=[["o1"]],
                polarity=[True],
                status=["confirmed"],
                start_frame=[2],
                end_frame=[4],
            ),
            scene(step_ns=5),
        )
    )
    (batch,) = [chunk.to_record_batch() for chunk in clocked if not chunk.is_static]
    assert np.asarray(batch.column("session_time")).astype(np.int64).tolist() == [10, 20]
