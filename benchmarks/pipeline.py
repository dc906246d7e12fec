"""From a recording to events: how long import and all stages take, and how much memory, as the recording gets longer.

``python benchmarks/pipeline.py [--long 4]``: rendered 1080p30 colour with depth 640 x 576 at 30 Hz, as an Azure Kinect
writes it (JPEG images and raw depth, to be encoded) and as a folder of videos (H.264 and FFV1, kept as they are).  Each
import and each run of the stages is a process of its own.  "x real time" is the recording's length by the time on the
clock; as other work on the machine makes that longer, the processor's time is told beside it: on two processors that
are shared out evenly, 1.5 times real time is 1.33 s of processor per second.  The recordings are rendered once and kept
in the folder for temporary files.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import av
import cv2
import numpy as np

from ecat.process import write_prototypes
from ecat.sample.pixels.image_truth import moments
from ecat.sample.recording import Recording as Rendered
from ecat.sample.recording import sample_recording
from ecat.sample.shipped import calibration_json
from ecat.store import write_new_file
from ecat.store.media import ColorWriter, DepthWriter
from tests.formats.recordings.k4a import Recording, block, write

ROOT = Path(__file__).parents[1]
KEPT = Path(tempfile.gettempdir()) / "ecat_benchmark_pipeline"
COLOR_PX, DEPTH_PX = (1920, 1080), (640, 576)
TARGET = 1.5
TARGET_MB = 1000
HOUR_S = 3600
JPEG_QUALITY = 90
_IMPORT = (
    "import sys; from pathlib import Path; from ecat.formats import import_source;"
    "import_source(Path(sys.argv[1]), Path(sys.argv[2]));"
)
_PROCESS = (
    "import sys; from pathlib import Path; from ecat.process import process_session, read_prototypes;"
    "r = process_session(Path(sys.argv[1]), smooth=True, prototypes=read_prototypes(Path(sys.argv[2])));"
    "assert r.not_applicable.keys() <= {'hull'}, r.not_applicable;"  # nobody drew a shape
)
# the greatest size since the program was started, which unlike ru_maxrss does not count what its parent had
_PEAK = "print([line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')][0])"


@dataclass(frozen=True)
class Cost:
    """Seconds on the clock and of processors, and peak memory."""

    seconds: float
    processor_s: float
    peak_mb: float


def rendered(folder: Path) -> float:
    """Render what the cameras see, once: JPEG images, depth images, calibration, boxes.

    Returns
    -------
    How many seconds it takes to show them forwards and backwards.
    """
    if not (folder / "done").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        print(f"rendering into {folder}", flush=True)
        made = sample_recording(seed=5, actions=("toward",), mirrored=False, depth_size=DEPTH_PX)
        _render(made, folder)
        (folder / "camera.json").write_bytes(calibration_json(made.draft.manifest))
        (folder / "factory.json").write_text(json.dumps(_factory(made)))
        (folder / "boxes.json").unlink(missing_ok=True)
        write_prototypes(folder / "boxes.json", made.truth.prototypes)
        (folder / "done").write_text(str(_seconds(made)))
    return 2 * float((folder / "done").read_text())


def _seconds(made: Rendered) -> float:
    t_ns = made.times["color"]
    return float(t_ns[-1] - t_ns[0]) / 1e9 * len(t_ns) / (len(t_ns) - 1)


def _render(made: Rendered, folder: Path) -> None:
    for i, frame in enumerate(moments(made.renderer, made.times["color"]).tolist()):
        packed = cv2.imencode(".jpg", made.renderer.color(frame), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        (folder / f"{i:05d}.jpg").write_bytes(packed.tobytes())
    for i, frame in enumerate(moments(made.renderer, made.times["depth"]).tolist()):
        made.renderer.depth(frame).astype(">u2").tofile(folder / f"{i:05d}.depth")
    np.savez(folder / "times.npz", color=made.times["color"], depth=made.times["depth"])


def _factory(made: Rendered) -> dict[str, object]:
    """The cameras as an Azure Kinect's calibration has them: shares of the sensor's image, of which a part is read."""
    cameras: list[dict[str, object]] = []
    for name, place, sensor, full, cut in (
        ("depth", "D0", (1024, 1024), (1024, 1024), (192, 180)),
        ("color", "PV0", (4096, 3072), (1920, 1440), (0, 180)),
    ):
        camera = made.renderer.cameras[name]
        (w, h), (left, top) = full, cut
        centre = [(camera.cx + 0.5 + left) / w, (camera.cy + 0.5 + top) / h]
        to = camera.from_reference
        parameters = [*centre, camera.fx / w, camera.fy / h, *[0.0] * 10]
        cameras.append(
            {
                "Location": f"CALIBRATION_CameraLocation{place}",
                "Intrinsics": {
                    "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
                    "ModelParameters": parameters,
                },
                "Rt": {"Rotation": to.rotation.ravel().tolist(), "Translation": to.translation.tolist()},
                "SensorWidth": sensor[0],
                "SensorHeight": sensor[1],
            }
        )
    return {"CalibrationInformation": {"Cameras": cameras}}


def shown(folder: Path, name: str, suffix: str, times: int) -> Iterator[tuple[int, Path]]:
    """Time and file of every image: forwards, then backwards, so that nothing jumps, and again so many ``times``."""
    t_ns = np.load(folder / "times.npz")[name]
    n, period = len(t_ns), int(t_ns[-1] - t_ns[0]) * len(t_ns) // (len(t_ns) - 1)
    for turn in range(2 * times):
        for i in range(n):
            at = i if turn % 2 == 0 else n - 1 - i
            yield int(t_ns[i]) + turn * period, folder / f"{at:05d}{suffix}"


def azure(folder: Path, dest: Path, times: int) -> Path:
    """A recording as an Azure Kinect makes it."""
    jpegs = list(shown(folder, "color", ".jpg", times))
    depths = list(shown(folder, "depth", ".depth", times))

    def clusters() -> Iterator[bytes]:
        for (color_ns, color), (depth_ns, depth) in zip(jpegs, depths, strict=True):
            yield block(1, color_ns // 1000, color.read_bytes())
            yield block(2, depth_ns // 1000, depth.read_bytes())

    facts = Recording(
        color=[jpegs[0][1].read_bytes()],
        depth=[np.zeros(DEPTH_PX[::-1], np.uint16)],
        color_px=COLOR_PX,
        depth_px=DEPTH_PX,
        infrared=False,
        imu=False,
        calibration=(folder / "factory.json").read_bytes(),
    )
    return write(dest / "azure.mkv", facts, clusters())


def videos(folder: Path, dest: Path, times: int) -> Path:
    """A folder of videos that are kept as they are."""
    made, once = dest / "videos", dest / "once"
    made.mkdir()
    once.mkdir()
    with ColorWriter(once / "color.mp4", *COLOR_PX, threads=2) as color:
        for t_ns, path in shown(folder, "color", ".jpg", 1):
            image = cv2.imread(str(path))
            assert image is not None
            color.write(np.asarray(image, np.uint8), t_ns)
    with DepthWriter(once / "depth.mkv", *DEPTH_PX, threads=2) as depth:
        for t_ns, path in shown(folder, "depth", ".depth", 1):
            depth.write(np.fromfile(path, ">u2").astype(np.uint16).reshape(DEPTH_PX[::-1]), t_ns)
    for name in ("color.mp4", "depth.mkv"):
        repeated(once / name, made / name, times, rendered(folder))
    write_new_file(made / "camera.json", [(folder / "camera.json").read_bytes()])
    return made


def repeated(source: Path, dest: Path, times: int, period_s: float) -> None:
    """The packets of a video over and over, later each time; nothing is encoded."""
    with av.open(str(dest), "w") as out:
        made: Any = None
        for turn in range(times):
            with av.open(str(source)) as container:
                stream = container.streams.video[0]
                made = made or out.add_stream_from_template(stream)
                for packet in container.demux(stream):
                    if packet.pts is None or packet.dts is None or not packet.size:
                        continue
                    later = round(turn * period_s / packet.time_base)
                    packet.pts, packet.dts, packet.stream = packet.pts + later, packet.dts + later, made
                    out.mux(packet)


def run(code: str, *arguments: Path) -> Cost:
    """What a program of its own costs; its start is counted."""
    before, start = os.times(), time.perf_counter()
    program = Popen([sys.executable, "-c", code + _PEAK, *map(str, arguments)], stdout=PIPE, cwd=ROOT)
    out = program.communicate()[0]
    seconds, after = time.perf_counter() - start, os.times()
    if program.returncode:
        sys.exit(f"it failed: {arguments[0]}")
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return Cost(seconds, used, int(out) / 1024)


def measured(what: str, seconds: float, costs: list[Cost]) -> None:
    """Print a line of the table."""
    took, used = sum(cost.seconds for cost in costs), sum(cost.processor_s for cost in costs)
    peak = max(cost.peak_mb for cost in costs)
    print(
        f"  {what:42}{seconds:7.1f}{seconds / took:8.2f}{used / seconds:9.2f}{used / took:8.2f}{peak:8.0f}",
        flush=True,
    )


def main() -> None:
    """Make recordings of two lengths, and measure both ways of each."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--long", type=int, default=4, help="how many times as long the longer recording is")
    long = parser.parse_args().long
    once = rendered(KEPT)
    print(f"1080p30 and depth {DEPTH_PX[0]} x {DEPTH_PX[1]}; {os.cpu_count()} processors")
    print(f"  {'':42}{'s':>7}{'x real':>8}{'cpu s/s':>9}{'cpus':>8}{'MB':>8}")
    for name, make in (("H.264 and FFV1, kept", videos), ("JPEG and raw depth, encoded", azure)):
        peaks: list[list[float]] = []
        for times in (1, long):
            with tempfile.TemporaryDirectory() as temporary:
                source, dest = make(KEPT, Path(temporary), times), Path(temporary) / "session"
                costs = [run(_IMPORT, source, dest), run(_PROCESS, dest, KEPT / "boxes.json")]
            for stage, cost in zip(("import", "process"), costs, strict=True):
                measured(f"{name}: {stage}", once * times, [cost])
            measured(f"{name}: both", once * times, costs)
            peaks.append([cost.peak_mb for cost in costs])
        for stage, short, longer in zip(("import", "process"), *peaks, strict=True):
            growth = max(longer - short, 0) / (once * (long - 1))
            hour = longer + growth * (HOUR_S - once * long)
            print(f"  {name}: {stage} of an hour, by the same growth: {hour:.0f} MB")
    print(f"  target: both at least {TARGET} times real time; below {TARGET_MB} MB for an hour")


if __name__ == "__main__":
    main()
