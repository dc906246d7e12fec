"""Qualitative spatial relations: frames per second on one core, and memory of long tracks.

    python benchmarks/qsr.py [--tracks 1000] [--frames 10000] [--skip-memory]

Speed: the best tenth of many calls on 10,000 frames of two points, one directed pair, cardir + mos + argd + qtccs, each
from arrays of positions to codes; then every relation alone.  QSRLib 0.4.1 under Python 3.11 does 9,200 frames/s of the
four on a machine of the kind that the targets were set on.  Memory: peak of a process of its own that computes the
four of all tracks at once, and of one that takes them from a Parquet file and writes another.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from learn.features import qsr

FRAMES = 10_000
QSRLIB = 9_200
LIMITS = {"close": 0.1, "near": 0.25, "far": 0.5, "veryfar": 1.0}
BANDS = {"close": (0.1, 0.1), "near": (0.5, 0.2), "far": (1.0, 0.5)}
Floats = NDArray[np.float64]


def walk(*shape: int, seed: int) -> Floats:
    """Tracks (..., frames, 2), metres: steps of two centimetres."""
    steps = np.random.default_rng(seed).normal(0, 0.02, (*shape, 2))
    return np.cumsum(steps, axis=-2, out=steps)


def seconds(call: Callable[[], object], times: int = 200) -> float:
    """Processor time of a call, the best tenth."""
    taken: list[float] = []
    for _ in range(times):
        started = time.process_time()
        call()
        taken.append(time.process_time() - started)
    return sorted(taken)[times // 10]


def four(a: Floats, b: Floats) -> dict[str, Callable[[], object]]:
    """What the target is about."""
    return {
        "cardir": lambda: qsr.cardir(a, b),
        "mos": lambda: qsr.mos(a, threshold=0.005),
        "argd": lambda: qsr.argd(a, b, LIMITS),
        "qtccs": lambda: qsr.qtc_c(a, b, threshold=0.001),
    }


def speed() -> None:
    """Print frames per second."""
    a, b, c = (walk(FRAMES, seed=seed) for seed in range(3))
    boxes = [np.hstack([each, np.full((FRAMES, 2), 0.3)]) for each in (a, b)]
    parts = four(a, b)
    taken = {name: seconds(call) for name, call in parts.items()}
    rate = FRAMES / sum(taken.values())
    share = ", ".join(f"{name} {1e6 * value:.0f}" for name, value in taken.items())
    print(f"| cardir + mos + argd + qtccs, frames/s | {rate / 1e6:.1f} million ({share} us) | >= 4 million |")
    print(f"| as much as QSRLib's {QSRLIB:,} | {rate / QSRLIB:,.0f} times | >= 400 |")
    others: dict[str, Callable[[], object]] = {
        "qtccs with angle": lambda: qsr.qtc_c(a, b, threshold=0.001, angle=0.6),
        "qtcbs": lambda: qsr.qtc_b(a, b, threshold=0.001),
        "qtcbcs": lambda: qsr.qtc_bc(a, b, threshold=0.001),
        "argprobd": lambda: qsr.argprobd(a, b, BANDS, generator=qsr.seeded(0)),
        "rcc8": lambda: qsr.rcc8(*boxes),
        "ra": lambda: qsr.ra(*boxes),
        "mwe": lambda: qsr.mwe(a, b),
        "tpcc": lambda: qsr.tpcc(a, b, c),
    }
    states = qsr.qtc_c(a, b, threshold=0.001)
    others["chain of qtccs"] = lambda: qsr.chain(states, qsr.QTC_C, collapse=True, validate=True)
    for name, call in others.items():
        print(f"| {name}, frames/s | {FRAMES / seconds(call, 50) / 1e6:.1f} million | |")
    live = qsr.Live(qsr.RELATIONS["qtccs"], threshold=0.001)
    frames = list(zip(a[:500], b[:500], strict=True))
    each = seconds(lambda: [live.feed(*frame) for frame in frames], 10) / len(frames)
    print(f"| qtccs while it happens, one pair | {1e6 * each:.0f} us per frame | |")


def arrays_memory(n_tracks: int, n_frames: int) -> None:
    """Compute the four of all tracks at once, and print the peak of this process."""
    a, b = (walk(n_tracks, n_frames, seed=seed) for seed in (0, 1))
    codes = [call() for call in four(a, b).values()]
    print(f"{len(codes)} {peak_mb():.0f}")


def write_tracks(path: Path, n_tracks: int, n_frames: int) -> None:
    """Tracks as ``ecat learn qsr`` reads them."""
    schema = pa.schema(
        [("track", pa.int64()), ("frame", pa.int64()), *((c, pa.float64()) for c in ("x1", "y1", "x2", "y2"))]
    )
    with pq.ParquetWriter(path, schema) as writer:
        for track in range(n_tracks):
            places = np.hstack([walk(n_frames, seed=2 * track + k) for k in (0, 1)]).round(4)
            columns = [np.full(n_frames, track), np.arange(n_frames), *places.T]
            writer.write_table(pa.Table.from_arrays([pa.array(each) for each in columns], schema=schema))


def peak_mb() -> float:
    """Peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def memory(n_tracks: int, n_frames: int) -> None:
    """Print peaks of two processes."""
    size = [f"--tracks={n_tracks}", f"--frames={n_frames}"]
    done = subprocess.run(
        [sys.executable, __file__, *size, "--arrays"], check=True, capture_output=True, text=True
    )
    print(
        f"| {n_tracks:,} tracks of {n_frames:,} frames, the four, arrays | {done.stdout.split()[1]} MB | < 1 GB |"
    )
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "tracks.parquet"
        write_tracks(source, n_tracks, n_frames)
        program = "import resource, sys; from ecat.cli import main; main(sys.argv[1:]); "
        program += "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)"
        verb = ["learn", "qsr", str(source), "--relation=qtccs", "--quiet", "-o", f"{folder}/out.parquet"]
        done = subprocess.run(
            [sys.executable, "-c", program, *verb], check=True, capture_output=True, text=True
        )
    print(f"| the same, qtccs, from file to file | {done.stdout.strip()} MB | < 1 GB |")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tracks", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--skip-memory", action="store_true")
    parser.add_argument("--arrays", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.arrays:
        arrays_memory(asked.tracks, asked.frames)
        return
    print("| what | measured | target |\n|---|---|---|")
    speed()
    if not asked.skip_memory:
        memory(asked.tracks, asked.frames)


if __name__ == "__main__":
    main()
