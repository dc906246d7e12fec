"""The recogniser of actions: seconds of training, windows per second, size of the model.

    python benchmarks/recognize.py DIR [--trees 150]

DIR holds learning exports.  Times are of processors, of all cores together, and by the clock.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).parents[1]))

from learn.recognize.dataset import read_exports
from learn.recognize.model import MODEL, Settings, load, save, train

T = TypeVar("T")


def timed(what: str, work: Callable[[], T], windows: int = 0) -> T:
    """Do it, and print how long it took."""
    clock, processor = time.perf_counter(), time.process_time()
    found = work()
    clock, processor = time.perf_counter() - clock, time.process_time() - processor
    rate = f", {windows / clock:,.0f} windows/s ({windows / processor:,.0f} per core)" if windows else ""
    print(f"{what}: {clock:.1f} s by the clock, {processor:.1f} s of processors{rate}")
    return found


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("--trees", type=int, default=Settings.n_trees)
    given = parser.parse_args()
    sessions = timed("reading", lambda: read_exports(given.source))
    windows = sum(len(session.labels) for session in sessions)
    recognizer = timed(
        f"training on {windows} windows", lambda: train(sessions, Settings(n_trees=given.trees))
    )
    with tempfile.TemporaryDirectory() as folder:
        timed("saving", lambda: save(recognizer, Path(folder)))
        print(f"model: {(Path(folder) / MODEL).stat().st_size / 1e6:.1f} MB")
        loaded = timed("loading", lambda: load(Path(folder)))
    points = [session.points for session in sessions]
    for _ in range(2):
        timed("recognising", lambda: loaded.recognize(points), windows)


if __name__ == "__main__":
    main()
