"""Depth and colour on disk: how small, how fast to decode on one core, and that a long import needs no more memory.

``python benchmarks/media.py``: ratios against plain FFV1 and 16-bit PNG of the same images, in the same run.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.sample import sample_session
from ecat.sample.pixels import Renderer
from ecat.store.media import ColorWriter, DepthWriter, remux
from ecat.store.media.container import decoded
from tests.formats.recordings.k4a import Recording, block, calibration, depth, imu_sample, jpeg, write

Depth = NDArray[np.uint16]
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
PERIOD_NS = 33_333_333
N = 24
REPEATS = 3
TARGET_FPS = 60
SHORT_S, LONG_S = 5, 20


def synthetic(noise_mm: float, size: tuple[int, int] = (576, 640)) -> Iterator[Depth]:
    """A curved scene with an edge, holes and the round border of a time-of-flight camera, 3 % of pixels missing."""
    height, width = size
    v, u = np.mgrid[:height, :width]
    for i in range(N):
        chance = np.random.default_rng(i)
        image = 1500 + 0.8 * v + 200 * np.sin((u + 3 * i) / 80) * (u > width // 3)
        image = image + chance.normal(0, noise_mm, (height, width))
        image[chance.random((height, width)) < 0.03] = 0
        image[((u - width / 2) / (0.55 * width)) ** 2 + ((v - height / 2) / (0.57 * height)) ** 2 > 1] = 0
        yield image.astype(np.uint16)


def real() -> Iterator[tuple[str, list[Depth]]]:
    """The depth images of the reference data, where that is beside the checkout."""
    recording = SHARED / "azure_kinect" / "recording.mkv"
    if recording.is_file():
        yield (
            "Azure Kinect, real",
            [f.to_ndarray().astype(np.uint16) for f in decoded(recording, "read", 1)] * N,
        )
    for name, pattern in (
        ("RealSense sequence, real", "sequence/depth/*"),
        ("TUM pair, real", "pairs/TUM_depth.png"),
    ):
        files = sorted((SHARED / "rgbd_images").glob(pattern))
        images = [np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.uint16) for file in files]
        if images:
            yield name, (images * N)[:N]


def rendered() -> list[Depth]:
    """Depth of a sample session."""
    renderer = Renderer(sample_session(seed=5, actions=["toward"])[1], seed=5)
    return [renderer.depth(40 + i) for i in range(N)]


def plain_ffv1(path: Path, images: list[Depth], *, intra: bool) -> int:
    """What FFmpeg makes of them without being told anything, or only that every image stands for itself (-g 1)."""
    size = 0
    with av.open(str(path), "w") as out:
        stream: Any = out.add_stream("ffv1", rate=30)
        stream.height, stream.width = images[0].shape
        stream.pix_fmt = "gray16le"
        if intra:
            stream.codec_context.gop_size = 1
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="gray16le")
            frame.pts = i
            size += sum(packet.size for packet in stream.encode(frame))
        size += sum(packet.size for packet in stream.encode(None))
    return size


def depth_codec(folder: Path) -> None:
    """Ratio and decoding speed of depth."""
    print("depth: ratio to raw 16 bits; images per second of processor time, best of three")
    print(f"  {'':28}{'ours':>7}{'-g 1':>7}{'FFV1':>7}{'PNG16':>7}{'decode/s':>10}{'encode/s':>10}")
    sets = [("Azure-like, noise 6 mm", list(synthetic(6))), ("Azure-like, noise 1 mm", list(synthetic(1)))]
    sets += [("Kinect-v2-like, noise 3 mm", list(synthetic(3, (424, 512))))]
    sets += [("Kinect v2, rendered", rendered())]
    for name, images in [*real(), *sets]:
        path = folder / "depth.mkv"
        height, width = images[0].shape
        start = time.process_time()
        with DepthWriter(path, width, height) as writer:
            for i, image in enumerate(images):
                writer.write(image, i * PERIOD_NS)
        encode = len(images) / (time.process_time() - start)
        for image, frame in zip(images, decoded(path, "read"), strict=True):
            assert (frame.to_ndarray() == image).all(), "not lossless"
        raw = sum(image.nbytes for image in images)
        few = images[:3]
        png = sum(i.nbytes for i in few) / sum(len(cv2.imencode(".png", i)[1]) for i in few)
        intra, plain = (raw / plain_ffv1(folder / "plain.mkv", images, intra=i) for i in (True, False))
        rate = best_rate(path)
        ratios = raw / path.stat().st_size, intra, plain, png
        print(f"  {name:28}{''.join(f'{ratio:7.2f}' for ratio in ratios)}{rate:10.0f}{encode:10.0f}")
    print(f"  target: at least the ratio of FFV1 -g 1, at least {TARGET_FPS} a second decoded")
    print(
        "  (FFV1 as it is by default can start decoding at one image in twelve: what is read at random cannot use it)"
    )


def best_rate(path: Path, prepare: Callable[[Any], object] = lambda frame: frame) -> float:
    """Images a second, decoded by one thread."""
    rates: list[float] = []
    for _ in range(REPEATS):
        start = time.process_time()
        n = 0
        for frame in decoded(path, "read"):
            prepare(frame)
            n += 1
        rates.append(n / (time.process_time() - start))
    return max(rates)


def color_codec(folder: Path) -> None:
    """Decoding speed of colour."""
    path = folder / "color.mp4"
    pictures = [
        np.asarray(cv2.imdecode(np.frombuffer(jpeg(i, (1920, 1080)), np.uint8), 1), np.uint8)
        for i in range(N)
    ]
    noise = np.random.default_rng(0).integers(0, 12, (1080, 1920, 1), np.uint8)
    start = time.process_time()
    with ColorWriter(path, 1920, 1080) as writer:
        for i, picture in enumerate(pictures):
            writer.write(picture + np.roll(noise, 7 * i, 1), i * PERIOD_NS)
    encode = N / (time.process_time() - start)
    print("colour, 1920 x 1080 with noise, images per second of processor time, best of three")
    print(f"  encode H.264          {encode:8.0f}")
    print(f"  decode                {best_rate(path):8.0f}")
    grey = best_rate(path, lambda frame: np.frombuffer(frame.planes[0], np.uint8))
    print(f"  decode to grey        {grey:8.0f}   a view, no copy")
    print(f"  decode to BGR         {best_rate(path, lambda f: f.to_ndarray(format='bgr24')):8.0f}")
    start = time.process_time()
    remux(path, folder / "copy.mkv")
    print(f"  remux                 {N / (time.process_time() - start):8.0f}")


def recording(path: Path, seconds: int) -> None:
    """1080p30 MJPEG, depth, infrared and inertial samples of so many seconds, a few images over and over."""
    pictures = [jpeg(i, (1920, 1080)) for i in range(4)]
    depths = [depth(i) for i in range(4)]
    facts = Recording(
        color=pictures, depth=depths, color_px=(1920, 1080), calibration=str(calibration()).encode()
    )

    def clusters() -> Iterator[bytes]:
        for i in range(30 * seconds):
            t_us = i * 33_333
            yield block(4, t_us, b"".join(imu_sample(t_us * 1000 + 625_000 * k, k) for k in range(53)))
            yield block(1, t_us, pictures[i % 4])
            yield block(2, t_us, depths[i % 4].astype(">u2").tobytes())
            yield block(3, t_us, depths[i % 4].astype(">u2").tobytes())

    write(path, facts, clusters())


def import_memory(folder: Path) -> None:
    """Peak memory of the import of a short and of a longer recording, each in a process of its own."""
    print("import of colour 1080p30, depth and infrared 640 x 576, inertial samples at 1.6 kHz")
    peaks: list[float] = []
    for seconds in (SHORT_S, LONG_S):
        source, dest = folder / f"r{seconds}.mkv", folder / f"s{seconds}"
        recording(source, seconds)
        code = (
            "import sys, resource; from pathlib import Path; from ecat.formats import import_source;"
            "import_source(Path(sys.argv[1]), Path(sys.argv[2]));"
            "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
        )
        before = os.times()
        run = Popen(
            [sys.executable, "-c", code, str(source), str(dest)], stdout=PIPE, cwd=Path(__file__).parents[1]
        )
        out = run.communicate()[0]
        after = os.times()
        took = after.children_user + after.children_system - before.children_user - before.children_system
        peaks.append(int(out) / 1024)
        print(
            f"  {seconds:4} s of recording: peak {peaks[-1]:6.0f} MB, {took / seconds:5.2f} s of processor per second"
        )
        source.unlink()
    hour = peaks[-1] + max(peaks[-1] - peaks[0], 0) / (LONG_S - SHORT_S) * (3600 - LONG_S)
    print(f"  an hour, by the same growth: {hour:.0f} MB (target: below 1000 MB)")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        depth_codec(Path(temporary))
        color_codec(Path(temporary))
        import_memory(Path(temporary))
