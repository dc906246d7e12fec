"""How fast and how large ECAT's files are to read, each figure beside a parser that only parses them.

``python benchmarks/ecat2018.py [folder]``: a folder with ``ecat_kinect`` and ``ecat_movies``, by default
``../shared/data``.
"""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd  # pyarrow loads it at the first conversion: not a part of reading
from lxml import etree

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat import formats
from ecat.formats.ecat2018.files_param import read_files_param
from ecat.formats.registry import all_formats

ROOT = Path(__file__).parents[1]
RUNS = 15
TIMES_AS_LONG = 100
TARGET_RATIO = 2.5
TARGET_MB = 400


@dataclass(frozen=True)
class Took:
    """Wall clock and processor time of one piece of work, seconds; the latter counts all threads."""

    wall_s: float
    cpu_s: float


def took(work: Callable[[], object]) -> Took:
    """Time one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Took(time.perf_counter() - wall, time.process_time() - cpu)


def report(name: str, mine: list[Took], parsing: list[Took], target: str = "") -> None:
    """Times of one kind of work, and their ratios to parsing in the same rounds: median, and best to best."""
    parts = [f"{name:17}"]
    for kind, times, theirs in (
        ("wall", [t.wall_s for t in mine], [t.wall_s for t in parsing]),
        ("processor", [t.cpu_s for t in mine], [t.cpu_s for t in parsing]),
    ):
        ratio = statistics.median(m / p for m, p in zip(times, theirs, strict=True))
        best = min(times) / min(theirs)
        parts.append(
            f"{kind} {1000 * statistics.median(times):4.0f} ms, ratio {ratio:4.2f}, of best {best:4.2f}"
        )
    print("   ".join(parts), target)


def compare(files: list[Path]) -> None:
    """Parse, read, import (with durable writes) and export the same files, in turns."""
    names = ("lxml.etree.parse", "read", "import", "export")
    rounds = [_round(files) for _ in range(RUNS)]
    for name, durations in zip(names, zip(*rounds, strict=True), strict=True):
        target = f"(target {TARGET_RATIO})" if name == "import" else ""
        report(name, list(durations), [parsing for parsing, *_ in rounds], target)


def _round(files: list[Path]) -> tuple[Took, ...]:
    with tempfile.TemporaryDirectory() as place:
        made = [Path(place, f"made{i}") for i in range(len(files))]
        back = [Path(place, f"back{i}") for i in range(len(files))]

        def parse() -> None:
            for file in files:
                etree.parse(file)

        def read() -> None:
            for file in files:
                read_files_param(file)

        def bring_in() -> None:
            for file, session in zip(files, made, strict=True):
                formats.import_source(file.parent, session)

        def bring_out() -> None:
            for session, folder in zip(made, back, strict=True):
                formats.export(session, folder, format="ecat-2018")

        return tuple(took(work) for work in (parse, read, bring_in, bring_out))


def lengthened(text: str, times: int) -> Iterator[str]:
    """The session with the markers of each list repeated, with growing frame numbers."""
    length = int(re.search(r' length="(\d+)"', text).group(1))  # type: ignore[union-attr]
    rest = 0
    for found in re.finditer(
        r"(<markers(?:3d)?>\n)((?: {8}<marker [^/]*?glyphSize.*?</marker>\n)+)", text, re.DOTALL
    ):
        yield text[rest : found.end(1)]
        for i in range(times):
            shift = i * length
            yield re.sub(r'frame="(\d+)"', lambda m: f'frame="{int(m.group(1)) + shift}"', found.group(2))  # noqa: B023
        rest = found.end()
    yield text[rest:]


IMPORT = """
import resource, sys, time
from pathlib import Path
from ecat import formats
start = time.perf_counter()
formats.import_source(Path(sys.argv[1]), Path(sys.argv[2]))
took = time.perf_counter() - start
print(f"{took:.1f} s, at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB of memory")
"""


def long_session(file: Path) -> None:
    """Import a session many times as long in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "Session1")
        folder.mkdir()
        text = file.read_text("utf-8")
        with (folder / "files.param").open("w", encoding="utf-8") as out:
            out.writelines(lengthened(text, TIMES_AS_LONG))
        size = (folder / "files.param").stat().st_size >> 20
        command = [sys.executable, "-c", IMPORT, str(folder), str(Path(place, "made"))]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    print(
        f"{TIMES_AS_LONG} times as long ({size} MB): {done.stdout.strip() or done.stderr}  (target {TARGET_MB} MB)"
    )


def movies(folder: Path) -> None:
    """Import and export a workspace of small sessions."""
    with tempfile.TemporaryDirectory() as place:
        made = Path(place, "made")
        n = 0

        def bring_in() -> None:
            nonlocal n
            n = formats.import_source(folder, made).sessions

        incoming = took(bring_in)
        outgoing = took(lambda: formats.export(made, Path(place, "back"), format="ecat-2018"))
    print(
        f"{n} movie sessions: import {n / incoming.wall_s:.0f}, export {n / outgoing.wall_s:.0f} sessions/s"
        f" (per second of one core: {n / incoming.cpu_s:.0f}, {n / outgoing.cpu_s:.0f})"
    )


def main() -> None:
    """Print all figures."""
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared" / "data"
    if not (data / "ecat_kinect").is_dir():
        print(f"skipped: the reference data is not at {data}")
        return
    all_formats()
    files = sorted((data / "ecat_kinect").rglob("files.param"))
    megabytes = sum(file.stat().st_size for file in files) / 1e6
    print(f"{len(files)} Kinect sessions, {megabytes:.1f} MB (pandas {pd.__version__})")
    compare(files)
    long_session(files[0])
    movies(data / "ecat_movies" / "Annotation_Test")


if __name__ == "__main__":
    main()
