"""What a stage reads of a session: its tables, the clock, the camera, the table that was drawn."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, replace
from functools import cached_property
from threading import Lock
from types import TracebackType
from typing import TYPE_CHECKING, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import InputError, LimitError
from ecat.model import AnnotatedObject, Stream
from ecat.model import Camera as CameraRecord
from ecat.model.prototype import BoxPrototype
from ecat.model.session import camera_problems
from ecat.store import Session
from ecat.store.media import StreamImages, annotated_stream, open_images

if TYPE_CHECKING:
    from ecat.geometry.boxfit import Noise
    from ecat.geometry.cameras import Camera
    from ecat.stages.images import Images
    from ecat.stages.rows import Rows
    from ecat.stages.stage import Stage

CLOCK = "clock"
"""Input that is made of the manifest: every frame and its time."""
MAX_FRAMES = 1_000_000
"""Nine hours of video; the poses of two boxes then take about half a gigabyte."""
MARKS = ("markers_2d", "markers_3d")
SHAPES = "keyframes"
"""Input that is part of the annotation: a stage that follows shapes through images wants the 2-D ones, others those in
space, so that other edits do not make their tables stale.
"""
MOST_COORDINATE = 1e6
"""Pixels or metres from the origin: what is said to be further away is nowhere, and counts as missing."""
_ROWS_READ = 1 << 15
LENS_TERMS = 8
"""Distortion coefficients that ecat's lens model has; OpenCV's others are for thin prisms and tilted sensors."""


def has_marks(session: Session) -> bool:
    """Whether any marker of a box was recorded."""
    records = (session.manifest.table(name) for name in MARKS)
    return any(record is not None and record.rows for record in records)


def stage_inputs(session: Session, stage: Stage) -> dict[str, pa.Table | Rows]:
    """What a stage reads of its inputs, as far as they are there, without coordinates beyond ``MOST_COORDINATE``.

    Raises
    ------
    InputError : one that the stage cannot do without is missing.
    """
    found: dict[str, pa.Table | Rows] = {}
    for name in stage.inputs:
        if name == CLOCK:
            found[name] = clock_table(session)
        elif session.has_table(name):
            partly = name in stage.partly
            found[name] = StoredRows(session, name) if partly else sane(session.table(name).to_arrow())
        elif name not in stage.optional:
            raise InputError(
                f"cannot run the stage {stage.name} on {session.name}",
                where=f"there is no table {name}",
                consequence="nothing was changed",
                fix=f"ecat process {session.path}",
            )
    return found


class StoredRows:
    """A table of a session (:class:`ecat.stages.rows.Rows`), without coordinates beyond ``MOST_COORDINATE``.

    Some thousand rows more than were asked for are read, and kept until others are asked for.
    """

    def __init__(self, session: Session, name: str) -> None:
        self._session, self._name = session, name
        self._kept = session.table(name).schema.empty_table()
        self._first = self._end = 0

    @cached_property
    def _frames(self) -> NDArray[np.int64]:
        return np.asarray(self.select(("frame",))["frame"].to_numpy(), np.int64)

    def select(self, columns: Sequence[str]) -> pa.Table:
        """All rows, of these columns."""
        return sane(self._session.table(self._name, columns=list(columns)).to_arrow())

    def between(self, first: int, end: int) -> pa.Table:
        """All columns of the rows whose frame is at least ``first`` and below ``end``."""
        from ecat.stages.rows import InMemory

        if first < self._first or end > self._end:
            last = min(int(np.searchsorted(self._frames, first)) + _ROWS_READ, len(self._frames)) - 1
            self._first, self._end = first, max(end, int(self._frames[last]) + 1 if last >= 0 else end)
            self._kept = self._kept.schema.empty_table()
            view = self._session.table(self._name, start_frame=self._first, end_frame=self._end)
            self._kept = sane(view.to_arrow())
        return InMemory(self._kept).between(first, end)


def image_stream(session: Session, kind: str) -> Stream | None:
    """The stream of this kind that stages look at: of colour the annotated one, otherwise the first that is there.

    Depth of which nobody knows the camera measures nothing, and does not count.
    """
    annotated = annotated_stream(session.manifest)
    if annotated is not None and annotated.kind == kind and annotated.present and kind != "depth":
        return annotated
    known = {camera.name for camera in session.manifest.cameras}
    streams = (s for s in session.manifest.streams if s.kind == kind and s.present)
    return next((s for s in streams if kind != "depth" or s.camera in known), None)


class StageImages(AbstractContextManager["StageImages"]):
    """The streams of a session that stages look at, each opened once for all of them.

    To know where the images of a stream lie, its file has to be read from end to end, which for an hour of depth may
    take as long as a stage.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._opened: dict[str, StreamImages] = {}
        self._stack = ExitStack()
        self._lock = Lock()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def of(self, stage: Stage) -> dict[str, Images]:
        """What a stage looks at, by kind; streams that the session has not are missing."""
        streams = {kind: image_stream(self._session, kind) for kind in stage.images}
        with self._lock:  # stages that run side by side ask for the same ones
            return {kind: self._images(stream) for kind, stream in streams.items() if stream is not None}

    def rest(self) -> None:
        """Close the files until another stage looks at them; where their images lie stays known.

        A file that is open for jumping about in it takes the more memory, the longer it is.
        """
        for images in self._opened.values():
            images.close()

    def _images(self, stream: Stream) -> StreamImages:
        if stream.name not in self._opened:
            # colour tells nothing that grey does not, and costs three times as much; while the stage is at work, its
            # next images are decoded: of depth by two threads, which with H.264 wait for each other
            is_color = stream.kind == "color"
            images = open_images(self._session, stream.name, gray=is_color, threads=2 if is_color else 3)
            self._opened[stream.name] = self._stack.enter_context(images)
        return self._opened[stream.name]


