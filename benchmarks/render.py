"""How fast and how exact sample images are rendered.

    python benchmarks/render.py [--frames 120]

Speed on one core, of a whole session's frames spread evenly: colour and depth together, as frames per second and as a
multiple of the time that copying the two images takes.  Exactness: marker corners measured in noiseless images, where
lines through the edges meet, against the projection of their true places.  Noise: depth of the flat table against its
true plane, and how well FFV1 packs what is rendered.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.geometry.transforms import Floats
from ecat.sample import GroundTruth, sample_session
from ecat.sample.pixels import EXACT_COLOR, Renderer
from ecat.store.media import DepthWriter


def measured_corners(image: Floats, ring: Floats) -> Floats:
    """Corners (4, 2) where lines through the edges meet; an edge is where the area under its profile puts it."""
    lines: list[tuple[Floats, Floats]] = []
    for start, end in zip(ring, np.roll(ring, -1, 0), strict=True):
        along = (end - start) / math.hypot(*(end - start))
        out = np.array([along[1], -along[0]])
        out *= np.sign(out @ (start - ring.mean(0)))
        share, way = np.linspace(0.25, 0.75, 41), np.arange(-30, 31) / 10
        points = start + share[:, None, None] * (end - start) + way[:, None] * out
        u, v = np.moveaxis(points, -1, 0).astype("f4")
        profile = cv2.remap(image.astype(np.float32), u, v, cv2.INTER_LINEAR)
        inner, outer = profile[:, :3].mean(1), profile[:, -3:].mean(1)
        lit = ((profile - inner[:, None]) / (outer - inner)[:, None]).sum(1)
        shift = np.polyfit(share, 3.05 - 0.1 * lit, 1)
        lines.append((start + out * shift[1], end + out * shift.sum()))
    corners: list[Floats] = []
    for (a, b), (c, d) in pairwise([lines[-1], *lines]):
        s, _ = np.linalg.solve(np.stack([b - a, c - d], 1), c - a)
        corners.append(a + s * (b - a))
    return np.array(corners)


def corner_errors(seeds: range) -> Floats:
    """Distances in pixels of large, not too flat markers' corners, with no hand near."""
    errors: list[Floats] = []
    for seed in seeds:
        truth = sample_session(seed=seed, actions=["next"])[1]
        renderer = Renderer(truth, seed=seed, noise=EXACT_COLOR, motion_blur=False)
        for frame in (0, truth.n_frames - 1):
            seen, image = renderer.faces(frame), renderer.color(frame).mean(-1)
            for box, face in np.argwhere(
                (seen.visible > 0.999) & (seen.tilt_rad < 0.95) & (seen.side_px > 42)
            ):
                ring = seen.pixels[box, face]
                errors.append(np.sqrt(((measured_corners(image, ring) - ring) ** 2).sum(-1)))
    return np.concatenate(errors)


def frames_per_second(truth: GroundTruth, n: int) -> tuple[float, float, float, float]:
    """Frames per second of colour and depth, milliseconds of each alone, and the multiple of a copy's time."""
    started = time.process_time()
    renderer = Renderer(truth)
    for warm in range(24):
        renderer.color(warm / 100)
        renderer.depth(0)
    ready = time.process_time() - started
    frames = np.linspace(0, truth.n_frames - 1, n).tolist()
    seconds: list[float] = []
    for render in (renderer.color, renderer.depth):
        started = time.process_time()
        for frame in frames:
            render(frame)
        seconds.append((time.process_time() - started) / n)
    images = renderer.color(0), renderer.depth(0)
    started = time.process_time()
    for _ in range(100):
        for image in images:
            image.copy()
    copied = (time.process_time() - started) / 100
    print(f"| made ready (textures, backdrop, noise) | {ready:.1f} s | |")
    return 1 / sum(seconds), 1000 * seconds[0], 1000 * seconds[1], sum(seconds) / copied


def depth_figures(truth: GroundTruth) -> tuple[float, float, float]:
    """Standard deviation of the table's depth in millimetres, share of holes, and how often FFV1 divides its bytes."""
    renderer = Renderer(truth)
    images = [renderer.depth(frame) for frame in range(20)]
    camera = renderer.cameras["depth"]
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(float)
    ray = camera.unproject(pixels)
    plane = truth.scene.depth_from_table
    normal = plane.rotation[:, 2]
    true = 1000 * (normal @ plane.translation) / (ray @ normal)
    at = plane.inverse().apply(ray * true[..., None] / 1000)
    table = (np.abs(at[..., 0]) < 0.5) & (at[..., 1] > -0.44) & (at[..., 1] < -0.35)
    error = np.concatenate([(image - true)[table & (image > 0)] for image in images])
    error = error[np.abs(error) < 30]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "depth.mkv"
        with DepthWriter(path, camera.width, camera.height) as writer:
            for k, image in enumerate(images):
                writer.write(image, k * 33_000_000)
        ratio = sum(image.nbytes for image in images) / path.stat().st_size
    return float(error.std()), float(np.mean([image == 0 for image in images])), ratio


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--frames", type=int, default=120)
    n = parser.parse_args().frames
    cv2.setNumThreads(1)
    truth = sample_session(seed=0, actions=["next"])[1]
    print("| what | measured | target |\n|---|---|---|")
    rate, color, depth, copies = frames_per_second(truth, n)
    print(f"| colour 1920x1080 and depth 512x424, one core | {rate:.1f} frames/s | >= 20 |")
    print(f"| colour, depth alone | {color:.1f} ms, {depth:.1f} ms | |")
    print(f"| times as long as copying both images | {copies:.0f} | |")
    error = corner_errors(range(8))
    print(
        f"| corners against the truth, n = {len(error)}: median, 95 %, greatest | "
        f"{np.median(error):.3f}, {np.percentile(error, 95):.3f}, {error.max():.3f} px | 95 % < 0.03 |"
    )
    sigma, holes, ratio = depth_figures(truth)
    print(f"| depth of the near table, standard deviation | {sigma:.2f} mm | |")
    print(f"| pixels without depth | {100 * holes:.1f} % | |")
    print(f"| depth packed by FFV1 | {ratio:.2f} times | |")


if __name__ == "__main__":
    main()
