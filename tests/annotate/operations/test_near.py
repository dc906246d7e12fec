"""An id that is not there: what was meant, and the command that shows what there is."""

from __future__ import annotations

import time
from typing import Any

import pytest

from ecat.annotate.operations.near import near
from ecat.cli.app import VERBS
from ecat.errors import OperationError
from ecat.model import Event, Layer
from ecat.model.document import Document
from tests.annotate.bench import Bench, event, op, relation, thing


@pytest.fixture
def full(bench: Bench) -> Bench:
    """A mug and a table, two events, a relation."""
    bench.do(thing("Mug"), thing("table"), event(0, 9, type="grasp"), event(20, 30, text="he lets go"))
    bench.do(relation("NEAR", "o1", "o2"), thing("lamp", id="lamp-left"))
    return bench


def fix(bench: Bench, *operations: dict[str, Any]) -> str:
    """What an error says to do."""
    with pytest.raises(OperationError) as caught:
        bench.do(*operations)
    return caught.value.fix


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        (
            op("edit_object", id="mug", color="#ff0000"),
            "did you mean o1 (Mug)? ecat object list MY_SESSION shows",
        ),
        (op("edit_object", id="tabel", color="#ff0000"), "did you mean o2 (table)? ecat object list"),
        (op("remove_object", id="lamp-lefd"), "did you mean lamp-left (lamp)? ecat object list"),
        (op("remove_object", id="O2"), "did you mean o2 (table)? ecat object list"),
        (op("remove_object", id="o9"), "ecat object list MY_SESSION shows those that there are"),
        (op("set_property", target="o9", name="a", value="b"), "ecat object list MY_SESSION shows"),
        (
            op("set_property", target="grasp", name="a", value="b"),
            "did you mean a1 (grasp)? ecat object list",
        ),
        (op("merge_events", ids=["a1", "a9"]), "ecat event list MY_SESSION shows those that there are"),
        (op("merge_events", ids=["a1", "o1"]), "o1 is an object; ecat event list MY_SESSION shows"),
        (op("remove_event", id="he lets"), "did you mean a2 (he lets go)? ecat event list"),
        (op("remove_relation", id="near"), "did you mean r1 (NEAR)? ecat relation list MY_SESSION shows"),
        (op("remove_event", id="r1"), "r1 is a relation; ecat event list MY_SESSION shows"),
        (op("set_role", id="a1", role="Theme", target="mugg"), "did you mean o1 (Mug)? ecat object list"),
    ],
)
def test_the_fix_names_what_was_meant_and_a_command(
    full: Bench, operation: dict[str, Any], expected: str
) -> None:
    assert expected in fix(full, operation)


def test_a_layer_without_such_elements_says_how_to_add_one(bench: Bench) -> None:
    assert (
        fix(bench, op("remove_event", id="a1")) == "there is none yet: ecat event add MY_SESSION ... adds one"
    )


def test_the_command_is_about_the_layer_that_was_edited() -> None:
    bench = Bench(layer=Layer(name="ann 2", events=(Event(id="a1"),)))
    assert "ecat event list MY_SESSION --layer 'ann 2' shows" in fix(bench, op("remove_event", id="a7"))


@pytest.mark.parametrize(
    "operation",
    [
        relation("NEAR", "o1", "tabel"),
        op("add_event", segments=[[0, 1]], parent="graps"),
    ],
)
def test_what_an_edit_names_and_is_not_there_has_a_hint_too(full: Bench, operation: dict[str, Any]) -> None:
    assert "did you mean" in full.refused(operation)


def test_every_command_exists() -> None:
    assert {"object", "event", "relation"} <= set(VERBS)


def test_a_large_layer_is_not_searched_through() -> None:
    document = Document(Layer(events=tuple(Event(id=f"event-{i}", type=f"t{i}") for i in range(50_000))))
    start = time.process_time()
    near(document, ("event",), "event-99999")
    assert time.process_time() - start < 2
