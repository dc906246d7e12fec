"""COCO's JSON: shapes image by image, with the videos, tracks and key points that others added to it.

``videos``, ``video_id`` and ``frame_id`` are CocoVID's, ``tracks``, ``track_id`` and ``frame_index`` are TAO's.  Every
image of the recording is listed, and a shape is told in every image where it is to be seen: a rectangle as ``bbox``, a
polygon as ``segmentation``, a point as one key point.  Beside what was drawn, the tables of the session are told
(``--option tracked=false`` leaves them out): shapes that were tracked, faces of markers, and bodies as key points with
their bones.

COCO has no place for events and what is said of them, and for relations.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecat.errors import LimitError
from ecat.formats.format import Format
from ecat.formats.interchange import coco_tables
from ecat.formats.interchange.coco_tables import Annotation, Category, box_annotation
from ecat.formats.interchange.documents import (
    Coordinate,
    Image,
    Rate,
    Size,
    Text,
    json_list,
    read_json,
    tells,
)
from ecat.formats.interchange.found import Found, FoundObject, FoundShape
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import (
    TYPED,
    Numbers,
    absences,
    area_of,
    box_around,
    is_typed,
    label_of,
    shapes,
    type_of,
)
from ecat.formats.interchange.source import PixelOptions, Source, counted, shape_kind, source_of
from ecat.formats.options import option
from ecat.model import AnnotatedObject
from ecat.model.annotation import ObjectKind
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "coco"
CARRIES = frozenset({"rectangle", "polygon", "point", "absence", "object type"})
MOST_IMAGES = 5_000_000
"""Two days at thirty a second."""
_VIDEO = 1
_MOST = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class CocoOptions(PixelOptions):
    """What the writer can be told, too."""

    tracked: bool = option(True, "tracked shapes, faces of markers and bodies of the session's tables, too")


# ---------------------------------------------------------------------------------------------- writing


def part(
    session: Session, label: str, dest: Path, options: CocoOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the shapes of one session, in memory that does not grow with its length.

    Raises
    ------
    LimitError : more images than anybody lists.
    """
    del progress
    source = source_of(session, label, options)
    if source.end > MOST_IMAGES:
        raise LimitError(
            f"cannot write {label} for COCO",
            where=f"{source.end:,} images, each of which would be listed; at most {MOST_IMAGES:,} are",
            consequence="nothing was written",
            fix="write the recording in parts",
        )
    drawn = source.drawn("rectangle", "polygon", "point")
    things = [(thing, _drawn(thing, source.end), _category(thing)) for thing in drawn]
    if options.tracked:
        things = coco_tables.with_tables(session, source.layer, things)
    write_new_file(dest, (piece.encode() for piece in _pieces(source, things)))
    unsized = source.size_px is None
    return source.findings(
        CARRIES,
        "COCO",
        "the size of the images is not known and was left out: --option width=... --option height=..."
        if unsized
        else "",
    )


def _category(thing: AnnotatedObject) -> Category:
    keypoints = ("point",) if shape_kind(thing) == "point" else ()
    return Category(label_of(thing), keypoints)


def _drawn(thing: AnnotatedObject, end: int) -> Iterator[tuple[int, Annotation]]:
    """Frame and annotation wherever an object that was drawn is to be seen."""
    kind = shape_kind(thing)
    for frame, shape in shapes(thing, end):
        if kind == "rectangle":
            yield frame, box_annotation(shape)
        elif kind == "point":
            key_points = {"keypoints": [*map(_round, shape), 2], "num_keypoints": 1}
            yield frame, {**box_annotation((*shape, 0.0, 0.0)), **key_points}
        else:
            area = _round(area_of(shape))
            yield (
                frame,
                {
                    **box_annotation(box_around(shape)),
                    "segmentation": [[_round(x) for x in shape]],
                    "area": area,
                },
            )


def _round(value: float) -> float:
    return round(value, 6)


