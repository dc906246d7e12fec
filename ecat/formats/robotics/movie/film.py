"""Image by image: the recorded one, what is drawn over it, and what stands beside and below."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError, UsageError
from ecat.formats.episodes import chosen_layer
from ecat.formats.robotics.movie import MovieOptions, paint
from ecat.formats.robotics.movie.lanes import Lanes, bars_of
from ecat.formats.robotics.movie.overlay import Overlay
from ecat.formats.robotics.movie.paint import Image
from ecat.formats.robotics.movie.panel import Panel
from ecat.formats.robotics.scene import frame_times, relations_of, stream_camera, things_of
from ecat.geometry.cameras import Camera
from ecat.geometry.records import camera_of
from ecat.model import Stream
from ecat.progress import Progress
from ecat.store import Session, files
from ecat.store.media import ColorWriter, StreamImages, annotated_stream, open_images

_ROWS = 1080
_LANES, _PANEL = 236, 400
"""Rows of the lanes and least columns of the panel, of 1080 rows."""
_USUAL_STEP_NS = 33_333_333
_BACK = (12, 13, 16)
_INK, _DARK = (245, 247, 250), (16, 18, 22)
_EMPTY_PX = (1280, 720)
_LARGEST = 6.0
"""What is shown where nobody knows how large the images were, and how many times that, at most, for the shapes."""


@dataclass(frozen=True)
class _Reel:
    """The images of the movie: their indices (n,), frames (n,) and times (n,), ascending."""

    index: NDArray[np.int64]
    frame: NDArray[np.int64]
    t_ns: NDArray[np.int64]


def make(
    session: Session, label: str, dest: Path, options: MovieOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a movie.

    Raises
    ------
    NotFoundError : there is neither a video nor anything to draw; no such stream or layer.
    UsageError : the session has no image in the time asked for.
    CorruptError : the stream cannot be read to its end.
    """
    what = f"cannot make a movie of {label}"
    findings: list[str] = []
    with ExitStack() as opened:
        stream = _stream(session, options.stream)
        images = opened.enter_context(open_images(session, stream.name)) if stream is not None else None
        reel, times = _reel(session, images, options, what, findings)
        camera, size = _seen_through(session, stream, images, what)
        if camera is None and images is None:
            findings.append(f"nobody knows how large the images were; {size[0]} x {size[1]} pixels are shown")
        stage = _Stage(_Source(session, stream, size, camera, reel, times), options, findings)
        made = dest.with_name(f"{dest.name}.mp4")
        writer = opened.enter_context(ColorWriter(made, stage.width, stage.height, qp=options.qp))
        pictures = _pictures(images, reel, size)
        last = -1
        for k, picture in enumerate(pictures):
            t_ns = int(reel.t_ns[k] - reel.t_ns[0])
            if t_ns // 1000 > last:
                writer.write(stage.draw(picture, int(reel.frame[k]), int(reel.t_ns[k])), t_ns)
                last = t_ns // 1000
            progress(f"drawing {label}", k + 1, len(reel.index))
    files.rename(made, dest)
    sounds = [s.name for s in session.manifest.streams if s.kind == "audio" and s.present]
    findings += [f"sound left behind: {', '.join(sounds)}"] if sounds else []
    return tuple(findings)


def _stream(session: Session, name: str) -> Stream | None:
    """The stream to show; None where the annotated one is not there."""
    stream = session.stream(name) if name else annotated_stream(session.manifest)
    return stream if stream is not None and (stream.present or name) else None


def _reel(
    session: Session, images: StreamImages | None, options: MovieOptions, what: str, findings: list[str]
) -> tuple[_Reel, NDArray[np.int64]]:
    """The images to show, and when each frame of the session was taken (n + 1,)."""
    times = frame_times(session)
    n = len(images) if images is not None else session.manifest.n_frames
    if times is None:
        findings.append("nobody knows when the images were taken; 30 a second are shown")
        times = np.arange(session.manifest.n_frames + 1) * _USUAL_STEP_NS
    frame = images.frame if images is not None else np.arange(n)
    own = images.t_ns if images is not None else None
    t_ns = own if own is not None else times[np.minimum(frame, len(times) - 1)]
    end_ns = np.inf if options.end_s is None else options.end_s * 1e9
    if not n:
        raise NotFoundError(
            what,
            where=f"{session.name}: there are no images, and nobody knows how many there were",
            consequence="this session was not written",
            fix="import the recording again, with its video in its place",
        )
    index = np.flatnonzero((t_ns >= options.start_s * 1e9) & (t_ns <= end_ns))[:: options.every]
    if not len(index):
        end_s = t_ns[-1] / 1e9
        raise UsageError(
            what, where=f"{session.name}: its {n:,} images end at {end_s:.3f} s", fix="start_s, end_s"
        )
    return _Reel(index, np.asarray(frame)[index], np.asarray(t_ns)[index]), times


def _seen_through(
    session: Session, stream: Stream | None, images: StreamImages | None, what: str
) -> tuple[Camera | None, tuple[int, int]]:
    """The camera of the images, if it is known, and their width and height."""
    if stream is not None and images is not None:
        camera = stream_camera(session.manifest, stream)
        first = next(iter(images.read([0])))
        size = first.shape[1], first.shape[0]
        return (camera if camera is not None and (camera.width, camera.height) == size else None), size
    known = [stream_camera(session.manifest, s) for s in session.manifest.streams if s.kind == "color"]
    known += [camera_of(record) for record in session.manifest.cameras]
    for camera in known:
        if camera is not None:
            return camera, (camera.width, camera.height)
    if any(session.has_table(name) for name in ("events", "keyframes")):
        return None, _room_for_shapes(session)
    raise NotFoundError(
        what,
        where=f"{session.name}: there is no video, no camera and no annotation",
        consequence="this session was not written",
        fix=f"ecat info {session.path} tells what was recorded",
    )


