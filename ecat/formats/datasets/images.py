"""The images that episodes show, small, each by itself: as JPEG, or as its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.datasets.options import DatasetOptions
from ecat.formats.episodes import Episode, image_streams
from ecat.formats.stream_names import require_unlike
from ecat.store import Session
from ecat.store.media import StreamImages, open_images

PLANES = b"RGB8"
"""What a raw image begins with: height and width follow, uint16 each, then three planes of bytes."""


class EpisodeImages(AbstractContextManager["EpisodeImages"]):
    """The colour streams of a session that a data set shows, in the manifest's order: ``names``.

    Raises
    ------
    NotFoundError : a stream that was asked for is not there.
    InputError : two streams would have the same name in the data set.
    """

    def __init__(self, session: Session, options: DatasetOptions) -> None:
        self._options = options
        self.names = _chosen(session, options)
        require_unlike(self.names, options.stream_names, taken=options.taken_names)
        with ExitStack() as stack:
            self._open: dict[str, StreamImages] = {
                name: stack.enter_context(open_images(session, name)) for name in self.names
            }
            self._stack = stack.pop_all()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def encoded(self, episode: Episode, name: str) -> Iterator[bytes]:
        """The image of each moment as the options want it, see :func:`decode_image`; nothing where there is none."""
        shown = episode.images[name]
        wanted = np.unique(shown[shown >= 0])
        images = self._open[name].read([int(index) for index in wanted])
        index, encoded = -1, b""
        for moment in shown:
            if moment < 0:
                yield b""
                continue
            # images are shown in their order, and some twice
            while index < moment:
                index, encoded = int(wanted[np.searchsorted(wanted, index + 1)]), self._encoded(next(images))
            yield encoded

    def _encoded(self, image: NDArray[np.uint8]) -> bytes:
        import cv2

        height = self._options.height
        if height is not None and height < image.shape[0]:
            width = max(1, round(image.shape[1] * height / image.shape[0]))
            image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        if self._options.images == "raw":
            size = np.array(image.shape[:2], "<u2").tobytes()
            return PLANES + size + image[:, :, ::-1].transpose(2, 0, 1).tobytes()
        _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._options.quality])
        return encoded.tobytes()


def decode_image(data: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """The image (3, H, W) that :meth:`EpisodeImages.encoded` made bytes of: red, green, blue; None if it is none.

    Of numbers, which need no decoding, it is a view of ``data``.
    """
    import cv2

    head = len(PLANES) + 4
    if data[: len(PLANES)].tobytes() == PLANES and len(data) > head:
        height, width = data[len(PLANES) : head].view("<u2").tolist()
        planes = data[head:]
        return planes.reshape(3, height, width) if len(planes) == 3 * height * width else None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    return None if image is None else np.asarray(image[:, :, ::-1].transpose(2, 0, 1), np.uint8)


def _chosen(session: Session, options: DatasetOptions) -> tuple[str, ...]:
    if options.images == "none":
        return ()
    there = image_streams(session)
    wanted = [name.strip() for name in options.streams.split(",") if name.strip()]
    if missing := [name for name in wanted if name not in there]:
        raise NotFoundError(
            f"cannot find stream {missing[0]} of {session.name}",
            where=f"the streams of images are: {', '.join(there) or 'none'}",
            fix="name one of them, or leave out the option streams",
        )
    return tuple(wanted) or tuple(name for name, stream in there.items() if stream.kind == "color")
