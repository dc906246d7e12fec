"""Proxies: a stream as a video in which every browser finds image k at once.

Image k of the proxy is image k of the stream, whatever the times are: the rate is constant, and seeking to the
middle of an image, ``(k + 0.5) / rate``, is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecat.errors import EcatError, NotFoundError
from ecat.store import Session
from ecat.store.media import open_images
from ecat.store.media.container import decoded, media_errors, open_media
from ecat.store.times import count_images
from ecat.web.exact import DEPTH_KINDS, bounds_of, colored

if TYPE_CHECKING:
    from av import VideoFrame, VideoStream

RATE_HZ = 30
GOP = 8
"""Images from one key frame to the next: what a browser has to decode at most for one image."""
MOST_WIDTH_PX = 1920
CRF = 20
_OPTIONS = {
    "preset": "ultrafast",
    "crf": str(CRF),
    "bf": "0",
    "x264-params": f"keyint={GOP}:min-keyint={GOP}:scenecut=0",
}
_MOVE_INDEX_FIRST = {"movflags": "+faststart"}

Tell = Callable[[int], None]
"""Called with the number of images written; what it raises ends the work."""


def write_proxy(session: Session, stream_name: str, dest: Path, tell: Tell) -> None:
    """Encode the proxy of a stream to ``dest``.

    A recording that is damaged half way gets black images from there on, so that what follows stays where it is.

    Raises
    ------
    NotFoundError, CorruptError, UsageError : the stream has no image that can be decoded.
    """
    import av

    with open_images(session, stream_name, threads=2) as images:
        count = count_images(session, session.stream(stream_name)) or len(images)
        frames = _frames(session, stream_name, images)
        first = next(frames, None)
        if first is None:
            where = f"{session.stream(stream_name).file}: there are no images"
            raise NotFoundError(
                f"cannot show stream {stream_name}",
                where=where,
                fix="show another stream; ecat check says more",
            )
        width, height = proxy_size(first.width, first.height)
        what = f"cannot write {dest.name}"
        with (
            media_errors(what, dest),
            av.open(str(dest), "w", format="mp4", options=_MOVE_INDEX_FIRST) as out,
        ):
            stream = out.add_stream("libx264", rate=RATE_HZ, options=_OPTIONS)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.time_base = stream.codec_context.time_base = Fraction(1, RATE_HZ)
            stream.thread_count = 2
            for k, frame in enumerate(_until(first, frames, count, (width, height))):
                out.mux(stream.encode(_fitted(frame, width, height, k)))
                tell(k + 1)
            out.mux(stream.encode(None))


def proxy_size(width_px: int, height_px: int) -> tuple[int, int]:
    """Width and height of a proxy: even, as 4:2:0 needs, and not wider than a screen."""
    scale = min(1.0, MOST_WIDTH_PX / width_px)
    even = [max(2 * round(size * scale / 2), 2) for size in (width_px, height_px)]
    return even[0], even[1]


def _frames(session: Session, stream_name: str, images: Any) -> Iterator[VideoFrame]:
    """The images as FFmpeg has them: colour undecoded to RGB, depth and infrared in colours."""
    from av import VideoFrame

    stream, path = session.stream(stream_name), session.stream_path(stream_name)
    if stream.kind not in DEPTH_KINDS and path.suffix != ".dep":
        yield from decoded(path, f"cannot read stream {stream_name}", threads=2)
        return
    bounds: tuple[float, float] | None = None
    for image in images:
        bounds = bounds or bounds_of(image)
        shown = colored(image, bounds, is_depth=stream.kind == "depth")
        yield VideoFrame.from_ndarray(shown, format="bgr24")


def _until(
    first: VideoFrame, frames: Iterator[VideoFrame], count: int, size: tuple[int, int]
) -> Iterator[VideoFrame]:
    """``count`` images; black ones from where they cannot be decoded."""
    yield first
    done = 1
    try:
        while done < count and (frame := next(frames, None)) is not None:
            yield frame
            done += 1
    except EcatError:
        pass  # ecat check says what is wrong with the file; the page marks nothing where nothing is shown
    for _ in range(done, count):
        yield _black(*size)


def _black(width: int, height: int) -> VideoFrame:
    from av import VideoFrame

    return VideoFrame.from_ndarray(np.zeros((height, width, 3), np.uint8), format="bgr24")


def _fitted(frame: VideoFrame, width: int, height: int, k: int) -> VideoFrame:
    from av.video.reformatter import ColorRange, Colorspace

    # browsers take for granted what a small file does not say: limited range, ITU 709 or 601 by size
    matrix = Colorspace.ITU709 if frame.format.is_rgb else frame.colorspace
    fitted = frame.reformat(
        width=width, height=height, format="yuv420p", dst_colorspace=matrix, dst_color_range=ColorRange.MPEG
    )
    fitted.pts, fitted.time_base = k, Fraction(1, RATE_HZ)
    return fitted


def direct_rate(session: Session, stream_name: str, count: int) -> float | None:
    """The rate of a recorded file that serves as its own proxy; None if it does not.

    It does if it is an MP4 of H.264 in 4:2:0 that browsers play, without B-frames, at a constant rate from time zero,
    with key frames so near to each other that seeking is quick, as many images as the stream, unturned and not
    stretched.
    """
    stream, path = session.stream(stream_name), session.stream_path(stream_name)
    if path.suffix.lower() not in {".mp4", ".m4v"} or stream.kind in DEPTH_KINDS or not count:
        return None
    with open_media(path, f"cannot read stream {stream_name}") as container:
        video = container.streams.video[0] if len(container.streams.video) == 1 else None
        if video is None or video.codec_context.name != "h264" or not _plain(video):
            return None
        entries = video.index_entries
        if len(entries) != count or count < 2 or video.time_base is None:
            return None
        times = np.array([entry.timestamp for entry in entries], np.float64) * float(video.time_base)
        keys = [k for k, entry in enumerate(entries) if entry.is_keyframe]
    step = (times[-1] - times[0]) / (count - 1)
    gaps = np.diff(np.array([*keys, count]))
    first = next(decoded(path, f"cannot read stream {stream_name}"), None)
    if first is None or first.rotation:
        return None
    constant = step > 0 and np.abs(times - step * np.arange(count)).max() < 0.1 * step
    if not constant or not keys or keys[0] != 0 or gaps.max() > _most_gop(video.width):
        return None
    return float(1 / step)


def _most_gop(width_px: int) -> int:
    return 30 if width_px <= 1280 else 2 * GOP


def _plain(video: VideoStream) -> bool:
    context = video.codec_context
    ratio = video.sample_aspect_ratio
    return (
        context.pix_fmt in {"yuv420p", "yuvj420p"}
        and not context.has_b_frames
        and context.width <= MOST_WIDTH_PX
        and (ratio is None or ratio in {0, 1})
        and video.start_time in {0, None}
    )
