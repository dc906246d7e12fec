"""The published tables hold the layer's facts, no more and no fewer, in the form that their schemas promise."""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations
from math import isnan

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ecat.model import Clock, Event, KeyFrame, Layer, Manifest, Relation
from ecat.model.annotation import Argument
from ecat.model.holding import conflicts
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.store.publish import publish
from ecat.tables import PUBLISHED
from tests.model.layers import LAYERS, instances

MANIFEST = Manifest(name="s", created="", n_frames=100, clock=Clock(rule="uniform", duration_ns=10**9))


def shown(keys: tuple[KeyFrame, ...]) -> dict[int, KeyFrame]:
    """The key frame that counts at each image that has one."""
    return {max(key.frame, 0): key for key in keys}


@given(LAYERS)
@settings(max_examples=60)
def test_only_columns_that_may_be_null_are_null(layer: Layer) -> None:
    tables = publish([layer], MANIFEST)
    for schema in PUBLISHED:
        for column in schema.columns:
            nulls = tables[schema.name][column.name].null_count
            assert column.nullable or nulls == 0, f"{schema.name}.{column.name}"


@given(LAYERS)
@settings(max_examples=60)
def test_shapes_are_published_vertex_by_vertex(layer: Layer) -> None:
    assume(len({thing.id for thing in layer.objects}) == len(layer.objects))
    found: dict[tuple[str, int, int], list[float | None]] = defaultdict(list)
    for row in publish([layer], MANIFEST)["keyframes"].to_pylist():
        numbers = [row["x"], row["y"], row["z"]][: row["dimensions"]]
        key = row["object_id"], row["dimensions"], row["frame"]
        found[key] += [] if row["vertex"] is None else numbers
        assert row["vertex"] in (None, len(found[key]) // row["dimensions"] - 1)
    expected: dict[tuple[str, int, int], list[float | None]] = {}
    for thing in layer.objects:
        for dimensions, keys in ((2, thing.key_frames), (3, thing.key_frames_3d)):
            for frame, key in shown(keys).items():
                whole = len(key.coordinates) // dimensions * dimensions
                numbers = [None if isnan(number) else number for number in key.coordinates[:whole]]
                expected[thing.id, dimensions, frame] = numbers
    assert found == expected


@given(st.lists(instances(Event), max_size=3))
@settings(max_examples=60)
def test_events_links_and_roles_are_published_one_by_one(events: list[Event]) -> None:
    tables = publish([Layer(events=tuple(events))], MANIFEST)
    links = [(e.id, link.type, link.target) for e in events for link in e.links]
    links += [(e.parent, "SUBEVENT", e.id) for e in events if e.parent is not None]
    rows = tables["event_links"].to_pylist()
    assert sorted((r["event_id"], r["type"], r["target"]) for r in rows) == sorted(links)
    roles = [(e.id, role.name, role.kind, role.target) for e in events for role in e.roles]
    roles += [(e.id, "reference", "object", reference.target) for e in events for reference in e.references]
    rows = tables["event_roles"].to_pylist()
    assert sorted((r["event_id"], r["role"], r["kind"], r["target"]) for r in rows) == sorted(roles)
    for row in tables["event_segments"].to_pylist():
        assert 0 <= row["start_frame"] < row["end_frame"]


FACTS = st.builds(
    lambda predicate, frame, target: Relation(
        predicate=predicate, start_frame=frame, arguments=(Argument(target=f"other/{target}"),)
    ),
    st.sampled_from(["SIT", "STAND", "LIE"]),
    st.integers(-1, 3),
    st.sampled_from("ab"),
)


@given(st.lists(FACTS, max_size=6))
def test_published_facts_that_conflict_share_no_image_not_even_the_first(facts: list[Relation]) -> None:
    rows = publish([Layer(relations=tuple(facts))], MANIFEST)["relations"].to_pylist()
    images = [
        set(range(row["start_frame"], 9 if row["end_frame"] is None else row["end_frame"])) for row in rows
    ]
    for (i, first), (j, second) in combinations(enumerate(rows), 2):
        if conflicts(ECAT_2018_SCHEME, facts[first["relation"]], facts[second["relation"]]):
            assert not images[i] & images[j]
