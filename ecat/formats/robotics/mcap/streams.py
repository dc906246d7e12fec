"""Recorded images: colour as video packets, depth and infrared as they are, and the cameras that took them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics.mcap import messages
from ecat.formats.robotics.mcap.messages import Item
from ecat.formats.robotics.mcap.video import Video, encoded_video, recorded_video
from ecat.formats.robotics.scene import file_names, stream_camera
from ecat.geometry.cameras import Camera
from ecat.model import Stream
from ecat.store import Session
from ecat.store.media import StreamImages, open_images


@dataclass
class Streams:
    """The streams of a session that are written.

    Parameters
    ----------
    folder : where videos that are encoded anew lie until they are written. findings : what is to be told.
    """

    session: Session
    folder: Path
    shift_ns: int
    video: Literal["best", "recorded", "none"]
    depth: bool
    infrared: bool
    qp: int
    findings: list[str] = field(default_factory=list[str])
    carried: list[str] = field(default_factory=list[str])

    def __post_init__(self) -> None:
        streams = [stream.name for stream in self.session.manifest.streams]
        self._names = dict(zip(streams, file_names(streams), strict=True))

    def sources(self, opened: ExitStack) -> Iterator[Iterator[Item]]:
        """The messages of each stream; what is opened for them is closed with ``opened``."""
        wanted = {"color": self.video != "none", "depth": self.depth, "infrared": self.infrared}
        for stream in self.session.manifest.streams:
            if not stream.present or not wanted.get(stream.kind, False):
                continue
            images = opened.enter_context(open_images(self.session, stream.name))
            if images.t_ns is None:
                self._tell(stream, "left behind, as nobody knows when its images were taken")
                continue
            times = images.t_ns + self.shift_ns
            if not len(times):
                continue
            if stream.kind == "color":
                found = self._video(stream, images)
                if found is not None:
                    self.carried.append(stream.name)
                    yield self._packets(stream, found, times)
            else:
                self.carried.append(stream.name)
                self._tell_unit(stream, images)
                yield self._raw(stream, images, times)

    def _video(self, stream: Stream, images: StreamImages) -> Video | None:
        found = recorded_video(self.session.stream_path(stream.name), len(images))
        if isinstance(found, Video):
            return found
        if self.video == "recorded":
            self._tell(stream, f"left behind: {found}")
            return None
        self._tell(stream, f"encoded anew as H.264 (qp {self.qp}): {found}")
        return encoded_video(images, self.folder, self._names[stream.name], self.qp)

    def _packets(self, stream: Stream, found: Video, times: NDArray[np.int64]) -> Iterator[Item]:
        name, frame_id = self._names[stream.name], self._frame_id(stream)
        yield from self._calibration(stream, int(times[0]))
        for t_ns, data in zip(times.tolist(), found.packets(len(times)), strict=True):
            yield t_ns, f"/{name}/video", messages.video(t_ns, frame_id, data, found.codec.name)

    def _raw(self, stream: Stream, images: StreamImages, times: NDArray[np.int64]) -> Iterator[Item]:
        name, frame_id = self._names[stream.name], self._frame_id(stream)
        yield from self._calibration(stream, int(times[0]))
        for t_ns, image in zip(times.tolist(), images, strict=True):
            yield t_ns, f"/{name}/image", messages.raw_image(t_ns, frame_id, image)

    def _calibration(self, stream: Stream, t_ns: int) -> Iterator[Item]:
        camera = self._camera(stream)
        if camera is not None:
            yield t_ns, f"/{self._names[stream.name]}/calibration", messages.calibration(t_ns, camera)
            if camera.mirrored:
                self._tell(stream, "its images are mirrored; the calibration says so by a negative fx")
            if any(camera.distortion[8:]):
                self._tell(
                    stream, "the lens has more than 8 coefficients, of which the calibration has the first 8"
                )
        else:
            self._tell(stream, "no calibration is known for images of its size")

    def _camera(self, stream: Stream) -> Camera | None:
        camera = stream_camera(self.session.manifest, stream)
        size = (stream.width_px, stream.height_px)
        if camera is None or (None not in size and size != (camera.width, camera.height)):
            return None
        return camera

    def _frame_id(self, stream: Stream) -> str:
        return f"camera/{stream.camera or stream.name}"

    def _tell_unit(self, stream: Stream, images: StreamImages) -> None:
        if stream.kind == "depth" and images.unit_m != 0.001:
            self._tell(
                stream, f"one unit is {images.unit_m:g} m, which viewers cannot know: they take it for 1 mm"
            )

    def _tell(self, stream: Stream, line: str) -> None:
        self.findings.append(f"stream {stream.name}: {line}")
