"""The stage: video, shapes, depth and timeline under a real hand, with assertions on what is on the disk."""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from ecat.web.exact import bounds_of
from tests.page.filming import (
    BITS,
    DEPTH_HEIGHT,
    DEPTH_WIDTH,
    HALF_PX,
    READ_NUMBER,
    TO_CLIENT,
    WAIT_MS,
    client,
    depth_image,
    drag,
    keys_of,
    open_filmed,
    show,
    span_of,
)

# --- images


def test_every_seek_shows_the_very_image(stage: Any) -> None:
    n = stage.says("app.nFrames")
    chosen = random.Random(4).sample(range(1, n), 20)
    found: list[int] = []
    for frame in chosen:
        show(stage, frame)
        found.append(stage.page.evaluate(READ_NUMBER, BITS))
    assert found == chosen


def test_what_is_shown_when_playing_stops_is_what_the_cursor_says(stage: Any) -> None:
    show(stage, 10)
    stage.page.keyboard.press("Space")
    stage.until("app.cursor.frame > 25")
    stage.page.keyboard.press("Space")
    frame = stage.says("app.cursor.frame")
    stage.page.wait_for_selector(f'[data-testid="pane-color"][data-frame="{frame}"]', timeout=WAIT_MS)
    assert stage.page.evaluate(READ_NUMBER, BITS) == frame


def test_a_loop_is_not_left(stage: Any) -> None:
    stage.page.evaluate("() => { window.seen = []; ecat.on('cursor', (c) => window.seen.push(c.frame)); }")
    stage.find("event-a2").dblclick()
    stage.page.keyboard.press("Space")
    stage.page.wait_for_function(
        "() => window.seen.filter((frame, i) => i > 0 && frame < window.seen[i - 1]).length >= 2",
        timeout=WAIT_MS,
    )
    stage.page.keyboard.press("Space")
    seen: list[int] = stage.page.evaluate("window.seen")
    assert stage.says("app.cursor.loop") == [30, 50]
    assert set(seen) <= set(range(30, 50))
    assert sum(b < a for a, b in pairwise(seen)) >= 2


def test_depth_under_the_pointer_is_the_stored_one(stage: Any) -> None:
    show(stage, 60)
    pane = stage.page.locator('#depth [data-testid="pane-depth"]')
    image = 60
    stage.page.wait_for_selector(f'#depth [data-testid="pane-depth"][data-frame="{image}"]', timeout=WAIT_MS)
    box = pane.bounding_box()
    scale = min(box["width"] / DEPTH_WIDTH, box["height"] / DEPTH_HEIGHT)
    left = box["x"] + (box["width"] - DEPTH_WIDTH * scale) / 2
    top = box["y"] + (box["height"] - DEPTH_HEIGHT * scale) / 2
    for u, v in ((0, 5), (17, 8), (63, 47)):
        stage.page.mouse.move(left + (u + 0.5) * scale, top + (v + 0.5) * scale)
        raw = int(depth_image(image)[v, u])
        wanted = f"{raw} mm" if raw else "no depth"
        stage.page.wait_for_function(
            "([text, pixel]) => { const t = document.querySelector('[data-testid=depth-readout]').textContent;"
            " return t.startsWith(text) && t.endsWith(pixel); }",
            arg=[wanted, f"pixel {u}, {v}"],
            timeout=WAIT_MS,
        )


# --- shapes


def test_the_colours_of_depth_are_explained_in_numbers(stage: Any, filmed: Any) -> None:
    legend = stage.find("depth-legend")
    stage.page.wait_for_function(
        "() => /\\d/.test(document.querySelector('[data-testid=depth-legend]').textContent)"
    )
    found = stage.says("app.api.depthRange(app.session.id, 'depth')")
    assert [1000 * found["near_m"], 1000 * found["far_m"]] == pytest.approx(bounds_of(depth_image(0)))
    near, middle, far = (found["near_m"], (found["near_m"] + found["far_m"]) / 2, found["far_m"])
    words = [f"{1000 * m:.0f} mm" if m < 0.9995 else f"{m:.2f} m" for m in (near, middle, far)]
    text = legend.inner_text().replace("\n", " ")
    assert [text.index(word) for word in words] == sorted(text.index(word) for word in words)


