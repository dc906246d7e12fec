"""Media files of any origin: opened with care, and looked through packet by packet without decoding."""

from __future__ import annotations

import errno
from array import array
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, LimitError, os_error
from ecat.store import files
from ecat.store.media.atoms import refuse_hollow
from ecat.store.media.ffv1 import SliceGuard
from ecat.store.media.truncation import bytes_missing

if TYPE_CHECKING:
    from av import Packet, VideoFrame, VideoStream
    from av.container import InputContainer

MAX_PIXELS = 50_000_000
"""Of one image; 8K has 33 million."""
MAX_PACKETS = 20_000_000
"""Of all streams of one file; an hour of three cameras at 30 images a second has 324,000."""
_CONTAINERS = (
    "matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,avi,mpegts,mpeg,flv,asf,ogg,wav,mp3,h264,hevc,ivf,gif,dv,mxf"
)
"""Never playlists: a reader of those would open whatever file or address the playlist names."""


@contextmanager
def media_errors(
    what: str, path: Path, *, done: Callable[[], str] = lambda: "", consequence: str = "it was not read"
) -> Generator[None]:
    """Turn the library's errors of the block into a FormatError, or that of the disk, of which ``consequence`` is one;
    ``done`` tells how far it got.
    """
    import av.error as av_errors

    try:
        yield
    except (av_errors.FFmpegError, EOFError, OSError) as error:
        # FFmpeg says "input/output error" of a header that breaks off
        of_format = isinstance(error, EOFError) or getattr(error, "errno", None) == errno.EIO
        if isinstance(error, OSError) and not of_format:
            raise os_error(error, what, path, consequence) from error
        where = "; ".join(part for part in (f"{path.name}: {_reason(error)}", done()) if part)
        raise FormatError(what, where=where) from error


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()


@contextmanager
def open_media(path: Path, what: str) -> Generator[InputContainer]:
    """A media file, opened for reading.

    Raises
    ------
    FormatError : not a regular file, empty, or not a media file that is known.
    LimitError : an image would have more than :data:`MAX_PIXELS`; or the file claims more than it has bytes for.
    StoreError : the file cannot be opened.
    """
    import av

    with files.typed_errors(what, path), files.open_regular(path) as file:
        if not file.read(1):
            raise FormatError(what, where=f"{path.name}: the file is empty")
    refuse_hollow(path, what)
    safely = {"format_whitelist": _CONTAINERS, "protocol_whitelist": "file"}
    with media_errors(what, path):
        # metadata of any encoding: a title must not stand between a person and their recording
        container = av.open(f"file:{path}", container_options=safely, metadata_errors="replace")
    with container:
        for stream in container.streams.video:
            context: Any = stream.codec_context  # None for a codec that is not known
            if context is not None and context.width * context.height > MAX_PIXELS:
                raise LimitError(
                    what,
                    where=f"{path.name}: images of {context.width} x {context.height} pixels, at most "
                    f"{MAX_PIXELS:,} pixels are read",
                    fix="convert it to smaller images first",
                )
        yield container


@dataclass(frozen=True)
class Packets:
    """What is known of a stream's packets, in the order of the file, which is the order of decoding.

    Parameters
    ----------
    pts : presentation time (n,) int64, in units of ``time_base`` seconds.
    is_key : (n,) bool, decoding can start there.
    is_shown : (n,) bool, false for what the container cuts off at its beginning.
    n_unclear : packets without a time or marked as damaged, which are not among those above.
    """

    pts: NDArray[np.int64]
    is_key: NDArray[np.bool_]
    is_shown: NDArray[np.bool_]
    time_base: Fraction
    n_unclear: int = 0

    @property
    def shown_pts(self) -> NDArray[np.int64]:
        """Times of the images, in the order in which they are shown."""
        return np.sort(self.pts[self.is_shown])

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Times of the images (n,) int64 in nanoseconds on the container's time line."""
        return to_ns(self.shown_pts, self.time_base)

    @cached_property
    def shown(self) -> NDArray[np.intp]:
        """For each image, in the order in which they are shown, its packet."""
        shown = np.flatnonzero(self.is_shown)
        return shown[np.argsort(self.pts[shown], kind="stable")]

    def place(self, pts: int | None) -> int | None:
        """Which packet has this time; None if none has."""
        if pts is None:
            return None
        at = int(np.searchsorted(self.pts, pts, sorter=self._by_time))
        packet = int(self._by_time[at]) if at < len(self._by_time) else -1
        return packet if packet >= 0 and self.pts[packet] == pts else None

    @cached_property
    def _by_time(self) -> NDArray[np.intp]:
        return np.argsort(self.pts, kind="stable")


def to_ns(pts: Any, time_base: Fraction) -> Any:
    """Nanoseconds of times in units of ``time_base`` seconds, rounded to the nearest."""
    unit = time_base * 1_000_000_000
    if unit.denominator == 1:
        return pts * unit.numerator
    whole, rest = pts // unit.denominator, pts % unit.denominator  # 64 bits last for centuries
    return whole * unit.numerator + (2 * rest * unit.numerator + unit.denominator) // (2 * unit.denominator)