def _room_for_shapes(session: Session) -> tuple[int, int]:
    """Width and height of an image in which all shapes are seen that were drawn in it."""
    scale = 1.0
    things = [thing for record in session.manifest.layers for thing in session.layer(record.name).objects]
    for thing in things:
        for key in thing.key_frames:
            points = np.array(key.coordinates).reshape(-1, 2)
            far = points.sum(0) if thing.kind == "rectangle" else points.max(0, initial=0)
            scale = max(scale, far[0] / _EMPTY_PX[0], far[1] / _EMPTY_PX[1])
    scale = min(scale, _LARGEST)
    return math.ceil(_EMPTY_PX[0] * scale), math.ceil(_EMPTY_PX[1] * scale)


def _pictures(images: StreamImages | None, reel: _Reel, size: tuple[int, int]) -> Iterator[Image]:
    """The images of the reel, blue first; dark ones where there is no video."""
    if images is None:
        dark = np.full((size[1], size[0], 3), paint.bgr(_BACK), np.uint8)
        yield from (dark.copy() for _ in reel.index)
        return
    far = 0.0
    for image in images.read(reel.index.tolist()):
        if image.dtype == np.uint16:
            # one scale for all, or the movie would flicker
            far = far or max(float(np.percentile(image, 99)), 1.0)
            shades = np.minimum(image * (255 / far), 255).astype(np.uint8)
            yield np.asarray(cv2.applyColorMap(shades, cv2.COLORMAP_BONE), np.uint8)
        else:
            yield image


@dataclass(frozen=True)
class _Source:
    """What a movie is made of.

    Parameters
    ----------
    size : width and height of the images, pixels. camera : that took them, None where it is unknown.
    times : when each frame of the session was taken (n + 1,).
    """

    session: Session
    stream: Stream | None
    size: tuple[int, int]
    camera: Camera | None
    reel: _Reel
    times: NDArray[np.int64]


class _Stage:
    """Puts the image, the panel and the lanes together."""

    def __init__(self, source: _Source, options: MovieOptions, findings: list[str]) -> None:
        session, times, reel = source.session, source.times, source.reel
        self.height = options.height - options.height % 2
        self.width = round(self.height * 16 / 9) // 2 * 2
        self._size = size = self.height / _ROWS
        lanes_px = round(_LANES * size)
        room = self.width - round(_PANEL * size), self.height - lanes_px
        scale = min(room[0] / source.size[0], room[1] / source.size[1])
        self._shown = round(source.size[0] * scale), round(source.size[1] * scale)
        self._top = (room[1] - self._shown[1]) // 2
        self._blank = np.full((self.height, self.width, 3), paint.bgr(_BACK), np.uint8)
        things = things_of(session)
        layer = chosen_layer(session, options.layer) if session.manifest.layers or options.layer else None
        name = layer.name if layer is not None else ""
        self._bars = bars_of(layer, times) if layer is not None else []
        self._end = int(times[-1])
        self._lanes = Lanes(
            self._bars,
            (int(reel.t_ns[0]), int(reel.t_ns[-1]) + 1),
            round(options.page_s * 1e9),
            shape=(lanes_px, self.width),
            size=size,
        )
        if self._lanes.n_hidden:
            findings.append(
                f"{self._lanes.n_hidden} lanes of events that overlap have no room below the image"
            )
        relations = relations_of(session, name, things, times)
        self._panel = Panel(
            session.name, name, relations, shape=(room[1], self.width - self._shown[0]), size=size
        )
        shown = source.stream.name if source.stream is not None else ""
        self._overlay = Overlay(session, things, source.camera, layer, stream=shown, scale=scale, size=size)

    def draw(self, picture: Image, frame: int, t_ns: int) -> Image:
        """One image of the movie."""
        canvas = self._blank.copy()
        smaller = self._shown[0] < picture.shape[1]
        shown = cv2.resize(
            picture, self._shown, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        )
        view = np.asarray(shown, np.uint8)
        blocks = self._overlay.draw(view, frame)
        current = [bar for bar in self._bars if bar.start_ns <= t_ns < bar.end_ns]
        self._caption(view, next((bar.words for bar in current if not bar.is_part), ""))
        width, height = self._shown
        canvas[self._top : self._top + height, :width] = view
        panel = self._panel.draw(t_ns, self._end, current, blocks)
        canvas[: panel.shape[0], width:] = panel
        lanes = self._lanes.draw(t_ns)
        canvas[self.height - lanes.shape[0] :] = lanes
        return canvas

    def _caption(self, view: Image, words: str) -> None:
        if not words:
            return
        size = round(34 * self._size)
        fitting = paint.shortened(words, size, view.shape[1] * 0.9, 600)
        half, base = paint.text_width(fitting, size, 600) / 2, view.shape[0] - 34 * self._size
        middle, pad = view.shape[1] / 2, 18 * self._size
        paint.box(
            view,
            (middle - half - pad, base - 1.15 * size, middle + half + pad, base + 0.55 * size),
            _DARK,
            0.72,
        )
        paint.text(view, (middle - half, base), fitting, size, _INK, weight=600)
