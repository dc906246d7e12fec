"""Images in files: sequences of colour and depth, pairs, plain numbered images, or a single one.

A folder may have its colour and depth images in folders of their own (``color/``, ``depth/``, and ``rgbd.match`` that
says which belong together), or side by side, told apart by their names (``desk_color.png``, ``desk_depth.png``).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ecat.errors import EcatError, FormatError, one_line
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings import rgbd_video
from ecat.formats.recordings.common import Track
from ecat.formats.recordings.image_files import is_image, read_header
from ecat.formats.recordings.image_folders import Px, listed, natural, role_folders, usable_sizes
from ecat.formats.recordings.image_tracks import DISPARITY_UNIT_M, image_track, is_disparity
from ecat.formats.recordings.known_cameras import (
    KINECT_V1_PX,
    NYU,
    NYU_RAW,
    TUM,
    Calibration,
    read_calibration,
)
from ecat.formats.recordings.rows import trajectory_rows
from ecat.formats.recordings.several import Part, create_all, folder_name
from ecat.formats.recordings.untimed import FILE_PERIOD_NS, create_untimed
from ecat.formats.recordings.video import SUFFIXES as VIDEOS
from ecat.progress import Progress
from ecat.store import TableData, files
from ecat.store.media import MILLIMETRE

NAME = "images"
_ROLE = re.compile(r"(?<![a-z])(?:(colou?r|rgb|image)|(depth))(?![a-z])|^(?:(r)|(d))(?=-\d)", re.IGNORECASE)
_MATCH_FILE, _TRAJECTORY_FILE = "rgbd.match", "trajectory.log"
_MAX_LIST_BYTES = 64 << 20


@dataclass
class ImageSet:
    """Images of one session, in order: colour and depth with the same index belong together."""

    name: str
    color: list[Path] = field(default_factory=list[Path])
    depth: list[Path] = field(default_factory=list[Path])
    color_px: Px | None = None
    depth_px: Px | None = None
    notes: list[str] = field(default_factory=list[str])


def sniff(path: Path) -> bool:
    """Whether it is an image, or a folder that has some in it or in folders named for colour or depth.

    A picture beside the videos of a recording, for instance of its first moment, is not what was recorded.
    """
    if path.is_file():
        return is_image(path)
    try:
        if (path / "rgb.txt").exists() or (path / "depth.txt").exists():  # TUM RGB-D
            return False
        color, depth = role_folders(path)
        if (color is None or depth is None) and rgbd_video.sniff(path):
            return False
        return any(is_image(file) for folder in (path, color, depth) if folder for file in folder.iterdir())
    except OSError:
        return False


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read images into a session, or into a project where they are of several sequences.  Their times are unknown.

    Raises
    ------
    FormatError : not one image can be read.
    LimitError : images of more pixels, or more images, than ecat reads.
    """
    what = f"cannot import {source.name}"
    with files.typed_errors(what, source, "nothing was written"):
        folder = source if source.is_dir() else source.parent
        found = list(_sequences(source, what))
        videos = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in VIDEOS)
    if source.is_dir() and videos and found:
        names = one_line(", ".join(videos[:3]))
        found[0].notes.append(
            f"{names}: video beside images of both kinds is not imported; colour in a video and depth in a folder "
            "depth/, or the other way around, are imported together"
        )
    parts: list[Part] = [
        (one.name, lambda to, one=one: _create(one, folder, to, what, progress)) for one in _named(found)
    ]
    if not parts:
        raise FormatError(what, where=f"{source.name}: there is no image in it that can be read")
    return create_all(dest, parts, format_name=NAME, source=source.name, options=options, progress=progress)


# ---------------------------------------------------------------------------------------------- what there is


def _sequences(source: Path, what: str) -> Iterator[ImageSet]:
    if source.is_file():
        role, _ = _role(source.stem)
        is_depth = role == "depth" or (not role and read_header(source, what).is_deep)
        one = ImageSet(source.stem, depth=[source]) if is_depth else ImageSet(source.stem, [source])
        yield from _sized([one], what)
        return
    folders = role_folders(source)
    color, depth = (listed(folder, what) if folder is not None else [] for folder in folders)
    if color or depth:
        notes: list[str] = []
        paired = _matched(source, color, depth, notes) or _paired(color, depth, notes)
        yield from _sized([ImageSet(source.resolve().name, *paired, notes=notes)], what)
    else:
        yield from _sized(_groups(listed(source, what), source.resolve().name, what), what)


