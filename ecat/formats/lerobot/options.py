"""What ``--format lerobot`` can be told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ecat.errors import UsageError
from ecat.formats.episodes import EpisodeOptions
from ecat.formats.options import option


@dataclass(frozen=True, slots=True, kw_only=True)
class LeRobotOptions(EpisodeOptions):
    """Options of the format, besides those of episodes."""

    cameras: str = option(
        "", "only these streams, with commas between them; otherwise those of most sessions"
    )
    depth: Literal["video", "none"] = option("video", "depth images as lossless 12-bit video, or not at all")
    size: str = option("", "width x height of colour images, as 640x480; otherwise as recorded")
    encode: Literal["when_needed", "always"] = option(
        "when_needed", "recorded video is copied where it fits the clock, or encoded anew always"
    )
    crf: int = option(23, "quality of video that is encoded; greater is smaller and worse", least=0, most=51)
    key_every: int = option(15, "images from one key frame to the next", least=1, most=1000)
    language: Literal["columns", "index", "none"] = option(
        "columns", "sub-events as lerobot 0.6 reads them; as a subtask_index, which 0.4 reads; or not at all"
    )
    gaps: Literal["hold", "task", "none"] = option(
        "hold", "between sub-events the last one goes on; or the task is named; or nothing"
    )
    split: Literal["none", "performer", "session"] = option(
        "none", "what is either in the split train or in test, never in both"
    )
    test_share: float = option(0.2, "how much of it is in test", least=0.0, most=1.0)

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height wanted for colour images.

        Raises
        ------
        UsageError : ``size`` is no size of an image.
        """
        if not self.size:
            return None
        width, _, height = self.size.lower().partition("x")
        if not (width.isdecimal() and height.isdecimal()):
            raise self._bad_size()
        found = int(width), int(height)
        if any(side % 2 or not 16 <= side <= 8192 for side in found):
            raise self._bad_size()
        return found

    def _bad_size(self) -> UsageError:
        return UsageError(
            f"lerobot cannot be told size={self.size}",
            where="size: expected two even numbers from 16 to 8192",
            fix="size=640x480",
        )
