"""Recorded video as the packets that a viewer of MCAP decodes: passed on as they are where that is possible.

``foxglove.CompressedVideo`` asks for H.264 or H.265 in Annex B form, one image to a message, parameter sets with every
key frame, and no B-frames, as its viewers decode without looking ahead.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ecat.errors import CorruptError
from ecat.store.media import ColorWriter, StreamImages
from ecat.store.media.container import first_video, media_errors, open_media, scan

if TYPE_CHECKING:
    from av import Packet, VideoStream

_START = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)
_HEAD_BYTES = 4096
_STEP_NS = 33_333_333


@dataclass(frozen=True)
class Codec:
    """A codec: what the schema calls it, what turns its packets to Annex B, where its SPS is known by."""

    name: str
    annex_b: str
    shift: int
    mask: int
    parameters: int

    def has_parameters(self, data: bytes) -> bool:
        """Whether the sequence's parameters come first in this packet."""
        heads = _START.finditer(data, 0, _HEAD_BYTES)
        return any((head[1][0] >> self.shift) & self.mask == self.parameters for head in heads)


_CODECS = {
    "h264": Codec("h264", "h264_mp4toannexb", 0, 0x1F, 7),
    "hevc": Codec("h265", "hevc_mp4toannexb", 1, 0x3F, 33),
}


@dataclass(frozen=True)
class Video:
    """A file whose packets can be passed on."""

    path: Path
    index: int
    codec: Codec

    def packets(self, n: int) -> Iterator[bytes]:
        """The packets of the first ``n`` images, in Annex B."""
        from av.bitstream import BitStreamFilterContext

        what = f"cannot read {self.path.name}"
        with open_media(self.path, what) as container:
            stream = cast("VideoStream", container.streams[self.index])
            annex_b = BitStreamFilterContext(self.codec.annex_b, stream)
            extra = bytes(stream.codec_context.extradata or b"")
            done = 0
            with media_errors(what, self.path, done=lambda: f"{done} images were read"):
                for packet in container.demux(stream):
                    if done == n or packet.pts is None:
                        break
                    yield self._whole(annex_b.filter(packet), extra, is_key=packet.is_keyframe)
                    done += 1
        if done < n:
            raise CorruptError(
                what,
                where=f"{self.path.name}: {done} of {n} images are there",
                consequence="this session was not written",
                fix="restore the file from a copy, or import the recording again",
            )

    def _whole(self, packets: list[Packet[Any]], extra: bytes, *, is_key: bool) -> bytes:
        data = b"".join(bytes(packet) for packet in packets)
        if is_key and not self.codec.has_parameters(data) and _START.search(extra, 0, 8):
            return extra + data
        return data


def recorded_video(path: Path, n: int) -> Video | str:
    """The video in a file of which ``n`` images are wanted; or why its packets cannot be passed on."""
    what = f"cannot read {path.name}"
    index = first_video(path, what)
    with open_media(path, what) as container:
        name = cast("VideoStream", container.streams[index]).codec_context.name
    codec = _CODECS.get(name)
    if codec is None:
        return f"it is {name}, which MCAP has no message for"
    packets = scan(path, what).packets[index]
    if packets.n_unclear or len(packets.pts) < n:
        return "not every image has a packet with a time"
    if (np.diff(packets.pts[:n]) <= 0).any():
        return "it has B-frames, which viewers of MCAP do not decode"
    if not packets.is_shown[:n].all() or not packets.is_key[:1].all():
        return "its first images cannot be decoded by themselves"
    video = Video(path, index, codec)
    if n and not codec.has_parameters(*video.packets(1)):
        return "it lacks its parameter sets"
    return video


def encoded_video(images: StreamImages, folder: Path, name: str, qp: int) -> Video:
    """The images of a stream, encoded anew to a file in ``folder`` whose packets can be passed on."""
    path = folder / f"{name}.mp4"
    writer: ColorWriter | None = None
    try:
        for k, image in enumerate(images):
            if writer is None:
                writer = ColorWriter(path, image.shape[1], image.shape[0], qp=qp)
            writer.write(image, k * _STEP_NS)  # their times are said by the messages
    finally:
        if writer is not None:
            writer.close()
    return Video(path, 0, _CODECS["h264"])
