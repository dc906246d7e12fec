"""What a stage sees of a recorded video: its images, one after the other, and when each was taken."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

from numpy.typing import NDArray

from ecat.geometry.cameras import Camera


class Images(Protocol):
    """The images of one stream, decoded when they are asked for and never held all at once.

    Colour images are (height, width, 3) uint8 in OpenCV's order blue, green, red, or (height, width) uint8 where grey
    ones were asked for; depth images are (height, width) uint16 in units of ``unit_m``, 0 where nothing was measured.
    """

    @property
    def frame(self) -> NDArray[Any]:
        """Frame of the session (n,) int64 that each image belongs to: the one taken nearest in time."""
        ...

    @property
    def t_ns(self) -> NDArray[Any] | None:
        """When each image was taken (n,) int64, nanoseconds since the session's start; None without a clock."""
        ...

    @property
    def camera(self) -> Camera | None:
        """The camera, None where its calibration is unknown."""
        ...

    @property
    def unit_m(self) -> float:
        """Metres per unit of a depth image."""
        ...

    def __len__(self) -> int:
        """How many images there are."""
        ...

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """All images, in order.

        Raises
        ------
        CorruptError : the stream's file cannot be decoded any further.
        """
        ...

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        """The images with these indices, ascending; what lies between is skipped as cheaply as the codec allows."""
        ...


Part: TypeAlias = tuple[int, int, int, int]
"""A part of an image: left, top, right, bottom in pixels, without the last column and row."""


@runtime_checkable
class PartlyRead(Protocol):
    """Images of which a part costs less than the whole."""

    def read_parts(self, indices: Sequence[int], parts: Sequence[Sequence[Part]]) -> Iterator[NDArray[Any]]:
        """The images with these indices, ascending; outside the parts of each, pixels may be 0."""
        ...


def read_parts(
    images: Images, indices: Sequence[int], parts: Sequence[Sequence[Part]]
) -> Iterator[NDArray[Any]]:
    """The images with these indices, ascending, whole or only where somebody looks at them: whichever costs less."""
    return images.read_parts(indices, parts) if isinstance(images, PartlyRead) else images.read(indices)


ImagesByKind: TypeAlias = Mapping[str, Images]
