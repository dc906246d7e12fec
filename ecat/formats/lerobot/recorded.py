"""The images of a session's streams on the regular clock of an episode: copied where they fit it, else encoded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ecat.errors import CorruptError
from ecat.formats.lerobot.depth import codes
from ecat.formats.lerobot.options import LeRobotOptions
from ecat.formats.lerobot.video import (
    TICKS,
    Clip,
    Kind,
    PacketFile,
    Sampler,
    container_options,
    sampled,
    time_base,
    with_level,
)
from ecat.model import Stream
from ecat.store import Session, files
from ecat.store.media import open_images
from ecat.store.media.container import Packets, media_errors
from ecat.store.media.sources import VideoImages

if TYPE_CHECKING:
    from av import VideoFrame

_IDR, _SLICES = 5, range(1, 6)
_LEVEL = "6.2"
"""The highest; 200 times as many pixels a second as a depth camera has."""
_COPIED_FORMATS = ("yuv420p", "yuvj420p")


class RecordedVideo(VideoImages):
    """A colour stream as the decoder hands it out, without turning it into red, green and blue."""

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(path, what, gray=False, wide=False, threads=1)

    def _array(self, frame: VideoFrame) -> NDArray[Any]:
        return cast("NDArray[Any]", frame)

    def frames(self, indices: list[int]) -> Iterator[VideoFrame]:
        """The images with these indices, ascending."""
        yield from cast("Iterator[VideoFrame]", self.at(indices))

    @property
    def packets(self) -> Packets:
        """Where the images lie."""
        return self._packets


class Camera(AbstractContextManager["Camera"]):
    """One stream of a session, episode by episode.

    Parameters
    ----------
    scratch : a file that may be written and overwritten.

    ``copied`` and ``encoded`` count episodes; ``reasons`` says why some were encoded.
    """

    def __init__(self, session: Session, stream: Stream, scratch: Path, options: LeRobotOptions) -> None:
        self.stream, self._options, self._scratch = stream, options, scratch
        self.kind: Kind = "depth" if stream.kind == "depth" else "color"
        self._session = session
        self._path = session.stream_path(stream.name)
        self._what = f"cannot read stream {stream.name}"
        self.copied = self.encoded = 0
        self.reasons: dict[str, int] = {}
        self._stack = ExitStack()
        self._made: ExitStack | None = None
        with media_errors(self._what, self._path):
            self._open()

    def _open(self) -> None:
        self._video: RecordedVideo | None = None
        if self.kind == "color":
            self._video = RecordedVideo(self._path, self._what)
            self._stack.callback(self._video.close)
            self._file = self._stack.enter_context(PacketFile(self._path, self._what))
            context = self._file.stream.codec_context
            width, height = self._options.image_size or (context.width, context.height)
        else:
            self._depth = self._stack.enter_context(open_images(self._session, self.stream.name))
            self._codes = codes(self._depth.unit_m)
            first = next(iter(self._depth.read([0])))
            height, width = first.shape
        # 4:2:0 has half as many rows and columns of colour: an odd last one is left out
        self.width, self.height = width - width % 2, height - height % 2

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()
        self._forget()

    def _forget(self) -> None:
        if self._made is not None:
            self._made.close()
        self._made = None
        files.remove(self._scratch)

    def clip(self, shown: NDArray[np.int64], fps: int) -> Clip:
        """The images (n,) of an episode, by their indices, which do not descend; good until the next is asked for.

        Raises
        ------
        CorruptError, FormatError : the recording cannot be read.
        """
        self._forget()
        reason = "depth is quantised" if self._video is None else self._why_not(self._video.packets, shown)
        if not reason:
            self.copied += 1
            assert self._video is not None
            return self._copy(self._video.packets, shown)
        self.encoded += 1
        self.reasons[reason] = self.reasons.get(reason, 0) + 1
        if self.kind == "color":
            self._encode(self._scratch, shown, fps)
        else:
            unlimited = self._scratch.with_suffix(".unlimited.mp4")
            self._encode(unlimited, shown, fps)
            with_level(unlimited, self._scratch, fps, _LEVEL)
            files.remove(unlimited)
        self._made = ExitStack()
        file = self._made.enter_context(PacketFile(self._scratch, f"cannot encode stream {self.stream.name}"))
        keys = range(0, len(shown), self._options.key_every)
        return Clip(
            file=file,
            first_pts=file.stream.start_time or 0,
            count=len(shown),
            sampler=Sampler(self.kind, sampled(keys)),
        )

    # --------------------------------------------------------------------------------------- copied

    def _why_not(self, packets: Packets, shown: NDArray[np.int64]) -> str:
        """Why the packets of these images cannot be copied; empty if they can."""
        context = self._file.stream.codec_context
        if self._options.encode == "always" or self._options.image_size is not None:
            return "it was asked for"
        if (
            context.name != "h264"
            or context.pix_fmt not in _COPIED_FORMATS
            or self._file.extradata[:1] != b"\1"
        ):
            return f"{context.name} {context.pix_fmt} is no H.264 that every reader of MP4 knows"
        if packets.n_unclear or int(shown[-1]) >= len(packets.shown):
            return "the times of its packets are not clear"
        if (np.diff(shown) != 1).any():
            return "on the regular clock an image is shown twice, or none"
        places = packets.shown[shown]
        if (np.diff(places) != 1).any():
            return "its images are not in the order in which they are shown"
        if not packets.is_key[places[0]] or not self._begins_anew(int(packets.pts[places[0]])):
            return "the episode does not begin with a key frame of the recording"
        return ""

    def _begins_anew(self, pts: int) -> bool:
        """Whether nothing after this packet needs what was before it: it holds an IDR picture (H.264 §7.4.1)."""
        data = bytes(next(self._file.packets(pts, 1)))
        length = (self._file.extradata[4] & 3) + 1
        at = 0
        while at + length < len(data):
            kind = data[at + length] & 31
            if kind in _SLICES:
                return kind == _IDR
            at += length + int.from_bytes(data[at : at + length], "big")
        return False

    def _copy(self, packets: Packets, shown: NDArray[np.int64]) -> Clip:
        places = packets.shown[shown]
        keys = np.flatnonzero(packets.is_key[places])
        return Clip(
            file=self._file,
            first_pts=int(packets.pts[places[0]]),
            count=len(shown),
            sampler=Sampler("color", sampled(keys.tolist())),
        )

    # -------------------------------------------------------------------------------------- encoded

    def _encode(self, path: Path, shown: NDArray[np.int64], fps: int) -> None:
        """Write the images to a file, each for one step of the clock."""
        import av

        every = self._options.key_every
        codec, options = (
            ("libx264", _x264(self._options.crf)) if self.kind == "color" else ("libx265", _x265(every))
        )
        images = self._frames(shown)
        with (
            media_errors(f"cannot encode stream {self.stream.name}", path),
            av.open(str(path), "w", format="mp4", container_options=container_options(fps)) as out,
        ):
            stream: Any = out.add_stream(codec, rate=fps, options=options)
            stream.width, stream.height = self.width, self.height
            stream.pix_fmt = "yuv420p" if self.kind == "color" else "gray12le"
            stream.thread_count = 1
            stream.codec_context.time_base = time_base(fps)
            stream.codec_context.gop_size = every
            for number, frame in enumerate(images):
                if not number and self.kind == "color":
                    context = stream.codec_context
                    context.colorspace, context.color_range = int(frame.colorspace), int(frame.color_range)
                frame.pts, frame.time_base = number * TICKS, time_base(fps)
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))

    def _frames(self, shown: NDArray[np.int64]) -> Iterator[VideoFrame]:
        """A frame for each moment; one that is shown again is handed out again."""
        wanted, times = np.unique(shown, return_counts=True)
        made = self._colors(wanted.tolist()) if self.kind == "color" else self._depths(wanted.tolist())
        done = 0
        for frame, again in zip(made, times.tolist(), strict=False):
            for _ in range(again):
                yield frame
            done += 1
        if done < len(wanted):
            raise CorruptError(
                self._what,
                where=f"{self._path.name}: {done} of {len(wanted)} images of an episode could be read",
                consequence="this session is not in the data set",
                fix="import the recording again",
            )

    def _colors(self, indices: list[int]) -> Iterator[VideoFrame]:
        from av.video.reformatter import ColorRange, Interpolation

        assert self._video is not None
        even = (self.width, self.height)
        for frame in self._video.frames(indices):
            whole = (frame.width - frame.width % 2, frame.height - frame.height % 2)
            # scaling to a size that is one smaller would blur what cutting leaves sharp
            cut = (
                frame
                if self._options.image_size or (frame.width, frame.height) == whole
                else _cropped(frame, *even)
            )
            yield cut.reformat(
                *even, "yuv420p", dst_color_range=ColorRange.MPEG, interpolation=Interpolation.AREA
            )

    def _depths(self, indices: list[int]) -> Iterator[VideoFrame]:
        from av import VideoFrame as Frame

        for image in self._depth.read(indices):
            frame = Frame(self.width, self.height, "gray12le")
            plane = frame.planes[0]
            rows = np.frombuffer(cast("Any", plane), np.uint16).reshape(self.height, plane.line_size // 2)
            rows[:, : self.width] = self._codes[image[: self.height, : self.width]]
            yield frame


def _cropped(frame: VideoFrame, width: int, height: int) -> VideoFrame:
    from av import VideoFrame as Frame

    cut = cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))[:height, :width]
    return Frame.from_ndarray(np.ascontiguousarray(cut), format="rgb24")


def _x264(crf: int) -> dict[str, str]:
    """As :class:`ecat.store.media.ColorWriter`: quick to make and to read, without images that depend on later ones."""
    return {"preset": "ultrafast", "crf": str(crf), "bf": "0", "sc_threshold": "0"}


def _x265(key_every: int) -> dict[str, str]:
    said = "lossless=1:log-level=none:info=0:bframes=0:scenecut=0:pools=none:frame-threads=1:wpp=0"
    return {"preset": "ultrafast", "x265-params": f"{said}:keyint={key_every}:min-keyint={key_every}"}
