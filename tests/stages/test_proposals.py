"""Relations and events from tables of poses and joints, on constructed sessions whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.transforms import Floats
from ecat.model.prototype import SHELL, STELLA_ARTOIS
from ecat.stages.propose import PROPOSE, ProposeParameters, propose_events
from ecat.stages.relations import RELATIONS, RelationParameters, propose_relations
from ecat.tables import EVENT_PROPOSALS, RELATION_PROPOSALS
from tests.stages.recorded import TABLE

N = 200
EDGE = SHELL.size_m[0]
BOXES = {"o2": SHELL, "o3": STELLA_ARTOIS}
CLOCK = pa.table(
    {
        "frame": pa.array(range(N), pa.int32()),
        "t_ns": pa.array([round(f * 1e9 / 30) for f in range(N)], pa.int64()),
    }
)
GRIP = np.array([0.0, 0.02, EDGE / 2 + 0.02])


def slide(start: tuple[float, float], end: tuple[float, float], first: int = 60, last: int = 100) -> Floats:
    """Places (N, 3) of a box that goes evenly from ``start`` to ``end`` in rows ``first`` to ``last``."""
    share = np.clip((np.arange(N) - first) / max(last - first, 1), 0, 1)[:, None]
    flat = np.array(start) + share * (np.array(end) - np.array(start))
    return np.column_stack([flat, np.full(N, EDGE / 2)])


def poses(places: dict[str, Floats], unseen: range = range(0)) -> pa.Table:
    rows: list[dict[str, Any]] = []
    for frame in range(N):
        for name, place in places.items():
            x, y, z = (float(v) for v in place[frame])
            seen = frame not in unseen
            rows.append(
                {
                    "t_ns": CLOCK["t_ns"][frame].as_py(),
                    "frame": frame,
                    "object_id": name,
                    "qw": 1.0 if seen else None,
                }
                | dict.fromkeys(("qx", "qy", "qz"), 0.0 if seen else None)
                | ({"x": x, "y": y, "z": z} if seen else {"x": None, "y": None, "z": None})
                | {"source": "observed" if seen else None, "sigma_m": 0.0005 if seen else None}
                | {"support": ("free" if z > EDGE / 2 + 0.005 else "table") if seen else None}
            )
    return pa.Table.from_pylist(rows)


def marks() -> pa.Table:
    """The codes by which the objects are known."""
    return pa.table({"object_id": list(BOXES), "code": [box.faces[0].code for box in BOXES.values()]})


def plane() -> pa.Table:
    turn, origin = TABLE.quaternion, TABLE.translation
    names = ("qx", "qy", "qz", "qw", "origin_x", "origin_y", "origin_z")
    fitted = {name: [float(v)] for name, v in zip(names, [*turn, *origin], strict=True)}
    return pa.table({"frame": [0], **fitted})


def joints(path: Floats, joint: str = "HandRight", rig: str | None = "o1") -> pa.Table:
    points = TABLE.apply(path)
    columns: dict[str, Any] = {"frame": pa.array(range(N), pa.int32())}
    columns |= {"object_id": pa.array([rig] * N, pa.string()), "body": pa.array([3] * N, pa.int8())}
    columns |= {"joint": [joint] * N, "state": ["tracked"] * N}
    columns |= {axis: points[:, k] for k, axis in enumerate("xyz")}
    return pa.table(columns)


def hand(box: Floats, first: int = 50, last: int = 110) -> Floats:
    """Fixed to a box in ``[first, last)``, elsewhere moving away from it by 1 cm a row."""
    rows = np.arange(N)
    away = 0.01 * (np.maximum(first - rows, 0) + np.maximum(rows - last + 1, 0))
    return box + GRIP + np.column_stack([np.zeros(N), np.zeros(N), away])


CAMERA = replace(KINECT_V2_COLOR, mirrored=False)


def relations(table: pa.Table, **tables: pa.Table) -> list[tuple[str, tuple[str, ...], int, int]]:
    parameters = RelationParameters(prototypes=tuple(BOXES.values()), surface="o5", camera=CAMERA)
    found = propose_relations(CLOCK, table, plane(), markers_2d=marks(), parameters=parameters, **tables)
    assert found.schema.equals(RELATION_PROPOSALS.arrow)
    return [
        (r["predicate"], tuple(r["arguments"]), r["start_frame"], r["end_frame"]) for r in found.to_pylist()
    ]


def events(table: pa.Table, **tables: pa.Table) -> list[dict[str, Any]]:
    parameters = ProposeParameters(prototypes=tuple(BOXES.values()), camera=CAMERA)
    found = propose_events(CLOCK, table, plane(), markers_2d=marks(), parameters=parameters, **tables)
    assert found.schema.equals(EVENT_PROPOSALS.arrow)
    return found.to_pylist()


APART = {"o2": slide((0.4, 0.0), (0.16, 0.0)), "o3": slide((0.0, 0.0), (0.0, 0.0))}
"""o2 is slid from the right of o3 until 8 mm are between them."""


def test_resting_boxes_are_on_the_table_all_the_time() -> None:
    found = relations(poses(APART))
    assert [r for r in found if r[0] == "ON"] == [("ON", ("o2", "o5"), 0, N), ("ON", ("o3", "o5"), 0, N)]


def test_a_box_that_is_slid_moves_from_the_first_frame_of_its_way_to_the_last() -> None:
    assert [r for r in relations(poses(APART)) if r[0] == "MOVING"] == [("MOVING", ("o2",), 61, 100)]


def test_near_begins_where_the_gap_falls_to_a_tenth_of_a_metre() -> None:
    (near,) = [r for r in relations(poses(APART)) if r[0] == "NEAR"]
    gap = APART["o2"][:, 0] - EDGE
    assert near == ("NEAR", ("o2", "o3"), int(np.flatnonzero(gap <= 0.1)[0]), N)


def test_boxes_touch_when_nothing_is_between_them() -> None:
    together = APART | {"o2": slide((0.4, 0.0), (EDGE + 0.002, 0.0))}
    assert [r[:2] for r in relations(poses(together)) if r[0] == "TOUCHING"] == [("TOUCHING", ("o2", "o3"))]
    assert [r for r in relations(poses(APART)) if r[0] == "TOUCHING"] == []


@pytest.mark.parametrize(
    ("place", "predicate"),
    [
        ((0.4, 0.0), "RIGHT_OF"),
        ((-0.4, 0.0), "LEFT_OF"),
        ((0.0, 0.4), "BEHIND"),
        ((0.0, -0.4), "IN_FRONT_OF"),
    ],
)
def test_directions_are_those_of_the_viewer(place: tuple[float, float], predicate: str) -> None:
    found = relations(poses({"o2": slide(place, place), "o3": APART["o3"]}))
    names = {"RIGHT_OF", "LEFT_OF", "BEHIND", "IN_FRONT_OF"}
    assert [r for r in found if r[0] in names] == [(predicate, ("o2", "o3"), 0, N)]


@given(st.floats(-180, 180))
def test_what_stands_still_is_in_just_one_direction_from_the_first_frame_on(degrees: float) -> None:
    assume(abs(degrees % 90 - 45) > 1e-6)
    place = 0.4 * np.cos(np.radians(degrees)), 0.4 * np.sin(np.radians(degrees))
    noise = np.random.default_rng(0).normal(0, 0.0002, (N, 2))
    still = slide(place, place)
    still[1:, :2] += noise[1:]
    found = relations(poses({"o2": still, "o3": APART["o3"]}))
    names = {"RIGHT_OF", "LEFT_OF", "BEHIND", "IN_FRONT_OF"}
    ((_, _, start, end),) = [r for r in found if r[0] in names and r[2] == 0]
    assert (start, end) == (0, N)


def test_a_box_put_on_another_is_on_it_and_above_it_and_in_no_direction() -> None:
    top = slide((0.0, 0.0), (0.0, 0.0))
    top[:, 2] += EDGE
    found = {r[:2] for r in relations(poses({"o2": top, "o3": APART["o3"]}))}
    assert found == {
        ("ON", ("o2", "o3")),
        ("ABOVE", ("o2", "o3")),
        ("ON", ("o3", "o5")),
        ("TOUCHING", ("o2", "o3")),
        ("NEAR", ("o2", "o3")),
    }


def test_boxes_pushed_as_one_move_together() -> None:
    pushed = {"o2": slide((0.2, 0.0), (0.4, 0.0)), "o3": slide((0.0, 0.0), (0.2, 0.0))}
    (found,) = [r for r in relations(poses(pushed)) if r[0] == "TOGETHER"]
    assert found[1] == ("o2", "o3")
    assert abs(found[2] - 61) <= 1
    assert abs(found[3] - 100) <= 1


def test_a_body_that_nobody_annotated_has_hands_too() -> None:
    found = relations(poses(APART), joints=joints(hand(APART["o2"]), rig=None))
    assert any(arguments == ("o2", "body_3") for _, arguments, *_ in found)


def test_a_box_is_in_the_hand_that_is_at_it() -> None:
    found = relations(poses(APART), joints=joints(hand(APART["o2"])))
    assert [r[:2] for r in found if "HAND" in r[0]] == [("IN_RIGHT_HAND", ("o2", "o1"))]


def test_intervals_of_one_fact_are_apart() -> None:
    found = relations(poses(APART, unseen=range(120, 170)))
    facts = {r[:2] for r in found}
    for fact in facts:
        mine = [r[2:] for r in found if r[:2] == fact]
        assert all(a[1] <= b[0] for a, b in pairwise(mine))
    assert [r[2:] for r in found if r[:2] == ("ON", ("o2", "o5"))] == [(0, 120), (170, N)]


def test_a_slide_without_hands_is_an_action_with_its_movement() -> None:
    action, part = events(poses(APART))
    assert (action["type"], action["text"]) == ("slide_next", "Slide Shell next to Stella Artois")
    assert (action["object_id"], action["landmark"], action["hand"]) == ("o2", "o3", None)
    assert (part["type"], part["parent"]) == ("move", action["event_id"])
    assert (
        (action["start_frame"], action["end_frame"]) == (part["start_frame"], part["end_frame"]) == (61, 100)
    )
    assert action["start_ns"] == round(61e9 / 30)


def test_with_hands_an_action_lasts_from_the_first_touch_to_the_last() -> None:
    action, *parts = events(poses(APART), joints=joints(hand(APART["o2"])))
    assert action["hand"] == "o1/HandRight"
    spans = {part["type"]: (part["start_frame"], part["end_frame"]) for part in parts}
    assert list(spans) == ["grasp", "hold", "move", "release"]
    assert spans["move"] == (61, 100)
    assert abs(spans["hold"][0] - 50) <= 2
    assert abs(spans["hold"][1] - 110) <= 2
    assert spans["grasp"][1] == spans["hold"][0]
    assert spans["hold"][1] == spans["release"][0]
    assert (action["start_frame"], action["end_frame"]) == (spans["grasp"][0], spans["release"][1])


def test_a_lifted_box_is_moved_rather_than_slid() -> None:
    high = APART["o2"].copy()
    high[62:99, 2] += 0.05
    assert events(poses(APART | {"o2": high}))[0]["type"] == "move_next"


def test_a_box_let_go_and_taken_again_on_its_way_is_one_action_with_two_movements() -> None:
    place = slide((0.6, 0.0), (0.4, 0.0), 30, 60)
    place[120:] = slide((0.4, 0.0), (0.2, 0.0), 120, 150)[120:]
    twice = np.where(np.arange(N)[:, None] < 90, hand(place, 25, 70), hand(place, 110, 160))
    action, *parts = events(poses(APART | {"o2": place}), joints=joints(twice))
    assert action["type"] == "slide_toward"
    assert [part["type"] for part in parts].count("move") == 2
    assert {part["parent"] for part in parts} == {action["event_id"]}


def test_without_knowing_the_hand_two_movements_are_two_actions() -> None:
    place = slide((0.6, 0.0), (0.4, 0.0), 30, 60)
    place[120:] = slide((0.4, 0.0), (0.2, 0.0), 120, 150)[120:]
    found = events(poses(APART | {"o2": place}))
    assert [event["type"] for event in found] == ["slide_toward", "move", "slide_toward", "move"]


def test_there_and_back_are_two_actions() -> None:
    place = slide((0.2, 0.0), (0.5, 0.0), 30, 60)
    place[120:] = slide((0.5, 0.0), (0.2, 0.0), 120, 150)[120:]
    found = events(poses(APART | {"o2": place}))
    assert [event["type"] for event in found] == ["slide_away", "move", "slide_toward", "move"]


def test_a_movement_in_the_dark_is_proposed_with_less_confidence() -> None:
    seen, dark = events(poses(APART))[0], events(poses(APART, unseen=range(55, 110)))[0]
    assert (dark["start_frame"], dark["end_frame"]) == (55, 110)
    assert dark["confidence"] == 0.5 < seen["confidence"]


def test_what_is_between_demonstrations_of_one_kind_is_set() -> None:
    rows = np.arange(N)
    share = np.abs(np.clip((rows % 24 - 6) / 6, 0, 1) - np.clip((rows % 24 - 18) / 6, 0, 1))
    place = slide((0.2, 0.0), (0.2, 0.0)) + 0.3 * share[:, None] * np.array([1.0, 0.0, 0.0])
    actions = [event for event in events(poses(APART | {"o2": place})) if event["parent"] is None]
    assert [event["type"] for event in actions] == ["slide_away", "set_toward"] * 8
    assert actions[1]["text"] == "Set Shell toward Stella Artois"


def test_a_landmark_need_only_stand_when_the_action_ends() -> None:
    nudged = slide((-0.05, 0.0), (0.0, 0.0), 55, 70)
    actions = [e for e in events(poses(APART | {"o3": nudged})) if e["parent"] is None]
    assert [(e["object_id"], e["landmark"]) for e in actions] == [("o3", None), ("o2", "o3")]


def test_boxes_that_stand_do_nothing() -> None:
    noise = np.random.default_rng(3).normal(0, 0.001, (N, 3))
    assert events(poses({"o3": APART["o3"] + noise})) == []


def test_proposals_do_not_depend_on_where_the_table_is() -> None:
    there = {name: place + np.array([0.7, -1.1, 0.0]) for name, place in APART.items()}
    assert events(poses(there)) == events(poses(APART))
    assert relations(poses(there)) == relations(poses(APART))


@pytest.mark.parametrize("stage", [RELATIONS, PROPOSE])
def test_stages_run_on_tables_without_rows_and_without_what_is_optional(stage: Any) -> None:
    tables = {"clock": CLOCK, "poses": poses(APART).slice(0, 0), "table_plane": plane()}
    ((name, made),) = stage.run(tables, {}, stage.parameters()).items()
    assert (name,) == stage.outputs
    assert made.num_rows == 0


def test_sessions_without_times_are_told_in_frames() -> None:
    clock = CLOCK.set_column(1, "t_ns", pa.nulls(N, pa.int64()))
    parameters = ProposeParameters(prototypes=tuple(BOXES.values()), camera=CAMERA)
    action = propose_events(
        clock, poses(APART), plane(), markers_2d=marks(), parameters=parameters
    ).to_pylist()[0]
    assert (action["start_frame"], action["start_ns"], action["end_ns"]) == (61, None, None)


def moved_camera(frame: int, tie: str | None) -> pa.Table:
    """The plane of a camera that was moved before a frame."""
    return pa.Table.from_pylist(
        [row | {"frame": f, "tie": tie} for f in (0, frame) for row in plane().to_pylist()]
    )


def test_nothing_goes_on_where_the_camera_was_moved_and_nothing_ties() -> None:
    """At frame 80 the box is on its way; from 150 on everything stands."""
    boxes = tuple(BOXES.values())
    for frame, tie, ends, slides in ((80, None, 80, 0), (80, "boxes", N, 1), (150, None, 150, 1)):
        moved = moved_camera(frame, tie)
        found = propose_relations(
            CLOCK,
            poses(APART),
            moved,
            markers_2d=marks(),
            parameters=RelationParameters(prototypes=boxes, surface="o5", camera=CAMERA),
        )
        first = [
            r["end_frame"] for r in found.to_pylist() if r["predicate"] == "ON" and r["start_frame"] == 0
        ]
        assert first == [ends, ends]
        acted = propose_events(
            CLOCK,
            poses(APART),
            moved,
            markers_2d=marks(),
            parameters=ProposeParameters(prototypes=boxes, camera=CAMERA),
        )
        assert sum(row["parent"] is None for row in acted.to_pylist()) == slides
