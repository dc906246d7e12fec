"""What events say in words, and the fields that offer what is known."""

from __future__ import annotations

from typing import Any


def test_a_text_refers_to_objects_as_whole_words(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.find("event-text").fill("The Shell box passes the shells of Stella Artois")
    annotating.find("event-text").blur()
    annotating.settle()
    annotating.find("find-references").click()
    annotating.settle()
    annotating.find("reference-o3").click()
    assert annotating.says("app.selectedObject.name") == "Stella Artois"
    event = served.layer().events[0]
    assert [(event.text[r.start : r.end], r.target) for r in event.references] == [
        ("Shell", "o2"),
        ("Stella Artois", "o3"),
    ]


def test_words_of_a_text_name_actions(served: Any, annotating: Any) -> None:
    annotating.press("e")
    text = annotating.find("event-text")
    text.fill("she lifts the box and puts it down")
    # what is still being typed counts
    text.evaluate("(area) => area.setSelectionRange(4, 9)")
    annotating.find("add-action").click()
    annotating.find("action-0-type").wait_for()
    annotating.settle()
    text.evaluate("(area) => area.setSelectionRange(22, 34)")
    annotating.find("add-action").click()
    annotating.find("action-1-type").wait_for()
    annotating.find("action-1-type").fill("put_down")
    annotating.find("action-1-type").press("Enter")
    annotating.settle()
    (event,) = served.layer().events
    said = [(event.text[p.start : p.end], p.type) for p in event.predicates]
    assert said == [("lifts", "lifts"), ("puts it down", "put_down")]
    annotating.find("action-0").get_by_label("Remove the action").click()
    annotating.settle()
    assert [p.type for p in served.layer().events[0].predicates] == ["put_down"]


def test_a_selection_of_no_words_names_nothing(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.find("event-text").fill("she lifts it")
    annotating.find("event-text").blur()
    annotating.settle()
    annotating.find("add-action").click()
    annotating.find("toasts").get_by_text("Select the words").wait_for()
    assert served.layer().events[0].predicates == ()


def test_references_are_set_by_hand_and_removed_one_by_one(served: Any, annotating: Any) -> None:
    annotating.press("e")
    text = annotating.find("event-text")
    text.fill("it passes the other one")
    text.blur()
    annotating.settle()
    for start, end, name in ((0, 2, "o2"), (14, 23, "o3")):
        text.evaluate("(area, [s, e]) => { area.focus(); area.setSelectionRange(s, e); }", [start, end])
        annotating.find("reference-target").focus()
        annotating.find("reference-target").select_option(name)
        annotating.settle()
    (event,) = served.layer().events
    assert [(r.start, r.end, r.target) for r in event.references] == [(0, 2, "o2"), (14, 23, "o3")]
    annotating.find("selected-panel").get_by_label("Remove the reference").first.click()
    annotating.settle()
    assert [r.target for r in served.layer().events[0].references] == ["o3"]
    annotating.find("selected-panel").get_by_label("Remove the reference").first.click()
    annotating.settle()
    assert served.layer().events[0].references == ()


class TestFieldsWithSuggestions:
    """A field that offers all it knows is empty while it has the focus, and loses nothing by that."""

    def test_leaving_it_untouched_changes_nothing(self, served: Any, annotating: Any) -> None:
        annotating.press("e")
        field = annotating.find("event-type")
        assert field.input_value() == "slide_next"
        field.focus()
        assert (field.input_value(), field.get_attribute("placeholder")) == ("", "slide_next")
        field.blur()
        annotating.settle()
        assert field.input_value() == "slide_next"
        assert served.layer().events[0].type == "slide_next"
        assert annotating.says("app.active.revision") == 1

    def test_what_is_typed_or_chosen_is_taken(self, served: Any, annotating: Any) -> None:
        annotating.press("e")
        field = annotating.find("event-type")
        field.fill("slide_away")
        field.press("Enter")
        annotating.settle()
        assert served.layer().events[0].type == "slide_away"
        field.fill("something else")
        field.blur()
        annotating.settle()
        assert served.layer().events[0].type == "something else"

    def test_escape_takes_back_what_was_typed(self, served: Any, annotating: Any) -> None:
        annotating.press("e")
        field = annotating.find("event-type")
        field.focus()
        annotating.page.keyboard.type("slide_aw")
        annotating.page.keyboard.press("Escape")
        annotating.settle()
        assert field.input_value() == "slide_next"
        assert served.layer().events[0].type == "slide_next"

    def test_backspace_means_nothing_at_all(self, served: Any, annotating: Any) -> None:
        annotating.press("e")
        field = annotating.find("event-type")
        field.focus()
        annotating.page.keyboard.press("Backspace")
        field.blur()
        annotating.settle()
        assert served.layer().events[0].type == ""

    def test_all_that_the_scheme_has_for_the_tier_is_offered(self, annotating: Any) -> None:
        annotating.press("e")
        offered = annotating.find("event-type").evaluate(
            "(field) => [...field.list.options].map(o => o.value)"
        )
        assert set(offered) >= {"slide_next", "slide_past", "slide_around", "slide_toward", "slide_away"}
        assert "grasp" not in offered
