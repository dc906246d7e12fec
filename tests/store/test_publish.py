"""Published tables say what the XML says."""

from __future__ import annotations

from math import isnan, nan
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import SchemaError
from ecat.model import (
    AnnotatedObject,
    Clock,
    Event,
    KeyFrame,
    Layer,
    Link,
    Manifest,
    Property,
    Relation,
    Role,
    Segment,
    TextReference,
)
from ecat.model.annotation import Argument
from ecat.store.publish import publish
from ecat.tables import PUBLISHED
from tests.model.layers import LAYERS

CLOCKED = Manifest(name="s", created="", n_frames=11, clock=Clock(rule="uniform", duration_ns=1_000))
PLAIN = Manifest(name="s", created="", n_frames=11)


def rows(name: str, *layers: Layer, manifest: Manifest = CLOCKED) -> list[dict[str, Any]]:
    return publish(layers, manifest)[name].to_pylist()


def pick(found: list[dict[str, Any]], *names: str) -> list[tuple[Any, ...]]:
    return [tuple(row[name] for name in names) for row in found]


def test_every_published_table_is_there_and_has_its_schema_even_when_empty() -> None:
    tables = publish([Layer()], PLAIN)
    assert {name: table.schema for name, table in tables.items()} == {s.name: s.arrow for s in PUBLISHED}
    assert all(table.num_rows == 0 for table in tables.values())


def test_objects_of_all_layers() -> None:
    thing = AnnotatedObject(id="o1", name="cup", kind="polygon", properties=(Property("weight", "3"),))
    found = rows("objects", Layer(objects=(thing,)), Layer(name="gold", objects=(thing,)))
    assert pick(found, "layer", "object_id", "name", "kind") == [
        ("main", "o1", "cup", "polygon"),
        ("gold", "o1", "cup", "polygon"),
    ]
    assert found[0]["properties"] == [("weight", "3")]


class TestKeyFrames:
    def found(self, *keys: KeyFrame, three: bool = False) -> list[dict[str, Any]]:
        name = "key_frames_3d" if three else "key_frames"
        return rows("keyframes", Layer(objects=(AnnotatedObject(id="o1", **{name: keys}),)))  # type: ignore[arg-type]

    def test_a_row_per_vertex(self) -> None:
        found = self.found(KeyFrame(frame=5, coordinates=(1, 2, 3, 4)))
        assert pick(found, "frame", "t_ns", "vertex", "x", "y", "z") == [
            (5, 500, 0, 1, 2, None),
            (5, 500, 1, 3, 4, None),
        ]

    def test_missing_is_null(self) -> None:
        found = self.found(KeyFrame(frame=5, coordinates=(nan, nan, nan, 1, 2, 3)), three=True)
        assert pick(found, "vertex", "x", "y", "z") == [(0, None, None, None), (1, 1, 2, 3)]

    def test_an_absence_is_a_row_without_a_vertex(self) -> None:
        assert pick(self.found(KeyFrame(frame=5, present=False)), "present", "vertex", "x") == [
            (False, None, None)
        ]

    def test_the_position_before_the_first_image_shows_the_first_image(self) -> None:
        both = (KeyFrame(frame=-1, coordinates=(1, 2)), KeyFrame(frame=0, coordinates=(3, 4)))
        assert pick(self.found(both[0]), "frame", "t_ns", "x") == [(0, 0, 1)]
        assert pick(self.found(*both), "frame", "x") == [(0, 3)], "the last counts"


class TestEvents:
    def test_the_span_of_an_event_is_over_all_its_segments(self) -> None:
        segments = (Segment(start_frame=6, end_frame=8), Segment(start_frame=1, end_frame=3))
        layer = Layer(events=(Event(id="a1", text="pour", segments=segments),))
        (event,) = rows("events", layer)
        assert pick([event], "start_frame", "end_frame", "start_ns", "end_ns") == [(1, 8, 100, 800)]
        assert pick(rows("event_segments", layer), "segment", "start_frame", "end_frame") == [
            (0, 6, 8),
            (1, 1, 3),
        ]

    def test_times_that_were_said_count(self) -> None:
        segment = Segment(start_frame=1, end_frame=3, start_ns=123, end_ns=456)
        (event,) = rows("events", Layer(events=(Event(id="a1", segments=(segment,)),)))
        assert (event["start_ns"], event["end_ns"]) == (123, 456)

    def test_without_a_clock_there_are_no_times(self) -> None:
        layer = Layer(events=(Event(id="a1", segments=(Segment(start_frame=1, end_frame=3),)),))
        assert pick(rows("events", layer, manifest=PLAIN), "start_ns", "end_ns") == [(None, None)]

    @pytest.mark.parametrize(
        ("start", "end", "published"), [(-1, 0, (0, 1)), (5, 5, (5, 6)), (9, 2, (9, 10))]
    )
    def test_an_interval_has_at_least_one_image(
        self, start: int, end: int, published: tuple[int, int]
    ) -> None:
        layer = Layer(events=(Event(id="a1", segments=(Segment(start_frame=start, end_frame=end),)),))
        assert pick(rows("event_segments", layer), "start_frame", "end_frame") == [published]

    def test_parts_and_links_are_links(self) -> None:
        events = (Event(id="a1", links=(Link(type="CAUSE", target="a3"),)), Event(id="a2", parent="a1"))
        found = pick(rows("event_links", Layer(events=events)), "event_id", "type", "target")
        assert sorted(found) == [("a1", "CAUSE", "a3"), ("a1", "SUBEVENT", "a2")]

    def test_roles_and_references_are_roles(self) -> None:
        event = Event(
            id="a1",
            roles=(Role(name="agent", target="o1"),),
            references=(TextReference(start=2, end=5, target="o2"),),
        )
        assert pick(
            rows("event_roles", Layer(events=(event,))), "role", "kind", "target", "text_start", "text_end"
        ) == [
            ("agent", "object", "o1", None, None),
            ("reference", "object", "o2", 2, 5),
        ]


