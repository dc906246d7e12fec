"""Files of images, of the kinds that sessions have: read from end to end, or here and there."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from ecat.store.media.ahead import AHEAD, ahead
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
from ecat.store.media.ffv1 import Part, Slicing

if TYPE_CHECKING:
    from av import Packet, VideoFrame, VideoStream
    from av.container import InputContainer

_SEEK_PACKETS = 64
"""Fewer packets than this are faster read and thrown away than jumped over."""
_AHEAD = 12
"""Images decoded ahead of their use: those who take some at once do not have to wait for the first of the next."""
_LUMA_FIRST = re.compile(r"yuvj?4\d\dp|nv\d\d|gray")
"""Pixel formats whose first plane is the luma, 8 bits a pixel."""


Parts: TypeAlias = Sequence[Sequence[Part]] | None
"""Which parts of each of some images are wanted; None for all of all."""


class Source(Protocol):
    """A file of images."""

    def __len__(self) -> int: ...

    def all(self) -> Iterator[NDArray[Any]]:
        """All images, in order."""
        ...

    def at(self, indices: Sequence[int], parts: Parts = None) -> Iterator[NDArray[Any]]:
        """Those with these indices, ascending; where only ``parts`` are wanted, the rest may be 0."""
        ...

    def close(self) -> None:
        """Close what was kept open for the next call; there may be one all the same."""
        ...


class DepthFileImages:
    """A ``.dep`` file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __len__(self) -> int:
        with DepthFile(self._path) as file:
            return len(file)

    def all(self) -> Iterator[NDArray[Any]]:
        """All images, in order."""
        with DepthFile(self._path) as file:
            yield from file

    def at(self, indices: Sequence[int], parts: Parts = None) -> Iterator[NDArray[Any]]:
        """Those with these indices, ascending."""
        del parts
        with DepthFile(self._path) as file:
            for index in indices:
                yield file.frame(index)

    def close(self) -> None:
        """Nothing is kept open."""


class VideoImages:
    """The first video stream of a media file.

    Parameters
    ----------
    gray : colour images as their luma. wide : images of 16 bits. threads : with more than one, many images are decoded
        ahead of their use, by all but the one that uses them.
    """

    def __init__(self, path: Path, what: str, *, gray: bool, wide: bool, threads: int) -> None:
        self._path, self._what = path, what
        self._gray, self._wide = gray, wide
        self._most_ahead, self._threads = (_AHEAD, threads - 1) if threads > 1 else (0, 1)
        self._index = first_video(path, what)
        self._idle: _Reader | None = None
        self._lock = Lock()

    def __len__(self) -> int:
        packets = self._packets
        return len(packets.shown_pts) + packets.n_unclear

    def all(self) -> Iterator[NDArray[Any]]:
        """All images, in order."""
        frames = decoded(self._path, self._what, self._index, threads=self._threads)
        images = map(self._array, frames)
        return ahead(images, self._most_ahead) if self._most_ahead else images

    def at(self, indices: Sequence[int], parts: Parts = None) -> Iterator[NDArray[Any]]:
        """Those with these indices, ascending; where only ``parts`` are wanted, the rest may be 0."""
        images = self._at(indices, parts)
        # a few are not worth a thread
        return ahead(images, self._most_ahead) if len(indices) > AHEAD and self._most_ahead else images

    def _at(self, indices: Sequence[int], parts: Parts) -> Iterator[NDArray[Any]]:
        # a file may hold less than was recorded; whoever asks is told when it ends
        n = len(self) if indices else 0
        indices = [i for i in indices if i < n]
        if not indices:
            return
        if not self._can_jump:
            yield from self._counted(set(indices))
            return
        with self._reader() as reader:
            for frame, there in reader.images(indices, parts):
                image = self._array(frame)
                yield image if there is None else _only(image, there)

    def close(self) -> None:
        """Close the file, if it was kept open for the next images."""
        with self._lock:
            idle, self._idle = self._idle, None
        if idle is not None:
            idle.close()

    @cached_property
    def _packets(self) -> Packets:
        return scan(self._path, self._what).packets[self._index]

    @cached_property
    def _can_jump(self) -> bool:
        """Without a time of its own for each image, counting is the only way to find one."""
        return not self._packets.n_unclear and not (np.diff(self._packets.shown_pts) == 0).any()

    @contextmanager
    def _reader(self) -> Generator[_Reader]:
        """A reader that nobody else is using; it is kept for the next, as opening a long recording takes a while."""
        with self._lock:
            reader, self._idle = self._idle, None
        reader = reader or _Reader(self._path, self._what, self._packets, self._index, self._threads)
        try:
            with media_errors(self._what, self._path):
                yield reader
        except BaseException:  # also when the iteration is given up: nobody knows where it stands
            reader.close()
            raise
        with self._lock:
            idle, self._idle = self._idle, reader
        if idle is not None:
            idle.close()

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