def test_a_rectangle_is_drawn_and_gets_a_key_frame_where_it_is_changed(stage: Any, filmed: Any) -> None:
    show(stage, 10)
    stage.press("r")
    drag(stage, client(stage, 20, 30), client(stage, 60, 70))
    show(stage, 40)
    drag(stage, client(stage, 60, 70), client(stage, 90, 85))
    keys = keys_of(filmed.layer())
    assert keys[10] == pytest.approx((20, 30, 40, 40), abs=HALF_PX)
    assert keys[40] == pytest.approx((20, 30, 70, 55), abs=HALF_PX)
    assert list(keys) == [10, 40]
    # between them it is where neither was drawn
    stage.at(25)
    stage.page.wait_for_function(
        "([id, wanted, least]) => document.querySelector(`[data-testid=shape-${id}]`)?.dataset.key.split(' ')"
        ".every((n, i) => Math.abs(Number(n) - wanted[i]) <= least)",
        arg=[filmed.layer().objects[-1].id, [20, 30, 55, 47.5], HALF_PX],
        timeout=WAIT_MS,
    )


def test_a_polygon_loses_a_vertex_gains_one_and_is_moved(stage: Any, filmed: Any) -> None:
    show(stage, 5)
    stage.press("g")
    for u, v in ((20, 20), (60, 20), (140, 90)):
        stage.page.mouse.click(*client(stage, u, v))
    stage.page.keyboard.press("Backspace")
    for u, v in ((60, 60), (20, 60)):
        stage.page.mouse.click(*client(stage, u, v))
    stage.page.keyboard.press("Enter")
    stage.page.wait_for_selector('[data-testid="vertex-3"]')
    stage.settle()
    assert keys_of(filmed.layer())[5] == pytest.approx((20, 20, 60, 20, 60, 60, 20, 60), abs=HALF_PX)

    drag(stage, client(stage, 40, 20), client(stage, 40, 10))
    assert keys_of(filmed.layer())[5] == pytest.approx((20, 20, 40, 10, 60, 20, 60, 60, 20, 60), abs=HALF_PX)
    stage.find("vertex-3").focus()
    stage.press("Delete")
    assert keys_of(filmed.layer())[5] == pytest.approx((20, 20, 40, 10, 60, 20, 20, 60), abs=HALF_PX)
    drag(stage, client(stage, 35, 27.5), client(stage, 55, 37.5))
    assert keys_of(filmed.layer())[5] == pytest.approx((40, 30, 60, 20, 80, 30, 40, 70), abs=HALF_PX)


def test_what_is_drawn_zoomed_and_on_a_fine_screen_lies_where_it_was_drawn(
    filmed: Any, window: Callable[..., Any]
) -> None:
    fine = open_filmed(window, filmed, device_scale_factor=2)
    x, y = client(fine, 100, 50)
    wide = client(fine, 110, 50)[0] - x
    # a wheel turns at a whole point of the screen, whatever part of an image's pixel that shows
    left, above = x % 1, y % 1
    u, v = 100 - left * 10 / wide, 50 - above * 10 / wide
    x, y = x - left, y - above
    fine.page.mouse.move(x, y)
    for _ in range(8):
        fine.page.mouse.wheel(0, -100)
    # together they make it e times as large, and all but the last one less than 2.5 times
    fine.page.wait_for_function(
        f"([pixel, least]) => ({TO_CLIENT})([pixel, 50])[0] > least",
        arg=[110, x + 2.6 * wide],
        timeout=WAIT_MS,
    )
    assert client(fine, u, v) == pytest.approx((x, y), abs=0.5)
    fine.press("r")
    drag(fine, client(fine, 95, 48), client(fine, 106.5, 54.25))
    assert keys_of(filmed.layer())[0] == pytest.approx((95, 48, 11.5, 6.25), abs=0.1)
    assert fine.complaints == []


def test_an_edit_is_given_up_with_escape(stage: Any, filmed: Any) -> None:
    stage.press("r")
    drag(stage, client(stage, 20, 30), client(stage, 60, 70))
    before = filmed.layer().objects[-1]
    stage.page.mouse.move(*client(stage, 60, 70))
    stage.page.mouse.down()
    stage.page.mouse.move(*client(stage, 90, 80), steps=3)
    stage.page.keyboard.press("Escape")
    stage.page.mouse.up()
    stage.settle()
    assert filmed.layer().objects[-1] == before


