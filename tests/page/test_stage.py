"""The stage: video, shapes, depth and timeline under a real hand, with assertions on what is on the disk."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable, Generator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.model import AnnotatedObject, Event, Layer, Segment, Stream
from ecat.sample import sample_session
from ecat.store import create_session
from ecat.store.media import ColorWriter, DepthWriter
from ecat.web.exact import bounds_of

WIDTH, HEIGHT = 160, 96
DEPTH_WIDTH, DEPTH_HEIGHT = 64, 48
BITS = 8
WAIT_MS = 20_000
HALF_PX = 0.51
"""A hand hits a pixel of the screen, which is less than half a pixel of these images."""

TO_CLIENT = """
([u, v]) => {
  const pane = document.querySelector('[data-testid="pane-color"]');
  const box = pane.getBoundingClientRect();
  const { a, e, f } = new DOMMatrix(getComputedStyle(pane.querySelector('video')).transform);
  return [box.left + e + a * u, box.top + f + a * v];
}
"""
READ_NUMBER = """
(bits) => {
  const video = document.querySelector('[data-testid="pane-color"] video');
  const canvas = new OffscreenCanvas(160, 96);
  const context = canvas.getContext('2d');
  context.drawImage(video, 0, 0, 160, 96);
  let value = 0;
  for (let bit = 0; bit < bits; bit++)
    if (context.getImageData(10 + 20 * bit, 10, 1, 1).data[0] > 128) value |= 1 << bit;
  return value;
}
"""


def _color(k: int) -> NDArray[np.uint8]:
    """An image (height, width, 3) with the bits of ``k`` as squares along its upper edge."""
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    for bit in range(BITS):
        image[2:18, 20 * bit + 2 : 20 * bit + 18] = 255 if k >> bit & 1 else 0
    return image


def _depth(k: int) -> NDArray[np.uint16]:
    """An image (height, width) in millimetres that tells row, column and number; the first column has no depth."""
    rows, columns = np.mgrid[:DEPTH_HEIGHT, :DEPTH_WIDTH]
    image = (700 + 31 * rows + 3 * columns + k).astype(np.uint16)
    image[:, 0] = 0
    return image


def _event(name: str, start: int, end: int, **more: Any) -> Event:
    return Event(id=name, segments=(Segment(start_frame=start, end_frame=end),), **more)


@pytest.fixture(scope="session")
def filmed_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with small videos whose images tell their number, some events, and what a machine proposes."""
    base = tmp_path_factory.mktemp("stage")
    draft, _ = sample_session(seed=3, actions=("next",), name="filmed")
    n = draft.manifest.n_frames
    with (
        ColorWriter(base / "color.mp4", WIDTH, HEIGHT) as color,
        DepthWriter(base / "depth.mkv", DEPTH_WIDTH, DEPTH_HEIGHT) as depth,
    ):
        for k in range(n):
            # at no constant rate, so that the recording is no proxy of itself
            color.write(_color(k), k * 33_000_000 + (k % 3) * 4_000_000)
            depth.write(_depth(k), k * 33_000_000)
    size: dict[Literal["color", "depth"], tuple[int, int]] = {
        "color": (WIDTH, HEIGHT),
        "depth": (DEPTH_WIDTH, DEPTH_HEIGHT),
    }
    files = {"color": base / "color.mp4", "depth": base / "depth.mkv"}
    streams = tuple(
        Stream(
            name=kind,
            kind=kind,
            file=f"media/{files[kind].name}",
            camera=kind,
            n_frames=n,
            width_px=w,
            height_px=h,
        )
        for kind, (w, h) in size.items()
    )
    main = Layer(
        name="main",
        scheme="blocks",
        event_counter=9,
        objects=(AnnotatedObject(id="o9", name="Shell", kind="marker_box"),),
        object_counter=9,
        events=(
            _event("a1", 20, 80, type="slide_next", tier="event"),
            _event("a2", 30, 50, type="grasp", tier="sub-event", parent="a1"),
            _event("a3", 95, 120, type="slide_past", tier="event"),
        ),
    )
    machine = Layer(
        name="machine",
        event_counter=2,
        events=(
            _event("a1", 40, 70, type="slide_away", tier="event", status="proposed"),
            _event("a2", 90, 110, type="slide_past", tier="event", status="proposed"),
        ),
    )
    manifest = replace(draft.manifest, streams=streams)
    create_session(base / "filmed", replace(draft, manifest=manifest, layers=(main, machine), files=files))
    return base / "filmed"


