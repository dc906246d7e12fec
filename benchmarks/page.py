"""How fast and how exact the annotation page is, in a real browser on the real server.

``python benchmarks/page.py [seek] [large]``: seeks in a 1080p video whose images carry their number as a bar code, read
back from the video's own pixels; then a session of 20,000 events, 500 objects and 100,000 frames: time until it can be
used, frames per second while the timeline is scrolled, and how long an edit takes until it is acknowledged and shown.

Needs playwright and Chromium (``CHROMIUM`` names another one than ``/usr/bin/chromium``).
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright

from ecat.model import AnnotatedObject, Clock, Event, KeyFrame, Layer, Manifest, Relation, Segment, Stream
from ecat.model.annotation import Argument
from ecat.store import Draft, create_session
from ecat.store.media import ColorWriter
from ecat.web import Server

WIDTH, HEIGHT = 1920, 1080
N_IMAGES, N_SEEKS, BITS = 450, 200, 16
N_EVENTS, N_OBJECTS, N_FRAMES = 20_000, 500, 100_000
FLAGS = [
    f"--{flag}"
    for flag in (
        "no-sandbox",
        "disable-gpu",
        "use-angle=swiftshader",
        "enable-unsafe-swiftshader",
        "disable-quic",
        "no-first-run",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
    )
]

READ_SEEKS = """
async ([targets, bits, read]) => {
  const pane = document.querySelector('.pane');
  const video = pane.querySelector('video');
  const canvas = new OffscreenCanvas(640, 8);
  const context = canvas.getContext('2d', { willReadFrequently: true });
  const number = () => {
    // the strip at the top of the image holds one square per bit
    context.drawImage(video, 0, 0, 1920, 24, 0, 0, 640, 8);
    const { data } = context.getImageData(0, 4, 640, 1);
    let value = 0;
    for (let bit = 0; bit < bits; bit++) if (data[4 * (bit * 40 + 20)] > 128) value |= 1 << bit;
    return value;
  };
  const results = [];
  for (const target of targets) {
    const start = performance.now();
    await new Promise((resolve) => {
      const observer = new MutationObserver(() => {
        if (pane.dataset.frame === String(target)) { observer.disconnect(); resolve(); }
      });
      observer.observe(pane, { attributeFilter: ['data-frame'] });
      ecat.seek(target);
    });
    const took = performance.now() - start;
    results.push([target, read ? number() : 0, took, pane.dataset.source]);
    await new Promise((resolve) => setTimeout(resolve, 15));
  }
  return results;
}
"""
BARE_SEEKS = """
async ([targets, fps]) => {
  // the same video, sought by nothing but the browser: what the page's own work is measured against
  const video = document.createElement('video');
  video.muted = true;
  video.src = document.querySelector('.pane video').src;
  video.style.cssText = 'position: fixed; left: 0; top: 0; width: 640px; z-index: 99';
  document.body.append(video);
  await new Promise((resolve) => video.addEventListener('loadeddata', resolve, { once: true }));
  const took = [];
  for (const target of targets) {
    const start = performance.now();
    await new Promise((resolve) => {
      video.requestVideoFrameCallback(resolve);
      video.currentTime = (target + 0.5) / fps;
    });
    took.push(performance.now() - start);
    await new Promise((resolve) => setTimeout(resolve, 15));
  }
  video.remove();
  return took;
}
"""
COUNT_FRAMES = """
() => {
  window.gaps = [];
  let last = performance.now();
  const step = (now) => { window.gaps.push(now - last); last = now; window.counting = requestAnimationFrame(step); };
  window.counting = requestAnimationFrame(step);
}
"""
EDIT = """
async (n) => {
  const took = [];
  const events = ecat.document.events.list.filter((event) => event.parent === null);
  for (let k = 0; k < n; k++) {
    const event = events[(k * 7919) % events.length];
    const [segment] = event.segments;
    const frame = segment.end_frame + 1;
    const start = performance.now();
    await ecat.edit({ op: 'move_edge', id: event.id, segment: 0, edge: 'end', frame });
    took.push(performance.now() - start);
    await new Promise((resolve) => setTimeout(resolve, 30));
  }
  return took;
}
"""


def coded(background: NDArray[np.uint8], k: int) -> NDArray[np.uint8]:
    """A picture (height, width, 3) that moves, with ``k`` as black and white squares along its upper edge."""
    image = np.roll(background, 7 * k, axis=1)
    for bit in range(BITS):
        image[:24, bit * 120 : bit * 120 + 120] = 255 if k >> bit & 1 else 0
    cv2.circle(image, (200 + 2 * k % 1500, 600), 90, (40, 190, 240), -1)
    return image


def video_session(folder: Path) -> None:
    """A session of 1080p whose times are not even, so that the page plays a proxy."""
    chance = np.random.default_rng(1)
    rough = chance.integers(60, 200, (HEIGHT // 8, WIDTH // 8, 3)).astype(np.uint8)
    background = np.asarray(cv2.resize(rough, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC), np.uint8)
    path = folder / "color.mp4"
    with ColorWriter(path, WIDTH, HEIGHT) as writer:
        for k in range(N_IMAGES):
            writer.write(coded(background, k), k * 33_000_000 + (k % 3) * 4_000_000)
    stream = Stream(
        name="color",
        kind="color",
        file="media/color.mp4",
        n_frames=N_IMAGES,
        width_px=WIDTH,
        height_px=HEIGHT,
    )
    clock = Clock(rule="uniform", duration_ns=N_IMAGES * 33_333_333)
    manifest = Manifest(
        name="video", created="2024-03-05T10:00:00", n_frames=N_IMAGES, clock=clock, streams=(stream,)
    )
    create_session(folder / "video", Draft(manifest=manifest, files={"color": path}))


def large_session(folder: Path) -> None:
    """As many events, objects and frames as a long afternoon of work, sub-events two levels deep."""
    chance = np.random.default_rng(2)
    types = ("slide", "grasp", "hold", "move", "release")
    events: list[Event] = []
    n_parents = N_EVENTS // 5
    starts = np.sort(chance.integers(0, N_FRAMES - 60, n_parents))
    for i, start in enumerate(starts.tolist()):
        whole = Event(
            id=f"e{5 * i + 1}",
            type="slide",
            tier="action",
            segments=(Segment(start_frame=start, end_frame=start + 40),),
        )
        parts = [
            Event(
                id=f"e{5 * i + 2 + k}",
                type=types[k + 1],
                tier="part",
                parent=whole.id,
                segments=(Segment(start_frame=start + 10 * k, end_frame=start + 10 * k + 10),),
            )
            for k in range(4)
        ]
        events += [whole, *parts]
    objects = [
        AnnotatedObject(
            id=f"o{i + 1}",
            name=f"object {i + 1}",
            kind="rectangle",
            key_frames=tuple(
                KeyFrame(frame=int(f), coordinates=tuple(chance.uniform(50, 400, 4).round(1).tolist()))
                for f in np.sort(chance.choice(N_FRAMES, 20, replace=False))
            ),
        )
        for i in range(N_OBJECTS)
    ]
    relations = [
        Relation(
            predicate="ON",
            start_frame=int(f),
            end_frame=int(f) + 200,
            arguments=(Argument(target="o1"), Argument(target="o2")),
        )
        for f in np.sort(chance.integers(0, N_FRAMES - 300, 200))
    ]
    layer = Layer(
        name="main",
        objects=tuple(objects),
        events=tuple(events),
        relations=tuple(relations),
        object_counter=N_OBJECTS,
        event_counter=N_EVENTS,
    )
    clock = Clock(rule="uniform", duration_ns=N_FRAMES * 33_333_333)
    manifest = Manifest(name="large", created="2024-03-05T10:00:00", n_frames=N_FRAMES, clock=clock)
    create_session(folder / "large", Draft(manifest=manifest, layers=(layer,)))


@contextmanager
def opened(server: Server) -> Generator[Page]:
    """A browser at 1280 x 720 that was let in."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=FLAGS
        )
        context = browser.new_context(viewport={"width": 1280, "height": 720})
        context.add_init_script("localStorage.setItem('ecat.settings', JSON.stringify({author: 'ann'}))")
        page = context.new_page()
        page.goto(server.url())
        page.wait_for_selector("#app > *")
        yield page
        browser.close()


