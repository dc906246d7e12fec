"""How fast windows come out of a loader with one worker: ``ecat.datasets.Windows`` beside ``LeRobotDataset``.

The same generated recording is exported as ``torch``, with JPEG images and with raw ones, and as ``lerobot``, and the
same number of shuffled samples is read from each, in turns: some states and actions up to a moment, and the image of
that moment or of all of them.

``python benchmarks/loader.py --lerobot .venv/lerobot/bin/python`` (``tests/conformance/lerobot_env.sh`` makes it)
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
FPS, LENGTH, BATCH = 30, 16, 16


def poses(n_frames: int) -> Any:
    """Two boxes that move, of which everything is known at every frame."""
    import numpy as np
    import pyarrow as pa

    from ecat.tables import POSES

    n = 2 * n_frames
    frame = np.repeat(np.arange(n_frames), 2)
    known: dict[str, Any] = {
        "frame": frame,
        "t_ns": frame * 1_000_000_000 // FPS,
        "object_id": np.tile(["o1", "o2"], n_frames),
        "x": frame / 1000,
        **{name: np.zeros(n) for name in ("y", "z", "qx", "qy", "qz")},
        "qw": np.ones(n),
        "source": np.full(n, "observed", object),
        "support": np.full(n, "table", object),
    }
    columns = [
        (pa.array(known[f.name]) if f.name in known else pa.nulls(n)).cast(f.type) for f in POSES.arrow
    ]
    return pa.table(columns, schema=POSES.arrow)


def record(project: Path, n_frames: int) -> None:
    """A session of moving boxes and a video of 320 x 240 with texture that moves."""
    import cv2
    import numpy as np

    from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Role, Segment, Stream
    from ecat.store import Draft, TableData, create_session
    from ecat.store.media import ColorWriter

    chance = np.random.default_rng(0)
    scene = cv2.GaussianBlur(chance.integers(0, 256, (480, 640, 3)).astype(np.uint8), (0, 0), 3)

    def film(path: Path) -> None:
        with ColorWriter(path, 320, 240) as writer:
            for i in range(n_frames):
                x, y = round(100 + 90 * np.sin(i / 40)), round(100 + 90 * np.cos(i / 50))
                image = np.ascontiguousarray(scene[y : y + 240, x : x + 320])
                cv2.rectangle(image, (i % 280, 100), (i % 280 + 40, 140), (0, 0, 255), -1)
                writer.write(image, i * 1_000_000_000 // FPS)

    things = tuple(
        AnnotatedObject(id=f"o{i}", name=name, kind="marker_box") for i, name in enumerate(("red", "blue"), 1)
    )
    events = tuple(
        Event(
            id=f"e{start}",
            type="slide",
            text="slide it",
            segments=(Segment(start_frame=start, end_frame=start + 150),),
            roles=(Role(name="Theme", target="o1"),),
        )
        for start in range(0, n_frames - 150, 150)
    )
    manifest = Manifest(
        name="session",
        created="2026",
        n_frames=n_frames,
        clock=Clock(rule="uniform", duration_ns=(n_frames - 1) * 1_000_000_000 // FPS),
        streams=(
            Stream(name="color", kind="color", file="media/color.mp4", present=True, n_frames=n_frames),
        ),
    )
    draft = Draft(
        manifest=manifest,
        layers=(Layer(objects=things, events=events),),
        tables={"poses": TableData(data=poses(n_frames))},
        media={"color": film},
    )
    create_session(project / "session", draft)


def open_dataset(kind: str, folder: Path, frames: str) -> Any:
    """The windows; in the environment of the one that reads them."""
    if kind == "ecat":
        sys.path.insert(0, str(ROOT))
        from ecat.datasets import Windows

        return Windows(folder, length=LENGTH, images=("color",), frames=frames)
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # pyright: ignore[reportMissingImports]

    deltas = [(i - LENGTH + 1) / FPS for i in range(LENGTH)]
    info = json.loads((folder / "meta" / "info.json").read_text())
    (image,) = (name for name in info["features"] if name.startswith("observation.images."))
    wanted = {"observation.state": deltas, "action": deltas} | ({image: deltas} if frames == "all" else {})
    backend = os.environ.get("LEROBOT_VIDEO_BACKEND", "pyav")
    return LeRobotDataset("local/bench", root=folder, delta_timestamps=wanted, video_backend=backend)


def read(kind: str, folder: Path, frames: str, n_samples: int) -> dict[str, float]:
    """Samples a second, on the wall's clock and of processor time, from the first batch to the end of the worker."""
    import torch
    from torch.utils.data import DataLoader, RandomSampler

    torch.set_num_threads(1)
    data = open_dataset(kind, folder, frames)
    sampler = RandomSampler(
        data, replacement=True, num_samples=n_samples, generator=torch.Generator().manual_seed(0)
    )
    loader: Any = DataLoader(data, batch_size=BATCH, sampler=sampler, num_workers=1)
    before, start = sum(os.times()[:4]), time.perf_counter()
    found = sum(len(next(iter(batch.values()))) for batch in loader)
    wall_s = time.perf_counter() - start
    del loader
    processor_s = sum(os.times()[:4]) - before
    assert found == n_samples
    return {"wall": n_samples / wall_s, "processor": n_samples / processor_s}


