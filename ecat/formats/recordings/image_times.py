"""When images were taken, as far as a list beside them or their names tell."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from ecat.errors import EcatError
from ecat.formats.recordings.timed_lists import read_text

WORDS = {"color": ("color", "colour", "rgb"), "depth": ("depth",)}
"""What files of a kind are called."""
_FIRST_S, _LAST_S = 946_684_800, 4_102_444_800
"""The wall clock's seconds from 2000 to 2100: what is in between counts from 1970."""
_LINE = re.compile(r"\s*(\d{1,19})(?:\.(\d{0,18}))?(?:[\s,;]+([^\r\n]{1,4096}))?")
_NAME = re.compile(r"(\d{1,19})(?:\.(\d{3,18}))?$")
_DIGITS_OF = {1: range(18, 20), 1000: range(15, 18), 1_000_000: range(12, 15)}
"""Nanoseconds a unit, and how many digits whole units since 1970 have."""


@dataclass(frozen=True)
class Times:
    """Times (n,) of images in ns, ascending; what says so; and the files that they are of, if any."""

    t_ns: list[int]
    told_by: str
    paths: list[Path]

    @property
    def is_wall_clock(self) -> bool:
        """Whether they count from 1970, and not from the recording's start."""
        return self.t_ns[0] >= _FIRST_S * 10**9


def times_of(
    source: Path, kind: str, images: Sequence[Path] | Callable[[], int], what: str, notes: list[str]
) -> Times | None:
    """The times of images of a kind, in files or as many as a video has (``images``); None where nothing tells them.

    A list is called ``depth.txt`` or ``depth_timestamps.txt`` and is beside them, or ``timestamps.txt`` in their own
    folder.  Its lines begin with a time: seconds with a decimal point, or whole milli-, micro- or nanoseconds since
    1970; the name of an image may follow, otherwise there are as many lines as images.  What is odd is told to
    ``notes``.
    """
    names = [f"{word}{ending}.txt" for word in WORDS[kind] for ending in ("", "_timestamps", "_times")]
    places = [source / name for name in names]
    if not callable(images) and images:
        places += [images[0].parent / name for name in ("timestamps.txt", "times.txt")]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return None if callable(images) else _by_names(images)
    try:
        return _by_list(path, images() if callable(images) else images, what, notes)
    except EcatError as error:
        notes.append(f"{path.name} was not read: {error.where}")
        return None


def _by_list(path: Path, images: Sequence[Path] | int, what: str, notes: list[str]) -> Times | None:
    files = [] if isinstance(images, int) else list(images)
    known = {file.name: file for file in files}
    rows: list[tuple[int, Path | None]] = []
    bad = 0
    for line in read_text(path, what).decode("utf-8", "replace").splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        found = _LINE.fullmatch(line.rstrip())
        t_ns = _ns(found[1], found[2]) if found else None
        if found is None or t_ns is None:
            bad += 1
            continue
        name = (found[3] or "").strip().replace("\\", "/").rpartition("/")[2]
        rows.append((t_ns, known.get(name)))
    if bad:
        notes.append(f"{path.name}: {bad} lines have no time whose unit is known; they were left out")
    if any(file for _, file in rows):
        named = {file: t_ns for t_ns, file in rows if file is not None}
        if alone := len(files) - len(named):
            notes.append(f"{path.name}: {alone} of {len(files)} images are not in it and were left out")
        return _ascending([(t_ns, file) for file, t_ns in named.items()], path.name, notes)
    n = images if isinstance(images, int) else len(files)
    if len(rows) != n:
        notes.append(f"{path.name} was not used: it has times for {len(rows)} images, and there are {n}")
        return None
    paths = files or [path] * n
    made = _ascending([(t_ns, paths[i]) for i, (t_ns, _) in enumerate(rows)], path.name, notes)
    if made is not None and made.t_ns != [t_ns for t_ns, _ in rows]:
        notes.append(f"{path.name} was not used: its times run backwards")
        return None
    return made


def _by_names(paths: Sequence[Path]) -> Times | None:
    found = [_NAME.search(path.stem) for path in paths]
    times = [_ns(match[1], match[2]) if match else None for match in found]
    pairs = [(t_ns, path) for t_ns, path in zip(times, paths, strict=True) if t_ns is not None]
    return _ascending(pairs, "the images' names", []) if len(pairs) == len(paths) else None


def _ascending(pairs: list[tuple[int, Path]], told_by: str, notes: list[str]) -> Times | None:
    pairs = sorted(pairs, key=lambda pair: pair[0])
    if any(after[0] == before[0] for before, after in pairwise(pairs)):
        notes.append(f"{told_by}: there are images of the same time; the times were not used")
        return None
    return Times([t_ns for t_ns, _ in pairs], told_by, [path for _, path in pairs]) if pairs else None


def _ns(whole: str, fraction: str | None) -> int | None:
    """Seconds with a fraction, or whole units since 1970 of which the number of digits tells the unit."""
    if fraction is not None:
        return int(whole) * 10**9 + int(fraction.ljust(9, "0")[:9]) if int(whole) < _LAST_S else None
    for unit_ns, digits in _DIGITS_OF.items():
        t_ns = int(whole) * unit_ns
        if len(whole) in digits and _FIRST_S * 10**9 <= t_ns < _LAST_S * 10**9:
            return t_ns
    return None
