"""Videos as LeRobot keeps them: many episodes one after the other in an MP4 per camera, packets as they are.

Every image of a file lasts exactly one step of the regular clock, and every episode begins with a key frame, so that a
reader finds any of them by its time.  Episodes are only in one file if they are encoded alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from ecat.errors import CorruptError
from ecat.formats.lerobot.depth import MOST
from ecat.store import files
from ecat.store.media.container import first_video, media_errors, open_media

if TYPE_CHECKING:
    from av import Packet, VideoCodecContext, VideoFrame, VideoStream
    from av.container import OutputContainer

Kind = Literal["color", "depth"]
TICKS = 512
"""Units of time from one image to the next."""
LONGEST_S = 1000
"""Of a file: to readers times are 32-bit numbers, which past 1,024 s are coarser than the 0.1 ms that lerobot allows.
"""
SAMPLES = 32
"""Of an episode so many key frames at most are looked at for statistics."""
_LEAST_SIDE = 150
"""Images are thinned to about this many rows or columns for statistics, as by lerobot."""


def time_base(fps: int) -> Fraction:
    """Seconds per unit of time in the files."""
    return Fraction(1, fps * TICKS)


def container_options(fps: int) -> dict[str, str]:
    """Of FFmpeg's MP4 writer, for files that are the same whenever they are made."""
    return {"fflags": "+bitexact", "video_track_timescale": str(fps * TICKS)}


class PacketFile(AbstractContextManager["PacketFile"]):
    """The first video of a file, read packet by packet."""

    def __init__(self, path: Path, what: str) -> None:
        self.path, self._what = path, what
        index = first_video(path, what)
        with ExitStack() as stack:
            self._container = stack.enter_context(open_media(path, what))
            self.stream = cast("VideoStream", self._container.streams[index])
            self._stack = stack.pop_all()
        self._packets: Iterator[Packet[Any]] = iter(())
        self._last_pts: int | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def extradata(self) -> bytes:
        """What a decoder has to know before the first packet."""
        return bytes(self.stream.codec_context.extradata or b"")

    def packets(self, first_pts: int, count: int, *, follows: bool = False) -> Iterator[Packet[Any]]:
        """``count`` packets from the one of this time on, which are in the order in which they are shown.

        ``follows`` tells that they come right after the last ones asked for.

        Raises
        ------
        CorruptError : the file ends before.
        """
        if not follows:
            with media_errors(self._what, self.path):
                self._container.seek(first_pts, stream=self.stream)
            self._packets = self._container.demux(self.stream)
        found = 0
        with media_errors(self._what, self.path):
            for packet in islice(self._from(first_pts), count):
                yield packet
                found += 1
        if found < count:
            raise CorruptError(
                self._what,
                where=f"{self.path.name}: {found} of {count} images could be copied",
                consequence="this session is not in the data set",
                fix="import the recording again",
            )

    def all(self) -> Iterator[Packet[Any]]:
        """All packets, as they are in the file."""
        return (packet for packet in self._container.demux(self.stream) if packet.size)

    def _from(self, first_pts: int) -> Iterator[Packet[Any]]:
        for packet in self._packets:
            if packet.size and packet.pts is not None and packet.pts >= first_pts:
                yield packet


