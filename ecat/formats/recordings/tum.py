"""TUM RGB-D recordings: lists of images with their times, the camera's true path and its accelerometer.

Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, and the benchmark's page on file
formats.  ``rgb.txt`` and ``depth.txt`` name an image each line after its time in seconds; ``groundtruth.txt`` has time,
position and quaternion (x, y, z, w) of the colour camera, ``accelerometer.txt`` time and three accelerations.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecat.errors import EcatError, FormatError
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Track, color_track, create, depth_track
from ecat.formats.recordings.image_files import image_source, read_header
from ecat.formats.recordings.known_cameras import (
    KINECT_V1_PX,
    TUM,
    TUM_UNIT_M,
    Calibration,
    read_calibration,
)
from ecat.formats.recordings.rows import imu_rows, numbers_of, pose_rows, wall_clock
from ecat.progress import Progress
from ecat.store import TableData, files
from ecat.store.manifest import is_inside

NAME = "tum-rgbd"
_LISTS = {"color": "rgb.txt", "depth": "depth.txt"}
_MAX_BYTES = 256 << 20
_LINE = re.compile(rb"[ \t]*(\d{1,10})(?:\.(\d{0,18}))?[ \t,]+([^\r\n]{1,4096})")


@dataclass
class TimedLines:
    """The lines of a file: their times in ns, sorted, and what follows them; what was odd, a line each."""

    t_ns: list[int] = field(default_factory=list[int])
    rest: list[str] = field(default_factory=list[str])
    notes: list[str] = field(default_factory=list[str])


def sniff(path: Path) -> bool:
    """Whether it is a folder with ``rgb.txt`` or ``depth.txt``."""
    return any((path / name).is_file() for name in _LISTS.values())


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


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a recording into a session; t = 0 is its first image.

    Raises
    ------
    FormatError : neither list names an image that can be read.
    LimitError : images of more pixels, or lists of more bytes, than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    notes: list[str] = []
    listed = {kind: _listed(source, name, what, notes) for kind, name in _LISTS.items()}
    sizes = {kind: _first_size(paths, what) for kind, (_, paths) in listed.items()}
    listed = {kind: found for kind, found in listed.items() if sizes[kind] is not None}
    if not listed:
        told = f"; {notes[0]}" if notes else ""
        raise FormatError(what, where=f"{source}: rgb.txt and depth.txt name no image that can be read{told}")
    known = _calibration(source, sizes)
    start_ns = min(times[0] for times, _ in listed.values())
    tracks = [
        _track(kind, paths, [t - start_ns for t in times], known, what)
        for kind, (times, paths) in listed.items()
    ]
    notes += [f"there are no {kind} images" for kind in _LISTS if kind not in listed]
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=source.resolve().name,
        cameras=known.cameras,
        tables=_tables(source, start_ns, notes),
        notes=[*notes, *known.notes],
        start=wall_clock(start_ns),
        progress=progress,
    )


def _read_text(path: Path, what: str) -> bytes:
    with files.typed_errors(what, path):
        return files.read_bytes(path, _MAX_BYTES)


def _listed(folder: Path, name: str, what: str, notes: list[str]) -> tuple[list[int], list[Path]]:
    """The images that a list names and that are inside the folder."""
    if not (folder / name).is_file():
        notes.append(f"there is no {name}")
        return [], []
    lines = parse_lines(_read_text(folder / name, what), name)
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


def _first_size(paths: Sequence[Path], what: str) -> tuple[int, int] | None:
    for path in paths:
        try:
            header = read_header(path, what)
        except FormatError:
            continue
        return header.width_px, header.height_px
    return None


def _calibration(folder: Path, sizes: dict[str, tuple[int, int] | None]) -> Calibration:
    written = read_calibration(folder, sizes["color"], sizes["depth"])
    unit_m = written.depth_unit_m or TUM_UNIT_M
    if written.cameras or written.notes:
        return replace(written, depth_unit_m=unit_m)
    if {size for size in sizes.values() if size} != {KINECT_V1_PX}:
        return Calibration(
            (), unit_m, ("there is no calibration for images of this size: the cameras are unknown",)
        )
    there = tuple(camera for camera in TUM.cameras if sizes[camera.name])
    if len(there) == 1:
        there = (replace(there[0], reference=""),)
    return Calibration(there, unit_m, TUM.notes)


def _track(kind: str, paths: list[Path], t_ns: list[int], known: Calibration, what: str) -> Track:
    notes: list[str] = []
    images = image_source(paths, t_ns, what, deep=kind == "depth", note=notes.append)
    camera = known.camera(kind)
    if kind == "color":
        track = color_track(kind, images, camera=camera, expected=len(paths))
    else:
        track = depth_track(kind, images, unit_m=known.depth_unit_m, camera=camera, expected=len(paths))
    track.notes = notes
    return track


def _tables(folder: Path, start_ns: int, notes: list[str]) -> dict[str, TableData]:
    tables: dict[str, TableData] = {}
    for name, columns in (("groundtruth.txt", 7), ("accelerometer.txt", 3)):
        if not (folder / name).is_file():
            continue
        try:
            t_ns, values, told = parse_rows(_read_text(folder / name, f"cannot read {name}"), name, columns)
        except EcatError as error:
            notes.append(f"{name} was not read: {error.where}")
            continue
        notes += told
        if not len(t_ns):
            continue
        if columns == 3:
            tables["imu"] = TableData(data=imu_rows(t_ns - start_ns, np.zeros(len(t_ns), np.int8), values))
            continue
        norm = np.linalg.norm(values[:, 3:], axis=1)
        good = np.abs(norm - 1) < 0.05
        if not good.all():
            notes.append(
                f"{name}: {int((~good).sum())} rotations are no unit quaternions; they were left out"
            )
        poses = np.hstack([values[good, :3], values[good, 3:] / norm[good, None]])
        tables["camera_poses"] = TableData(data=pose_rows(t_ns[good] - start_ns, None, poses, "color"))
    return tables


FORMAT = Format(
    name=NAME,
    description="TUM RGB-D folders: rgb.txt, depth.txt, groundtruth.txt, accelerometer.txt",
    sniff=sniff,
    read=read,
)
