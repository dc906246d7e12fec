"""What data sets for training can be told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from ecat.formats.episodes import EpisodeOptions
from ecat.formats.options import option
from ecat.formats.stream_names import plain_name


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetOptions(EpisodeOptions):
    """Options of all data sets, besides those of episodes."""

    images: Literal["jpeg", "raw", "none"] = option(
        "jpeg", "colour images of each moment as JPEG, raw (large, and read without decoding), or none"
    )
    height: int | None = option(
        240, "rows of the images, which keep their shape; as recorded", least=16, most=8192
    )
    quality: int = option(90, "of JPEG", least=1, most=100)
    streams: str = option(
        "", "only these streams of images, with commas between them; otherwise all colour ones"
    )
    taken_names: ClassVar[tuple[str, ...]] = ()
    """What no stream can be called in the data set."""

    def stream_names(self, stream: str) -> tuple[str, ...]:
        """What a stream is called in the data set, and what belongs to it."""
        return (plain_name(stream),)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedOptions(DatasetOptions):
    """Options of data sets whose readers know JPEG."""

    images: Literal["jpeg", "none"] = option("jpeg", "colour images of each moment as JPEG, or none")
