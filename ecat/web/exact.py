"""Single images of a stream as they were recorded, and the distance at a pixel."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError, UsageError
from ecat.store import Session
from ecat.store.media import StreamImages, open_images

MOST_OPEN = 6
"""Files that are kept open; each holds a decoder."""
MOST_DECODED = 8
MOST_ENCODED = 64
STEP_OVER = 24
"""Images ahead of the last one that are reached sooner by decoding on than by a new start at a key frame."""
RUN = 128
"""Images that are asked of a decoder at once: whoever steps on gets the next one without a new start."""
JPEG_QUALITY = 90
DEPTH_KINDS = frozenset({"depth", "infrared"})
IMAGE_KINDS = DEPTH_KINDS | {"color"}
_NEAR_MM, _FAR_MM = 300.0, 3000.0

T = TypeVar("T")


class Recent(Generic[T]):
    """The values that were asked for last."""

    def __init__(self, most: int, close: Callable[[T], None] = lambda _: None) -> None:
        self._most, self._close = most, close
        self._kept: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of ``key``, made if it is not there."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = make()
        with self._lock:
            value = self._kept.setdefault(key, made)
            dropped = [self._kept.popitem(last=False)[1] for _ in range(len(self._kept) - self._most)]
        for old in dropped if value is made else [*dropped, made]:
            self._close(old)
        return value

    def clear(self) -> None:
        """Let go of everything."""
        with self._lock:
            kept = list(self._kept.values())
            self._kept.clear()
        for value in kept:
            self._close(value)


@dataclass
class _Reader:
    """A stream that is open, and how far it was decoded."""

    images: StreamImages
    lock: threading.Lock = field(default_factory=threading.Lock)
    going: Iterator[NDArray[Any]] | None = None
    next: int = 0
    stop: int = 0
    bounds: tuple[float, float] | None = None

    def read(self, index: int) -> NDArray[Any]:
        with self.lock:
            if self.going is None or not self.next <= index < min(self.next + STEP_OVER, self.stop):
                self.next, self.stop = index, min(index + RUN, len(self.images))
                self.going = self.images.read(range(index, self.stop))
            going, self.going = self.going, None  # what fails half way is not gone on with
            for image in going:
                self.next += 1
                if self.next > index:
                    self.going = going
                    return image
        raise AssertionError("an iteration of images ends with an error or with all of them")

    def close(self) -> None:
        with self.lock:
            self.images.close()


class ExactImages:
    """Images of any stream of any session, decoded one by one."""

    def __init__(self) -> None:
        self._readers: Recent[_Reader] = Recent(MOST_OPEN, _Reader.close)
        self._decoded: Recent[NDArray[Any]] = Recent(MOST_DECODED)
        self._encoded: Recent[bytes] = Recent(MOST_ENCODED)

    def close(self) -> None:
        """Close all files."""
        for kept in (self._readers, self._decoded, self._encoded):
            kept.clear()

    def image(self, session: Session, stream: str, index: int) -> NDArray[Any]:
        """The image with this index.

        Raises
        ------
        NotFoundError : there is no such stream, file or image.
        UsageError : the stream has no images.
        CorruptError : it cannot be decoded.
        """
        reader = self._reader(session, stream)
        if not 0 <= index < len(reader.images):
            raise NotFoundError(
                f"cannot show image {index} of stream {stream}",
                where=f"it has {len(reader.images):,} images, counted from 0",
                fix="ask for one of these",
            )
        return self._decoded.get((_key(session, stream), index), lambda: reader.read(index))

    def jpeg(self, session: Session, stream: str, index: int) -> bytes:
        """The image as a JPEG: depth in colours, infrared in greys."""
        key = _key(session, stream), index
        return self._encoded.get(key, lambda: self._jpeg(session, stream, index))

    def depth(self, session: Session, stream: str, index: int, u: float, v: float) -> dict[str, float | None]:
        """Distance along the optical axis at a pixel, and the point in the camera's own frame, metres.

        Raises
        ------
        UsageError : it is not a stream of depth, or the pixel is outside of the image.
        """
        if session.stream(stream).kind != "depth":
            raise UsageError(
                f"cannot measure in stream {stream}", where="its images are no depth", fix="name another"
            )
        image = self.image(session, stream, index)
        height, width = image.shape
        column, row = round(u) if np.isfinite(u) else -1, round(v) if np.isfinite(v) else -1
        if not (0 <= column < width and 0 <= row < height):
            raise UsageError(
                f"cannot measure at {u:g}, {v:g}",
                where=f"outside of the image of {width} x {height} pixels",
                fix="ask for a pixel inside",
            )
        images = self._reader(session, stream).images
        z = float(image[row, column]) * images.unit_m
        if not z:
            return {"depth_m": None, "x": None, "y": None, "z": None}
        if images.camera is None:
            return {"depth_m": z, "x": None, "y": None, "z": None}
        x, y, _ = (float(n) * z for n in images.camera.unproject(np.array([float(column), float(row)])))
        return {"depth_m": z, "x": x, "y": y, "z": z}

    def depth_range(self, session: Session, stream: str) -> dict[str, float]:
        """The distances, metres, that the first and the last colour of a depth stream mean.

        Raises
        ------
        UsageError : it is not a stream of depth.
        """
        if session.stream(stream).kind != "depth":
            raise UsageError(
                f"cannot measure in stream {stream}", where="its images are no depth", fix="name another"
            )
        near, far = bounds_of(self.image(session, stream, 0))
        unit_m = self._reader(session, stream).images.unit_m
        return {"near_m": near * unit_m, "far_m": far * unit_m}

    def _reader(self, session: Session, stream: str) -> _Reader:
        return self._readers.get(_key(session, stream), lambda: _Reader(open_images(session, stream)))

    def _jpeg(self, session: Session, stream: str, index: int) -> bytes:
        import cv2

        image = self.image(session, stream, index)
        if image.dtype == np.uint16:
            reader = self._reader(session, stream)
            if reader.bounds is None:
                reader.bounds = bounds_of(self.image(session, stream, 0))
            image = colored(image, reader.bounds, is_depth=session.stream(stream).kind == "depth")
        return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])


def _key(session: Session, stream: str) -> tuple[str, str]:
    # what is told of the camera and the clock may change, too
    return session.snapshot.sha256, stream


def bounds_of(first: NDArray[np.uint16]) -> tuple[float, float]:
    """The values that get the first and the last colour, from a stream's first image: all but the extremes of it."""
    seen = first[first > 0]
    if not seen.size:
        return _NEAR_MM, _FAR_MM
    near, far = (float(value) for value in np.percentile(seen, [1, 98]))
    # the darkest colours are left to what comes nearer than anything in the first image
    return max(near - 0.15 * (far - near), 0.0), max(far, near + 1.0)


def colored(image: NDArray[np.uint16], bounds: tuple[float, float], *, is_depth: bool) -> NDArray[np.uint8]:
    """Depth in colours that are ordered by brightness too, black where nothing was measured; infrared in greys.

    Infrared goes by its square root, as eyes and cameras for them do: what is far returns little light.
    """
    import cv2

    near, far = bounds
    if not is_depth:
        grey = (255 * np.sqrt(np.minimum(image / far, 1.0))).astype(np.uint8)
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
    scaled = np.clip((image.astype(np.float32) - near) * (255 / (far - near)), 0, 255).astype(np.uint8)
    shown = np.asarray(cv2.applyColorMap(scaled, cv2.COLORMAP_VIRIDIS), np.uint8)
    shown[image == 0] = 0
    return shown
