"""TUM RGB-D recordings: lists of images with their times, the camera's true path and its accelerometer.

Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, and the benchmark's page on file
formats.  ``rgb.txt`` and ``depth.txt`` name an image each line after its time in seconds; ``groundtruth.txt`` has time,
position and quaternion (x, y, z, w) of the colour camera, ``accelerometer.txt`` time and three accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ecat.errors import EcatError, FormatError
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Track, create
from ecat.formats.recordings.image_files import read_header
from ecat.formats.recordings.image_tracks import image_track
from ecat.formats.recordings.known_cameras import (
    KINECT_V1_PX,
    TUM,
    TUM_UNIT_M,
    Calibration,
    read_calibration,
)
from ecat.formats.recordings.rows import imu_rows, pose_rows, wall_clock
from ecat.formats.recordings.timed_lists import image_list, parse_rows, read_text
from ecat.progress import Progress
from ecat.store import TableData

NAME = "tum-rgbd"
_LISTS = {"color": "rgb.txt", "depth": "depth.txt"}


def sniff(path: Path) -> bool:
    """Whether it is a folder with ``rgb.txt`` or ``depth.txt``."""
    return any((path / name).is_file() for name in _LISTS.values())


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
    listed = {kind: image_list(source, name, what, notes) for kind, name in _LISTS.items()}
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
    return image_track(
        kind,
        paths,
        t_ns,
        what,
        camera=known.camera(kind),
        unit_m=known.depth_unit_m if kind == "depth" else None,
    )


def _tables(folder: Path, start_ns: int, notes: list[str]) -> dict[str, TableData]:
    tables: dict[str, TableData] = {}
    for name, columns in (("groundtruth.txt", 7), ("accelerometer.txt", 3)):
        if not (folder / name).is_file():
            continue
        try:
            t_ns, values, told = parse_rows(read_text(folder / name, f"cannot read {name}"), name, columns)
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
