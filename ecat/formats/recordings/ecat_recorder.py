"""What ECAT's recorder leaves without a session file: ``rgb_*.avi``, ``depth_*.dep``, ``rig_*.xml`` side by side.

Source: ECAT 2018 file format §1.4, §1.5, §1.7.  All three count their times from the first colour image.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.rig import Rig, read_rig
from ecat.formats.ecat2018.session_folder import kinect_cameras
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Decoded, Track, color_track, copied_track, create, depth_track
from ecat.formats.recordings.several import Part, create_all
from ecat.formats.recordings.untimed import create_untimed
from ecat.geometry.nearest import nearest_in_time
from ecat.model import Stream
from ecat.progress import Progress
from ecat.store import TableData, files
from ecat.store.media import MILLIMETRE
from ecat.store.media.container import first_video, scan
from ecat.store.media.dep import DepthFile
from ecat.tables import JOINTS

NAME = "ecat-recorder"
_SESSION_FILE = "files.param"
_STAMPED = re.compile(r"(?:rgb|color|depth|rig)_(.+)", re.IGNORECASE)
_MS = 1_000_000
_KEPT = ("body", "joint", "x", "y", "z", "u_px", "v_px", "state")


@dataclass
class _Files:
    """The files of one recording."""

    video: Path | None = None
    depth: Path | None = None
    rig: Path | None = None
    notes: list[str] = field(default_factory=list[str])


def _kind(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix == ".xml":
        return "rig" if path.name.lower().startswith("rig_") else ""
    return {".avi": "video", ".dep": "depth"}.get(suffix, "")


def sniff(path: Path) -> bool:
    """Whether it is a folder without session file that has depth or skeletons of the recorder in it."""
    try:
        if not path.is_dir() or (path / _SESSION_FILE).exists():
            return False
        return any(_kind(file) in {"depth", "rig"} and file.is_file() for file in path.iterdir())
    except OSError:
        return False


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read the folder's recording into a session; a folder with several of them, by their stamps, into a project.

    Raises
    ------
    FormatError : there is no recording, or nothing of it can be read.
    """
    what = f"cannot import {source.name}"
    with files.typed_errors(what, source, "nothing was written"):
        found = _recordings(source)
    if not found:
        raise FormatError(what, where=f"{source}: there is no .avi, .dep or rig_*.xml in it")
    parts: list[Part] = [
        (name, lambda to, one=one: _create(one, source, to, what, progress)) for name, one in found.items()
    ]
    return create_all(
        dest, parts, format_name=NAME, source=source.resolve().name, options=options, progress=progress
    )


def _recordings(folder: Path) -> dict[str, _Files]:
    """By the stamp in the files' names, or all together where there is not more than one of a kind."""
    paths = [path for path in sorted(folder.iterdir()) if _kind(path) and path.is_file()]
    kinds = [_kind(path) for path in paths]
    alone = len(set(kinds)) == len(kinds)
    found: dict[str, _Files] = {}
    for path, kind in zip(paths, kinds, strict=True):
        stamp = _STAMPED.fullmatch(path.stem)
        name = "session" if alone else re.sub(r"[^\w.-]", "_", stamp[1] if stamp else path.stem).lstrip("._-")
        one = found.setdefault(name or "session", _Files())
        if getattr(one, kind) is None:
            setattr(one, kind, path)
        else:
            one.notes.append(f"{path.name} was left out: there is another of its kind")
    return found


def _create(one: _Files, folder: Path, dest: Path, what: str, progress: Progress) -> ImportReport:
    notes = list(one.notes)
    color = _color(one, notes, progress)
    depth = _depth(one, notes)
    rig = _rig(one, notes)
    if color is None and depth is None and rig is None:
        raise FormatError(what, where=notes[0] if notes else f"{folder}: nothing in it can be read")
    tracks = [track for track in (color, depth) if track is not None]
    notes += [
        f"there is no {kind}" for kind, track in (("colour video", color), ("depth file", depth)) if not track
    ]
    tables: dict[str, TableData] = {}
    if rig is not None and rig.joints.num_rows:
        tables["joints"] = TableData(data=_joint_rows(rig, color or depth))
    if rig is not None and not tracks:
        return _without_images(rig, folder, dest, tables, notes)
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=folder.resolve().name,
        cameras=kinect_cameras(),
        tables=tables,
        notes=notes,
        progress=progress,
    )


