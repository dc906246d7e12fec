"""Operations are data: they come back from JSON as they were, and nonsense is named with its path."""

from __future__ import annotations

import json
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.annotate import (
    OPERATIONS,
    AddEvent,
    SetPredicates,
    operation_from_dict,
    operation_to_dict,
    operations_from_list,
)
from ecat.errors import LimitError, SchemaError
from ecat.model import TextPredicate
from tests.annotate.anything import MACHINE, anything


@given(st.integers(0, 2**32))
def test_an_operation_comes_back_as_it_was(seed: int) -> None:
    operation = operation_from_dict(anything(Random(seed), MACHINE))
    said = json.loads(json.dumps(operation_to_dict(operation), allow_nan=False))
    assert operation_from_dict(said) == operation
    assert said["op"] in OPERATIONS


def test_json_says_what_is_not_the_default() -> None:
    added = AddEvent(segments=((3, 9),), roles={"Theme": "o1"})
    assert operation_to_dict(added) == {"op": "add_event", "segments": [[3, 9]], "roles": {"Theme": "o1"}}
    named = SetPredicates(id="a1", predicates=(TextPredicate(start=0, end=5, type="slide"),))
    assert operation_to_dict(named)["predicates"] == [{"start": 0, "end": 5, "type": "slide"}]


@pytest.mark.parametrize(
    ("asked", "problem"),
    [
        ({}, "op: None is no operation"),
        ({"op": "explode"}, "op: 'explode' is no operation"),
        ({"op": ["add_event"]}, "is no operation"),
        ({"op": "remove_event"}, "id: Field required"),
        ({"op": "remove_event", "id": "a1", "force": True}, "force: Unexpected"),
        ({"op": "remove_event", "id": 7}, "id: Input should be a valid string"),
        ({"op": "move_event", "id": "a1", "frames": "7"}, "frames: Input should be a valid integer"),
        ({"op": "move_event", "id": "a1", "frames": 1.5}, "frames: Input should be a valid integer"),
        ({"op": "move_event", "id": "a1", "frames": True}, "frames: Input should be a valid integer"),
        ({"op": "move_event", "id": "a1", "frames": 2**31}, "frames: beyond 32 bits"),
        (
            {"op": "move_edge", "id": "a1", "edge": "middle", "frame": 1},
            "edge: Input should be 'start' or 'end'",
        ),
        ({"op": "add_event", "segments": [[1, 2], [3]]}, "segments[1]"),
        ({"op": "add_event", "segments": [[1, 2, 3]]}, "segments[0]"),
        ({"op": "add_event", "roles": {"Theme": 1}}, "roles.Theme"),
        ({"op": "add_event", "text": "a\0"}, "text: the character U+0000 cannot be kept"),
        ({"op": "add_event", "text": "\ud800"}, "text: the character U+D800 cannot be kept"),
        ({"op": "add_event", "roles": {"a\0": "o1"}}, "U+0000 cannot be kept"),
        ({"op": "add_event", "text": "a" * 10_001}, "text: 10,001 characters, at most 10,000"),
        ({"op": "add_object", "kind": "polygon", "coordinates": [0.0] * 10_001}, "coordinates: 10,001 parts"),
        (
            {"op": "add_object", "kind": "point", "coordinates": [float("nan"), 1]},
            "coordinates[0]: not a number",
        ),
        ({"op": "add_object", "kind": "point", "coordinates": [None, 1]}, "coordinates[0]"),
        (
            {"op": "set_predicates", "id": "a1", "predicates": [{"start": 0, "end": "x", "type": ""}]},
            "predicates[0].end",
        ),
    ],
)
def test_nonsense_is_named_with_its_path(asked: dict[str, Any], problem: str) -> None:
    with pytest.raises(SchemaError) as caught:
        operation_from_dict(asked)
    assert any(problem in found for found in caught.value.problems), caught.value.problems
    assert caught.value.consequence == "nothing was changed"


def test_of_several_the_position_is_named_too() -> None:
    with pytest.raises(SchemaError, match="cannot read the operation") as caught:
        operations_from_list([{"op": "find_references"}, {"op": "remove_event"}])
    assert caught.value.problems[0].startswith("[1].id: ")


def test_a_hundred_thousand_are_enough() -> None:
    with pytest.raises(LimitError, match="cannot do so much"):
        operations_from_list([{"op": "find_references"}] * 100_001)


def test_every_operation_says_what_it_does() -> None:
    for kind in OPERATIONS.values():
        assert kind.__doc__
        assert not kind.__doc__.startswith(kind.__name__)
