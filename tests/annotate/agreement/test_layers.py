"""Two annotators of one session: what they agree on, what they do not, and where."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.annotate.agreement import Agreement, disagreements, figures, text_of
from ecat.annotate.agreement.compare import frame_patterns
from ecat.annotate.agreement.facts import depths
from ecat.annotate.agreement.objects import match_objects, mean_iou
from ecat.annotate.agreement.spans import Span
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Relation, Role, Segment
from ecat.model.annotation import Argument


def event(name: str, start: int, end: int, kind: str = "slide", **rest: object) -> Event:
    segments = (Segment(start_frame=start, end_frame=end),)
    return Event(id=name, type=kind, tier="event", segments=segments, **rest)  # type: ignore[arg-type]


def box(name: str, u: float, label: str = "", frame: int = 0) -> AnnotatedObject:
    keys = (KeyFrame(frame=frame, coordinates=(u, 0.0, 100.0, 100.0)),)
    return AnnotatedObject(id=name, name=label or name, kind="rectangle", key_frames=keys)


def relation(start: int, end: int, *targets: str, predicate: str = "ON") -> Relation:
    arguments = tuple(Argument(target=target) for target in targets)
    return Relation(predicate=predicate, start_frame=start, end_frame=end, arguments=arguments)


ANN = Layer(
    name="ann",
    objects=(box("o1", 0.0, "mug"), box("o2", 300.0, "plate")),
    events=(
        event("e1", 10, 60, roles=(Role(name="Theme", target="o1"),)),
        event("e2", 10, 30, "grasp", parent="e1"),
        event("e3", 70, 90, "push"),
    ),
    relations=(relation(0, 50, "o1", "o2"),),
)
BEN = Layer(
    name="ben",
    objects=(box("o7", 310.0, "dish"), box("o9", 5.0, "mug")),
    events=(
        event("e5", 14, 60, roles=(Role(name="Theme", target="o9"),)),
        event("e6", 14, 32, "grasp", parent="e5"),
        event("e7", 70, 90, "pull"),
    ),
    relations=(relation(0, 48, "o9", "o7"),),
)


def compared(first: Layer = ANN, second: Layer = BEN, n_frames: int = 100) -> dict[str, object]:
    found = Agreement((first.name, second.name))
    found.add((first, second), n_frames)
    return figures(found)


def test_objects_are_the_same_where_they_lie_whatever_they_are_called() -> None:
    paired = match_objects(ANN.objects, BEN.objects)
    assert {a: b for a, (b, _) in paired.items()} == {"o1": "o9", "o2": "o7"}


def test_marked_boxes_are_the_same_by_id_then_by_name() -> None:
    first = [AnnotatedObject(id="o1", name="Shell", kind="marker_box")]
    second = [
        AnnotatedObject(id="o4", name="shell", kind="marker_box"),
        AnnotatedObject(id="o1", name="Stella", kind="marker_box"),
    ]
    assert match_objects(first, second)["o1"][0] == "o1"
    assert match_objects(first, second[:1])["o1"][0] == "o4"


def test_a_frame_where_only_one_sees_the_object_counts_against_it() -> None:
    gone = replace(box("o1", 0.0), key_frames=(*box("o1", 0.0).key_frames, KeyFrame(frame=50, present=False)))
    assert mean_iou(box("o1", 0.0), gone) == pytest.approx(0.5)


def test_events_agree_by_type_and_overlap() -> None:
    rows = {(row["of"], row["name"], row["least_iou"]): row for row in compared()["events"]}  # type: ignore[attr-defined]
    assert rows["all", "all", 0.5]["matched"] == 2
    assert rows["type", "slide", 0.75]["f1"] == 1.0
    assert rows["type", "push", 0.5]["f1"] == 0.0
    assert rows["depth", "1", 0.5] == {
        "of": "depth", "name": "1", "least_iou": 0.5, "matched": 1, "first": 1, "second": 1, "f1": 1.0,
    }  # fmt: skip


def test_edges_roles_parents_and_relations_follow_the_paired() -> None:
    found = compared()
    assert found["edges"]["event"]["median_frames"] == 3.0  # type: ignore[index]
    assert found["edges"]["event"]["start_bias_frames"] == 4.0  # type: ignore[index]
    assert found["roles"]["Theme"]["f1"] == 1.0  # type: ignore[index]
    assert found["parents"]["f1"] == 1.0  # type: ignore[index]
    assert found["relations"]["ON"]["f1"] == 1.0  # type: ignore[index]
    assert found["objects"]["same_name"] == 0.5  # type: ignore[index]


def test_labels_by_frame_are_sets_of_what_goes_on() -> None:
    first = [Span("a", "hold", ((0, 10),)), Span("b", "move", ((5, 8),))]
    second = [Span("c", "hold", ((0, 10),))]
    patterns = frame_patterns((first, second), 20, lambda labels: "+".join(sorted(labels)))
    assert patterns == {("hold", "hold"): 7, ("hold+move", "hold"): 3, ("", ""): 10}


def test_an_event_without_a_type_is_not_silence() -> None:
    silent = replace(ANN, events=())
    untyped = replace(ANN, events=(event("e1", 0, 50, ""),))
    assert compared(untyped, silent)["tiers"]["event"]["observed"] == 0.5  # type: ignore[index]


def test_every_disagreement_is_named_with_its_place() -> None:
    found = disagreements(ANN, BEN, 100)
    seen = {(d.kind, d.first, d.second, d.differs) for d in found}
    assert ("event", "e1", "e5", ("start",)) in seen
    assert ("event", "e3", "e7", ("type",)) in seen
    assert ("object", "o2", "o7", ("name", "shape")) in seen
    assert not any(d.kind == "relation" for d in found), (
        "two frames of difference at a relation's end are no difference"
    )


def test_shapes_that_nearly_cover_each_other_are_no_disagreement() -> None:
    ann = Layer(name="ann", objects=(box("o1", 0.0, "mug"),))
    assert disagreements(ann, Layer(name="ben", objects=(box("o9", 5.0, "mug"),)), 100) == []
    moved = disagreements(ann, Layer(name="ben", objects=(box("o9", 20.0, "mug"),)), 100)
    assert [(d.first, d.second, d.differs) for d in moved] == [("o1", "o9", ("shape",))]


def test_who_says_nothing_disagrees_with_all_that_is_said() -> None:
    found = disagreements(ANN, Layer(name="ben"), 100)
    assert [d.differs for d in found] == [("only",)] * 6
    assert {d.kind for d in found} == {"event", "relation", "object"}


def test_a_relation_that_is_disputed_is_named_by_its_ids() -> None:
    stated = [replace(relation(start, start + 10, "o1", "o2"), id=f"r{start}") for start in (0, 40)]
    found = disagreements(replace(ANN, relations=tuple(stated)), Layer(name="ben"), 100)
    assert [(d.first, d.label) for d in found if d.kind == "relation"] == [("r0 r40", "ON o1 o2")]


def test_a_whole_is_decided_before_its_parts() -> None:
    part = replace(event("part", 0, 10, "grasp"), parent="whole", tier="sub-event")
    layer = Layer(name="ann", events=(part, event("whole", 0, 50, "slide")))
    assert [d.first for d in disagreements(layer, Layer(name="ben"), 100)] == ["whole", "part"]


@given(st.integers(0, 3))
def test_an_annotator_agrees_with_herself(n: int) -> None:
    layer = replace(ANN, events=ANN.events[:n])
    found = compared(layer, layer)
    assert all(row["f1"] == 1.0 for row in found["events"])  # type: ignore[attr-defined]
    assert disagreements(layer, layer, 100) == []


def test_depth_survives_a_circle() -> None:
    events = {"a": event("a", 0, 1, parent="b"), "b": event("b", 0, 1, parent="a")}
    assert set(depths(events)) == {"a", "b"}


def test_three_annotators_are_compared_in_pairs() -> None:
    found = Agreement(("ann", "ben", "cleo"))
    found.add((ANN, BEN, replace(ANN, name="cleo")), 100)
    rows = {(r["of"], r["least_iou"]): r for r in figures(found)["events"] if r["of"] == "all"}
    assert rows["all", 0.5]["first"] == 9
    assert "ann and ben and cleo" in text_of(figures(found))
