"""Video files of a session: depth without loss, colour for eyes and browsers, and packets passed on as they are."""

from __future__ import annotations

import io
import re
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from fractions import Fraction
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, UsageError
from ecat.store import files
from ecat.store.media import ffv1
from ecat.store.media.container import Packets, gray16, media_errors, open_media, scan
from ecat.store.together import go_on

if TYPE_CHECKING:
    from av import Packet, VideoCodecContext, VideoFrame, VideoStream
    from av.container import OutputContainer

_MICROSECOND = Fraction(1, 1_000_000)
_TICK = Fraction(1, 1000)
"""What FFmpeg's Matroska writer takes for its unit whatever one asks for."""
_SCALE = re.compile(rb"(\x15\x49\xA9\x66.{1,24}?\x2A\xD7\xB1\x83)\x0F\x42\x40", re.DOTALL)
"""The segment's information (RFC 9559 §5.1.2), up to a timestamp scale of 1,000,000 ns."""
_HEADER_BYTES = 1 << 12


class _Matroska(io.FileIO):
    """A Matroska file whose times are microseconds.

    FFmpeg writes milliseconds, which is not enough to tell cameras apart.  The file is written in ticks that FFmpeg
    believes to be milliseconds, and the scale in the header is set to what they are while it passes by, so that the
    file is right at any moment, also when the process dies.
    """

    def __init__(self, path: Path) -> None:
        files.step("write", path)
        super().__init__(path, "w+b")

    def write(self, data: Any, /) -> int:
        """Write all of ``data``: of a part that did not fit on the disk, FFmpeg would hear nothing.

        Raises
        ------
        OSError : the disk is full.
        """
        if self.tell() < _HEADER_BYTES:
            data = _SCALE.sub(rb"\1" + (1000).to_bytes(3, "big"), bytes(data), count=1)
        left = memoryview(data)
        while left:
            left = left[super().write(left) :]
        return len(data)


class _Writer(AbstractContextManager[Any]):
    """A file with one video stream; a block that fails leaves what was written so far."""

    def __init__(
        self, path: Path, width_px: int, height_px: int, codec: str, options: dict[str, str]
    ) -> None:
        import av

        self.path = path
        self.n_images = 0
        self._what = f"cannot write {path.name}"
        self._shape = (height_px, width_px)
        self._last_ticks = -1
        self._failed = False
        if not 0 < width_px < 1 << 15 or not 0 < height_px < 1 << 15:
            raise UsageError(
                self._what, where=f"images of {width_px} x {height_px} pixels", fix="reduce them"
            )
        with ExitStack() as stack, self._errors():
            matroska = path.suffix in {".mkv", ".mka"}
            file = stack.enter_context(_Matroska(path)) if matroska else str(path)
            container: OutputContainer = av.open(file, "w", format="matroska" if matroska else None)
            self._container = stack.enter_context(container)
            self._unit = _TICK if matroska else _MICROSECOND
            self._stream = cast("VideoStream", self._container.add_stream(codec, rate=30, options=options))
            self._stream.width, self._stream.height = width_px, height_px
            self._stream.codec_context.time_base = self._stream.time_base = self._unit
            self._stream.thread_count = 1
            self._stack = stack.pop_all()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # what comes of closing a file that could not be written says less than why it could not
        with suppress(Exception) if kind is not None else nullcontext():
            self.close()

    def close(self) -> None:
        """Write what is left, and the index.

        Raises
        ------
        DiskError : the disk is full.
        """
        stack, self._stack = self._stack, ExitStack()
        with self._errors(), stack:
            # FFmpeg does not survive images for a file whose head could not be written
            if self.n_images and not self._failed:
                self._append(None)

    def _errors(self) -> AbstractContextManager[None]:
        return media_errors(
            self._what,
            self.path,
            done=lambda: f"{self.n_images} images were written",
            consequence="it was not written",
        )

    def _put(self, frame: VideoFrame, t_ns: int) -> None:
        from av.video.frame import PictureType

        go_on()
        ticks = (int(t_ns) + 500) // 1000
        if ticks <= self._last_ticks:
            raise UsageError(
                self._what,
                where=f"image {self.n_images}: its time of {t_ns} ns does not follow the one before",
                fix="write the images in the order of their times",
            )
        self._last_ticks = ticks
        frame.pts, frame.time_base = ticks, self._unit
        frame.pict_type = (
            PictureType.NONE
        )  # a decoded image still says what it was, and would become that again
        self._failed = True
        with self._errors():
            self._append(frame)
        self._failed = False
        self.n_images += 1

    def _append(self, frame: VideoFrame | None) -> None:
        """Write an image, or with None those that are held back."""
        self._container.mux(self._stream.encode(frame))


