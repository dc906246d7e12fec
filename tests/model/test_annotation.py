"""Annotations are plain immutable values."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from typing import Any

import pytest

from ecat import model
from ecat.model import Event, Foreign, KeyFrame, Layer, Relation
from ecat.model.annotation import Argument, foreign_value

VALUES = [thing for thing in vars(model).values() if isinstance(thing, type) and is_dataclass(thing)]


@pytest.mark.parametrize("kind", VALUES, ids=lambda kind: kind.__name__)
def test_every_part_of_the_model_is_frozen_and_documented(kind: type[Any]) -> None:
    assert kind.__dataclass_params__.frozen
    assert "__slots__" in vars(kind)
    assert not (kind.__doc__ or "").startswith(f"{kind.__name__}("), "no docstring but the generated one"


def test_a_layer_cannot_be_changed_only_replaced() -> None:
    layer = Layer(events=(Event(id="e1"),))
    with pytest.raises(FrozenInstanceError):
        layer.name = "gold"  # pyright: ignore[reportAttributeAccessIssue]
    assert replace(layer, name="gold").events is layer.events
    assert layer.name == "main"


def test_equal_content_is_equal_and_hashable() -> None:
    assert Layer(events=(Event(id="e1", text="a"),)) == Layer(events=(Event(id="e1", text="a"),))
    assert len({Event(id="e1"), Event(id="e1"), Event(id="e2")}) == 2


def test_what_nobody_said_is_missing_and_never_a_number() -> None:
    relation, key = Relation(predicate="ON", start_frame=0), KeyFrame(frame=0)
    assert (relation.end_frame, relation.start_ns, relation.end_ns, key.t_ns) == (None,) * 4
    assert Event(id="e1").parent is None


def test_the_targets_of_a_relation_are_its_arguments_in_order() -> None:
    arguments = tuple(Argument(target=target) for target in ("o2", "other/o1"))
    assert Relation(predicate="ON", start_frame=0, arguments=arguments).targets == ("o2", "other/o1")


def test_a_foreign_value_is_found_by_its_key() -> None:
    items = (Foreign("ecat-2018:no", "3"), Foreign("ecat-2018:no", "4"))
    assert foreign_value(items, "ecat-2018:no") == "3"
    assert foreign_value(items, "elan:no") is None


def test_every_child_element_has_a_name_of_its_own() -> None:
    for kind in VALUES:
        tags = [item.metadata["tag"] for item in fields(kind) if "tag" in item.metadata]
        attributes = [item.name for item in fields(kind) if "tag" not in item.metadata]
        assert len({*tags, *attributes}) == len(tags) + len(attributes), kind
