"""Colour images and depth of a session, made small enough to look at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.model import Camera, Stream
from ecat.progress import Progress
from ecat.view.scene import CAMERA, IMAGE, Frames, Scene, integers, static, temporal, texts

if TYPE_CHECKING:
    from pathlib import Path

    from rerun.chunk import Chunk

    from ecat.store import Session

SHOWN_WIDTH = 960
"""Colour images wider than this are reduced: 1080p frames would make a recording of a gigabyte a minute."""
DEPTH_STEP = 2
"""Every other depth pixel of every other row is shown."""
_BATCH = 30
_JPEG_QUALITY = 80


def media(session: Session, scene: Scene, progress: Progress) -> Iterator[Chunk]:
    """The first colour and the first depth stream whose files are there."""
    for kind, send in (("color", _color), ("depth", _depth)):
        stream = next((s for s in session.manifest.streams if s.kind == kind and s.present), None)
        if stream is not None:
            yield from send(session, stream, scene, progress)


def image_frames(session: Session, stream: Stream, n_images: int, scene: Scene) -> Frames:
    """The frame of the annotated video (n_images,) during which each image of ``stream`` was taken.

    From the recorded times; without them the images are spread evenly over the recording.
    """
    if session.has_table("frames"):
        frames = session.table("frames").to_arrow()
        mine = frames.filter(pa.array(texts(frames, "stream") == stream.name))
        if mine.num_rows >= n_images:
            return scene.timebase.frames_at(np.sort(integers(mine, "t_ns"))[:n_images])
    share = scene.timebase.n_frames / max(stream.n_frames or n_images, n_images, 1)
    return np.floor(np.arange(n_images) * share).astype(np.int64)


def reduced(camera: Camera, step: int) -> Camera:
    """The camera whose image is every ``step``-th pixel of every ``step``-th row."""
    return replace(
        camera,
        width_px=-(-camera.width_px // step),
        height_px=-(-camera.height_px // step),
        fx_px=camera.fx_px / step,
        fy_px=camera.fy_px / step,
        cx_px=camera.cx_px / step,
        cy_px=camera.cy_px / step,
    )


def _color(session: Session, stream: Stream, scene: Scene, progress: Progress) -> Iterator[Chunk]:
    import rerun as rr

    path = f"{IMAGE}/image"
    total = min(stream.n_frames or scene.timebase.n_frames, scene.timebase.n_frames)
    images = islice(_video(session.stream_path(stream.name), raw=False), total)
    done = 0
    while batch := list(islice(images, _BATCH)):
        if not done:
            scale = batch[0].shape[1] / min(batch[0].shape[1], SHOWN_WIDTH)
            yield static(path, rr.Transform3D(scale=[scale, scale, 1.0]))
        blobs = [_jpeg(image) for image in batch]
        columns = rr.EncodedImage.columns(blob=blobs, media_type=["image/jpeg"] * len(blobs))
        yield temporal(path, scene.timebase, np.arange(done, done + len(blobs)), columns)
        done += len(blobs)
        progress("colour images", done, total)
    if not done:
        yield unreadable(stream)


def _jpeg(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    height, width = image.shape[:2]
    if width > SHOWN_WIDTH:
        size = (SHOWN_WIDTH, round(height * SHOWN_WIDTH / width))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1], np.uint8)


def _depth(session: Session, stream: Stream, scene: Scene, progress: Progress) -> Iterator[Chunk]:
    import cv2
    import rerun as rr

    path = f"{CAMERA}/depth"
    file = session.stream_path(stream.name)
    total = stream.n_frames or scene.timebase.n_frames
    frames = image_frames(session, stream, total, scene)
    images = islice(_dep(file) if file.suffix == ".dep" else _video(file, raw=True), total)
    done = 0
    while batch := list(islice(images, _BATCH)):
        if batch[0].dtype != np.uint16 or batch[0].ndim != 2:
            break
        small = [np.ascontiguousarray(image[::DEPTH_STEP, ::DEPTH_STEP]) for image in batch]
        blobs = [
            np.asarray(cv2.imencode(".png", i, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1], np.uint8) for i in small
        ]
        if not done:
            yield static(path, rr.EncodedDepthImage.from_fields(meter=1000.0, depth_range=[300.0, 3000.0]))
        columns = rr.EncodedDepthImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
        yield temporal(path, scene.timebase, frames[done : done + len(blobs)], columns)
        done += len(blobs)
        progress("depth images", done, total)
    if not done:
        yield unreadable(stream)


def unreadable(stream: Stream) -> Chunk:
    """A line in the log instead of images that no decoder here understands."""
    import rerun as rr

    text = f"stream {stream.name}: {stream.file} could not be decoded; the view goes without its images"
    return static("/log/media", rr.TextLog(text, level="WARN"))


def _video(path: Path, *, raw: bool) -> Iterator[NDArray[Any]]:
    """The images of a video, BGR; ``raw`` as stored, for 16-bit depth."""
    import cv2

    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_CONVERT_RGB, 0] if raw else [])
    try:
        while (read := capture.read())[0]:
            yield np.asarray(read[1])
    finally:
        capture.release()


def _dep(path: Path) -> Iterator[NDArray[np.uint16]]:
    from ecat.formats.ecat2018.depth_file import DepthFile

    with DepthFile(path) as images:
        yield from images