@pytest.fixture
def filmed(served: Any, filmed_once: Path) -> Any:
    """A copy of it on the running server."""
    return replace(
        served, path=Path(shutil.copytree(filmed_once, served.path.with_name(f"{served.path.name}-filmed")))
    )


@pytest.fixture
def stage(filmed: Any, window: Callable[..., Any]) -> Generator[Any]:
    """The filmed session with its videos ready, opened."""
    made = _open(window, filmed)
    yield made
    assert made.complaints == []


def _open(window: Callable[..., Any], filmed: Any, **options: Any) -> Any:
    made = window(filmed, **options)
    made.page.wait_for_selector(
        '[data-testid="pane-color"][data-source="video"][data-frame]', timeout=WAIT_MS
    )
    return made


def _client(window: Any, u: float, v: float) -> tuple[float, float]:
    x, y = window.page.evaluate(TO_CLIENT, [u, v])
    return x, y


def _drag(window: Any, start: tuple[float, float], *through: tuple[float, float]) -> None:
    """Press, move, let go; the points are those of the screen."""
    mouse = window.page.mouse
    mouse.move(*start)
    mouse.down()
    for point in through:
        mouse.move(*point, steps=4)
    mouse.up()
    window.page.wait_for_timeout(50)
    window.settle()


def _shown(window: Any, frame: int) -> None:
    """Go to a frame, and wait until its image is there."""
    window.at(frame)
    window.page.wait_for_selector(f'[data-testid="pane-color"][data-frame="{frame}"]', timeout=WAIT_MS)


def _keys(layer: Layer, index: int = -1) -> dict[int, tuple[float, ...]]:
    return {key.frame: key.coordinates for key in layer.objects[index].key_frames}


def _span(layer: Layer, name: str) -> tuple[int, int]:
    (found,) = (event for event in layer.events if event.id == name)
    return found.segments[0].start_frame, found.segments[-1].end_frame


# --- images


def test_every_seek_shows_the_very_image(stage: Any) -> None:
    n = stage.says("app.nFrames")
    chosen = random.Random(4).sample(range(1, n), 20)
    found: list[int] = []
    for frame in chosen:
        _shown(stage, frame)
        found.append(stage.page.evaluate(READ_NUMBER, BITS))
    assert found == chosen


def test_what_is_shown_when_playing_stops_is_what_the_cursor_says(stage: Any) -> None:
    _shown(stage, 10)
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
    stage.page.wait_for_timeout(2500)
    stage.page.keyboard.press("Space")
    seen: list[int] = stage.page.evaluate("window.seen")
    assert stage.says("app.cursor.loop") == [30, 50]
    assert set(seen) <= set(range(30, 50))
    assert sum(b < a for a, b in pairwise(seen)) >= 2


def test_depth_under_the_pointer_is_the_stored_one(stage: Any) -> None:
    _shown(stage, 60)
    pane = stage.page.locator('#depth [data-testid="pane-depth"]')
    image = stage.says(
        "app.session.streams.find((s) => s.name === 'depth') && document.querySelector('#depth .pane').dataset.frame"
    )
    box = pane.bounding_box()
    scale = min(box["width"] / DEPTH_WIDTH, box["height"] / DEPTH_HEIGHT)
    left = box["x"] + (box["width"] - DEPTH_WIDTH * scale) / 2
    top = box["y"] + (box["height"] - DEPTH_HEIGHT * scale) / 2
    for u, v in ((0, 5), (17, 8), (63, 47)):
        stage.page.mouse.move(left + (u + 0.5) * scale, top + (v + 0.5) * scale)
        raw = int(_depth(int(image))[v, u])
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
    assert [1000 * found["near_m"], 1000 * found["far_m"]] == pytest.approx(bounds_of(_depth(0)))
    near, middle, far = (found["near_m"], (found["near_m"] + found["far_m"]) / 2, found["far_m"])
    words = [f"{1000 * m:.0f} mm" if m < 0.9995 else f"{m:.2f} m" for m in (near, middle, far)]
    text = legend.inner_text().replace("\n", " ")
    assert [text.index(word) for word in words] == sorted(text.index(word) for word in words)


