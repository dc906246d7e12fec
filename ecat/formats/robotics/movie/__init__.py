"""A movie of a session for a talk (``.mp4``): the recorded images with what is known drawn over them.

The table's grid, blocks with axes, names and the way they came, bodies, drawn shapes; beside the image what happens and
which relations hold, below it the events as lanes with a cursor.  Images are shown when they were taken.
Left behind: everything that can be computed with; a movie is for eyes.  Sound is left behind too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ecat.formats.format import Format
from ecat.formats.options import option
from ecat.progress import Progress
from ecat.store import Session


@dataclass(frozen=True, slots=True, kw_only=True)
class MovieOptions:
    """Which part, of which stream, and how large."""

    height: int = option(1080, "rows of the movie, which is 16 to 9", least=240, most=2160)
    start_s: float = option(0.0, "where it begins, seconds since the session's start", least=0)
    end_s: float | None = option(None, "where it ends; nothing: with the recording", least=0)
    every: int = option(1, "every so-manieth image", least=1)
    stream: str = option("", "the stream whose images are shown; nothing: the annotated video")
    layer: str = option("", "the layer whose events are shown; nothing: gold, else main, else another")
    page_s: float = option(30.0, "how much of the events is shown at a time, seconds", least=1)
    qp: int = option(20, "step of quantization; smaller is better and larger", least=1, most=51)


def part(
    session: Session, label: str, dest: Path, options: MovieOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a movie; errors as of :func:`ecat.formats.robotics.movie.film.make`."""
    from ecat.formats.robotics.movie.film import make

    return make(session, label, dest, options, progress)


FORMAT = Format(
    name="movie",
    description="a movie for a talk (.mp4): the video with table, blocks, bodies and names drawn in, events below",
    part=part,
    suffix=".mp4",
    options=MovieOptions,
)