def _pieces(source: Source, things: Sequence[coco_tables.Thing]) -> Iterator[str]:
    numbers: dict[Category, int] = {}
    for _, _, category in things:
        numbers.setdefault(category, len(numbers) + 1)
    size = source.size_px
    about = {"description": source.name, "version": "1.0", "contributor": "ecat"}
    yield '{"info": ' + json.dumps(about, ensure_ascii=False)
    yield ',\n"licenses": []'
    video: dict[str, object] = {"id": _VIDEO, "name": source.name, **_sized(size)}
    video |= (
        {"length": source.end, "fps": source.times.rate_hz} if source.times.known else {"length": source.end}
    )
    video |= {"file_name": source.media[0]} if source.media else {}
    yield ',\n"videos": ' + "".join(json_list([video]))
    yield ',\n"categories": ' + "".join(json_list(c.to_dict(n) for c, n in numbers.items()))
    tracks = (
        {
            "id": number,
            "video_id": _VIDEO,
            "category_id": numbers[category],
            "name": thing.name,
            "object": thing.id,
            **({TYPED: True} if is_typed(thing) else {}),
        }
        for number, (thing, _, category) in enumerate(things, 1)
    )
    yield ',\n"tracks": ' + "".join(json_list(tracks))
    yield ',\n"images": '
    yield from json_list(_image(source.name, frame, size) for frame in range(source.end))
    yield ',\n"annotations": '
    yield from json_list(_annotations(things, numbers))
    yield "}\n"


def _sized(size: tuple[int, int] | None) -> dict[str, object]:
    return {} if size is None else {"width": size[0], "height": size[1]}


def _image(name: str, frame: int, size: tuple[int, int] | None) -> object:
    file = f"{name}/{frame:06}.jpg"
    said = {"id": frame + 1, "file_name": file, "video_id": _VIDEO, "frame_id": frame, "frame_index": frame}
    return said | _sized(size)


def _annotations(things: Sequence[coco_tables.Thing], numbers: Mapping[Category, int]) -> Iterator[object]:
    number = 0
    for track, (_, told, category) in enumerate(things, 1):
        for frame, annotation in told:
            number += 1
            yield {
                "id": number,
                "image_id": frame + 1,
                "video_id": _VIDEO,
                "track_id": track,
                "instance_id": track,
                "category_id": numbers[category],
                "iscrowd": 0,
                **annotation,
            }


# ---------------------------------------------------------------------------------------------- reading


@dataclass
class _Video:
    id: int
    name: Text = ""
    file_name: Text = ""
    fps: Rate | None = None


@dataclass
class _Image:
    id: int
    file_name: Text = ""
    video_id: int | None = None
    frame_id: Image | None = None
    frame_index: Image | None = None
    width: Size = 0
    height: Size = 0


@dataclass
class _Annotation:
    image_id: int = -1
    category_id: int = -1
    bbox: list[Coordinate] = field(default_factory=list[float])
    segmentation: Any = None
    keypoints: list[Coordinate] = field(default_factory=list[float])
    track_id: int | None = None
    instance_id: int | None = None


@dataclass
class _Category:
    id: int
    name: Text = ""


@dataclass
class _Track:
    id: int
    name: Text = ""
    object: Text = ""
    typed: bool = False


@dataclass
class _File:
    images: list[_Image]
    annotations: list[_Annotation]
    categories: list[_Category] = field(default_factory=list[_Category])
    videos: list[_Video] = field(default_factory=list[_Video])
    tracks: list[_Track] = field(default_factory=list[_Track])


def sniff(path: Path) -> bool:
    """Whether it is an annotation in COCO's form."""
    keys = ("images", "annotations", "categories")
    pairs = ((a, b) for a in keys for b in keys if a < b)
    return any(tells(path, (".json",), *pair) for pair in pairs)


def parse(source: Path) -> Sequence[Found]:
    """Read an annotation in COCO's form: what it says about each video; images without one are one after the other.

    Raises
    ------
    FormatError, LimitError : it is none.
    """
    file = read_json(source, _File, f"cannot import {source.name}")
    videos = {video.id: video for video in file.videos}
    by_video: dict[int | None, list[_Image]] = {video: [] for video in videos}
    for image in file.images:
        by_video.setdefault(image.video_id if image.video_id in videos else None, []).append(image)
    by_image: dict[int, list[_Annotation]] = {}
    for annotation in file.annotations:
        by_image.setdefault(annotation.image_id, []).append(annotation)
    found: list[Found] = []
    for video, images in by_video.items():
        said = videos.get(video) if video is not None else None
        made = Found(name=said.name if said is not None and len(by_video) > 1 else source.stem)
        if said is not None:
            made.media = tuple(name for name in (said.file_name, said.name) if name)
            made.rate_hz = said.fps
        _fill(made, images, by_image, file)
        found.append(made)
    return found or [Found(name=source.stem)]


