"""A filmed session whose images tell their number, and a hand on its page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ecat.model import AnnotatedObject, Event, Layer, Segment, Stream
from ecat.sample import sample_session
from ecat.store import create_session
from ecat.store.media import ColorWriter, DepthWriter

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


def color_image(k: int) -> NDArray[np.uint8]:
    """An image (height, width, 3) with the bits of ``k`` as squares along its upper edge."""
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    for bit in range(BITS):
        image[2:18, 20 * bit + 2 : 20 * bit + 18] = 255 if k >> bit & 1 else 0
    return image


def depth_image(k: int) -> NDArray[np.uint16]:
    """An image (height, width) in millimetres that tells row, column and number; the first column has no depth."""
    rows, columns = np.mgrid[:DEPTH_HEIGHT, :DEPTH_WIDTH]
    image = (700 + 31 * rows + 3 * columns + k).astype(np.uint16)
    image[:, 0] = 0
    return image


def event_of(name: str, start: int, end: int, **more: Any) -> Event:
    return Event(id=name, segments=(Segment(start_frame=start, end_frame=end),), **more)


def filmed_session(base: Path) -> Path:
    """A session with small videos whose images tell their number, some events, and what a machine proposes."""
    draft, _ = sample_session(seed=3, actions=("next",), name="filmed")
    n = draft.manifest.n_frames
    with (
        ColorWriter(base / "color.mp4", WIDTH, HEIGHT) as color,
        DepthWriter(base / "depth.mkv", DEPTH_WIDTH, DEPTH_HEIGHT) as depth,
    ):
        for k in range(n):
            # at no constant rate, so that the recording is no proxy of itself
            color.write(color_image(k), k * 33_000_000 + (k % 3) * 4_000_000)
            depth.write(depth_image(k), k * 33_000_000)
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
            event_of("a1", 20, 80, type="slide_next", tier="event"),
            event_of("a2", 30, 50, type="grasp", tier="sub-event", parent="a1"),
            event_of("a3", 95, 120, type="slide_past", tier="event"),
        ),
    )
    machine = Layer(
        name="machine",
        event_counter=2,
        events=(
            event_of("a1", 40, 70, type="slide_away", tier="event", status="proposed"),
            event_of("a2", 90, 110, type="slide_past", tier="event", status="proposed"),
        ),
    )
    manifest = replace(draft.manifest, streams=streams)
    create_session(base / "filmed", replace(draft, manifest=manifest, layers=(main, machine), files=files))
    return base / "filmed"


def open_filmed(window: Callable[..., Any], filmed: Any, **options: Any) -> Any:
    made = window(filmed, **options)
    made.page.wait_for_selector(
        '[data-testid="pane-color"][data-source="video"][data-frame]', timeout=WAIT_MS
    )
    return made


def client(window: Any, u: float, v: float) -> tuple[float, float]:
    x, y = window.page.evaluate(TO_CLIENT, [u, v])
    return x, y


def drag(window: Any, start: tuple[float, float], *through: tuple[float, float]) -> None:
    """Press, move, let go; the points are those of the screen."""
    mouse = window.page.mouse
    mouse.move(*start)
    mouse.down()
    for point in through:
        mouse.move(*point, steps=4)
    mouse.up()
    window.page.wait_for_timeout(50)
    window.settle()


def show(window: Any, frame: int) -> None:
    """Go to a frame, and wait until its image is there."""
    window.at(frame)
    window.page.wait_for_selector(f'[data-testid="pane-color"][data-frame="{frame}"]', timeout=WAIT_MS)


def keys_of(layer: Layer, index: int = -1) -> dict[int, tuple[float, ...]]:
    return {key.frame: key.coordinates for key in layer.objects[index].key_frames}


def span_of(layer: Layer, name: str) -> tuple[int, int]:
    (found,) = (event for event in layer.events if event.id == name)
    return found.segments[0].start_frame, found.segments[-1].end_frame
