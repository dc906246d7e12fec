"""The images of a session, made small enough to look at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.errors import EcatError
from ecat.progress import Progress
from ecat.store.media import StreamImages, open_images
from ecat.view.scene import Frames, Scene, static, temporal
from ecat.view.streams import ShownStream, depth_step, shown_streams, straightened

if TYPE_CHECKING:
    from rerun.chunk import Chunk

    from ecat.store import Session

SHOWN_WIDTH = 960
"""Colour and infrared images wider than this are reduced: 1080p would make a recording of a gigabyte a minute."""
MOST_IMAGES = 6000
"""Of a longer stream every second, third, ... image is shown: a viewer holds all that it is sent in memory."""
_BATCH = 30
_JPEG_QUALITY = 80
_THREADS = 2
_POINT_FILL = 0.7
"""How far the points of neighbouring pixels overlap: 1 closes slanted surfaces, .5 leaves no overlap at all."""

Encode: TypeAlias = Callable[[NDArray[Any]], NDArray[np.uint8]]


@dataclass(frozen=True)
class _Picture:
    """How the images of a stream are sent: what holds for all of them, and how one becomes bytes."""

    always: Any
    archetype: Any
    media_type: str
    encode: Encode


def media(session: Session, scene: Scene, progress: Progress, damage: list[str]) -> Iterator[Chunk]:
    """The images of every stream of colour, depth and infrared whose file is there, each at its own time.

    What cannot be shown is in the log, and a line of ``damage`` when the last chunk was given.
    """
    for shown in shown_streams(session.manifest):
        try:
            images = open_images(session, shown.stream.name, threads=_THREADS)
        except EcatError as error:
            damage.append(_line(shown, f"could not be decoded: {error.where}"))
            yield _remark(shown, damage[-1])
            continue
        with images:
            yield from _sent(shown, images, scene, progress, damage)


def _sent(
    shown: ShownStream, images: StreamImages, scene: Scene, progress: Progress, damage: list[str]
) -> Iterator[Chunk]:
    at = _chosen(images, scene)
    every = int(at[1] - at[0]) if len(at) > 1 else 1
    if every > 1:
        thinned = f"one image of every {every} is shown, {len(at):,} of {len(images):,}"
        yield _remark(shown, _line(shown, thinned))
    t_ns = None if images.t_ns is None else images.t_ns[at]
    frames, done = images.frame[at], 0
    source = islice(images, len(at)) if every == 1 else images.read(at.tolist())
    picture: _Picture | None = None
    try:
        for first in source:
            if picture is None:
                picture = _picture(shown, first, images.unit_m)
                yield static(shown.image_path, picture.always)
            batch = islice(chain([first], source), _BATCH)
            blobs, problem = _until_broken(picture.encode, batch)
            here = slice(done, done + len(blobs))
            columns = picture.archetype.columns(blob=blobs, media_type=[picture.media_type] * len(blobs))
            own = None if t_ns is None else t_ns[here]
            yield temporal(shown.image_path, scene.timebase, frames[here], columns, own)
            done += len(blobs)
            progress(f"{shown.stream.name} images", done, len(at))
            if problem is not None:
                raise problem
    except EcatError as error:
        told = f"could be decoded for {done:,} of {len(at):,} images: {error.where}"
        damage.append(_line(shown, told))
        yield _remark(shown, damage[-1])


def _chosen(images: StreamImages, scene: Scene) -> Frames:
    """Which images (n,) are shown: evenly, at most ``MOST_IMAGES``, none after the annotated video's last frame."""
    n = int(np.count_nonzero(images.frame < scene.timebase.n_frames))
    return np.arange(0, n, max(-(-n // MOST_IMAGES), 1))


def _until_broken(
    encode: Encode, images: Iterator[NDArray[Any]]
) -> tuple[list[NDArray[np.uint8]], EcatError | None]:
    """The encoded images, and what ended them before their time."""
    blobs: list[NDArray[np.uint8]] = []
    try:
        blobs.extend(encode(image) for image in images)
    except EcatError as error:
        return blobs, error
    return blobs, None


def _picture(shown: ShownStream, first: NDArray[Any], unit_m: float) -> _Picture:
    import rerun as rr

    if shown.stream.kind == "depth":
        near, far = np.percentile(first[first > 0], [1, 98]) if first.any() else (300, 3000)
        always = rr.EncodedDepthImage.from_fields(
            meter=1 / unit_m,
            # the darkest colours are left to what comes nearer than anything in the first image
            depth_range=[max(near - 0.15 * (far - near), 0.0), far],
            point_fill_ratio=_POINT_FILL,
        )
        return _Picture(always, rr.EncodedDepthImage, "image/png", _depth_encoder(shown, first))
    scale = first.shape[1] / min(first.shape[1], SHOWN_WIDTH)
    encode = _jpeg
    if first.dtype == np.uint16:
        white = max(float(np.percentile(first, 99)), 1.0)

        def encode(image: NDArray[Any]) -> NDArray[np.uint8]:
            # the square root, as eyes and cameras for them do: what is far returns little light
            return _jpeg((255 * np.sqrt(np.minimum(image / white, 1.0))).astype(np.uint8))

    return _Picture(rr.Transform3D(scale=[scale, scale, 1.0]), rr.EncodedImage, "image/jpeg", encode)


def _jpeg(image: NDArray[Any]) -> NDArray[np.uint8]:
    import cv2

    height, width = image.shape[:2]
    if width > SHOWN_WIDTH:
        size = (SHOWN_WIDTH, max(round(height * SHOWN_WIDTH / width), 1))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1], np.uint8)


def _depth_encoder(shown: ShownStream, first: NDArray[Any]) -> Encode:
    """Depth images as PNG, thinned, and as if taken without a bent lens where that is known."""
    import cv2

    step = depth_step(first.shape[1])
    camera = shown.camera
    bent = camera is not None and any(camera.distortion)
    source: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
    if camera is not None and bent and first.shape == (camera.height_px, camera.width_px):
        # never between two pixels: at an edge there is nothing half way
        u, v = (np.nan_to_num(grid, nan=-1).astype(np.float32) for grid in straightened(camera, step))
        source = u, v

    # runs of equal bytes (what was not measured) and their frequencies: no search for longer repeats in noise
    packing = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]

    def encode(image: NDArray[Any]) -> NDArray[np.uint8]:
        if source is None:
            small = np.ascontiguousarray(image[::step, ::step])
        else:
            small = cv2.remap(image, *source, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(cv2.imencode(".png", small, packing)[1], np.uint8)

    return encode


def _line(shown: ShownStream, text: str) -> str:
    return f"stream {shown.stream.name}: {text}"


def _remark(shown: ShownStream, line: str) -> Chunk:
    """A line in the log."""
    import rerun as rr

    return static(f"/log/media/{shown.path.rsplit('/', 1)[-1]}", rr.TextLog(line, level="WARN"))