@dataclass
class Sampler:
    """Counts the values of some images of an episode, decoded while their packets pass by.

    Parameters
    ----------
    at : which packets to look at; each is a key frame.
    counts : how often each value occurs: (3, 256) for red, green and blue, (1, 4096) for depth.
    """

    kind: Kind
    at: frozenset[int]
    counts: NDArray[np.int64] = field(init=False)
    n_images: int = 0
    _decoder: VideoCodecContext | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.counts = np.zeros((3, 256) if self.kind == "color" else (1, MOST + 1), np.int64)

    def see(self, number: int, packet: Packet[Any], stream: VideoStream) -> None:
        """Look at a packet of the episode, if it is one of those wanted."""
        if number not in self.at:
            return
        from av import CodecContext

        if self._decoder is None:
            context = stream.codec_context
            self._decoder = cast("VideoCodecContext", CodecContext.create(context.name, "r"))
            self._decoder.extradata = context.extradata
        frames = [*self._decoder.decode(packet), *self._decoder.decode(None)]
        self._decoder.flush_buffers()
        for frame in frames:
            self._count(frame)

    def _count(self, frame: VideoFrame) -> None:
        step = max(min(frame.width, frame.height) // _LEAST_SIDE, 1)
        if self.kind == "color":
            thin = frame.to_ndarray(format="rgb24")[::step, ::step].reshape(-1, 3)
        else:
            thin = frame.to_ndarray(format="gray12le")[::step, ::step].reshape(-1, 1)
        for channel, values in enumerate(thin.T):
            self.counts[channel] += np.bincount(values, minlength=self.counts.shape[1])
        self.n_images += 1


def with_level(source: Path, dest: Path, fps: int, level: str) -> None:
    """Copy a video in HEVC, and say in its header that decoders of this level (H.265 annex A.4) can decode it.

    Of lossless video x265 says 8.5, "no limit", which not every reader of MP4 knows.
    """
    import av
    from av.bitstream import BitStreamFilterContext

    with (
        PacketFile(source, f"cannot copy {source.name}") as file,
        media_errors("cannot write a video", dest),
        av.open(str(dest), "w", format="mp4", container_options=container_options(fps)) as out,
    ):
        stream = out.add_stream_from_template(file.stream)
        level_filter = BitStreamFilterContext(f"hevc_metadata=level={level}", file.stream, stream)
        for packet in file.all():
            for changed in level_filter.filter(packet):
                changed.stream = stream
                out.mux(changed)


def sampled(key_frames: Sequence[int]) -> frozenset[int]:
    """At most :data:`SAMPLES` of the key frames, spread evenly."""
    n = min(len(key_frames), SAMPLES)
    at = np.round(np.linspace(0, len(key_frames) - 1, n)).astype(int)
    return frozenset(int(key_frames[i]) for i in at)


@dataclass(frozen=True, kw_only=True)
class Clip:
    """The images of one episode: ``count`` packets of a file from ``first_pts`` on, the first being a key frame.

    ``follows`` : they come right after the last ones read of that file.  ``n_bytes`` : of all of them, 0 if unknown.
    """

    file: PacketFile
    first_pts: int
    count: int
    sampler: Sampler | None = None
    follows: bool = False
    n_bytes: int = 0


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an episode's video is."""

    chunk: int
    file: int
    from_s: float
    to_s: float
    n_bytes: int


class VideoFiles(AbstractContextManager["VideoFiles"]):
    """The videos of one camera: ``folder/chunk-000/file-000.mp4`` and so on.

    A new file is begun when the next episode would make it larger than ``most_bytes`` or longer than
    :data:`LONGEST_S`, or is encoded in another way.
    """

    def __init__(self, folder: Path, fps: int, *, most_bytes: int, chunk_size: int) -> None:
        self._folder, self._fps, self._most_bytes, self._chunk_size = folder, fps, most_bytes, chunk_size
        self._number = -1
        self._extradata = b""
        self._n_images = self._n_bytes = 0
        self._container: OutputContainer | None = None
        self._stream: VideoStream | None = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Write the index of the last file."""
        if self._container is not None:
            with media_errors("cannot write a video", self._path):
                self._container.close()
        self._container = None

    @property
    def _path(self) -> Path:
        chunk, number = divmod(max(self._number, 0), self._chunk_size)
        return self._folder / f"chunk-{chunk:03d}" / f"file-{number:03d}.mp4"

    def add(self, clip: Clip) -> Place:
        """Append an episode; it is counted by its sampler on the way."""
        if not self._fits(clip):
            self._begin(clip)
        assert self._container is not None
        start, before = self._n_images, self._n_bytes
        base = time_base(self._fps)
        with media_errors("cannot write a video", self._path):
            for number, packet in enumerate(
                clip.file.packets(clip.first_pts, clip.count, follows=clip.follows)
            ):
                if clip.sampler is not None:
                    clip.sampler.see(number, packet, clip.file.stream)
                self._n_bytes += packet.size
                packet.pts = packet.dts = self._n_images * TICKS
                packet.duration, packet.time_base = TICKS, base
                packet.stream = cast("VideoStream", self._stream)
                self._container.mux(packet)
                self._n_images += 1
        chunk, number = divmod(self._number, self._chunk_size)
        return Place(
            chunk=chunk,
            file=number,
            from_s=start / self._fps,
            to_s=self._n_images / self._fps,
            n_bytes=self._n_bytes - before,
        )

    def _fits(self, clip: Clip) -> bool:
        return (
            self._container is not None
            and self._extradata == clip.file.extradata
            and self._n_images + clip.count <= LONGEST_S * self._fps
            and self._n_bytes + clip.n_bytes <= self._most_bytes
        )

    def _begin(self, clip: Clip) -> None:
        import av

        self.close()
        self._number += 1
        self._n_images = self._n_bytes = 0
        self._extradata = clip.file.extradata
        files.make_folders(self._path.parent)
        files.step("write", self._path)
        with media_errors("cannot write a video", self._path):
            self._container = av.open(
                str(self._path), "w", format="mp4", container_options=container_options(self._fps)
            )
            self._stream = self._container.add_stream_from_template(clip.file.stream)
            self._stream.time_base = time_base(self._fps)