def test_a_rectangle_is_drawn_and_gets_a_key_frame_where_it_is_changed(stage: Any, filmed: Any) -> None:
    _shown(stage, 10)
    stage.press("r")
    _drag(stage, _client(stage, 20, 30), _client(stage, 60, 70))
    _shown(stage, 40)
    _drag(stage, _client(stage, 60, 70), _client(stage, 90, 85))
    keys = _keys(filmed.layer())
    assert keys[10] == pytest.approx((20, 30, 40, 40), abs=HALF_PX)
    assert keys[40] == pytest.approx((20, 30, 70, 55), abs=HALF_PX)
    assert list(keys) == [10, 40]
    # between them it is where neither was drawn
    stage.at(25)
    stage.page.wait_for_timeout(500)
    told = stage.page.locator(f'[data-testid="shape-{filmed.layer().objects[-1].id}"]').get_attribute(
        "data-key"
    )
    assert [float(n) for n in told.split()] == pytest.approx((20, 30, 55, 47.5), abs=HALF_PX)


def test_a_polygon_loses_a_vertex_gains_one_and_is_moved(stage: Any, filmed: Any) -> None:
    _shown(stage, 5)
    stage.press("g")
    for u, v in ((20, 20), (60, 20), (140, 90)):
        stage.page.mouse.click(*_client(stage, u, v))
    stage.page.keyboard.press("Backspace")
    for u, v in ((60, 60), (20, 60)):
        stage.page.mouse.click(*_client(stage, u, v))
    stage.page.keyboard.press("Enter")
    stage.page.wait_for_selector('[data-testid="vertex-3"]')
    stage.settle()
    assert _keys(filmed.layer())[5] == pytest.approx((20, 20, 60, 20, 60, 60, 20, 60), abs=HALF_PX)

    _drag(stage, _client(stage, 40, 20), _client(stage, 40, 10))
    assert _keys(filmed.layer())[5] == pytest.approx((20, 20, 40, 10, 60, 20, 60, 60, 20, 60), abs=HALF_PX)
    stage.find("vertex-3").focus()
    stage.press("Delete")
    assert _keys(filmed.layer())[5] == pytest.approx((20, 20, 40, 10, 60, 20, 20, 60), abs=HALF_PX)
    _drag(stage, _client(stage, 35, 27.5), _client(stage, 55, 37.5))
    assert _keys(filmed.layer())[5] == pytest.approx((40, 30, 60, 20, 80, 30, 40, 70), abs=HALF_PX)


def test_what_is_drawn_zoomed_and_on_a_fine_screen_lies_where_it_was_drawn(
    filmed: Any, window: Callable[..., Any]
) -> None:
    fine = _open(window, filmed, device_scale_factor=2)
    x, y = _client(fine, 100, 50)
    fine.page.mouse.move(x, y)
    for _ in range(8):
        fine.page.mouse.wheel(0, -100)
    fine.page.wait_for_timeout(200)
    assert _client(fine, 100, 50) == pytest.approx((x, y), abs=0.5)
    fine.press("r")
    _drag(fine, _client(fine, 95, 48), _client(fine, 106.5, 54.25))
    assert _keys(filmed.layer())[0] == pytest.approx((95, 48, 11.5, 6.25), abs=0.1)
    assert fine.complaints == []


def test_an_edit_is_given_up_with_escape(stage: Any, filmed: Any) -> None:
    stage.press("r")
    _drag(stage, _client(stage, 20, 30), _client(stage, 60, 70))
    before = filmed.layer().objects[-1]
    stage.page.mouse.move(*_client(stage, 60, 70))
    stage.page.mouse.down()
    stage.page.mouse.move(*_client(stage, 90, 80), steps=3)
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
    _drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 87) - 1, y))
    assert _span(filmed.layer(), "a1") == (20, 87)
    assert stage.says("app.cursor.frame") == 86