class DepthWriter(_Writer):
    """Depth or infrared images, lossless: FFV1 level 3 (RFC 9043), gray16le, every image for itself, in Matroska.

    A file whose writer died is readable up to its last images, and a damaged slice is known by its checksum.  Times are
    kept in microseconds.  Of FFmpeg's two tables for differences, the one is taken that makes the first image smaller:
    that for more than 8 bits saves 10 % of quiet real depth, and loses up to 2 % of noisy one.  There are six slices,
    or four where six would take a quarter of a percent more: each can be decoded alone, so that a part of an image
    costs less than all of it.  With more ``threads`` than one, so many images are packed at once, which keeps
    processors busier than to divide each of them; the file is the same.
    """

    def __init__(self, path: Path, width_px: int, height_px: int, *, threads: int = 1) -> None:
        super().__init__(path, width_px, height_px, "ffv1", ffv1.choices(width_px, height_px)[0])
        self._stream.pix_fmt = "gray16le"
        self._stream.codec_context.gop_size = 1
        self._stream.codec_context.framerate = Fraction(0)  # none is declared: the times say it
        self._threads = threads
        self._workers = self._stack.enter_context(ThreadPoolExecutor(threads)) if threads > 1 else None
        self._idle: SimpleQueue[VideoCodecContext] = SimpleQueue()
        self._packing: deque[Future[list[Packet[Any]]]] = deque()

    def write(self, image: NDArray[np.uint16] | VideoFrame, t_ns: int) -> None:
        """Append an image (height, width) uint16, or a decoded one (gray16le), taken at ``t_ns``, later than the one
        before.

        Raises
        ------
        UsageError : another size or type, or a time that is negative or not later by a microsecond.
        DiskError : the disk is full.
        """
        from av import VideoFrame

        if isinstance(image, VideoFrame):
            shape, dtype = (image.height, image.width), image.format.name
        else:
            shape, dtype = image.shape, str(image.dtype)
        if shape != self._shape or dtype not in {"uint16", "gray16le"}:
            raise UsageError(
                self._what,
                where=f"image {self.n_images}: {dtype}{[*shape]}, not uint16{[*self._shape]}",
                fix="give images of one size and type",
            )
        if isinstance(image, VideoFrame):
            frame = image
        else:
            frame = VideoFrame.from_ndarray(np.ascontiguousarray(image, "<u2"), format="gray16le")
        if not self.n_images:
            self._stream.codec_context.options.update(ffv1.suited(gray16(frame)))
        self._put(frame, t_ns)

    def _append(self, frame: VideoFrame | None) -> None:
        if self._workers is None:
            return super()._append(frame)
        if not self.n_images:  # what the first is written with is what the file says
            encoder = self._stream.codec_context
            options = dict(encoder.options)
            super()._append(frame)
            for _ in range(self._threads - 1):
                self._idle.put(ffv1.encoder(encoder.width, encoder.height, self._unit, options))
            return self._idle.put(encoder)
        if frame is not None:
            self._packing.append(self._workers.submit(self._packed, frame))
        while len(self._packing) > (2 * self._threads if frame is not None else 0):
            for packet in self._packing.popleft().result():
                packet.stream = self._stream
                self._container.mux(packet)
        return None

    def _packed(self, frame: VideoFrame) -> list[Packet[Any]]:
        encoder = self._idle.get()
        try:
            return encoder.encode(frame)
        finally:
            self._idle.put(encoder)


