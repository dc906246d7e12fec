"""Objects and streams on the stage, by mouse and inspector."""

from __future__ import annotations

from typing import Any

from tests.page.filming import client, drag, keys_of


def test_an_object_gets_its_colour_line_key_frames_and_absence(stage: Any, filmed: Any) -> None:
    stage.at(10)
    stage.press("r")
    drag(stage, client(stage, 20, 30), client(stage, 60, 70))
    stage.settle()
    stage.find("object-color").evaluate(
        "(input) => { input.value = '#123456'; input.dispatchEvent(new Event('change')); }"
    )
    stage.settle()
    stage.page.get_by_label("Line width").fill("4")
    stage.page.get_by_label("Line width").press("Enter")
    stage.settle()
    stage.find("object-interpolation").select_option("hold")
    stage.settle()
    stage.at(40)
    # the field that was left keeps no key: the shape that is shown becomes a key frame of its own
    stage.find("add-key").click()
    stage.settle()
    stage.at(60)
    stage.find("set-absent").click()
    stage.settle()
    layer = filmed.layer()
    thing = layer.objects[-1]
    assert (thing.color[:7], thing.line_width, thing.interpolation) == ("#123456", 4, "hold")
    assert [(key.frame, key.present) for key in thing.key_frames] == [(10, True), (40, True), (60, False)]
    stage.page.get_by_label("Remove the key frame at 60").click()
    stage.settle()
    assert sorted(keys_of(filmed.layer())) == [10, 40]


def test_a_shape_is_selected_by_a_click_and_removed(stage: Any, filmed: Any) -> None:
    stage.at(10)
    stage.press("r")
    drag(stage, client(stage, 20, 30), client(stage, 60, 70))
    stage.settle()
    # the first one leaves the name
    stage.press("Escape", "Escape")
    assert stage.says("app.selection.length") == 0
    # there is no grip left in its middle, which would take the click
    stage.page.mouse.click(*client(stage, 40, 50))
    assert stage.says("app.selectedObject.kind") == "rectangle"
    before = len(filmed.layer().objects)
    stage.press("Delete")
    assert len(filmed.layer().objects) == before - 1


def test_grips_go_with_the_choice_and_not_with_the_next_picture(stage: Any) -> None:
    stage.at(10)
    stage.press("r")
    drag(stage, client(stage, 20, 30), client(stage, 60, 70))
    stage.find("centroid").wait_for()
    left = "() => { window.ecat.select([]); return document.querySelectorAll('.grip').length; }"
    assert stage.page.evaluate(left) == 0


def test_the_stream_is_chosen_and_streams_stand_side_by_side(stage: Any) -> None:
    stage.find("stream-depth").click()
    stage.page.wait_for_selector('.stage [data-testid="pane-depth"]')
    assert stage.page.locator('.stage [data-testid="pane-color"]').count() == 0
    stage.find("stream-color").click(modifiers=["Shift"])
    stage.page.wait_for_selector('.stage [data-testid="pane-color"]')
    assert stage.page.locator('.stage [data-testid="pane-depth"]').count() == 1