class _Collected:
    """The packets of a stream while they come."""

    def __init__(self, time_base: Fraction) -> None:
        self.time_base = time_base
        self.pts = array("q")
        self.flags = bytearray()
        self.n_unclear = 0

    def add(self, packet: Packet[Any]) -> None:
        if packet.pts is None or packet.is_corrupt:
            self.n_unclear += 1
        else:
            self.pts.append(packet.pts)
            self.flags.append(packet.is_keyframe | (not packet.is_discard) << 1)

    def packets(self) -> Packets:
        flags = np.frombuffer(bytes(self.flags), np.uint8)
        pts = np.frombuffer(self.pts.tobytes(), np.int64)
        return Packets(
            pts, (flags & 1).astype(bool), (flags & 2).astype(bool), self.time_base, self.n_unclear
        )


@dataclass(frozen=True, slots=True)
class Scan:
    """All packets of a file by the index of their stream, and why there are no more of them (empty at a clean end)."""

    packets: dict[int, Packets]
    stopped: str = ""


def scan(
    path: Path,
    what: str,
    *,
    kinds: tuple[str, ...] = ("video",),
    each: Callable[[Packet[Any]], None] | None = None,
    tell: Callable[[int, int], None] | None = None,
) -> Scan:
    """Look through a file without decoding anything.

    Parameters
    ----------
    kinds : the kinds of streams whose packets are counted. each : called with every packet of every stream.
        tell : called now and then with the bytes read and the bytes there are.

    Raises
    ------
    FormatError, LimitError, StoreError : as :func:`open_media`; more than :data:`MAX_PACKETS` packets.
    """
    stopped = ""
    n = 0
    missing = bytes_missing(path)
    size = path.stat().st_size
    with open_media(path, what) as container:
        found = {
            s.index: _Collected(s.time_base or Fraction(1)) for s in container.streams if s.type in kinds
        }
        try:
            with media_errors(what, path):
                for packet in container.demux():
                    if packet.size == 0 and packet.pts is None:
                        continue  # what tells a decoder that there is no more
                    n += 1
                    if n > MAX_PACKETS:
                        raise LimitError(what, where=f"{path.name}: more than {MAX_PACKETS:,} packets")
                    if packet.stream_index in found:
                        found[packet.stream_index].add(packet)
                    if each is not None and not packet.is_corrupt:
                        each(packet)
                    if tell is not None and n % 256 == 0:
                        tell(min(max(packet.pos or 0, 0), size), size)
        except FormatError as error:
            stopped = error.where
    if missing and not stopped:
        stopped = f"{path.name}: the file ends {missing:,} bytes too early"
    return Scan({index: collected.packets() for index, collected in found.items()}, stopped)


def first_video(path: Path, what: str) -> int:
    """The index of the first video stream in the file that is not merely its cover picture.

    Raises
    ------
    FormatError : there is none, and what :func:`open_media` raises.
    """
    import av.stream

    with open_media(path, what) as container:
        for stream in container.streams.video:
            context: Any = stream.codec_context
            if context is not None and not stream.disposition & av.stream.Disposition.attached_pic:
                return stream.index
    raise FormatError(what, where=f"{path.name}: there is no video in it")


class Decoder:
    """Decodes the packets of a stream, within the limit of pixels; a damaged slice of FFV1 is an error."""

    def __init__(self, stream: VideoStream, threads: int = 1) -> None:
        stream.thread_count = threads
        stream.thread_type = "SLICE" if threads == 1 else "AUTO"
        self._context = stream.codec_context
        self._context.options = {"max_pixels": str(MAX_PIXELS)}
        self._guard = SliceGuard() if self._context.name == "ffv1" else None

    def decode(self, packet: Packet[Any] | None) -> list[VideoFrame]:
        """The images that are complete with this packet; with None, those that were still held back."""
        if self._guard is not None and packet is not None and self._guard.damaged(bytes(packet)):
            raise EOFError(errno.EBADMSG, "a slice of an image is damaged")
        return self._context.decode(packet)

    def drain(self) -> list[VideoFrame]:
        """The images that were held back; the decoder can go on elsewhere after it."""
        frames = self._context.decode(None)
        self._context.flush_buffers()
        return frames


def decoded(path: Path, what: str, index: int | None = None, *, threads: int = 1) -> Iterator[VideoFrame]:
    """The images of the video stream with this index in the file (the first by default), one after the other.

    Raises
    ------
    FormatError : there is no such stream, or it cannot be decoded any further; the error tells how many could be.
    """
    n = 0
    index = first_video(path, what) if index is None else index
    with open_media(path, what) as container:
        stream = cast("VideoStream", container.streams[index])
        decoder = Decoder(stream, threads)
        with media_errors(what, path, done=lambda: f"{n} images could be read"):
            for packet in container.demux(stream):
                for frame in decoder.decode(packet):
                    yield frame
                    n += 1


def gray16(frame: VideoFrame) -> NDArray[np.uint16]:
    """A decoded depth image (height, width) as its numbers are: FFmpeg would stretch 10, 12 or 14 bits to 16."""
    own = frame.format.name.startswith("gray1")
    return frame.to_ndarray(format=None if own else "gray16le").astype(np.uint16)