class TestRelations:
    def relation(self, predicate: str, start: int, *targets: str, holds: bool = True) -> Relation:
        return Relation(
            predicate=predicate,
            start_frame=start,
            polarity=holds,
            arguments=tuple(Argument(target=t) for t in targets),
        )

    def test_a_relation_holds_until_contradicted(self) -> None:
        objects = (AnnotatedObject(id="o1"),)
        relations = (self.relation("SIT", 2, "o1"), self.relation("STAND", 6, "o1"))
        found = rows("relations", Layer(objects=objects, relations=relations))
        assert pick(found, "relation", "start_frame", "end_frame", "arguments") == [
            (0, 2, 6, ["o1"]),
            (1, 6, None, ["o1"]),
        ]

    def test_it_holds_only_while_its_objects_are_there(self) -> None:
        keys = (KeyFrame(frame=0), KeyFrame(frame=4, present=False), KeyFrame(frame=7))
        layer = Layer(
            objects=(AnnotatedObject(id="o1", key_frames=keys),), relations=(self.relation("SIT", 2, "o1"),)
        )
        assert pick(rows("relations", layer), "relation", "start_frame", "end_frame") == [
            (0, 2, 4),
            (0, 7, None),
        ]

    def test_a_fact_about_nobody_never_held_and_is_still_there(self) -> None:
        found = rows("relations", Layer(relations=(self.relation("SIT", 2, "o9"),)))
        assert pick(found, "start_frame", "end_frame") == [(2, 2)]

    def test_an_object_of_another_session_is_taken_to_be_there(self) -> None:
        layer = Layer(
            objects=(AnnotatedObject(id="o1"),), relations=(self.relation("IDENTITY", 0, "o1", "gone/o99"),)
        )
        assert pick(rows("relations", layer), "arguments", "end_frame") == [(["o1", "gone/o99"], None)]

    def test_a_denial_is_a_row_too(self) -> None:
        found = rows("relations", Layer(relations=(self.relation("SIT", 2, "o1", holds=False),)))
        assert pick(found, "polarity", "start_frame", "end_frame") == [(False, 2, None)]


def test_a_number_that_its_column_cannot_hold_is_named() -> None:
    layer = Layer(objects=(AnnotatedObject(id="o1", key_frames=(KeyFrame(frame=2**31),)),))
    with pytest.raises(SchemaError) as caught:
        publish([layer], PLAIN)
    assert caught.value.problems == ("frame: 2147483648",)


def is_sorted(table: pa.Table, order: tuple[str, ...]) -> bool:
    keys = [[(row[name] is None, row[name]) for name in order] for row in table.to_pylist()]
    return keys == sorted(keys)


@given(st.lists(LAYERS, max_size=2, unique_by=lambda layer: layer.name))
@settings(max_examples=60)
def test_every_fact_of_any_layers_is_published_and_sorted(layers: list[Layer]) -> None:
    tables = publish(layers, PLAIN)
    for schema in PUBLISHED:
        assert is_sorted(tables[schema.name], schema.order)
    count = {name: table.num_rows for name, table in tables.items()}
    assert count["objects"] == sum(len(layer.objects) for layer in layers)
    assert count["events"] == sum(len(layer.events) for layer in layers)
    assert count["event_segments"] == sum(len(event.segments) for layer in layers for event in layer.events)
    assert {(row["layer"], row["relation"]) for row in tables["relations"].to_pylist()} == {
        (layer.name, i) for layer in layers for i in range(len(layer.relations))
    }
    texts = [event.text for layer in layers for event in layer.events]
    assert sorted(str(text) for text in tables["events"]["text"].to_pylist()) == sorted(texts)
    numbers = tables["keyframes"]["x"].to_pylist()
    assert not any(number is not None and isnan(number) for number in numbers)