def _role(stem: str) -> tuple[str, str]:
    """``color``, ``depth`` or nothing, by the last word that says so, and the rest of the name."""
    found = list(_ROLE.finditer(stem))
    if not found:
        return "", stem
    last = found[-1]
    return ("color" if last[1] or last[3] else "depth"), stem[: last.start()] + stem[last.end() :]


def _groups(paths: Sequence[Path], name: str, what: str) -> list[ImageSet]:
    """Images that lie side by side, by what is the same in their names."""
    groups: dict[str, dict[str, list[Path]]] = {}
    for path in paths:
        role, rest = _role(path.stem)
        skeleton = natural(rest)[0] if role else ""
        if not role:
            try:
                role = "depth" if read_header(path, what).is_deep else "color"
            except FormatError:
                role = "color"
        groups.setdefault(skeleton, {"color": [], "depth": []})[role].append(path)
    made: list[ImageSet] = []
    for skeleton, roles in groups.items():
        notes: list[str] = []
        color, depth = _paired(roles["color"], roles["depth"], notes)
        label = re.sub(r"[^\w.]+|_+", "_", skeleton.replace("#", "")).strip("_.") if len(groups) > 1 else ""
        made.append(ImageSet(label or name, color, depth, notes=notes))
    return made


def _paired(color: list[Path], depth: list[Path], notes: list[str]) -> tuple[list[Path], list[Path]]:
    """Colour and depth of the same number; without such, in their order."""
    if not color or not depth:
        return color, depth
    numbered = [{natural(_role(path.stem)[1])[1]: path for path in paths} for paths in (color, depth)]
    common = [number for number in numbered[0] if number in numbered[1]]
    unique = len(numbered[0]) == len(color) and len(numbered[1]) == len(depth)
    if common and unique:
        for of, other, paths in (("colour", "depth", color), ("depth", "colour", depth)):
            if alone := len(paths) - len(common):
                notes.append(f"{alone} {of} images have no {other} image of their number and were left out")
        return [numbered[0][n] for n in common], [numbered[1][n] for n in common]
    if len(color) != len(depth):
        notes.append(f"{len(color)} colour and {len(depth)} depth images cannot be paired by number or count")
    return color, depth


def _matched(
    folder: Path, color: list[Path], depth: list[Path], notes: list[str]
) -> tuple[list[Path], list[Path]] | None:
    """The pairs that ``rgbd.match`` lists: a line each, two paths in either order."""
    path = folder / _MATCH_FILE
    if not path.is_file():
        return None
    try:
        lines = files.read_bytes(path, _MAX_LIST_BYTES).decode("utf-8", "replace").splitlines()
    except EcatError as error:
        notes.append(f"{_MATCH_FILE} was not used: {error.where}")
        return None
    names = [{file.relative_to(folder).as_posix(): file for file in of} for of in (color, depth)]
    pairs: list[tuple[Path, Path]] = []
    for line in lines:
        words = line.split()
        one = next((names[0][word] for word in words if word in names[0]), None)
        two = next((names[1][word] for word in words if word in names[1]), None)
        if one is not None and two is not None:
            pairs.append((one, two))
    if not pairs:
        notes.append(f"{_MATCH_FILE} names no image that is there; it was not used")
        return None
    alone = len({*color, *depth} - {file for pair in pairs for file in pair})
    if alone:
        notes.append(f"{alone} images are not in {_MATCH_FILE} and were left out")
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def _sized(sequences: Iterable[ImageSet], what: str) -> Iterator[ImageSet]:
    """The sequences by the sizes of their images; those that are no images are left out."""
    for one in sequences:
        color_px = usable_sizes(one.color, what, one.notes, deep=False)
        depth_px = usable_sizes(one.depth, what, one.notes, deep=True)
        color, depth = (one.color if color_px else []), (one.depth if depth_px else [])
        if color and depth and len(color) != len(depth):  # they cannot be paired: the most frequent sizes
            px = [Counter(found.values()).most_common(1)[0][0] for found in (color_px, depth_px)]
            yield replace(one, color=color, depth=depth, color_px=px[0], depth_px=px[1])
            continue
        groups: dict[tuple[Px | None, Px | None], list[tuple[Path | None, Path | None]]] = {}
        for c, d in zip_longest(color, depth):
            if (c is None or c in color_px) and (d is None or d in depth_px):
                sizes = (color_px[c] if c else None, depth_px[d] if d else None)
                groups.setdefault(sizes, []).append((c, d))
        for sizes, rows in groups.items():
            pair = [c for c, _ in rows if c], [d for _, d in rows if d]
            yield replace(one, color=pair[0], depth=pair[1], color_px=sizes[0], depth_px=sizes[1])


