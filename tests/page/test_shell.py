"""The frame around the widgets: keys, help, layers, proposals, the project, and who can use it."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import resources
from typing import Any

import pytest

from ecat.model import Layer

AXE = resources.files("axe_playwright_python") / "axe.min.js"


def test_no_shortcut_fires_while_text_is_typed(served: Any, annotating: Any) -> None:
    annotating.press("e")
    frame = annotating.says("app.cursor.frame")
    text = annotating.find("event-text")
    text.click()
    annotating.page.keyboard.type("sub-event? [1] {2} Delete: n e s m u j k l")
    annotating.page.keyboard.press("ArrowLeft")
    annotating.page.keyboard.press("Backspace")
    text.blur()
    annotating.settle()
    assert annotating.says("[app.cursor.frame, app.cursor.playing, app.settings.tool]") == [
        frame,
        False,
        "select",
    ]
    events = served.layer().events
    assert [e.text for e in events] == ["sub-event? [1] {2} Delete: n e s m u j kl"]
    assert not events[0].unsure


def test_keys_move_the_cursor_and_the_selection(annotating: Any) -> None:
    for start in (30, 80):
        annotating.at(start)
        annotating.press("e")
    annotating.at(50)
    annotating.press("ArrowRight", "Shift+ArrowRight", "ArrowLeft")
    assert annotating.says("app.cursor.frame") == 60
    annotating.press("Control+ArrowRight")
    assert annotating.says("app.cursor.frame") == 80
    annotating.press("ArrowUp")
    assert annotating.says("[app.selectedEvent.id, app.cursor.frame]") == ["a1", 30]
    annotating.press("ArrowDown")
    assert annotating.says("app.selectedEvent.id") == "a2"
    annotating.press("l", "l")
    assert annotating.says("app.cursor.speed") == 2
    annotating.press("j")
    assert annotating.says("app.cursor.speed") == 1.5
    annotating.press("Escape")
    assert annotating.says("app.selection.length") == 0


def test_the_help_names_every_shortcut_and_every_label(annotating: Any) -> None:
    annotating.press("?")
    text = annotating.find("help").inner_text()
    for label in (
        "Play or pause",
        "Split at the cursor",
        "Unsure",
        "Reject the proposal",
        "Draw a polygon",
        "Redo",
        "slide_next",
        "release",
    ):
        assert label in text
    annotating.press("Escape")
    annotating.find("help").wait_for(state="detached")


def test_a_button_pressed_with_the_mouse_does_not_keep_the_space_bar(annotating: Any) -> None:
    annotating.find("tab-events").click()
    annotating.press(" ")
    assert annotating.says("app.cursor.playing")


def test_each_annotator_has_a_layer_and_sees_the_others(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.new_layer("ben")
    annotating.at(100)
    annotating.press("e")
    assert annotating.says("app.shownLayers.map(l => l.name)") == ["ben", "main"]
    assert [len(served.layer(name).events) for name in ("main", "ben")] == [1, 1]


def test_a_theme_can_be_chosen_and_is_remembered(annotating: Any) -> None:
    annotating.find("theme").click()
    annotating.find("theme").click()
    assert annotating.says("document.documentElement.dataset.theme") == "dark"
    annotating.page.reload()
    annotating.opened()
    assert annotating.says("document.documentElement.dataset.theme") == "dark"


def test_an_operation_that_is_refused_says_why_and_changes_nothing(served: Any, annotating: Any) -> None:
    annotating.press("e")
    annotating.find("segment-0-end").fill("0")
    annotating.find("segment-0-end").press("Enter")
    annotating.find("toasts").get_by_text("cannot").first.wait_for()
    said = annotating.find("toasts").inner_text().split("\n")
    assert "nothing was changed" in said, "what became of it stands on a line of its own"
    assert served.layer().events[0].segments[0].end_frame > 0


def test_colours_names_and_key_frames_of_an_object_are_edited_in_the_inspector(
    served: Any, annotating: Any
) -> None:
    annotating.find("tab-objects").click()
    annotating.find("row-o2").click()
    annotating.find("tab-selected").click()
    annotating.find("object-semantic").fill("block")
    annotating.find("object-semantic").press("Enter")
    annotating.settle()
    annotating.find("property-name").fill("made of")
    annotating.find("property-value").fill("card")
    annotating.find("property-value").press("Enter")
    annotating.settle()
    thing = next(o for o in served.layer().objects if o.id == "o2")
    assert thing.semantic_type == "block"
    assert [(p.name, p.value) for p in thing.properties] == [("made of", "card")]


def _serious(window: Any) -> list[str]:
    """What axe finds that keeps people out."""
    # by the browser itself: the page's own policy lets no script in that is not its own
    window.page.evaluate(AXE.read_text(encoding="utf-8"))
    found = window.page.evaluate("() => axe.run(document, { resultTypes: ['violations'] })")
    return [
        f"{v['id']}: {v['nodes'][0]['html'][:160]} {json.dumps(v['nodes'][0].get('any', [])[:1])[:200]}"
        for v in found["violations"]
        if v["impact"] in {"serious", "critical"}
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(served: Any, window: Callable[..., Any], scheme: str) -> None:
    page = window(served, color_scheme=scheme)
    page.press("e")
    assert _serious(page) == []
    page.find("tab-relations").click()
    assert _serious(page) == []
    page.press("?")
    assert _serious(page) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious_in_any_dialog(
    served: Any, window: Callable[..., Any], scheme: str
) -> None:
    page = window(served, color_scheme=scheme)
    for button in ("session-button", "windows-button", "scheme-button", "layer-button", "history-button"):
        page.find(button).click()
        page.page.wait_for_selector("dialog[open]")
        assert _serious(page) == [], button
        page.page.keyboard.press("Escape")
    page.find("tab-objects").click()
    page.find("row-o2").click()
    page.find("tab-selected").click()
    assert _serious(page) == []
    page.find("session-button").click()
    page.find("add-skeleton").click()
    assert _serious(page) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious_in_the_list_of_sessions(
    served: Any, window: Callable[..., Any], scheme: str
) -> None:
    page = window(served, color_scheme=scheme)
    page.page.evaluate("() => { location.hash = '#/'; }")
    page.find("statistics").wait_for()
    assert _serious(page) == []
    for button in (
        "new-project", "import-recording", "windows-everywhere", "find-everywhere", f"delete-{served.path.name}",
    ):  # fmt: skip
        page.find(button).click()
        page.page.wait_for_selector("dialog[open]")
        assert _serious(page) == [], button
        page.page.keyboard.press("Escape")
    assert page.complaints == []


def test_a_dialog_that_the_mouse_opened_does_not_keep_the_space_bar(annotating: Any) -> None:
    annotating.find("windows-button").click()
    annotating.page.keyboard.press("Escape")
    annotating.closed("windows")
    annotating.press(" ")
    assert annotating.says("app.cursor.playing")
    assert annotating.find("windows").count() == 0


def test_the_system_decides_about_light_and_dark_until_somebody_does(
    served: Any, window: Callable[..., Any]
) -> None:
    page = window(served, color_scheme="dark")
    surface = "getComputedStyle(document.documentElement).getPropertyValue('--surface').trim()"
    dark = page.says(surface)
    page.page.emulate_media(color_scheme="light")
    page.until("document.documentElement.dataset.theme === 'light'")
    light = page.says(surface)
    assert light != dark
    page.find("theme").click()
    page.find("theme").click()
    page.until("document.documentElement.dataset.theme === 'dark'")
    assert page.says(surface) == dark


def test_a_layer_of_the_page_is_one_of_the_package(served: Any, annotating: Any) -> None:
    """What the page holds is what the store reads: the mirror applies records as the package does."""
    annotating.press("e", "n", "u", "Control+z", "Delete", "Control+z")
    shown = annotating.says(
        "app.document.events.list.map("
        "e => [e.id, e.parent, e.unsure, e.segments.map(s => [s.start_frame, s.end_frame])])"
    )
    layer: Layer = served.layer()
    assert shown == [
        [e.id, e.parent, e.unsure, [[s.start_frame, s.end_frame] for s in e.segments]] for e in layer.events
    ]