def run(python: str, kind: str, folder: Path, frames: str, n_samples: int) -> dict[str, float]:
    """:func:`read` in an environment of its own."""
    stubs = str(ROOT / "tests" / "conformance" / "stubs")
    more = {"HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    if kind == "lerobot":
        more["PYTHONPATH"] = stubs
    # -P: benchmarks/lerobot.py is not the lerobot that is meant
    command = [
        python,
        "-P",
        __file__,
        "--read",
        kind,
        str(folder),
        "--frames",
        frames,
        "--samples",
        str(n_samples),
    ]
    done = subprocess.run(command, capture_output=True, check=False, text=True, env=os.environ | more)
    if done.returncode:
        raise SystemExit(done.stderr[-3000:])
    return json.loads(done.stdout.splitlines()[-1])


def compare(lerobot: str | None, n_samples: int, n_frames: int) -> None:
    """Print a table."""
    sys.path.insert(0, str(ROOT))
    from ecat import formats

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        record(folder / "project", n_frames)
        # lerobot 0.4 does not know the columns of language that 0.6 reads
        made = (("torch", {}), ("raw", {"images": "raw"}), ("lerobot", {"language": "none"}))
        for name, options in made:
            written = "lerobot" if name == "lerobot" else "torch"
            formats.export(folder / "project", folder / name, format=written, options=options)
        print(f"{'images':8}{'loader':10}{'samples/s':>12}{'per processor s':>18}")
        for frames in ("last", "all"):
            n = n_samples if frames == "last" else n_samples // 4
            rates: dict[str, list[dict[str, float]]] = {"torch": [], "raw": [], "lerobot": []}
            for _ in range(2):
                for name in ("torch", "raw"):
                    rates[name].append(run(sys.executable, "ecat", folder / name, frames, 4 * n))
                if lerobot:
                    rates["lerobot"].append(run(lerobot, "lerobot", folder / "lerobot", frames, n))
            best = {
                kind: {by: max(rate[by] for rate in some) for by in ("wall", "processor")}
                for kind, some in rates.items()
                if some
            }
            for kind, rate in best.items():
                print(f"{frames:8}{kind:10}{rate['wall']:12,.0f}{rate['processor']:18,.0f}")
            for name in ("torch", "raw") if lerobot else ():
                ratio = {by: best[name][by] / best["lerobot"][by] for by in ("wall", "processor")}
                print(
                    f"{frames:8}{name + ' x':10}{ratio['wall']:12.1f}{ratio['processor']:18.1f}", flush=True
                )


def main() -> None:
    """Compare, or read in the environment of one."""
    parser = argparse.ArgumentParser(description="windows of ecat beside those of lerobot")
    parser.add_argument("--lerobot", metavar="PYTHON", help="of an environment that has lerobot")
    parser.add_argument("--read", nargs=2, metavar=("KIND", "FOLDER"), help=argparse.SUPPRESS)
    parser.add_argument("--frames", default="last", choices=("last", "all"))
    parser.add_argument("--samples", type=int, default=480)
    parser.add_argument("--length", type=int, default=1800, help="of the recording, in frames")
    asked = parser.parse_args()
    if asked.read:
        print(json.dumps(read(asked.read[0], Path(asked.read[1]), asked.frames, asked.samples)))
    else:
        compare(asked.lerobot, asked.samples, asked.length)


if __name__ == "__main__":
    main()
