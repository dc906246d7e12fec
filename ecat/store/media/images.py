"""The images of a session's stream, decoded in order when they are asked for, never all at once."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from itertools import pairwise
from types import TracebackType
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import CorruptError, FormatError, NotFoundError, UsageError
from ecat.geometry.nearest import nearest_in_time
from ecat.model import Manifest, Stream
from ecat.store.media.dep import DepthFile
from ecat.store.media.sources import DepthFileImages, Parts, Source, VideoImages
from ecat.store.together import go_on

if TYPE_CHECKING:
    from ecat.geometry.cameras import Camera
    from ecat.store.session import Session

_DEPTH_KINDS = {"depth", "infrared"}
MILLIMETRE = 0.001
"""The unit of depth where a recording says none."""


class StreamImages(AbstractContextManager["StreamImages"]):
    """The images of one stream (:class:`ecat.stages.images.Images`).

    Colour images are (height, width, 3) uint8, blue first; grey ones are (height, width) uint8, the luma as it is in
    the file (a read-only view of the decoder's memory, no copy); depth and infrared are (height, width) uint16.
    An image stays valid for as long as it is referred to.  Every iteration decodes anew, from its own open file.
    """

    def __init__(self, session: Session, stream: Stream, source: Source) -> None:
        self._manifest = session.manifest
        self._stream = stream
        self._source = source
        # those that somebody still goes on with; one that is given up closes its file as it goes
        self._running: WeakSet[Generator[NDArray[Any]]] = WeakSet()
        self._recorded = _recorded_times(session)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the iterations that are under way, and close their files."""
        for running in list(self._running):
            running.close()
        self._source.close()

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
        return nearest_in_time(its, mine)

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
        return self.read_parts(indices, None)

    def read_parts(self, indices: Sequence[int], parts: Parts) -> Iterator[NDArray[Any]]:
        """The same, of which only these parts are wanted (:class:`ecat.stages.images.PartlyRead`).

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
        return self._run(self._source.at(wanted, parts), len(wanted))

    @cached_property
    def _count(self) -> int:
        times = self._recorded.get(self._stream.name)
        return len(times) if times is not None else len(self._source)

    def _run(self, images: Iterator[NDArray[Any]], expected: int) -> Iterator[NDArray[Any]]:
        running = self._checked(images, expected)
        self._running.add(running)
        return running

    def _checked(self, images: Iterator[NDArray[Any]], expected: int) -> Generator[NDArray[Any]]:
        done = 0
        try:
            for image in images:
                if done == expected:
                    break
                go_on()
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


def _recorded_times(session: Session) -> dict[str, NDArray[np.int64]]:
    """The times of every stream in the table ``frames``, in the order of its images."""
    if not session.has_table("frames"):
        return {}
    rows = session.table("frames").to_arrow()
    found: dict[str, NDArray[np.int64]] = {}
    for stream in session.manifest.streams:
        times = times_of_stream(rows, stream.name)
        if times is not None:
            found[stream.name] = times
    return found


def times_of_stream(rows: pa.Table, name: str) -> NDArray[np.int64] | None:
    """The times (n,) of a stream in rows of the table ``frames``, in the order of its images; None without any."""
    mine = rows.filter(pc.equal(rows["stream"].cast(pa.string()), pa.scalar(name)))
    if not mine.num_rows:
        return None
    order = np.argsort(np.asarray(mine["frame"]), kind="stable")
    return np.asarray(mine["t_ns"])[order]


def open_images(session: Session, stream_name: str, *, gray: bool = False, threads: int = 1) -> StreamImages:
    """The images of a stream, given to a stage or looped over.

    Parameters
    ----------
    gray : colour images as their luma, one byte a pixel.
    threads : how many take part; one by default, so that sessions can be worked on side by side.  With more, images are
        decoded ahead of their use, by all but the one that uses them.

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
        source: Source
        if path.suffix == ".dep":
            with DepthFile(path):
                source = DepthFileImages(path)
        else:
            source = VideoImages(path, what, gray=gray, wide=stream.kind in _DEPTH_KINDS, threads=threads)
    except NotFoundError as error:
        raise NotFoundError(
            what, where=error.where, fix="restore the file, or import the recording again"
        ) from error
    except FormatError as error:
        raise CorruptError(
            what, where=error.where, consequence="no image was read", fix="restore the file from a copy"
        ) from error
    return StreamImages(session, stream, source)
