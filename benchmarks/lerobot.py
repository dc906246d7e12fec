"""LeRobot export: how long 100 sessions with video take, beside lerobot's own writer, and how much memory.

``python benchmarks/lerobot.py [--sessions 100] [--pixels 640x480]``; lerobot's part needs the environment that
``tests/conformance/lerobot_env.sh`` makes.  Ten recordings are rendered, each of which is there as often as needed.
Whole sessions are exported image by image, so that no video has to be encoded.  lerobot is handed the same frames and
numbers, decoded beforehand, of the first ten sessions, and its time is counted up to all of them (it gets slower with
each episode, so this favours it); as it comes, and in its quickest way that I found: H.264, encoded while frames come.
Seconds are of the processor; those on the clock follow in brackets.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.process import process_session
from ecat.sample import ACTIONS
from ecat.sample.recording import sample_recording
from ecat.store import create_session

ROOT = Path(__file__).parents[1]
KEPT = Path(tempfile.gettempdir()) / "ecat_benchmark_lerobot"
ENVIRONMENT = Path(os.environ.get("ECAT_LEROBOT_ENV", ROOT / ".venv" / "lerobot"))
DIFFERENT = 10
TARGET, TARGET_MB = 3.0, 600
_EXPORT = """
import json, resource, sys, time
from pathlib import Path
from ecat import formats
options = {"episodes": "session", "clock": "images", "cameras": "color"}
start, wall = time.process_time(), time.perf_counter()
report = formats.export(Path(sys.argv[1]), Path(sys.argv[2]), format="lerobot", options=options)
used = time.process_time() - start, time.perf_counter() - wall
assert not report.failures, report.failures
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps({"cpu_s": used[0], "wall_s": used[1], "peak_mb": peak}))
"""


def recordings(pixels: tuple[int, int]) -> list[Path]:
    """Ten sessions with poses, rendered once."""
    made: list[Path] = []
    for seed in range(DIFFERENT):
        folder = KEPT / f"{pixels[0]}x{pixels[1]}" / f"s{seed}"
        if not (folder / "session.json").exists():
            print(f"rendering {folder.name}", flush=True)
            action = [ACTIONS[seed % len(ACTIONS)]]
            create_session(
                folder, sample_recording(seed=seed, actions=action, size=pixels, depth_size=(160, 132)).draft
            )
            process_session(folder)
        made.append(folder)
    return made


def project(folder: Path, sessions: list[Path], n: int) -> Path:
    """A project of n sessions, copies of these."""
    folder.mkdir()
    about = {"schema_version": 1, "name": "benchmark", "created": "2026-01-01T00:00:00Z"}
    (folder / "project.json").write_text(json.dumps(about))
    for number in range(n):
        shutil.copytree(sessions[number % len(sessions)], folder / f"session_{number:03d}")
    return folder


def run(python: Path | str, *arguments: str, path: Path) -> dict[str, Any]:
    """What a process of its own prints."""
    variables = os.environ | {"PYTHONPATH": str(path), "HF_HUB_OFFLINE": "1"}
    done = subprocess.run(
        [str(python), *arguments],
        env=variables,
        check=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--pixels", default="640x480")
    chosen = parser.parse_args()
    width, height = map(int, chosen.pixels.split("x"))
    sessions = recordings((width, height))
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        few, many = (
            project(place / "few", sessions, DIFFERENT),
            project(place / "many", sessions, chosen.sessions),
        )
        small = run(sys.executable, "-c", _EXPORT, str(few), str(place / "few_out"), path=ROOT)
        ours = run(sys.executable, "-c", _EXPORT, str(many), str(place / "out"), path=ROOT)
        info = json.loads((place / "out/meta/info.json").read_bytes())
        how = json.loads((place / "out/meta/ecat.json").read_bytes())["video"]["observation.images.color"]
        frames = info["total_frames"]
        print(
            f"{info['total_episodes']} sessions, {frames} images of {chosen.pixels}, {how['episodes_encoded']} encoded"
        )
        print(
            f"{'ecat':32}{ours['cpu_s']:8.1f} s ({ours['wall_s']:.1f})  {frames / ours['cpu_s']:8.0f} images/s"
        )
        print(f"{'memory, 10 sessions':32}{small['peak_mb']:8.0f} MB")
        print(
            f"{f'memory, {chosen.sessions} sessions':32}{ours['peak_mb']:8.0f} MB  (target: under {TARGET_MB})"
        )
        if not (ENVIRONMENT / ".installed").exists():
            print("lerobot is not installed: tests/conformance/lerobot_env.sh")
            return
        for name, codec, streaming in (
            ("lerobot", "libsvtav1", "no"),
            ("lerobot, H.264 streamed", "h264", "yes"),
        ):
            conformance = ROOT / "tests" / "conformance"
            arguments = [str(place / "out"), str(place / codec), str(DIFFERENT), codec, streaming]
            theirs = run(
                ENVIRONMENT / "bin" / "python",
                str(conformance / "lerobot_write.py"),
                *arguments,
                path=conformance / "stubs",
            )
            scale = frames / theirs["frames"]
            cpu, wall = theirs["cpu_s"] * scale, theirs["wall_s"] * scale
            print(
                f"{name:32}{cpu:8.1f} s ({wall:.1f})  {frames / cpu:8.0f} images/s"
                f"   {cpu / ours['cpu_s']:.1f} x of processor, {wall / ours['wall_s']:.1f} x on the clock"
                f"  (target: {TARGET:g})"
            )


if __name__ == "__main__":
    main()
