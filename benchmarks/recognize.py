"""A recogniser of actions: seconds of training, size of the model, windows per second alone and with their sessions.

    python benchmarks/recognize.py DIR [--model mixture] [--trees 150] [--epochs N]

DIR holds learning exports.  Times are of processors, of all cores together, and by the clock.  A mixture takes minutes,
`--model trees` less than one.  The first of two rounds of recognising also pays for what is made once.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).parents[1]))

from learn.features.windows import Floats
from learn.recognize import model as boosted
from learn.recognize.dataset import read_exports
from learn.recognize.mixture import Mixture
from learn.recognize.runs import BEST, MODELS, Options, load, save, train

T = TypeVar("T")


def timed(what: str, work: Callable[[], T], windows: int = 0) -> T:
    """Do it, and print how long it took."""
    clock, processor = time.perf_counter(), time.process_time()
    found = work()
    clock, processor = time.perf_counter() - clock, time.process_time() - processor
    rate = f", {windows / clock:,.0f} windows/s ({windows / processor:,.0f} per core)" if windows else ""
    print(f"{what}: {clock:.1f} s by the clock, {processor:.1f} s of processors{rate}", flush=True)
    return found


def alone(recognizer: Any, sessions: Sequence[Floats], *, thorough: bool = True) -> None:
    """What windows show without their session; of models of sequences that is part of :meth:`recognize` only."""
    if isinstance(recognizer, Mixture):
        alone(recognizer.trees, sessions)
        alone(recognizer.neural, sessions, thorough=False)
    elif isinstance(recognizer, boosted.Recognizer):
        recognizer.seen(sessions)
    else:
        recognizer.alone(sessions, thorough=thorough)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("--model", choices=MODELS, default=BEST)
    parser.add_argument("--trees", type=int)
    parser.add_argument("--epochs", type=int)
    given = parser.parse_args()
    options = Options(trees=given.trees, epochs=given.epochs)
    sessions = timed("reading", lambda: read_exports(given.source))
    windows = sum(len(session.labels) for session in sessions)
    recognizer, _ = timed(
        f"training {given.model} on {windows:,} windows of {len(sessions)} sessions",
        lambda: train(given.model, sessions, options),
    )
    with tempfile.TemporaryDirectory() as folder:
        timed("saving", lambda: save(recognizer, Path(folder)))
        files = [path for path in Path(folder).rglob("*") if path.is_file()]
        print(f"model: {sum(path.stat().st_size for path in files) / 1e6:.1f} MB")
        loaded = timed("loading", lambda: load(Path(folder)))
    points = [session.points for session in sessions]
    for _ in range(2):
        if given.model not in ("hmm", "lds"):
            timed("recognising windows alone", lambda: alone(loaded, points), windows)
        timed("recognising with the session", lambda: loaded.recognize(points), windows)


if __name__ == "__main__":
    main()
