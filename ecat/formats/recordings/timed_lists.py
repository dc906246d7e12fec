"""Lists whose lines begin with a time in seconds, as the TUM RGB-D benchmark introduced them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecat.formats.recordings.rows import numbers_of
from ecat.store import files
from ecat.store.manifest import is_inside

_MAX_BYTES = 256 << 20
_LINE = re.compile(rb"[ \t]*(\d{1,10})(?:\.(\d{0,18}))?[ \t,]+([^\r\n]{1,4096})")


@dataclass
class TimedLines:
    """The lines of a file: their times in ns, sorted, and what follows them; what was odd, a line each."""

    t_ns: list[int] = field(default_factory=list[int])
    rest: list[str] = field(default_factory=list[str])
    notes: list[str] = field(default_factory=list[str])


def parse_lines(data: bytes, name: str) -> TimedLines:
    """The timed lines of a list; comments (``#``) are passed over, other lines are counted."""
    found = TimedLines()
    pairs: list[tuple[int, str]] = []
    bad = 0
    for line in data.splitlines():
        if not line.strip() or line.lstrip().startswith(b"#"):
            continue
        match = _LINE.fullmatch(line.rstrip())
        t_ns = int(match[1]) * 10**9 + int((match[2] or b"").ljust(9, b"0")[:9]) if match else 1 << 62
        if match is None or t_ns >= 1 << 62:
            bad += 1
            continue
        pairs.append((t_ns, match[3].decode("utf-8", "replace").strip()))
    backwards = sum(after[0] < before[0] for before, after in pairwise(pairs))
    if backwards:
        found.notes.append(
            f"{name}: time runs backwards {backwards} times; the lines were sorted by their times"
        )
        pairs.sort(key=lambda pair: pair[0])
    if bad:
        found.notes.append(f"{name}: {bad} lines are not a time and what belongs to it; they were left out")
    found.t_ns, found.rest = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    return found


def parse_rows(
    data: bytes, name: str, columns: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], list[str]]:
    """Timed lines of ``columns`` numbers each: times (n,) in ns, numbers (n, columns), and what was odd."""
    lines = parse_lines(data, name)
    rows = [(t, numbers_of(rest.encode())) for t, rest in zip(lines.t_ns, lines.rest, strict=True)]
    good = [(t, row) for t, row in rows if row is not None and len(row) == columns and np.isfinite(row).all()]
    if len(good) < len(rows):
        lines.notes.append(
            f"{name}: {len(rows) - len(good)} lines do not have {columns} numbers; they were left out"
        )
    values = np.array([row for _, row in good], np.float64).reshape(-1, columns)
    return np.array([t for t, _ in good], np.int64), values, lines.notes


def read_text(path: Path, what: str) -> bytes:
    """The whole of a list; StoreError or LimitError if that cannot be had."""
    with files.typed_errors(what, path):
        return files.read_bytes(path, _MAX_BYTES)


def image_list(folder: Path, name: str, what: str, notes: list[str]) -> tuple[list[int], list[Path]]:
    """The images that a list names and that are inside the folder, and their times in ns."""
    if not (folder / name).is_file():
        notes.append(f"there is no {name}")
        return [], []
    lines = parse_lines(read_text(folder / name, what), name)
    notes += lines.notes
    root = folder.resolve()
    kept: list[tuple[int, Path]] = []
    outside: list[str] = []
    missing: list[str] = []
    for t_ns, said in zip(lines.t_ns, lines.rest, strict=True):
        try:
            inside = is_inside(said) and (folder / said).resolve().is_relative_to(root)
            there = inside and (folder / said).is_file()
        except (OSError, ValueError):  # a name that no file system has
            inside = there = False
        if there:
            kept.append((t_ns, folder / said))
        else:
            (missing if inside else outside).append(said)
    if outside:
        notes.append(
            f"{name}: {len(outside)} paths lead out of the folder and were not followed: {outside[0]!r}"
        )
    if missing:
        notes.append(f"{name}: {len(missing)} of {len(lines.t_ns)} images are not there: {missing[0]!r}")
    return [t for t, _ in kept], [path for _, path in kept]