def told(name: str, value: str, reach: str) -> None:
    """One line of the answer."""
    print(f"{name:<44} {value:>28}   (reach {reach})", flush=True)


def seeks(server: Server) -> None:
    """Random seeks: which image was shown, and after how long."""
    with opened(server) as page:
        page.goto(f"{server.address}/#/session/video")
        page.wait_for_selector('.pane[data-source="video"][data-frame="0"]', timeout=180_000)
        targets = np.random.default_rng(3).permutation(np.arange(1, N_IMAGES))[:N_SEEKS].tolist()
        results: list[Any] = page.evaluate(READ_SEEKS, [targets, BITS, True])
        right = sum(1 for target, found, _, source in results if target == found and source == "video")
        told("seeks to the right image, 1080p", f"{right}/{len(results)}", "200/200")
        # reading pixels back keeps the browser busy into the next seek: what is timed is not read
        took = np.array([ms for _, _, ms, _ in page.evaluate(READ_SEEKS, [targets[-2::-1], BITS, False])])
        told(
            "seek latency p50, p95",
            f"{np.percentile(took, 50):.1f}, {np.percentile(took, 95):.1f} ms",
            "p95 <= 60 ms",
        )
        bare = np.array(page.evaluate(BARE_SEEKS, [targets, 30]))
        told(
            "the same by the browser alone",
            f"{np.percentile(bare, 50):.1f}, {np.percentile(bare, 95):.1f} ms",
            "-",
        )
        playing(page)


