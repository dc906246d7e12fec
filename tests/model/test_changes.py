"""Changes are exact both ways, are data, and a document keeps up with them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import SchemaError
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Link, Relation, Role, Segment, TextReference
from ecat.model.annotation import Argument, Decision
from ecat.model.changes import Change, diff, from_json, invert, to_json
from ecat.model.document import Document
from tests.model.layers import DISTINCT

LISTS = ("objects", "events", "relations", "decisions")


@st.composite
def pairs(draw: st.DrawFn) -> tuple[Layer, Layer]:
    """Two layers that share some elements, in some order, some of them changed."""
    old, other = draw(DISTINCT), draw(DISTINCT)
    mixed: dict[str, Any] = {}
    for name in LISTS:
        by_id = {_id(item): item for item in getattr(old, name)}
        by_id |= {
            _id(item): item for item in draw(st.permutations(getattr(other, name))) if draw(st.booleans())
        }
        mixed[name] = tuple(draw(st.permutations(list(by_id.values()))))
    header = other if draw(st.booleans()) else old
    return old, replace(header, name=old.name, **mixed)


def _id(item: Any) -> str:
    return item.proposal if isinstance(item, Decision) else item.id


def same(first: Layer, second: Layer) -> bool:
    """What is missing is NaN, which equals nothing."""
    return repr(first) == repr(second)


def event(name: str, start: int, end: int, **said: Any) -> Event:
    return Event(id=name, segments=(Segment(start_frame=start, end_frame=end),), **said)


@given(DISTINCT)
@settings(max_examples=60)
def test_an_element_comes_back_from_json_as_it_was(layer: Layer) -> None:
    data = json.loads(json.dumps(to_json(layer), allow_nan=False))
    assert same(from_json(Layer, data), layer)


def test_json_says_what_is_not_the_default() -> None:
    key = KeyFrame(frame=3, coordinates=(1.0, float("nan"), 2.5, float("inf")))
    thing = AnnotatedObject(id="o1", kind="rectangle", key_frames=(key,))
    assert to_json(thing) == {
        "id": "o1",
        "kind": "rectangle",
        "key_frames": [{"frame": 3, "coordinates": [1, None, 2.5, "inf"]}],
    }


@pytest.mark.parametrize(
    "data",
    [
        {"id": 7},
        {"id": "o1", "line_width": "1"},
        {"id": "o1", "line_width": True},
        {"id": "o1", "kind": "sphere"},
        {"id": "o1", "key_frames": {"frame": 1}},
        {"id": "o1", "key_frames": [7]},
        {"id": "o1", "unheard": 1},
        {},
    ],
)
def test_what_is_no_element_is_refused(data: dict[str, Any]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        from_json(AnnotatedObject, data)


@given(pairs())
@settings(max_examples=150)
def test_a_difference_makes_one_layer_of_the_other_and_back(pair: tuple[Layer, Layer]) -> None:
    old, new = pair
    changes = diff(old, new)
    document = Document(old)
    document.apply(changes)
    assert same(document.layer(), new)
    document.apply(invert(changes))
    assert same(document.layer(), old)
    assert invert(invert(changes)) == changes


@given(pairs())
@settings(max_examples=50)
def test_changes_are_data(pair: tuple[Layer, Layer]) -> None:
    for change in diff(*pair):
        assert Change.from_dict(json.loads(json.dumps(change.to_dict(), allow_nan=False))) == change


def test_nothing_changed_is_no_change() -> None:
    layer = Layer(
        objects=(AnnotatedObject(id="o1", key_frames=(KeyFrame(frame=0, coordinates=(float("nan"),)),)),)
    )
    assert diff(layer, from_json(Layer, to_json(layer))) == ()


def test_a_moved_shape_is_a_change_of_that_key_frame_alone() -> None:
    keys = tuple(KeyFrame(frame=frame, coordinates=(1.0, 2.0)) for frame in range(3))
    old = AnnotatedObject(id="o1", name="cup", kind="point", key_frames=keys)
    new = replace(old, key_frames=(keys[0], replace(keys[1], coordinates=(5.0, 6.0)), keys[2]))
    (change,) = diff(Layer(objects=(old,)), Layer(objects=(new,)))
    assert (change.kind, change.id) == ("key_frame", "o1@1")
    assert change.before == {"frame": 1, "coordinates": [1, 2]}
    assert change.after == {"frame": 1, "coordinates": [5, 6]}


def test_of_events_in_another_order_the_fewest_are_moved() -> None:
    events = [event(f"a{i}", i, i + 1) for i in range(6)]
    old = Layer(events=tuple(events))
    new = Layer(events=(events[5], *events[:5]))
    assert [change.id for change in diff(old, new)] == ["a5", "a5"]


@pytest.mark.parametrize(
    "layer",
    [
        Layer(events=(Event(id="a1"), Event(id="a1"))),
        Layer(objects=(AnnotatedObject(id="o1", key_frames=(KeyFrame(frame=1), KeyFrame(frame=1))),)),
    ],
)
def test_parts_that_cannot_be_told_apart_are_refused(layer: Layer) -> None:
    with pytest.raises(SchemaError, match="cannot tell the parts"):
        Document(layer)
    with pytest.raises(SchemaError):
        diff(Layer(), layer)


class TestDocument:
    """Looking up costs what is found, and follows every change."""

    @pytest.fixture
    def document(self) -> Document:
        return Document(
            Layer(
                objects=(AnnotatedObject(id="o1"), AnnotatedObject(id="o2")),
                events=(
                    event("a1", 0, 10, tier="event", roles=(Role(name="Theme", target="o1"),)),
                    event("a3", 5, 9, parent="a1"),
                    event("a2", 0, 4, parent="a1", references=(TextReference(start=0, end=1, target="o1"),)),
                    event("a4", 20, 30, tier="event", links=(Link(type="CAUSE", target="a1"),)),
                ),
                relations=(
                    Relation(
                        predicate="ON",
                        start_frame=0,
                        arguments=(Argument(target="o1"), Argument(target="s/o1")),
                    ),
                ),
                decisions=(Decision(proposal="machine/a7", verdict="accepted", result="a1"),),
            )
        )

    def test_it_finds_things_by_id(self, document: Document) -> None:
        found = (
            document.object("o1"),
            document.event("a1"),
            document.relation("r1"),
            document.decision("machine/a7"),
        )
        assert None not in found
        assert document.object("a1") is document.event("o1") is None

    def test_it_knows_sub_events_by_their_start(self, document: Document) -> None:
        assert [child.id for child in document.children("a1")] == ["a2", "a3"]

    def test_it_knows_who_names_what(self, document: Document) -> None:
        assert set(document.users("object", "o1")) == {("event", "a1"), ("event", "a2"), ("relation", "r1")}
        assert set(document.users("event", "a1")) == {
            ("event", "a2"), ("event", "a3"), ("event", "a4"), ("decision", "machine/a7"),
        }  # fmt: skip
        assert document.users("object", "o2") == ()

    def test_it_knows_what_overlaps_on_a_tier(self, document: Document) -> None:
        def overlapping(start: int, end: int) -> list[str]:
            return [found.id for found in document.overlapping("event", start, end)]

        assert overlapping(0, 40) == ["a1", "a4"]
        assert overlapping(10, 20) == []
        assert overlapping(9, 10) == ["a1"]

    def test_it_follows_changes(self, document: Document) -> None:
        list(document.overlapping("event", 0, 1))
        old = document.layer()
        moved = replace(old.events[0], segments=(Segment(start_frame=12, end_frame=15),), roles=())
        changes = diff(old, replace(old, events=(moved, old.events[3])))
        document.apply(changes)
        assert [found.id for found in document.overlapping("event", 0, 40)] == ["a1", "a4"]
        assert list(document.overlapping("event", 0, 12)) == []
        assert document.children("a1") == ()
        assert document.users("object", "o1") == (("relation", "r1"),)
        document.apply(invert(changes))
        assert document.layer() == old
        assert [child.id for child in document.children("a1")] == ["a2", "a3"]
