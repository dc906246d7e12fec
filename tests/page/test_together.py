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
    window.page.evaluate(
        "() => { window.ecat.socket.onmessage = null; window.ecat.onLive = () => undefined; }"
    )


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