def playing(page: Page) -> None:
    """How evenly it plays: images presented of those that were due in three seconds."""
    page.evaluate(
        "() => { ecat.seek(0); window.seen = []; ecat.on('cursor', (c) => window.seen.push(c.frame)); }"
    )
    page.wait_for_timeout(300)
    start = page.evaluate("() => { ecat.setPlaying(true); return performance.now(); }")
    page.wait_for_timeout(3000)
    now, frame = page.evaluate(
        "() => { const at = [performance.now(), ecat.cursor.frame]; ecat.setPlaying(false); return at; }"
    )
    seen: list[int] = page.evaluate("window.seen")
    shown = len(set(seen))
    told(
        "playing 3 s at 1x: images shown, of due",
        f"{shown} of {frame}, clock {frame / (now - start) * 100 / 3:.2f}",
        "all, 1.00",
    )


def frame_rate(page: Page, gesture: str, dx: float, dy: float) -> None:
    """Frames per second while the wheel is turned for three seconds."""
    page.evaluate(COUNT_FRAMES)
    end = time.perf_counter() + 3
    turn = 1
    while time.perf_counter() < end:
        page.mouse.wheel(dx * turn, dy * turn)
        if page.evaluate("window.gaps.length") % 90 > 75:
            turn = -turn
    gaps = np.array(
        page.evaluate("() => { cancelAnimationFrame(window.counting); return window.gaps.slice(5); }")
    )
    told(
        f"timeline, {gesture}",
        f"{1000 / gaps.mean():.1f} fps, p95 {np.percentile(gaps, 95):.1f} ms",
        ">= 50 fps",
    )


def large(server: Server) -> None:
    """The large session: opening, scrolling, editing."""
    with opened(server) as page:
        for attempt in ("first", "second"):
            page.goto(f"{server.address}/#/")
            page.wait_for_selector("#app > *")
            page.wait_for_timeout(500)
            start = time.perf_counter()
            page.evaluate("location.hash = '#/session/large'")
            page.wait_for_selector(".tl-group", timeout=60_000)
            page.keyboard.press("ArrowRight")
            page.wait_for_function("ecat.cursor.frame === 1")
            told(
                f"{attempt} opening until a key is answered", f"{time.perf_counter() - start:.2f} s", "<= 2 s"
            )
        box = page.locator(".tl-lanes").bounding_box()
        assert box
        page.mouse.move(box["x"] + 500, box["y"] + 60)
        frame_rate(page, "scrolling down", 0, 40)
        frame_rate(page, "scrolling along time, all in view", 30, 0)
        page.keyboard.down("Control")
        frame_rate(page, "zooming", 0, -40)
        page.keyboard.up("Control")
        page.evaluate("() => document.querySelector('[data-testid=zoom-all]').click()")
        for _ in range(9):
            page.click('[data-testid="zoom-in"]')
        page.mouse.move(box["x"] + 500, box["y"] + 60)
        frame_rate(page, "scrolling along time, zoomed in", 60, 0)
        took = np.array(page.evaluate(EDIT, 100))
        told(
            "edit until shown p50, p95",
            f"{np.percentile(took, 50):.1f}, {np.percentile(took, 95):.1f} ms",
            "p95 <= 20 ms",
        )


def main() -> None:
    """Make the sessions, serve them, measure."""
    wanted = sys.argv[1:] or ["seek", "large"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["ECAT_CACHE"] = str(folder / "cache")
        (folder / "study").mkdir()
        if "seek" in wanted:
            video_session(folder / "study")
        if "large" in wanted:
            large_session(folder / "study")
        for work in (seeks, large):
            if work.__name__.removesuffix("s") in wanted:
                with Server(folder / "study", port=0, author="ann").running() as server:
                    work(server)


if __name__ == "__main__":
    main()
