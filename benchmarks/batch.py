"""Many small sessions: how much faster two processes are than one, Ray against processes, and memory.

``python benchmarks/batch.py [--sessions 1000] [--engines processes,ray]``: small generated sessions are exported
(``--format parquet``), and a tenth of them processed, by one process, by two, and as Ray tasks on this machine, in a
cluster that is started for them and in one that runs already; the results are compared byte by byte.  Each run is a
program of its own; its greatest memory is that of the program that joins, which must not grow with the number of
sessions (a tenth of them is exported for comparison).  Times are on the clock and mean little on a machine that does
something else as well; the runs take turns, and the best of each counts.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.sample import sample_session
from ecat.store import create_session

ROOT = Path(__file__).parents[1]
KINDS = 10
TARGET, TARGET_RAY = 1.8, 1.15
_PROGRAM = (
    "import sys; from ecat.cli import main; code = main(sys.argv[1:]);"
    "print([line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')][0]); sys.exit(code)"
)
RAY, RAY_RUNNING = "Ray, two at once", "Ray, running already"
RUNS = {
    "one process": ["--jobs", "1"],
    "two processes": ["--jobs", "2"],
    RAY: ["--jobs", "2", "--engine", "ray"],
    RAY_RUNNING: ["--jobs", "2", "--engine", "ray"],
}


def make(folder: Path, n: int) -> None:
    """Copies of a few generated sessions, which differ in name only."""
    models = [folder.with_name(f"{folder.name}-model{i}") for i in range(min(KINDS, n))]
    for seed, model in enumerate(models):
        create_session(model, sample_session(seed=seed, actions=("next",), name=f"s{seed}")[0])
    for i in range(n):
        shutil.copytree(models[i % len(models)], folder / f"{i:05}")


def run(name: str, arguments: list[str]) -> tuple[float, float]:
    """Seconds on the clock, and the greatest memory of the program itself in MB."""
    with cluster() if name == RAY_RUNNING else nullcontext(os.environ) as environment:
        begun = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM, *arguments, *RUNS[name], "-q"],
            check=True,
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        return time.perf_counter() - begun, int(done.stdout.split()[-1]) / 1024


@contextmanager
def cluster() -> Generator[dict[str, str]]:
    """The environment of programs that use a Ray cluster of this machine, which is there before the clock starts."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "RAY_USAGE_STATS_ENABLED": "0"}

    def ray(*arguments: str) -> int:
        program = Path(sys.executable).with_name("ray")
        return subprocess.run(
            [program, *arguments], check=False, env=environment, capture_output=True
        ).returncode

    if ray("status") == 0:
        sys.exit(
            "a Ray cluster runs on this machine, and would be stopped: --engines processes leaves Ray out"
        )
    try:
        if ray("start", "--head", "--num-cpus=2", "--include-dashboard=false"):
            sys.exit("Ray cannot be started: ray start --head says why")
        time.sleep(5)  # it says that it is there before its workers are
        yield {**environment, "RAY_ADDRESS": "auto"}
    finally:
        ray("stop")


def digest(folder: Path) -> str:
    """Of all files and their names; of sessions, of what can be compared: not when they were made."""
    total = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "session.lock"):
        total.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def compared(title: str, took: dict[str, list[float]], same: set[str]) -> None:
    """Print one comparison."""
    best = {name: min(seconds) for name, seconds in took.items()}
    print(f"{title}: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in best.items()))
    print(
        f"  two processes {best['one process'] / best['two processes']:.2f} times as fast (target {TARGET})"
    )
    for name, what in ((RAY, "its start included"), (RAY_RUNNING, "in a cluster that runs already")):
        if name in best:
            ratio = best[name] / best["two processes"]
            print(f"  Ray takes {ratio:.2f} of the processes' time (target {TARGET_RAY}), {what}")
    print(f"  results are {'equal' if len(same) == 1 else 'DIFFERENT'}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--engines", default="processes,ray")
    parser.add_argument("--process-all", action="store_true", help="not only a tenth; takes minutes")
    arguments = parser.parse_args()
    runs = [name for name, more in RUNS.items() if "ray" in arguments.engines or "ray" not in more]
    with tempfile.TemporaryDirectory() as scratch:
        project, tenth = Path(scratch, "project"), Path(scratch, "tenth")
        make(project, arguments.sessions)
        make(tenth, max(arguments.sessions // 10, 1))
        print(f"{arguments.sessions} sessions; {len(os.sched_getaffinity(0))} processors")
        export(project, tenth, runs, arguments.repeats)
        process(project if arguments.process_all else tenth, runs)


def export(project: Path, tenth: Path, runs: list[str], repeats: int) -> None:
    """Export all sessions in every way."""
    took: dict[str, list[float]] = {name: [] for name in runs}
    same: set[str] = set()
    memory = 0.0
    for _ in range(repeats):
        for name in runs:
            dest = project.with_name("out")
            seconds, memory_mb = run(name, ["export", str(project), str(dest), "--format", "parquet"])
            took[name].append(seconds)
            memory = max(memory, memory_mb) if "ray" not in RUNS[name] else memory
            same.add(digest(dest))
            shutil.rmtree(dest)
    compared("export", took, same)
    dest = project.with_name("out")
    _, few = run("two processes", ["export", str(tenth), str(dest), "--format", "parquet"])
    print(f"  memory {memory:.0f} MB, of a tenth of the sessions {few:.0f} MB")


def process(project: Path, runs: list[str]) -> None:
    """Process all sessions in every way, each in a copy of its own."""
    took: dict[str, list[float]] = {}
    same: set[str] = set()
    for name in runs:
        copy = project.with_name("copy")
        shutil.copytree(project, copy)
        took[name] = [run(name, ["process", str(copy)])[0]]
        same.add(digest_tables(copy))
        shutil.rmtree(copy)
    compared("process", took, same)


def digest_tables(folder: Path) -> str:
    """Of all tables; file names carry a random part."""
    total = hashlib.sha256()
    for session in sorted(folder.iterdir()):
        for data in sorted(path.read_bytes() for path in (session / "tables").glob("*.parquet")):
            total.update(data)
    return total.hexdigest()


if __name__ == "__main__":
    main()
