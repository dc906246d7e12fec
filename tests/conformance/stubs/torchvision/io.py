"""Videos, image by image, as torchvision's reader on PyAV hands them out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


class VideoReader:
    """Images from the key frame before the time that was sought: ``data`` (3, height, width) uint8, ``pts`` seconds."""

    def __init__(self, src: str, stream: str = "video") -> None:
        import av

        self.container: Any = av.open(src)
        self._stream = self.container.streams.video[0]

    def seek(self, time_s: float, keyframes_only: bool = False) -> VideoReader:
        """Go on from the key frame at this time, or the last one before."""
        self.container.seek(int(time_s / self._stream.time_base), stream=self._stream)
        return self

    def __iter__(self) -> Iterator[dict[str, Any]]:
        import torch

        for frame in self.container.decode(self._stream):
            yield {
                "data": torch.from_numpy(frame.to_ndarray(format="rgb24")).permute(2, 0, 1),
                "pts": frame.time,
            }