def _without_images(
    rig: Rig, folder: Path, dest: Path, tables: dict[str, TableData], notes: list[str]
) -> ImportReport:
    """Skeletons alone: without images there is nothing that a session's clock could count."""
    told = "without images the frames are the recorder's count of colour images, and the skeletons' times are left out"
    return create_untimed(
        dest,
        (),
        format_name=NAME,
        source=folder.resolve().name,
        n_frames=int(np.asarray(rig.joints["counter"]).max(initial=0)),
        cameras=kinect_cameras(),
        tables=tables,
        notes=[*notes, told],
    )


def _color(one: _Files, notes: list[str], progress: Progress) -> Track | None:
    if one.video is None:
        return None
    what, name = f"cannot read {one.video.name}", one.video.name
    try:
        index = first_video(one.video, what)
        found = scan(one.video, what, tell=lambda done, total: progress(f"reading {name}", done, total))
    except FormatError as error:
        notes.append(f"{name} cannot be read and was left out: {error.where}")
        return None
    packets = found.packets[index]
    n = len(packets.pts) + packets.n_unclear
    if not n:
        notes.append(f"{name}: there is not a single image in it; it was left out")
        return None
    if found.stopped:
        notes.append(f"{name} is not complete: {found.stopped}; {n} images were there")
    track = color_track("color", Decoded(one.video, index), camera="color", expected=n)
    track.note(f"transcoded from {name} to H.264, which browsers play")
    return track


def _depth(one: _Files, notes: list[str]) -> Track | None:
    if one.depth is None:
        return None
    path = one.depth
    try:
        with DepthFile(path) as depth:
            notes += [f"{path.name}: {finding}" for finding in depth.findings]
            n, times_ms, size = len(depth), depth.times_ms, (depth.width, depth.height)
    except FormatError as error:
        notes.append(f"{path.name} cannot be read and was left out: {error.where}")
        return None
    if not n:
        notes.append(f"{path.name}: there is not a single image in it; it was left out")
        return None
    if times_ms is None:
        notes.append(f"{path.name} was copied as it is, as its times are unknown")
        stream = Stream(
            name="depth",
            kind="depth",
            file="media/depth.dep",
            codec="uint16",
            camera="depth",
            n_frames=n,
            width_px=size[0],
            height_px=size[1],
            depth_unit_m=MILLIMETRE,
        )
        return copied_track(stream, path)
    times = times_ms.astype(np.int64) * _MS
    order = np.argsort(times, kind="stable")

    def images() -> Iterator[tuple[int, NDArray[np.uint16]]]:
        with DepthFile(path) as file:
            for index in order:
                yield int(times[index]), file.frame(int(index))

    return depth_track("depth", images, unit_m=MILLIMETRE, camera="depth", expected=n)


def _rig(one: _Files, notes: list[str]) -> Rig | None:
    if one.rig is None:
        return None
    try:
        rig = read_rig(one.rig)
    except FormatError as error:
        notes.append(f"{one.rig.name} cannot be read and was left out: {error.where}")
        return None
    notes += [f"{one.rig.name}: {finding}" for finding in rig.findings]
    return rig


def _joint_rows(rig: Rig, video: Track | None) -> Iterator[pa.RecordBatch]:
    """The skeletons on the images nearest in time; asked for when the times of the images are known."""
    rows = rig.joints
    t_ns = rows["t_ns"] if video is not None else pa.nulls(rows.num_rows, pa.int64())
    if video is not None and len(video.t_ns) and rows["t_ns"].null_count == 0:
        moments = np.sort(np.frombuffer(video.t_ns, np.int64))
        frames = nearest_in_time(moments, np.asarray(rows["t_ns"]), later_on_tie=True)
    else:
        frames = np.maximum(np.asarray(rows["counter"]).astype(np.int32) - 1, 0)
    columns = {
        "t_ns": t_ns,
        "frame": pa.array(frames, pa.int32()),
        "object_id": pa.nulls(rows.num_rows, JOINTS.arrow.field("object_id").type),
    } | {name: rows[name] for name in _KEPT}
    table = pa.table([columns[name] for name in JOINTS.arrow.names], schema=JOINTS.arrow)
    order = np.lexsort((np.arange(len(frames)), np.asarray(table["body"]), frames))
    yield from table.take(pa.array(order, pa.int64())).combine_chunks().to_batches()


FORMAT = Format(
    name=NAME,
    description="loose files of ECAT's recorder: .avi, .dep and rig_*.xml in a folder without files.param",
    sniff=sniff,
    read=read,
)