def _fill(
    found: Found, images: Sequence[_Image], by_image: Mapping[int, Sequence[_Annotation]], file: _File
) -> None:
    names = {category.id: category.name for category in file.categories}
    tracks = {track.id: track for track in file.tracks}
    numbered = _numbered(images)
    runs: dict[_Key, dict[int, _Annotation]] = {}
    others = 0
    for frame, image in numbered.items():
        copies: dict[_Key, int] = {}
        for annotation in by_image.get(image.id, ()):
            if _shape(annotation) is None:
                others += 1
                continue
            track = annotation.track_id if annotation.track_id is not None else annotation.instance_id
            key = (annotation.category_id, track, 0)
            copies[key] = copies.get(key, 0) + 1
            runs.setdefault((annotation.category_id, track, copies[key]), {})[frame] = annotation
    listed = list(numbered)
    for (category, track, copy), run in runs.items():
        label = names.get(category, f"category {category}")
        kind, coordinates = _run(run)
        record = _record(kind, label, tracks.get(track or -1), copy)
        keys = absences(coordinates, listed)
        told = [FoundShape(frame=k.frame, coordinates=k.coordinates, present=k.present) for k in keys]
        found.objects.append(FoundObject(record=record, shapes=told, dense=True))
    found.n_frames = listed[-1] + 1 if listed else None
    found.size_px = next(((i.width, i.height) for i in images if i.width and i.height), None)
    if others:
        found.findings.append(
            f"{counted(others, 'annotation')} that draw no single shape left out: bodies, masks"
        )


_Key = tuple[int, int | None, int]


def _run(run: Mapping[int, _Annotation]) -> tuple[ObjectKind, dict[int, Numbers]]:
    """An object's shapes by frame; where they are of several kinds, the boxes around them."""
    found = {frame: shape for frame, said in run.items() if (shape := _shape(said)) is not None}
    kinds: set[ObjectKind] = {kind for kind, _ in found.values()}
    if len(kinds) == 1:
        return kinds.pop(), {frame: numbers for frame, (_, numbers) in found.items()}
    boxes = {frame: tuple(said.bbox) for frame, said in run.items() if len(said.bbox) == 4}
    return "rectangle", boxes


def _numbered(images: Sequence[_Image]) -> dict[int, _Image]:
    """The images by frame, in order: as they say, or one after the other."""
    told = [i.frame_id if i.frame_id is not None else i.frame_index for i in images]
    if any(frame is None for frame in told) or len(set(told)) < len(told):
        return dict(enumerate(images))
    return {
        frame or 0: image for frame, image in sorted(zip(told, images, strict=True), key=lambda p: p[0] or 0)
    }


def _record(kind: ObjectKind, label: str, track: _Track | None, copy: int) -> AnnotatedObject:
    if track is None:
        return AnnotatedObject(id=f"{label} {copy}", name=label, kind=kind, semantic_type=label)
    made = type_of(label, track.name, typed=track.typed)
    return AnnotatedObject(
        id=track.object or f"{label} {copy}", name=track.name, kind=kind, semantic_type=made
    )


def _shape(annotation: _Annotation) -> tuple[ObjectKind, Numbers] | None:
    """What an annotation draws; ``None`` for bodies and masks of several parts without a box."""
    if annotation.keypoints:
        return ("point", tuple(annotation.keypoints[:2])) if len(annotation.keypoints) == 3 else None
    if polygon := _polygon(annotation.segmentation):
        return "polygon", polygon
    box = annotation.bbox
    return ("rectangle", tuple(box)) if len(box) == 4 and box[2] > 0 and box[3] > 0 else None


def _polygon(segmentation: Any) -> Numbers:
    """The only part of a segmentation; nothing if it has several, or is a mask."""
    if not isinstance(segmentation, list) or len(segmentation) != 1 or not isinstance(segmentation[0], list):
        return ()
    numbers: list[Any] = segmentation[0]
    places = [float(x) for x in numbers if isinstance(x, int | float) and abs(x) <= _MOST]
    return tuple(places) if len(places) == len(numbers) >= 6 and len(places) % 2 == 0 else ()


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="COCO annotations image by image, with videos, tracks and key points",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".json",
    options=CocoOptions,
)
