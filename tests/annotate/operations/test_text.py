"""The text of an event and what it refers to."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.annotate.operations.text import find_references, moved_spans
from ecat.model import AnnotatedObject, TextReference
from tests.annotate.bench import Bench, event, op, thing


def marked(bench: Bench) -> list[tuple[str, str]]:
    """The words that an event's text refers to objects with, and the objects."""
    text = bench.event().text
    return [(text[r.start : r.end], r.target) for r in bench.event().references]


def found(text: str, *names: str) -> list[tuple[str, str]]:
    things = [AnnotatedObject(id=f"o{i}", name=name) for i, name in enumerate(names, 1)]
    return [(text[r.start : r.end], r.target) for r in find_references(text, things)]


def test_names_are_found_as_whole_words_in_any_case_every_time() -> None:
    assert found("the man waves, the woman sees the MAN", "man") == [("man", "o1"), ("MAN", "o1")]


def test_the_longest_name_is_meant_and_nothing_is_marked_twice() -> None:
    assert found("red box beside box", "box", "red box") == [("red box", "o2"), ("box", "o1")]


def test_names_may_have_odd_characters_and_blanks() -> None:
    assert found("Stella  Artois (cup) by C++", "Stella Artois ", "C++", "(cup)", " ") == [
        ("Stella  Artois", "o1"), ("(cup)", "o3"), ("C++", "o2"),
    ]  # fmt: skip


def test_without_names_nothing_is_found() -> None:
    assert found("a b", "", " ") == []


@given(st.text("ab \u0130ß", max_size=20), st.lists(st.text("ab \u0130ß", max_size=4), max_size=4))
def test_what_is_found_lies_in_the_text_apart_and_in_order(text: str, names: list[str]) -> None:
    things = [AnnotatedObject(id=f"o{i}", name=name) for i, name in enumerate(names)]
    last = 0
    for reference in find_references(text, things):
        assert last <= reference.start < reference.end <= len(text)
        last = reference.end


def test_what_a_person_marked_stays(bench: Bench) -> None:
    bench.do(thing("cup"), thing("box"), event(0, 9, text="cup beside cup"))
    bench.do(op("add_reference", id="a1", start=0, end=3, target="o2"))
    bench.do(op("find_references", ids=["a1"]))
    assert marked(bench) == [("cup", "o2"), ("cup", "o1")]


def test_references_are_found_in_all_events_by_default(bench: Bench) -> None:
    bench.do(thing("cup"), event(0, 9, text="a cup"), event(0, 9, text="no cups"), op("find_references"))
    assert [len(e.references) for e in bench.layer.events] == [1, 0]


def test_a_reference_takes_the_place_of_what_was_marked_there(bench: Bench) -> None:
    bench.do(
        thing("cup"), event(0, 9, text="red cup"), op("add_reference", id="a1", start=4, end=7, target="o1")
    )
    bench.do(op("add_reference", id="a1", start=0, end=7, target="o1"))
    assert marked(bench) == [("red cup", "o1")]
    bench.do(op("remove_reference", id="a1", start=0, end=7))
    assert marked(bench) == []
    assert "refer to nothing" in bench.refused(op("remove_reference", id="a1", start=0, end=7))


@pytest.mark.parametrize("span", [(0, 8), (3, 3), (5, 2), (-1, 2)])
def test_a_reference_lies_in_the_text(bench: Bench, span: tuple[int, int]) -> None:
    bench.do(thing("cup"), event(0, 9, text="red cup"))
    refused = bench.refused(op("add_reference", id="a1", start=span[0], end=span[1], target="o1"))
    assert "in a text of 7" in refused


def test_references_move_with_the_words_they_mark(bench: Bench) -> None:
    bench.do(thing("cup"), thing("box"), event(0, 9, text="cup on box"), op("find_references"))
    bench.do(op("edit_event", id="a1", text="a cup put on box"))
    assert marked(bench) == [("box", "o2")]
    bench.do(op("find_references"))
    bench.do(op("edit_event", id="a1", text="a cup put on the box"))
    assert marked(bench) == [("cup", "o1"), ("box", "o2")]


def test_words_that_are_edited_refer_to_nothing(bench: Bench) -> None:
    bench.do(thing("cup"), thing("box"), event(0, 9, text="cup on box"), op("find_references"))
    bench.do(op("edit_event", id="a1", text="cap on box"))
    assert marked(bench) == [("box", "o2")]


@given(st.text("ab", max_size=12), st.text("ab", max_size=12), st.integers(0, 12), st.integers(0, 12))
def test_a_span_that_is_kept_marks_the_same_characters(old: str, new: str, start: int, end: int) -> None:
    if start >= end or end > len(old):
        return
    for moved in moved_spans((TextReference(start=start, end=end, target="o1"),), old, new):
        assert old[start:end] == new[moved.start : moved.end]


def test_words_may_name_actions(bench: Bench) -> None:
    bench.do(event(0, 9, text="slide the cup"))
    bench.do(op("set_predicates", id="a1", predicates=[{"start": 0, "end": 5, "type": "slide"}]))
    assert bench.event().predicates[0].type == "slide"
    assert "in a text of 13" in bench.refused(
        op("set_predicates", id="a1", predicates=[{"start": 0, "end": 50, "type": "slide"}])
    )