def _only(image: NDArray[Any], there: Sequence[Part]) -> NDArray[Any]:
    """What was decoded of an image; the rest of the decoder's memory holds what was there before."""
    made = np.zeros_like(image)
    for left, top, right, bottom in there:
        made[top:bottom, left:right] = image[top:bottom, left:right]
    return made


def runs(packets: Packets, indices: Sequence[int]) -> Iterator[tuple[int, int, set[int]]]:
    """Which stretches of packets to decode for the images ``indices``, ascending, counted as they are shown.

    Each run is its first packet, where decoding can start, its last, and the times of the images wanted of it.
    """
    place, keys = packets.shown, np.flatnonzero(packets.is_key)
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


class _Reader:
    """Decodes images here and there in an open file, and jumps over what lies between."""

    def __init__(self, path: Path, what: str, packets: Packets, index: int, threads: int) -> None:
        self._packets = packets
        self._next = 0
        # where every image stands for itself the decoder need not be emptied before a jump
        self._intra = bool(packets.is_key.all())
        self._parts: dict[int, Sequence[Part]] = {}
        self._decoded_parts: dict[int, list[Part]] = {}
        with ExitStack() as opened:
            self._container: InputContainer = opened.enter_context(open_media(path, what))
            self._stream = cast("VideoStream", self._container.streams[index])
            self._decoder = Decoder(self._stream, threads)
            self._slicing = _slicing(self._stream) if self._intra else None
            self._opened = opened.pop_all()

    def close(self) -> None:
        """Close the file."""
        self._opened.close()

    def images(
        self, indices: Sequence[int], parts: Parts = None
    ) -> Iterator[tuple[VideoFrame, Sequence[Part] | None]]:
        """The images with these indices, ascending, and which parts of each were decoded; None for all of it."""
        wanted = self._packets.pts[self._packets.shown[list(indices)]].tolist()
        self._parts = {} if parts is None else dict(zip(wanted, parts, strict=False))
        self._decoded_parts.clear()
        there = set(wanted)
        for frame in self._decoded(indices):
            if frame.pts in there:
                yield frame, self._decoded_parts.pop(cast("int", frame.pts), None)

    def _decoded(self, indices: Sequence[int]) -> Iterator[VideoFrame]:
        """All images, as they are shown, of the stretches of packets that those with these indices lie in."""
        for first, last, _ in runs(self._packets, indices):
            if self._is_far(first) or not self._intra:
                yield from self._decoder.drain()  # a jump would throw away what it holds back
            for packet in self._from(first):
                yield from self._decoder.decode(self._cut(packet))
                if self._next > last:
                    break
        yield from self._decoder.drain()

    def _cut(self, packet: Packet[Any]) -> Packet[Any]:
        """The packet without what nobody wants of its image."""
        if self._slicing is None or packet.pts not in self._parts:
            return packet
        from av import Packet as NewPacket

        data, self._decoded_parts[packet.pts] = self._slicing.cut(bytes(packet), self._parts[packet.pts])
        cut = NewPacket(data)
        cut.pts, cut.dts, cut.time_base = packet.pts, packet.dts, packet.time_base
        return cut

    def _is_far(self, packet: int) -> bool:
        return not 0 <= packet - self._next <= _SEEK_PACKETS

    def _from(self, first: int) -> Iterator[Packet[Any]]:
        jumped = self._is_far(first)
        if jumped:
            self._container.seek(int(self._packets.pts[first]), stream=self._stream)
        for packet in self._container.demux(self._stream):
            place = self._packets.place(packet.pts)
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
            place = self._packets.place(packet.pts)
            if place is not None:
                self._next = place + 1
                if place >= first:
                    yield packet


def _slicing(stream: VideoStream) -> Slicing | None:
    """How images of a stream are divided into slices that can be decoded alone, if they are."""
    context = stream.codec_context
    if context.name != "ffv1":
        return None
    try:
        return Slicing(bytes(context.extradata or b""), context.width, context.height)
    except ValueError:
        return None
