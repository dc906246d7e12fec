"""Two people in one session, and a connection that goes away."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import pytest


@pytest.fixture
def both(served: Any, window: Callable[..., Any]) -> Generator[tuple[Any, Any]]:
    """Ann and Ben, who see the same layer."""
    pair = window(served, author="ann"), window(served, author="ben")
    yield pair
    assert pair[0].complaints == pair[1].complaints == []


def _hold_back(window: Any) -> None:
    """Let this window not hear of what others do, as on a slow line."""
    window.page.evaluate("() => { window.ecat.onLive = () => undefined; }")


def test_what_one_does_the_other_sees(served: Any, both: tuple[Any, Any]) -> None:
    ann, ben = both
    ann.press("e")
    ben.until("app.document.events.list.length === 1")
    assert ben.says("app.document.events.list[0].author") == "ann"
    ben.find("people").get_by_label("ann").wait_for()
    assert len(served.layer().events) == 1


def test_edits_of_different_things_are_not_asked_about(served: Any, both: tuple[Any, Any]) -> None:
    ann, ben = both
    _hold_back(ben)
    ann.press("e")
    ben.at(100)
    ben.press("e")
    assert ben.find("conflict").count() == 0
    assert ben.says("app.document.events.list.length") == 2
    assert {e.author for e in served.layer().events} == {"ann", "ben"}


@pytest.mark.parametrize(("button", "kept"), [("conflict-theirs", "by ann"), ("conflict-mine", "by ben")])
def test_an_edit_of_what_somebody_else_changed_shows_what_changed_and_asks(
    served: Any, both: tuple[Any, Any], button: str, kept: str
) -> None:
    ann, ben = both
    ann.press("e")
    ben.until("app.document.events.list.length === 1")
    _hold_back(ben)
    ben.find("tab-events").click()
    ben.find("row-a1").click()
    ben.find("tab-selected").click()
    ann.find("event-text").fill("by ann")
    ann.find("event-text").blur()
    ann.settle()
    ben.find("event-text").fill("by ben")
    ben.find("event-text").blur()
    dialog = ben.find("conflict")
    dialog.wait_for()
    assert "by ann" in dialog.inner_text()
    ben.find(button).click()
    ben.settle()
    assert ben.says("app.document.event('a1').text") == kept
    assert served.layer().events[0].text == kept


def test_an_edit_made_while_the_server_is_away_arrives_once_it_is_back(
    served: Any, window: Callable[..., Any]
) -> None:
    ann = window(served)
    ann.page.context.set_offline(True)
    ann.page.keyboard.press("e")
    ann.until("app.save === 'offline'")
    assert ann.find("save-state").inner_text() == "not connected"
    ann.page.context.set_offline(False)
    ann.settle()
    assert ann.find("save-state").inner_text() == "saved"
    assert len(served.layer().events) == 1


def test_an_edit_whose_answer_was_lost_is_not_made_twice(served: Any, window: Callable[..., Any]) -> None:
    ann = window(served)
    lost: list[str] = []

    def lose_the_first_answer(route: Any) -> None:
        route.fetch()
        lost.append(route.request.url)
        route.abort()
        ann.page.unroute("**/operations")

    ann.page.route("**/operations", lose_the_first_answer)
    ann.page.keyboard.press("e")
    ann.until("app.document.events.list.length === 1")
    ann.settle()
    assert len(lost) == 1
    assert len(served.layer().events) == 1


def test_what_is_pressed_twice_while_the_server_is_away_is_done_twice(
    served: Any, window: Callable[..., Any]
) -> None:
    ann = window(served)
    ann.press("e")
    end = ann.says("app.selectedEvent.segments[0].end_frame")
    ann.page.context.set_offline(True)
    for key in ("}", "}", "}", "{", "u", "u"):
        ann.page.keyboard.press(key)
    ann.until("app.save === 'offline'")
    ann.page.context.set_offline(False)
    ann.settle()
    (event,) = served.layer().events
    assert event.segments[0].end_frame == end + 2
    assert not event.unsure


@pytest.fixture
def conflicting(served: Any, both: tuple[Any, Any]) -> tuple[Any, Any]:
    """Ann has moved the edge of an event, which Ben does not know and is about to do, too."""
    ann, ben = both
    ann.press("e")
    ben.until("app.document.events.list.length === 1")
    _hold_back(ben)
    ben.find("tab-events").click()
    ben.find("row-a1").click()
    ann.find("segment-0-end").fill("50")
    ann.find("segment-0-end").press("Enter")
    ann.settle()
    return ann, ben


def test_a_conflict_shows_both_and_leaving_it_keeps_theirs(served: Any, conflicting: tuple[Any, Any]) -> None:
    _, ben = conflicting
    ben.page.keyboard.press("}")
    dialog = ben.find("conflict")
    dialog.wait_for()
    said = dialog.inner_text()
    assert "ann changed a1" in said
    assert "50" in said
    assert "Yours" in said
    assert "move edge" in said
    ben.page.keyboard.press("Escape")
    dialog.wait_for(state="detached")
    ben.settle()
    ben.find("toasts").get_by_text("Your change was left out").wait_for()
    assert served.layer().events[0].segments[0].end_frame == 50
    assert ben.says("app.document.event('a1').segments[0].end_frame") == 50


def test_while_a_conflict_is_decided_no_key_edits_anything(served: Any, conflicting: tuple[Any, Any]) -> None:
    _, ben = conflicting
    ben.page.keyboard.press("}")
    ben.find("conflict").wait_for()
    for key in ("e", "Delete", "s"):
        ben.page.keyboard.press(key)
    ben.find("conflict-mine").click()
    ben.settle()
    layer = served.layer()
    assert [e.id for e in layer.events] == ["a1"]
    assert layer.events[0].segments[0].end_frame == 31, "what Ben had seen and moved by one"
    assert ben.says("app.active.canUndo")
    ben.press("Control+z")
    assert served.layer().events[0].segments[0].end_frame == 50


def test_a_part_that_somebody_added_meanwhile_is_asked_about(served: Any, both: tuple[Any, Any]) -> None:
    ann, ben = both
    ann.press("e")
    ben.until("app.document.events.list.length === 1")
    _hold_back(ben)
    ben.find("tab-events").click()
    ben.find("row-a1").click()
    ann.press("u")
    ben.page.keyboard.press("Delete")
    ben.find("conflict").wait_for()
    assert "unsure" in ben.find("conflict").inner_text()
    ben.find("conflict-mine").click()
    ben.settle()
    assert served.layer().events == ()