# --- timeline


def _lane(window: Any, frame: float) -> float:
    """Where a frame is on the screen: the whole recording is in view."""
    box = window.find("lanes").bounding_box()
    return float(box["x"] + box["width"] * frame / window.says("app.nFrames"))


def _middle(window: Any, test_id: str) -> float:
    box = window.find(test_id).bounding_box()
    return float(box["y"] + box["height"] / 2)


def test_an_edge_is_dragged_to_the_very_frame(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 87) - 1, y))
    assert span_of(filmed.layer(), "a1") == (20, 87)
    assert stage.says("app.cursor.frame") == 86


def test_an_edge_snaps_to_its_neighbour(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 95) - 5, y))
    assert span_of(filmed.layer(), "a1") == (20, 95)


def test_a_sub_event_stays_within_its_event(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a2")
    drag(stage, (_lane(stage, 50) - 1, y), (_lane(stage, 120), y))
    assert span_of(filmed.layer(), "a2") == (30, 80)


def test_an_event_takes_its_parts_along(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    stage.page.keyboard.down("Alt")
    drag(stage, (_lane(stage, 65), y), (_lane(stage, 70), y))
    stage.page.keyboard.up("Alt")
    layer = filmed.layer()
    assert (span_of(layer, "a1"), span_of(layer, "a2")) == ((25, 85), (35, 55))


def test_shortening_an_event_asks_before_its_part_is_cut(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 40) - 1, y))
    stage.find("question-yes").click()
    stage.until("app.document.event('a2').segments[0].end_frame === 40")
    layer = filmed.layer()
    assert (span_of(layer, "a1"), span_of(layer, "a2")) == ((20, 40), (30, 40))


def test_dragging_in_an_empty_lane_makes_an_event(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a3")
    drag(stage, (_lane(stage, 130), y), (_lane(stage, 145), y))
    (made,) = (event for event in filmed.layer().events if event.id not in {"a1", "a2", "a3"})
    assert (made.tier, made.status, made.author) == ("event", "confirmed", "ann")
    assert (made.segments[0].start_frame, made.segments[0].end_frame) == (130, 145)


def test_proposals_are_accepted_adjusted_and_rejected(stage: Any, filmed: Any) -> None:
    stage.find("proposal-a1").click()
    stage.find("timeline-accept").click()
    stage.until("app.decided('a1') === 'accepted'")
    stage.find("proposal-a2").click()
    stage.find("timeline-reject").click()
    stage.until("app.decided('a2') === 'rejected'")
    layer = filmed.layer()
    verdicts = {decision.proposal: (decision.verdict, decision.author) for decision in layer.decisions}
    assert verdicts == {"machine/a1": ("accepted", "ann"), "machine/a2": ("rejected", "ann")}
    (made,) = (event for event in layer.events if event.type == "slide_away")
    assert (made.status, span_of(layer, made.id)) == ("confirmed", (40, 70))
    for name in ("a1", "a2"):
        stage.find(f"proposal-{name}").wait_for(state="detached")
    assert {event.status for event in filmed.session().layer("machine").events} == {"proposed"}


def test_a_proposal_whose_edge_is_dragged_is_accepted_with_it(stage: Any, filmed: Any) -> None:
    stage.find("proposal-a2").click()
    y = _middle(stage, "proposal-a2")
    stage.page.keyboard.down("Alt")
    drag(stage, (_lane(stage, 90) + 1, y), (_lane(stage, 84) + 1, y))
    stage.page.keyboard.up("Alt")
    stage.until("app.decided('a2') === 'accepted'")
    layer = filmed.layer()
    made = layer.decisions[0].result
    assert span_of(layer, made) == (84, 110)


def test_the_keyboard_reaches_an_event(stage: Any) -> None:
    stage.find("event-a3").focus()
    assert stage.says("app.primary.id") == "a3"
    assert "slide_past, frames 95 to 120" in stage.find("event-a3").get_attribute("aria-label")
