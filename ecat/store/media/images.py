"""The images of a session's stream, decoded in order when they are asked for, never all at once."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from inspect import GEN_CLOSED, getgeneratorstate
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import CorruptError, FormatError, NotFoundError, UsageError
from ecat.model import Manifest, Stream
from ecat.store.media.container import (
    Decoder,
    Packets,
    decoded,
    first_video,
    gray16,
    media_errors,
    open_media,
    scan,
)
from ecat.store.media.dep import DepthFile

if TYPE_CHECKING:
    from av import Packet, VideoFrame, VideoStream
    from av.container import InputContainer

    from ecat.geometry.cameras import Camera
    from ecat.store.session import Session

_SEEK_PACKETS = 64
"""Fewer packets than this are faster read and thrown away than jumped over."""
_LUMA_FIRST = re.compile(r"yuvj?4\d\dp|nv\d\d|gray")
"""Pixel formats whose first plane is the luma, 8 bits a pixel."""
_DEPTH_KINDS = {"depth", "infrared"}
MILLIMETRE = 0.001
"""The unit of depth where a recording says none."""


class _Source(Protocol):
    """A file of images."""

    def __len__(self) -> int: ...

    def all(self) -> Iterator[NDArray[Any]]: ...

    def at(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]: ...


class StreamImages(AbstractContextManager["StreamImages"]):
    """The images of one stream (:class:`ecat.stages.images.Images`).

    Colour images are (height, width, 3) uint8, blue first; grey ones are (height, width) uint8, the luma as it is in
    the file (a read-only view of the decoder's memory, no copy); depth and infrared are (height, width) uint16.
    An image stays valid for as long as it is referred to.  Every iteration decodes anew, from its own open file.
    """

    def __init__(self, session: Session, stream: Stream, source: _Source) -> None:
        self._manifest = session.manifest
        self._stream = stream
        self._source = source
        self._running: list[Generator[NDArray[Any]]] = []
        self._recorded = _recorded_times(session)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the iterations that are under way, and close their files."""
        for running in self._running:
            running.close()
        self._running.clear()

    def __repr__(self) -> str:
        return f"StreamImages({self._stream.name!r})"

    def __len__(self) -> int:
        return self._count

    @property
    def camera(self) -> Camera | None:
        """The camera, None where its calibration is unknown."""
        from ecat.geometry.records import camera_of

        record = self._manifest.camera(self._stream.camera)
        return camera_of(record) if record is not None else None

    @property
    def unit_m(self) -> float:
        """Metres per unit of a depth image: what the stream says, else millimetres."""
        return self._stream.depth_unit_m or MILLIMETRE

    @property
    def t_ns(self) -> NDArray[np.int64] | None:
        """When each image was taken (n,), nanoseconds since the session's start; None without a clock."""
        return self._times(self._stream, len(self))

    @property
    def frame(self) -> NDArray[np.int64]:
        """The frame of the session (n,) nearest in time to each image; spread evenly where no times are known."""
        return self._frame

    @cached_property
    def _frame(self) -> NDArray[np.int64]:
        n, video = len(self), annotated_stream(self._manifest)
        if video is None or video.name == self._stream.name:
            return np.arange(n)
        n_frames = self._manifest.n_frames
        mine, its = self.t_ns, self._times(video, n_frames)
        if mine is None or its is None or not len(its):
            return np.arange(n) * n_frames // max(n, 1)
        return nearest(its, mine)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """All images, in order.

        Raises
        ------
        CorruptError : the file cannot be decoded any further, or has other images than the session says.
        """
        return self._run(self._source.all(), len(self))

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        """The images with these indices, which ascend; errors as of an iteration.

        Raises
        ------
        UsageError : the indices do not ascend, or leave the stream.
        """
        wanted = [int(index) for index in indices]
        bounded = not wanted or (wanted[0] >= 0 and wanted[-1] < len(self))
        if not bounded or any(b <= a for a, b in pairwise(wanted)):
            raise UsageError(
                f"cannot read images of stream {self._stream.name}",
                where=f"the indices have to ascend and stay within 0 and {len(self) - 1}",
                fix="sort the indices, and leave out what is beyond",
            )
        return self._run(self._source.at(wanted), len(wanted))

    @cached_property
    def _count(self) -> int:
        times = self._recorded.get(self._stream.name)
        return len(times) if times is not None else len(self._source)

    def _run(self, images: Iterator[NDArray[Any]], expected: int) -> Iterator[NDArray[Any]]:
        running = self._checked(images, expected)
        self._running = [other for other in self._running if getgeneratorstate(other) != GEN_CLOSED]
        self._running.append(running)
        return running

    def _checked(self, images: Iterator[NDArray[Any]], expected: int) -> Generator[NDArray[Any]]:
        done = 0
        try:
            for image in images:
                if done == expected:
                    break
                yield image
                done += 1
        except FormatError as error:
            raise self._corrupt(error.where, done, expected) from error
        if done < expected:
            raise self._corrupt(f"{self._stream.file}: there are no more images", done, expected)

    def _corrupt(self, where: str, done: int, expected: int) -> CorruptError:
        return CorruptError(
            f"cannot read stream {self._stream.name} any further",
            where=f"{where}; {done} of {expected} images were readable",
            consequence="what follows was not read",
            fix="restore the file from a copy, or import the recording again",
        )

    def _times(self, stream: Stream, n: int) -> NDArray[np.int64] | None:
        recorded = self._recorded.get(stream.name)
        if recorded is not None:
            return recorded
        video = annotated_stream(self._manifest)
        if video is None or video.name != stream.name:
            return None
        times = self._manifest.clock.times_ns(range(n), self._manifest.n_frames)
        return None if None in times else np.array(times, np.int64)


def annotated_stream(manifest: Manifest) -> Stream | None:
    """The stream whose images are the session's frames: the first colour stream, without one the first of depth."""
    for kind in ("color", "depth"):
        for stream in manifest.streams:
            if stream.kind == kind:
                return stream
    return None


def nearest(times: NDArray[np.int64], asked: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each time ``asked`` (m,), the nearest of the ascending ``times`` (n,), n > 0, by its position."""
    after = np.clip(np.searchsorted(times, asked), 1, max(len(times) - 1, 1))
    if len(times) == 1:
        return np.zeros(len(asked), np.int64)
    return np.where(asked - times[after - 1] <= times[after] - asked, after - 1, after)


def _recorded_times(session: Session) -> dict[str, NDArray[np.int64]]:
    """The times of every stream in the table ``frames``, in the order of its images."""
    if not session.has_table("frames"):
        return {}
    rows = session.table("frames").to_arrow()
    names = rows["stream"].cast(pa.string())
    found: dict[str, NDArray[np.int64]] = {}
    for stream in session.manifest.streams:
        mine = rows.filter(pc.equal(names, pa.scalar(stream.name)))
        if mine.num_rows:
            order = np.argsort(np.asarray(mine["frame"]), kind="stable")
            found[stream.name] = np.asarray(mine["t_ns"])[order]
    return found


def open_images(session: Session, stream_name: str, *, gray: bool = False, threads: int = 1) -> StreamImages:
    """The images of a stream, given to a stage or looped over.

    Parameters
    ----------
    gray : colour images as their luma, one byte a pixel.
    threads : how many the decoder may use; one by default, so that sessions can be worked on side by side.

    Raises
    ------
    NotFoundError : there is no such stream, its file was not there at import or has gone since.
    CorruptError : the file is empty, or no media file.
    UsageError : the stream has no images.
    """
    stream = session.stream(stream_name)
    path = session.stream_path(stream_name)
    what = f"cannot read stream {stream_name}"
    if stream.kind not in {"color", *_DEPTH_KINDS, "other"}:
        raise UsageError(
            what, where=f"there are no images in a stream of the kind {stream.kind}", fix="name another"
        )
    try:
        source: _Source
        if path.suffix == ".dep":
            with DepthFile(path):
                source = _Dep(path)
        else:
            source = _Video(path, what, gray=gray, wide=stream.kind in _DEPTH_KINDS, threads=threads)
    except NotFoundError as error:
        raise NotFoundError(
            what, where=error.where, fix="restore the file, or import the recording again"
        ) from error
    except FormatError as error:
        raise CorruptError(
            what, where=error.where, consequence="no image was read", fix="restore the file from a copy"
        ) from error
    return StreamImages(session, stream, source)


class _Dep:
    """A ``.dep`` file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __len__(self) -> int:
        with DepthFile(self._path) as file:
            return len(file)

    def all(self) -> Iterator[NDArray[Any]]:
        with DepthFile(self._path) as file:
            yield from file

    def at(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        with DepthFile(self._path) as file:
            for index in indices:
                yield file.frame(index)


class _Video:
    """The first video stream of a media file."""

    def __init__(self, path: Path, what: str, *, gray: bool, wide: bool, threads: int) -> None:
        self._path, self._what = path, what
        self._gray, self._wide, self._threads = gray, wide, threads
        self._index = first_video(path, what)

    def __len__(self) -> int:
        packets = self._packets
        return len(packets.shown_pts) + packets.n_unclear

    def all(self) -> Iterator[NDArray[Any]]:
        for frame in decoded(self._path, self._what, self._index, threads=self._threads):
            yield self._array(frame)

    def at(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        if not indices:
            return
        times = self._packets.shown_pts
        # a file may hold less than was recorded; whoever asks is told when it ends
        indices = [i for i in indices if i < len(times) + self._packets.n_unclear]
        if not indices:
            return
        if self._packets.n_unclear or (np.diff(times) == 0).any():
            # without a time of its own for each image, counting is the only way to find one
            yield from self._counted(set(indices))
            return
        with self._opened() as (container, stream):
            reader = _Jumps(container, stream, self._packets, self._threads)
            for first, last, wanted in runs(self._packets, indices):
                for frame in reader.decode(first, last):
                    if frame.pts in wanted:
                        yield self._array(frame)

    @cached_property
    def _packets(self) -> Packets:
        return scan(self._path, self._what).packets[self._index]

    @contextmanager
    def _opened(self) -> Generator[tuple[InputContainer, VideoStream]]:
        with open_media(self._path, self._what) as container:
            stream = cast("VideoStream", container.streams[self._index])
            with media_errors(self._what, self._path):
                yield container, stream

    def _counted(self, wanted: set[int]) -> Iterator[NDArray[Any]]:
        for i, frame in enumerate(decoded(self._path, self._what, self._index, threads=self._threads)):
            if i in wanted:
                yield self._array(frame)
            if i >= max(wanted):
                return

    def _array(self, frame: VideoFrame) -> NDArray[Any]:
        name = frame.format.name
        if self._wide or name.startswith("gray16"):
            if name == "gray16le":
                return _plane(frame, np.dtype("<u2"))
            return gray16(frame)
        if not self._gray:
            return frame.to_ndarray(format="bgr24")
        if _LUMA_FIRST.fullmatch(name):
            return _plane(frame, np.dtype(np.uint8))
        return frame.to_ndarray(format="gray")


def _plane(frame: VideoFrame, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The first plane (height, width) as it lies in the decoder's memory."""
    plane = frame.planes[0]
    rows: NDArray[Any] = np.frombuffer(memoryview(plane), dtype)
    view = rows.reshape(-1, plane.line_size // dtype.itemsize)[: frame.height, : frame.width]
    view.flags.writeable = False
    return view


def runs(packets: Packets, indices: Sequence[int]) -> Iterator[tuple[int, int, set[int]]]:
    """Which stretches of packets to decode for the images ``indices``, ascending, counted as they are shown.

    Each run is its first packet, where decoding can start, its last, and the times of the images wanted of it.
    """
    shown = np.flatnonzero(packets.is_shown)
    place = shown[np.argsort(packets.pts[shown], kind="stable")]
    keys = np.flatnonzero(packets.is_key)
    first = last = -1
    wanted: set[int] = set()
    for index in indices:
        at = int(place[index])
        time = int(packets.pts[at])
        # images that come before their key frame in time, but after it in the file, belong to the group before
        k = int(np.searchsorted(keys, at, side="right")) - 1
        while k > 0 and packets.pts[keys[k]] > time:
            k -= 1
        start = int(keys[k]) if k >= 0 else 0
        if wanted and start > last + 1:
            yield first, last, wanted
            wanted = set()
        if not wanted:
            first, last = start, at
        last = max(last, at)
        wanted.add(time)
    if wanted:
        yield first, last, wanted


class _Jumps:
    """Decodes stretches of packets, one after the other, and jumps over what lies between."""

    def __init__(
        self, container: InputContainer, stream: VideoStream, packets: Packets, threads: int
    ) -> None:
        self._decoder = Decoder(stream, threads)
        self._container, self._stream, self._packets = container, stream, packets
        self._place = {int(pts): i for i, pts in enumerate(packets.pts)}
        self._next = 0

    def decode(self, first: int, last: int) -> Iterator[VideoFrame]:
        """The images of the packets from ``first`` to ``last``, as they are shown."""
        for packet in self._from(first):
            yield from self._decoder.decode(packet)
            if self._next > last:
                break
        yield from self._decoder.drain()

    def _from(self, first: int) -> Iterator[Packet[Any]]:
        jumped = first - self._next > _SEEK_PACKETS
        if jumped:
            self._container.seek(int(self._packets.pts[first]), stream=self._stream)
        for packet in self._container.demux(self._stream):
            place = self._place.get(packet.pts) if packet.pts is not None else None
            if place is None:
                continue
            if jumped and place > first:  # the index of the file is wrong: from the beginning, then
                self._container.seek(int(self._packets.pts.min()), stream=self._stream)
                self._next = 0
                yield from self._without_jump(first)
                return
            jumped = False
            self._next = place + 1
            if place >= first:
                yield packet

    def _without_jump(self, first: int) -> Iterator[Packet[Any]]:
        for packet in self._container.demux(self._stream):
            place = self._place.get(packet.pts) if packet.pts is not None else None
            if place is not None:
                self._next = place + 1
                if place >= first:
                    yield packet
