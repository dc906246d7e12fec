"""From a recording to events: how long import and all stages take, and how much memory, as the recording gets longer.

``python benchmarks/pipeline.py [--long 4]``: rendered 1080p30 colour with depth 640 x 576 at 30 Hz, as an Azure Kinect
writes it (JPEG images and raw depth, to be encoded) and as a folder of videos (H.264 and FFV1, kept as they are).  Each
import and each run of the stages is a process of its own.  "x real time" is the recording's length by the time on the
clock; as other work on the machine makes that longer, the processor's time is told beside it: on two processors that
are shared out evenly, 1.5 times real time is 1.33 s of processor per second.  The recordings are rendered once and kept
in the folder for temporary files.

``python benchmarks/pipeline.py --hour [--folder DIR]``: a whole hour instead, the same packets over and over, imported
and processed: how much memory each step takes and what it leaves behind.  The depth is cut off behind the table, as
noise of the wall alone would fill 16 GB; it takes 32 GB of disk and half an hour of two processors.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE, Popen, TimeoutExpired
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
HOUR_GB = 33
WALL_MM = 2000
SAMPLED_S = 10.0
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
# for every stage its name and the peak during it, of which the kernel keeps none but the last
_TOLD = """
import os, sys, time
from pathlib import Path
from ecat.process import process_session, read_prototypes
def size():
    lines = [line.split() for line in open("/proc/self/status")]
    return [int(line[1]) // 1024 for name in ("VmHWM:", "VmRSS:") for line in lines if line[0] == name]
def tell(what, done, total):
    global last, used, seconds, worst
    if what != last:
        peak, left = size()
        took = time.process_time() - used, time.time() - seconds
        print(f"  {last or 'start':14}{took[0]:9.0f}{took[1]:9.0f}{peak:9}{left:9}", flush=True)
        open("/proc/self/clear_refs", "w").write("5")
        last, used, seconds, worst = what, time.process_time(), time.time(), max(worst, peak)
last, used, seconds, worst = "", 0.0, time.time(), 0
process_session(
    Path(sys.argv[1]), smooth=True, prototypes=read_prototypes(Path(sys.argv[2])), progress=tell
)
tell("end", 0, 0)
print(f"  process: peak {worst} MB")
"""
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


def videos(folder: Path, dest: Path, times: int, *, farthest_mm: int = 1 << 16) -> Path:
    """A folder of videos that are kept as they are, with depth as far as ``farthest_mm``."""
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
            measured_mm = np.fromfile(path, ">u2").reshape(DEPTH_PX[::-1])
            depth.write(np.where(measured_mm < farthest_mm, measured_mm, 0).astype(np.uint16), t_ns)
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


def hour(folder: Path) -> None:
    """Import and process an hour, and print what memory that takes."""
    once = rendered(KEPT)
    if (free := shutil.disk_usage(folder).free / 1e9) < HOUR_GB:
        sys.exit(f"{folder}: {free:.0f} GB are free, it takes {HOUR_GB}; name another with --folder")
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        dest = Path(temporary) / "session"
        source = videos(KEPT, Path(temporary), round(HOUR_S / once), farthest_mm=WALL_MM)
        print(f"an hour of 1080p30 and depth; memory every {SAMPLED_S:.0f} s")
        program = Popen([sys.executable, "-c", _IMPORT, str(source), str(dest)], cwd=ROOT)
        sizes = list(sampled(program))
        marks = [sizes[i * (len(sizes) - 1) // 4] for i in range(5)]
        print(
            f"  import: peak {max(sizes):.0f} MB; from beginning to end {', '.join(f'{m:.0f}' for m in marks)}"
        )
        shutil.rmtree(source)
        print(f"  {'process':14}{'cpu s':>9}{'clock s':>9}{'peak MB':>9}{'MB after':>9}", flush=True)
        program = Popen([sys.executable, "-c", _TOLD, str(dest), str(KEPT / "boxes.json")], cwd=ROOT)
        if program.wait():
            sys.exit("it failed")
        print(f"  target: both below {TARGET_MB} MB")


def sampled(program: Popen[bytes]) -> Iterator[float]:
    """The memory in MB that a program has taken at most by now, until it ends."""
    while program.poll() is None:
        with contextlib.suppress(TimeoutExpired):
            program.wait(SAMPLED_S)
        with contextlib.suppress(OSError):  # it has just ended
            lines = Path(f"/proc/{program.pid}/status").read_text().splitlines()
            yield from (int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    if program.returncode:
        sys.exit("it failed")


def main() -> None:
    """Make recordings of two lengths, and measure both ways of each."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--long", type=int, default=4, help="how many times as long the longer recording is")
    parser.add_argument("--hour", action="store_true", help="an hour, for its memory")
    parser.add_argument(
        "--folder", type=Path, default=Path(tempfile.gettempdir()), help="where the hour is made"
    )
    asked = parser.parse_args()
    if asked.hour:
        hour(asked.folder)
        return
    long, once = asked.long, rendered(KEPT)
    print(f"1080p30 and depth {DEPTH_PX[0]} x {DEPTH_PX[1]}; {os.cpu_count()} processors")
    print(f"  {'':42}{'s':>7}{'x real':>8}{'cpu s/s':>9}{'cpus':>8}{'MB':>8}")
    for name, make in (("H.264 and FFV1, kept", videos), ("JPEG and raw depth, encoded", azure)):
        for times in (1, long):
            with tempfile.TemporaryDirectory() as temporary:
                source, dest = make(KEPT, Path(temporary), times), Path(temporary) / "session"
                costs = [run(_IMPORT, source, dest), run(_PROCESS, dest, KEPT / "boxes.json")]
            for stage, cost in zip(("import", "process"), costs, strict=True):
                measured(f"{name}: {stage}", once * times, [cost])
            measured(f"{name}: both", once * times, costs)
    print(f"  target: both at least {TARGET} times real time")


if __name__ == "__main__":
    main()