def _named(found: Sequence[ImageSet]) -> Iterator[ImageSet]:
    """The same under names of their own, as folders can have them."""
    taken: set[str] = set()
    for one in found:
        yield replace(one, name=folder_name(one.name, taken, default="images"))


# ---------------------------------------------------------------------------------------------- what is made of it


def _create(one: ImageSet, folder: Path, dest: Path, what: str, progress: Progress) -> ImportReport:
    disparity = bool(one.depth) and is_disparity(one.depth[0], what)
    known = _calibration(one, folder, is_disparity=disparity)
    notes = [*one.notes, *known.notes, *_missing(one, known)]
    unit_m = DISPARITY_UNIT_M if disparity else known.depth_unit_m
    if one.depth and unit_m is None:
        unit_m = MILLIMETRE
        notes.append("nothing says what the depth is measured in: it was taken for millimetres")
    tracks = list(_tracks(one, known, unit_m, what, is_disparity=disparity))
    tables: dict[str, TableData] = {}
    if (folder / _TRAJECTORY_FILE).is_file() and len(one.color or one.depth) > 1:
        rows, problem = trajectory_rows(folder / _TRAJECTORY_FILE, "color" if one.color else "depth")
        tables |= {"camera_poses": TableData(data=rows)} if rows is not None else {}
        notes += [problem] if problem else []
    return create_untimed(
        dest,
        tracks,
        format_name=NAME,
        source=folder.resolve().name,
        cameras=known.cameras,
        tables=tables,
        notes=notes,
        progress=progress,
    )


def _tracks(
    one: ImageSet, known: Calibration, unit_m: float | None, what: str, *, is_disparity: bool
) -> Iterator[Track]:
    paired = len(one.color) == len(one.depth)
    lost: set[int] = set()
    for name, paths, size in (("color", one.color, one.color_px), ("depth", one.depth, one.depth_px)):
        if not paths:
            continue
        yield image_track(
            name,
            paths,
            [i * FILE_PERIOD_NS for i in range(len(paths))],
            what,
            camera=known.camera(name),
            unit_m=unit_m if name == "depth" else None,
            disparity=is_disparity and name == "depth",
            # only their place says which belong together, and colour is written first
            lost=lost if paired else None,
            blank=np.zeros(size[::-1], np.uint16) if paired and size and name == "depth" else None,
        )


def _calibration(one: ImageSet, folder: Path, *, is_disparity: bool) -> Calibration:
    """From the folder's file, else as published for the data set that name, size and content speak for."""
    written = read_calibration(folder, one.color_px, one.depth_px)
    if written.cameras or written.notes:
        return written
    names = " ".join(path.stem for path in (*one.color[:1], *one.depth[:1])).lower() + f" {one.name.lower()}"
    sizes = {px for px in (one.color_px, one.depth_px) if px is not None}
    known = Calibration()
    if sizes == {KINECT_V1_PX}:
        if is_disparity:
            known = NYU_RAW
        elif re.search(r"(?<![a-z])nyu", names):
            known = NYU
        elif re.search(r"(?<![a-z])tum(?![a-z])|freiburg", names):
            known = TUM
    there = {name for name, paths in (("color", one.color), ("depth", one.depth)) if paths}
    cameras = tuple(camera for camera in known.cameras if camera.name in there)
    if len(cameras) == 1:
        cameras = (replace(cameras[0], reference=""),)
    return replace(known, cameras=cameras, depth_unit_m=written.depth_unit_m or known.depth_unit_m)


def _missing(one: ImageSet, known: Calibration) -> Iterator[str]:
    for name, paths in (("color", one.color), ("depth", one.depth)):
        if paths and not known.camera(name):
            yield (
                f"stream {name}: its camera is unknown; with a file intrinsics.json beside the images "
                '({"fx": ..., "fy": ..., "cx": ..., "cy": ...}) they can be imported with it'
            )
        if not paths:
            yield f"there are no {'depth' if name == 'depth' else 'colour'} images"


FORMAT = Format(
    name=NAME,
    description="images: colour and depth sequences or pairs in a folder, numbered images, or a single one",
    sniff=sniff,
    read=read,
)