def sane(table: pa.Table) -> pa.Table:
    """The table with null for every number that is no place (infinite, or beyond ``MOST_COORDINATE``)."""
    for i, field in enumerate(table.schema):
        if pa.types.is_floating(field.type):
            absurd = pc.greater(pc.abs(table.column(i)), pa.scalar(MOST_COORDINATE, field.type))
            if pc.any(absurd).as_py():
                column = pc.if_else(absurd, pa.scalar(None, field.type), table.column(i))
                table = table.set_column(i, field.with_nullable(True), column)
    return table


def clock_table(session: Session) -> pa.Table:
    """Every frame of the session with its time: columns ``frame`` int32, ``t_ns`` int64 (null without a clock).

    A recorded clock has the times of the colour stream, whose images the marks were seen in.
    """
    manifest = session.manifest
    n = manifest.n_frames
    for name in MARKS:
        # marks beyond the end of a recording of known length are mistakes; ecat check names them
        if not manifest.n_frames and session.has_table(name):
            frames = session.table(name, columns=["frame"]).to_arrow()["frame"]
            n = max(n, int(np.asarray(frames).max(initial=-1)) + 1)
    if n > MAX_FRAMES:
        raise LimitError(
            f"cannot process {session.name}",
            where=f"{n:,} frames, at most {MAX_FRAMES:,} are placed at once",
            consequence="nothing was changed",
            fix="ecat check says whether the number can be right; split a longer recording",
        )
    frame = pa.array(np.arange(n, dtype=np.int32))
    recorded = _recorded_times(session)
    if recorded is None:
        t_ns = pa.array(manifest.clock.times_ns(range(n), manifest.n_frames), pa.int64())
        return pa.table({"frame": frame, "t_ns": t_ns})
    its, times = recorded
    known = (its >= 0) & (its < n)
    values, there = np.zeros(n, np.int64), np.zeros(n, bool)
    values[its[known]], there[its[known]] = times[known], True
    return pa.table({"frame": frame, "t_ns": pa.array(values, mask=~there)})