class ColorWriter(_Writer):
    """Colour images as H.264 yuv420p that any browser plays, in MP4 or Matroska by the name of the file.

    Without B-frames and with a key frame every 15 images, so that seeking is exact and short.

    x264's preset ultrafast encodes 1080p more than three times as fast as veryfast and is decoded twice as fast.  The
    step of quantization, ``qp``, is the same everywhere; 20 leaves 42 to 47 dB of luma, by the noise there is.  To
    choose it by the content (crf) takes nearly as long as all the rest, and blocks are placed no better for it.
    """

    def __init__(
        self,
        path: Path,
        width_px: int,
        height_px: int,
        *,
        qp: int = 20,
        threads: int = 1,
    ) -> None:
        options = {"preset": "ultrafast", "qp": str(qp), "bf": "0"}
        # 4:2:0 has half as many rows and columns of colour: an odd last one is left out
        even = (width_px - width_px % 2, height_px - height_px % 2)
        super().__init__(path, *even, "libx264", options)
        self._shape = (height_px, width_px)
        self._stream.pix_fmt = "yuv420p"
        self._stream.thread_count = threads
        self._stream.codec_context.gop_size = 15

    def write(self, image: NDArray[np.uint8] | VideoFrame, t_ns: int) -> None:
        """Append an image (height, width, 3) uint8, blue first, or a decoded one, taken at ``t_ns``.

        Raises
        ------
        UsageError : another size or type, or a time that is negative or not later by a microsecond.
        DiskError : the disk is full.
        """
        from av import VideoFrame
        from av.video.reformatter import ColorRange, Colorspace

        context = self._stream.codec_context
        height, width = context.height, context.width
        if isinstance(image, VideoFrame):
            self._check((image.height, image.width), "")
            frame = image if self._shape == (height, width) else _cropped(image, height, width)
        else:
            self._check(
                image.shape[:2], "" if image.dtype == np.uint8 and image.ndim == 3 else str(image.dtype)
            )
            frame = VideoFrame.from_ndarray(np.ascontiguousarray(image[:height, :width]), format="bgr24")
        if not self.n_images and frame.format.name == "yuvj420p":
            self._stream.pix_fmt = "yuvj420p"  # the same in another name, which converting would copy
        if frame.format.is_rgb:
            matrix, bounds = Colorspace.ITU709, ColorRange.MPEG
            yuv = frame.reformat(format=context.pix_fmt, dst_colorspace=matrix, dst_color_range=bounds)
        else:  # whatever it is, it is passed on
            matrix, bounds = frame.colorspace, frame.color_range
            yuv = frame.reformat(format=context.pix_fmt)
        if not self.n_images:
            context.colorspace, context.color_range = int(matrix), int(bounds)
        self._put(yuv, t_ns)

    def _check(self, shape: tuple[int, ...], wrong: str) -> None:
        if shape != self._shape or wrong:
            raise UsageError(
                self._what,
                where=f"image {self.n_images}: {wrong or 'size'} {list(shape)}, not {list(self._shape)}",
                fix="give images of one size and type",
            )


def _cropped(frame: VideoFrame, height: int, width: int) -> VideoFrame:
    from av import VideoFrame as Frame

    bgr = cast("NDArray[np.uint8]", frame.to_ndarray(format="bgr24"))[:height, :width]
    return Frame.from_ndarray(np.ascontiguousarray(bgr), format="bgr24")


def remux(source: Path, dest: Path, indices: tuple[int, ...] = ()) -> int:
    """Copy packets of streams into another container, as they are: nothing is decoded.

    What comes before the first key frame and what is damaged is left out; a source that ends too early is copied as far
    as it goes.

    Parameters
    ----------
    indices : the streams of ``source`` by their index in it; the first video by default.

    Returns
    -------
    How many packets were copied.

    Raises
    ------
    FormatError : ``source`` cannot be read, or ``dest`` cannot hold such streams.
    """
    import av

    what = f"cannot copy {source.name}"
    copied = 0
    files.step("write", dest)
    copying = media_errors(what, dest, consequence="it was not copied")
    with open_media(source, what) as container, copying, av.open(str(dest), "w") as out:
        wanted = indices or tuple(stream.index for stream in container.streams.video[:1])
        streams: dict[int, Any] = {}
        for index in wanted:
            try:
                streams[index] = out.add_stream_from_template(cast("VideoStream", container.streams[index]))
            except ValueError as error:
                raise FormatError(what, where=f"stream {index} of {source.name}: {error}") from error
        decoding = {
            i: decoding_times(packets) for i, packets in scan(source, what).packets.items() if i in streams
        }
        started: set[int] = set()
        packets = container.demux([container.streams[index] for index in wanted])
        while (packet := _next(packets)) is not None:
            started |= {packet.stream_index} if packet.is_keyframe else set()
            if packet.stream_index in decoding:
                packet.dts = decoding[packet.stream_index].get(packet.pts)  # Matroska does not have them
            if packet.dts is None or packet.is_corrupt or packet.stream_index not in started:
                continue
            go_on()
            packet.stream = streams[packet.stream_index]
            out.mux(packet)
            copied += 1
    return copied


def decoding_times(packets: Packets) -> dict[int | None, int]:
    """For the time of each packet the time at which to decode it: ascending in the file's order, never after it."""
    shown = np.sort(packets.pts)
    shift = int((shown - packets.pts).max(initial=0))
    return dict(zip(packets.pts.tolist(), (shown - shift).tolist(), strict=True))


def _next(packets: Iterator[Packet[Any]]) -> Packet[Any] | None:
    """The next packet with content; None at the end of what can be read, of which a scan has told the reason."""
    import av.error as av_errors

    try:
        return next((packet for packet in packets if packet.size), None)
    except (av_errors.FFmpegError, EOFError):
        return None