def test_an_edge_snaps_to_its_neighbour(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    _drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 95) - 5, y))
    assert _span(filmed.layer(), "a1") == (20, 95)


def test_a_sub_event_stays_within_its_event(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a2")
    _drag(stage, (_lane(stage, 50) - 1, y), (_lane(stage, 120), y))
    assert _span(filmed.layer(), "a2") == (30, 80)


def test_an_event_takes_its_parts_along(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    stage.page.keyboard.down("Alt")
    _drag(stage, (_lane(stage, 65), y), (_lane(stage, 70), y))
    stage.page.keyboard.up("Alt")
    layer = filmed.layer()
    assert (_span(layer, "a1"), _span(layer, "a2")) == ((25, 85), (35, 55))


def test_shortening_an_event_asks_before_its_part_is_cut(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a1")
    _drag(stage, (_lane(stage, 80) - 1, y), (_lane(stage, 40) - 1, y))
    stage.find("question-yes").click()
    stage.until("app.document.event('a2').segments[0].end_frame === 40")
    layer = filmed.layer()
    assert (_span(layer, "a1"), _span(layer, "a2")) == ((20, 40), (30, 40))


def test_dragging_in_an_empty_lane_makes_an_event(stage: Any, filmed: Any) -> None:
    y = _middle(stage, "event-a3")
    _drag(stage, (_lane(stage, 130), y), (_lane(stage, 145), y))
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
    assert (made.status, _span(layer, made.id)) == ("confirmed", (40, 70))
    stage.page.wait_for_timeout(300)
    assert stage.find("proposal-a1").count() == stage.find("proposal-a2").count() == 0
    assert {event.status for event in filmed.session().layer("machine").events} == {"proposed"}


def test_a_proposal_whose_edge_is_dragged_is_accepted_with_it(stage: Any, filmed: Any) -> None:
    stage.find("proposal-a2").click()
    y = _middle(stage, "proposal-a2")
    stage.page.keyboard.down("Alt")
    _drag(stage, (_lane(stage, 90) + 1, y), (_lane(stage, 84) + 1, y))
    stage.page.keyboard.up("Alt")
    stage.until("app.decided('a2') === 'accepted'")
    layer = filmed.layer()
    made = layer.decisions[0].result
    assert _span(layer, made) == (84, 110)


def test_the_keyboard_reaches_an_event(stage: Any) -> None:
    stage.find("event-a3").focus()
    assert stage.says("app.primary.id") == "a3"
    assert "slide_past, frames 95 to 120" in stage.find("event-a3").get_attribute("aria-label")


def test_an_object_gets_its_colour_line_key_frames_and_absence(stage: Any, filmed: Any) -> None:
    stage.at(10)
    stage.press("r")
    _drag(stage, _client(stage, 20, 30), _client(stage, 60, 70))
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
    assert sorted(_keys(filmed.layer())) == [10, 40]


def test_a_shape_is_selected_by_a_click_and_removed(stage: Any, filmed: Any) -> None:
    stage.at(10)
    stage.press("r")
    _drag(stage, _client(stage, 20, 30), _client(stage, 60, 70))
    stage.settle()
    # the first one leaves the name
    stage.press("Escape", "Escape")
    assert stage.says("app.selection.length") == 0
    stage.page.mouse.click(*_client(stage, 40, 50))
    assert stage.says("app.selectedObject.kind") == "rectangle"
    before = len(filmed.layer().objects)
    stage.press("Delete")
    assert len(filmed.layer().objects) == before - 1


def test_the_stream_is_chosen_and_streams_stand_side_by_side(stage: Any) -> None:
    stage.find("stream-depth").click()
    stage.page.wait_for_selector('.stage [data-testid="pane-depth"]')
    assert stage.page.locator('.stage [data-testid="pane-color"]').count() == 0
    stage.find("stream-color").click(modifiers=["Shift"])
    stage.page.wait_for_selector('.stage [data-testid="pane-color"]')
    assert stage.page.locator('.stage [data-testid="pane-depth"]').count() == 1
