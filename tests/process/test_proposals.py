"""Proposals become a layer that a session keeps, beside what people said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa

from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Link, Relation, Role, Segment
from ecat.model.annotation import Argument, with_relation_ids
from ecat.process.proposals import machine_layer, with_others
from ecat.sample import sample_session
from ecat.stages.propose import PROPOSE
from ecat.stages.relations import RELATIONS
from ecat.store import create_session, open_session
from ecat.tables import EVENT_PROPOSALS, RELATION_PROPOSALS

OBJECTS = (
    AnnotatedObject(id="o1", name="Performer 1", kind="rig"),
    AnnotatedObject(id="o2", name="Shell", kind="marker_box", key_frames=(KeyFrame(frame=0),)),
    AnnotatedObject(id="o3", name="Stella Artois", kind="marker_box"),
    AnnotatedObject(id="o4", name="table", kind="polygon", semantic_type="table"),
    AnnotatedObject(id="o9", name="lamp"),
)


def event(
    event_id: str, kind: str, start: int, end: int, parent: str | None = None, **more: Any
) -> dict[str, Any]:
    times = {"start_frame": start, "end_frame": end, "start_ns": start * 1000, "end_ns": end * 1000}
    who = {"object_id": "o2", "hand": "o1/HandRight", "landmark": "o3", "confidence": 0.875}
    return times | who | {"event_id": event_id, "type": kind, "text": "", "parent": parent} | more


def events(*rows: dict[str, Any]) -> pa.Table:
    return pa.Table.from_pylist(list(rows), schema=EVENT_PROPOSALS.arrow)


RELATION = pa.Table.from_pylist(
    [
        {
            "predicate": "ON",
            "arguments": ["o2", "o4"],
            "polarity": True,
            "start_frame": 3,
            "end_frame": 40,
            "start_ns": 3000,
            "end_ns": 40000,
            "confidence": 0.9,
        }
    ],
    schema=RELATION_PROPOSALS.arrow,
)
TEXT = "Slide Shell past Stella Artois"
PROPOSED = events(
    event("a1", "slide_past", 10, 90, text=TEXT),
    event("a2", "grasp", 10, 15, "a1"),
    event("a3", "hold", 15, 38, "a1"),
    event("a4", "release", 38, 40, "a1"),
    event("a5", "hold", 60, 90, "a1"),
)


def layer() -> Layer:
    return machine_layer(RELATION, PROPOSED, OBJECTS)


def test_everything_is_a_proposal_of_a_stage() -> None:
    made = layer()
    assert made.name == "machine"
    assert {e.status for e in made.events} == {r.status for r in made.relations} == {"proposed"}
    assert {e.author for e in made.events} == {f"ecat propose {PROPOSE.version}"}
    assert {(r.author, r.source) for r in made.relations} == {
        (f"ecat relations {RELATIONS.version}", "computed")
    }


def test_only_what_takes_part_is_repeated_without_what_a_person_drew() -> None:
    things = {thing.id: thing for thing in layer().objects}
    assert sorted(things) == ["o1", "o2", "o3", "o4"]
    assert things["o2"].name == "Shell"
    assert things["o2"].key_frames == ()


def test_an_action_binds_roles_and_the_words_that_name_them() -> None:
    action = layer().events[0]
    assert [(role.name, role.target) for role in action.roles] == [
        ("Agent", "o1"),
        ("Theme", "o2"),
        ("Landmark", "o3"),
    ]
    assert [TEXT[r.start : r.end] for r in action.references] == ["Shell", "Stella Artois"]
    assert [TEXT[p.start : p.end] for p in action.predicates] == ["Slide"]
    assert action.properties[0].value == "0.88"


def test_parts_hang_below_their_action_and_name_the_hand() -> None:
    made = layer()
    assert [(e.type, e.parent, e.tier) for e in made.events[1:3]] == [
        ("grasp", "a1", "sub-event"),
        ("hold", "a1", "sub-event"),
    ]
    assert (made.events[1].roles[0].target, made.events[1].roles[0].kind) == ("o1/HandRight", "joint")


def test_an_interrupted_action_has_a_segment_for_each_stretch() -> None:
    assert [(s.start_frame, s.end_frame) for s in layer().events[0].segments] == [(10, 40), (60, 90)]


def test_the_verb_of_what_only_sets_up_the_next_action_is_bound_too() -> None:
    text = "Set Shell toward Stella Artois"
    (action,) = machine_layer(None, events(event("a1", "set_toward", 0, 9, text=text)), OBJECTS).events
    assert [(text[p.start : p.end], p.type) for p in action.predicates] == [("Set", "set")]


def test_without_a_hand_there_is_no_agent() -> None:
    made = machine_layer(None, events(event("a1", "slide", 0, 9, hand=None, landmark=None)), OBJECTS)
    assert [role.name for role in made.events[0].roles] == ["Theme"]


def test_nothing_proposed_is_an_empty_layer() -> None:
    assert machine_layer(None, None, OBJECTS) == Layer(name="machine")


def test_what_others_proposed_stays_behind_what_is_proposed_anew() -> None:
    span, shell = Segment(start_frame=0, end_frame=9), Argument(target="o2")
    theirs = Layer(
        name="machine",
        event_counter=2,
        objects=(OBJECTS[1], OBJECTS[4]),
        events=(
            Event(id="a1", type="pull", status="proposed", author="a model", segments=(span,)),
            Event(
                id="a2",
                type="hold",
                parent="a1",
                status="proposed",
                author="a model",
                roles=(Role(name="Cause", target="a1", kind="event"), Role(name="Theme", target="o9")),
            ),
        ),
        relations=(Relation(predicate="n", start_frame=1, author="a model", arguments=(shell,)),),
    )
    old = with_others(layer(), with_relation_ids(theirs))
    made = with_others(layer(), old)
    assert made == old
    assert made.events[: layer().event_counter] == layer().events
    pulled, held = made.events[layer().event_counter :]
    assert (pulled.id, pulled.type, pulled.author) == ("a6", "pull", "a model")
    assert (held.id, held.parent, held.roles[0].target, made.event_counter) == ("a7", "a6", "a6", 7)
    assert [relation.predicate for relation in made.relations] == ["ON", "n"]
    assert len({relation.id for relation in made.relations}) == 2
    assert [thing.id for thing in made.objects] == ["o1", "o2", "o3", "o4", "o9"]


def test_others_go_on_to_mean_an_event_of_a_stage_only_if_it_is_proposed_again() -> None:
    def staged(event_id: str, kind: str) -> Event:
        segment = Segment(start_frame=0, end_frame=9)
        author = f"ecat {PROPOSE.name} 1"
        return Event(id=event_id, type=kind, status="proposed", author=author, segments=(segment,))

    def of_another(event_id: str, meant: str) -> Event:
        return Event(
            id=event_id,
            type="part",
            parent=meant,
            author="a model",
            roles=(Role(name="Cause", target=meant, kind="event"),),
            links=(Link(type="before", target=meant),),
        )

    old = Layer(
        name="machine",
        events=(staged("a1", "slide"), staged("a2", "push"), of_another("a3", "a1"), of_another("a4", "a2")),
    )
    made = with_others(
        Layer(name="machine", event_counter=2, events=(staged("a1", "push"), staged("a2", "roll"))), old
    )
    gone, again = made.events[2:]
    assert (gone.parent, gone.roles, gone.links) == (None, (), ())
    assert (again.parent, again.roles[0].target, again.links[0].target) == ("a1", "a1", "a1")


def test_what_nobody_signed_is_not_taken_for_a_stages() -> None:
    theirs = Event(id="a1", type="hold", status="proposed")
    made = with_others(layer(), Layer(name="machine", events=(theirs,)))
    assert made.events[-1].type == "hold"


def test_what_the_stages_proposed_before_does_not_stay() -> None:
    assert with_others(Layer(name="machine"), layer()) == Layer(name="machine")


def test_the_layer_survives_the_session_and_its_tables(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("past",))
    create_session(tmp_path / "s", draft)
    with open_session(tmp_path / "s").write() as commit:
        commit.put_layer(layer())
    session = open_session(tmp_path / "s")
    assert session.layer("machine") == layer()
    rows = [row for row in session.events.to_arrow().to_pylist() if row["layer"] == "machine"]
    assert next((row["event_id"], row["status"]) for row in rows) == ("a1", "proposed")
    assert session.layer("main") == draft.layers[0]