def _recorded_times(session: Session) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Frame and time (n,) of every image of the annotated video; None without a recorded clock."""
    if session.manifest.clock.rule != "recorded" or not session.has_table("frames"):
        return None
    video = annotated_stream(session.manifest)
    name = video.name if video is not None else ""
    rows = session.table("frames").to_arrow().filter(pc.field("stream").cast(pa.string()) == name)
    return rows["frame"].to_numpy().astype(np.int64), rows["t_ns"].to_numpy().astype(np.int64)


def input_hashes(session: Session, stage: Stage) -> dict[str, str]:
    """The hash of each input of a stage that is there."""
    hashes: dict[str, str] = {}
    for name in stage.inputs:
        record = session.manifest.table(name)
        if name == CLOCK:
            clock, frames = session.manifest.clock, session.manifest.table("frames")
            known: list[object] = [clock.rule, clock.duration_ns, session.manifest.n_frames]
            if clock.rule == "recorded" and frames is not None:
                known.append(frames.sha256)
            hashes[name] = _hash(known)
        elif name == SHAPES and record is not None:
            hashes[name] = _hash(shapes_for(session, stage))
        elif record is not None:
            hashes[name] = record.sha256
    for kind in stage.images:
        stream = image_stream(session, kind)
        if stream is not None:
            camera, frames = session.manifest.camera(stream.camera), session.manifest.table("frames")
            known = [stream.sha256, stream.depth_unit_m, camera and asdict(camera), frames and frames.sha256]
            hashes[f"{kind} images"] = _hash(known)
    return hashes


def shapes_for(session: Session, stage: Stage) -> list[dict[str, object]]:
    """The key frames that a stage looks at."""
    wanted = 2 if "tracks_2d" in stage.outputs else 3
    if not session.has_table(SHAPES):
        return []
    return [row for row in session.table(SHAPES).to_arrow().to_pylist() if row["dimensions"] == wanted]


def _hash(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def mark_noise(session: Session) -> Noise:
    """What errors the corners of the session's marks have: those of the detector that found them."""
    from ecat.geometry.boxfit import OUTERMOST, SUBPIXEL

    return SUBPIXEL if was_tracked(session) else OUTERMOST


def was_tracked(session: Session) -> bool:
    """Whether the marks were found here, by the stage, and did not come with the recording."""
    record = session.manifest.table("markers_2d")
    return record is not None and bool(record.stage)


def color_camera(session: Session) -> CameraRecord | None:
    """What the manifest says of the camera of the annotated video."""
    stream = annotated_stream(session.manifest)
    named = session.manifest.camera(stream.camera) if stream is not None and stream.kind == "color" else None
    return named or session.manifest.camera("color")


def session_camera(session: Session) -> Camera:
    """The colour camera of a session: its own, or a typical Kinect v2 where marks are known but no camera.

    Raises
    ------
    InputError : its values describe no camera, or a lens that ecat has no model of.
    """
    from ecat.geometry.cameras import KINECT_V2_COLOR
    from ecat.geometry.records import camera_of

    record = color_camera(session)
    if record is None:
        return KINECT_V2_COLOR
    problems = list(camera_problems(record))
    if any(record.distortion[LENS_TERMS:]):
        problems.append(f"distortion: ecat's lens model has the first {LENS_TERMS} coefficients only")
    if problems:
        place = f"cameras[{session.manifest.cameras.index(record)}]"
        raise InputError(
            f"cannot use the camera of {session.name}",
            where="; ".join(f"session.json: {place}.{problem}" for problem in problems),
            consequence="nothing was changed",
            fix=f"correct these fields of {session.path / 'session.json'}, or import the recording again",
        )
    return camera_of(replace(record, distortion=record.distortion[:LENS_TERMS]))


def annotated_objects(session: Session) -> tuple[AnnotatedObject, ...]:
    """The objects of the layer that people and importers write to."""
    return session.layer("main").objects if session.manifest.layer("main") is not None else ()


def box_objects(objects: Sequence[AnnotatedObject], prototypes: Sequence[BoxPrototype]) -> tuple[str, ...]:
    """The object that each box is: the annotated one of its name, or a new one."""
    from ecat.stages.track import object_ids

    named = {thing.name: thing.id for thing in objects if thing.kind == "marker_box"}
    return tuple(
        named.get(box.name, new) for box, new in zip(prototypes, object_ids(prototypes), strict=True)
    )


def table_surface(session: Session) -> str:
    """The object that is the table: its type or its name says so; empty if none does."""
    for row in session.objects.to_arrow().to_pylist():
        if row["dimensions"] == 3 and "table" in (row["semantic_type"].lower(), row["name"].strip().lower()):
            return cast("str", row["object_id"])
    return ""
