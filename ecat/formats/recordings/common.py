"""What the readers of recordings share: tracks of images with their own times, put together to a session."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.format import ImportReport
from ecat.model import Camera, Clock, Manifest, Provenance, Stream
from ecat.progress import Progress, silent, together
from ecat.store import Draft, TableData, create_session
from ecat.store.manifest import is_plain_name
from ecat.store.media import ColorWriter, DepthWriter, annotated_stream
from ecat.store.media.ahead import ahead
from ecat.store.media.container import Decoder, gray16, media_errors, open_media, to_ns
from ecat.tables import FRAMES

if TYPE_CHECKING:
    from av import Packet, VideoFrame, VideoStream

Image: TypeAlias = "NDArray[Any] | VideoFrame"
Images: TypeAlias = Callable[[], Iterable[tuple[int, Image]]]
"""Called once, when the session is written: the time of each image since the session's start in ns, and the image."""

_LATEST_NS = 100 * 366 * 24 * 3600 * 10**9
_THREADS = 2
_MANY = 100  # notes kept of one session
_TELL_EVERY = 16


@dataclass(eq=False)
class Track:
    """One stream of a session that is being imported.

    Parameters
    ----------
    stream : the record, as far as it is known before the file is written.
    images : where a file that has to be written gets them from. source : or the file to copy.
    t_ns : when each image was taken; known beforehand for a file that is copied, else told by ``images``.
    expected : how many images there should be, for the progress. notes : what was odd, a line each.
    timed : whether that is when they were taken; if nobody knows, the session has no times of this stream.
    """

    stream: Stream
    images: Images | None = None
    source: Path | None = None
    copy: Callable[[Path], None] | None = None
    t_ns: array[int] = field(default_factory=lambda: array("q"))
    expected: int = 0
    notes: list[str] = field(default_factory=list[str])
    timed: bool = True
    progress: Progress = silent

    def note(self, text: str) -> None:
        """Remember something odd."""
        self.notes.append(f"stream {self.stream.name}: {text}")

    def write(self, path: Path) -> None:
        """Write the stream's file, and keep the times and the size of what was written.

        Raises
        ------
        FormatError : there is not a single image.
        """
        if self.copy is not None:
            self.copy(path)
            return
        assert self.images is not None
        images = self._in_time(self.images())
        first = next(images, None)
        if first is None:
            raise FormatError(
                f"cannot import stream {self.stream.name}", where="not one of its images is readable"
            )
        height, width = _size(first[1])
        self.stream = replace(self.stream, width_px=width, height_px=height)
        others = 0
        with self._writer(path, width, height) as writer:
            last_us = -1
            for t_ns, image in chain([first], images):
                if _size(image) != (height, width):
                    others += 1
                    continue
                # the file's times have to ascend; the table of frames keeps what the device said
                last_us = max((t_ns + 500) // 1000, last_us + 1)
                writer.write(image, last_us * 1000)
                self.t_ns.append(t_ns)
                if len(self.t_ns) % _TELL_EVERY == 0:
                    self.progress(f"writing {self.stream.name}", len(self.t_ns), self.expected)
        if isinstance(self.images, Decoded):
            self.notes += [f"stream {self.stream.name}: {loss}" for loss in self.images.losses()]
        if others:
            self.note(f"{others} images of another size than {width} x {height} were left out")
        self.progress(f"writing {self.stream.name}", len(self.t_ns), self.expected or len(self.t_ns))

    def _in_time(self, images: Iterable[tuple[int, Image]]) -> Iterator[tuple[int, Image]]:
        """The images, without those of a damaged file whose time is none that a table could hold."""
        lost = 0
        for t_ns, image in images:
            if abs(t_ns) < _LATEST_NS:
                yield t_ns, image
            else:
                lost += 1
        if lost:
            self.note(f"{lost} images whose time is more than a century away were left out")

    def _writer(self, path: Path, width: int, height: int) -> Any:
        if self.stream.kind == "color":
            return ColorWriter(path, width, height, threads=_THREADS)
        return DepthWriter(path, width, height, threads=_THREADS)


def _size(image: Image) -> tuple[int, int]:
    """Height and width."""
    if isinstance(image, np.ndarray):
        return int(image.shape[0]), int(image.shape[1])
    return image.height, image.width


def color_track(name: str, images: Images, *, camera: str = "", expected: int = 0) -> Track:
    """Colour images, (height, width, 3) uint8 in the order blue, green, red or as decoded: they become H.264 in MP4."""
    stream = Stream(name=name, kind="color", file=f"media/{name}.mp4", codec="h264", camera=camera)
    return Track(stream, images, expected=expected)


def depth_track(
    name: str,
    images: Images,
    *,
    unit_m: float | None,
    camera: str = "",
    expected: int = 0,
    kind: Literal["depth", "infrared"] = "depth",
) -> Track:
    """Depth (or infrared) images (height, width) uint16, kept without loss; ``unit_m`` metres per unit."""
    stream = Stream(
        name=name,
        kind=kind,
        file=f"media/{name}.mkv",
        codec="ffv1 gray16le",
        camera=camera,
        depth_unit_m=unit_m,
    )
    return Track(stream, images, expected=expected)


def copied_track(stream: Stream, source: Path, t_ns: Sequence[int] | NDArray[np.int64] = ()) -> Track:
    """A file that is kept as it is, with the times of its images (none for audio)."""
    times = array("q", np.asarray(t_ns, np.int64).tobytes()) if len(t_ns) else array("q")
    return Track(stream, source=source, t_ns=times)


class _Gap:
    """What lies between a lost image and the next that stands for itself; images come out later than packets go in."""

    def __init__(self) -> None:
        self._first = self._end = math.inf

    def begins(self, packet: Packet[Any] | None) -> None:
        """The image of this packet is lost."""
        if packet is not None and packet.pts is not None:
            if self._end <= packet.pts:
                self._first = self._end = math.inf
            self._first = min(self._first, packet.pts)

    def goes_on(self, packet: Packet[Any] | None) -> None:
        """The decoder was given this packet."""
        if packet is not None and packet.pts is not None and packet.is_keyframe and packet.pts > self._first:
            self._end = min(self._end, packet.pts)

    def holds(self, frame: VideoFrame) -> bool:
        """Whether the image builds on the lost one."""
        return frame.pts is not None and self._first < frame.pts < self._end


def _wide(frame: VideoFrame) -> Image:
    """A depth image with its numbers as they are: decoded, with the lower byte first, or as an array."""
    return frame.reformat(format="gray16le") if frame.format.name.startswith("gray16") else gray16(frame)


@dataclass
class Decoded:
    """The images of one video stream of a file, for an import: what cannot be decoded is left out and counted.

    Parameters
    ----------
    start_ns : the session's start on the container's time line.
    as_depth : grey images of 16 bits, as they are kept.
    """

    path: Path
    index: int
    start_ns: int = 0
    as_depth: bool = False
    bad: int = 0
    doubtful: int = 0
    untimed: int = 0

    def __call__(self) -> Iterator[tuple[int, Image]]:
        """Times since the session's start in ns, and images; those without a time get one by the declared rate."""
        return ahead(self._images())  # the next images are read while one is written

    def _images(self) -> Iterator[tuple[int, Image]]:
        what = f"cannot import {self.path.name}"
        with open_media(self.path, what) as container:
            stream: VideoStream = container.streams[self.index]  # pyright: ignore[reportAssignmentType]
            base = stream.time_base or stream.codec_context.time_base
            period = 1 / (stream.average_rate or stream.guessed_rate or 25) / base
            last = -1.0
            for frame in self._frames(stream, container.demux(stream)):
                ticks = frame.pts if frame.pts is not None else frame.dts
                if ticks is None:
                    self.untimed += 1
                    ticks = round(last + period) if last >= 0 else 0
                last = float(ticks)
                yield int(to_ns(ticks, base)) - self.start_ns, _wide(frame) if self.as_depth else frame

    def losses(self) -> Iterator[str]:
        """What could not be decoded, a line each, once the images have been used up."""
        if self.bad:
            yield f"{self.bad} images could not be decoded and are missing"
        if self.doubtful:
            yield f"{self.doubtful} images that build on missing ones may look wrong"
        if self.untimed:
            yield f"{self.untimed} images carry no time; theirs follow from the declared rate"

    def _frames(self, stream: VideoStream, packets: Iterator[Packet[Any]]) -> Iterator[VideoFrame]:
        what = f"cannot decode {self.path.name}"
        decoder, gap, ended = Decoder(stream), _Gap(), False
        while not ended:
            try:
                with media_errors(what, self.path):
                    packet = next(packets, None)
            except FormatError:  # the file cannot be read any further: give out what the decoder still holds
                packet = None
            ended = packet is None or packet.size == 0
            if packet is not None and packet.is_corrupt:
                self.bad += 1
                gap.begins(packet)
                continue
            frames: list[VideoFrame] = []
            try:
                with media_errors(what, self.path):
                    frames = decoder.decode(None if ended else packet)
            except FormatError:
                self.bad += not ended
                gap.begins(packet)
            gap.goes_on(packet)
            self.doubtful += sum(map(gap.holds, frames))
            yield from frames


def create(
    dest: Path,
    tracks: Sequence[Track],
    *,
    format_name: str,
    source: str,
    name: str = "",
    cameras: Sequence[Camera] = (),
    tables: Mapping[str, TableData] | None = None,
    notes: Sequence[str] = (),
    start: str | None = None,
    software: str = "",
    foreign: Mapping[str, str] | None = None,
    progress: Progress = silent,
) -> ImportReport:
    """Write a session of these tracks, with every stream's own times; nothing is resampled.

    Parameters
    ----------
    source : the recording's own name. name : of the session, that of ``dest`` by default.
    start : the wall clock at the session's start, ISO 8601. foreign : what else the source said.

    Raises
    ------
    FormatError : a stream has not one readable image.
    StoreError : ``dest`` is taken or cannot be written; nothing is left there.
    """
    written = tell_together(tracks, progress)
    manifest = Manifest(
        name=name or _session_name(dest),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        clock=Clock(rule="recorded", start=start),
        cameras=tuple(cameras),
        streams=tuple(track.stream for track in tracks),
        provenance=Provenance(format=format_name, source=source, software=software),
        foreign=dict(foreign or {}),
    )
    frames = TableData(data=_frame_rows(tracks))
    draft = Draft(
        manifest=manifest,
        tables={"frames": frames, **(tables or {})},
        files={track.stream.name: track.source for track in tracks if track.source is not None},
        media={track.stream.name: track.write for track in written},
        finish=lambda manifest: _finished(manifest, tracks, notes),
    )
    session = create_session(dest, draft)
    return ImportReport(path=dest, format=format_name, sessions=1, findings=session.manifest.provenance.notes)


def tell_together(tracks: Sequence[Track], progress: Progress) -> list[Track]:
    """Let the tracks whose files will be written, side by side, tell how far all of them are; those are returned."""
    written = [track for track in tracks if track.source is None]
    if len(written) > 1:
        names = ", ".join(track.stream.name for track in written)
        known = all(track.expected for track in written)
        progress = together(f"writing {names}", sum(track.expected for track in written) * known, progress)
    for track in written:
        track.progress = progress
    return written


def _finished(manifest: Manifest, tracks: Sequence[Track], notes: Sequence[str]) -> Manifest:
    """The manifest with what is known now that all files are written."""
    known = {track.stream.name: track for track in tracks}
    streams = tuple(_final(stream, known[stream.name]) for stream in manifest.streams)
    manifest = replace(manifest, streams=streams)
    video = annotated_stream(manifest)
    last = max((max(track.t_ns) for track in tracks if track.t_ns and track.timed), default=None)
    found = [*notes, *(note for track in tracks for note in track.notes)]
    rest = len(found) - _MANY
    return replace(
        manifest,
        n_frames=(video.n_frames or 0) if video else 0,
        clock=replace(
            manifest.clock,
            rule="recorded" if last is not None else "unknown",
            duration_ns=max(last, 0) if last is not None else None,
        ),
        provenance=replace(
            manifest.provenance,
            notes=(*found[:_MANY], *([f"and {rest} more like these"] if rest > 0 else [])),
        ),
    )


def _session_name(dest: Path) -> str:
    name = dest.resolve().name
    return name if is_plain_name(name) else "session"


def _final(stream: Stream, track: Track) -> Stream:
    """The record with what is known now that its file is written."""
    size = {"width_px": track.stream.width_px, "height_px": track.stream.height_px}
    return replace(stream, n_frames=len(track.t_ns) if track.t_ns else stream.n_frames, **size)


def _frame_rows(tracks: Sequence[Track]) -> Iterator[pa.RecordBatch]:
    """The table of recorded times; made when it is asked for, which is after the media were written."""
    timed = [track for track in tracks if track.t_ns and track.timed]
    names = [track.stream.name for track in timed]
    t_ns = np.concatenate([np.frombuffer(track.t_ns, np.int64) for track in timed] or [np.zeros(0, np.int64)])
    frame = np.concatenate(
        [np.arange(len(track.t_ns), dtype=np.int32) for track in timed] or [np.zeros(0, np.int32)]
    )
    which = np.repeat(np.arange(len(timed), dtype=np.int32), [len(track.t_ns) for track in timed])
    rank = np.argsort(np.argsort(names)) if names else np.zeros(0, np.int64)
    order = np.lexsort((frame, rank[which], t_ns)) if len(t_ns) else np.zeros(0, np.int64)
    streams = pa.DictionaryArray.from_arrays(pa.array(which[order], pa.int32()), pa.array(names, pa.string()))
    yield pa.record_batch([pa.array(t_ns[order]), pa.array(frame[order]), streams], schema=FRAMES.arrow)
