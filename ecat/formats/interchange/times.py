"""Every conversion between ecat's frames and times and those of other programs.

Ecat counts images from zero and nanoseconds since the session's start; intervals exclude their end.

================  ==========================================  ===========================================
program           how it tells a stretch                      here
================  ==========================================  ===========================================
ELAN              milliseconds, end excluded                  :func:`to_ms`, :func:`from_ms`
VIA, Vidat,       seconds as a float, end excluded            :func:`to_seconds`, :func:`from_seconds`
BORIS
CSV               seconds as a decimal number, end excluded   :func:`to_decimal`, :func:`from_decimal`
EPIC-KITCHENS     ``HH:MM:SS.mmm``; and images from 1, the    :func:`to_timestamp`, :func:`from_timestamp`,
                  last included                               :func:`to_counted`, :func:`from_counted`
Label Studio      images from 1, the last included            :func:`to_counted`, :func:`from_counted`
CVAT, COCO        images from 0; absent from an image on      as they are
================  ==========================================  ===========================================

A time becomes the nearest edge between images.  Where it is that edge's time, as exactly as the other program tells
times, the edge's own time is taken, so that what went out comes back to the nanosecond.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ecat.model import Clock, Segment
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.store.media.images import times_of_stream

NOMINAL_HZ = 30.0
"""Images a second where nobody knows."""
MOST_FRAMES = 2**31 - 2
MOST_SECONDS = 1e8
"""Three years; no recording is longer, and a float still tells its nanoseconds to within ten."""
MS_NS, SECOND_NS = 1_000_000, 1_000_000_000
HALF_MS_NS = MS_NS // 2
_DECIMAL = re.compile(r"-?\d{1,9}(?:\.\d{0,30})?")
_TIMESTAMP = re.compile(r"(\d{1,5}):(\d{1,2}):(\d{1,2}(?:\.\d{1,9})?)")


# ---------------------------------------------------------------------------------------------- units


def to_ms(t_ns: int) -> int:
    """Milliseconds, to the nearest."""
    return (t_ns + HALF_MS_NS) // MS_NS


def from_ms(t_ms: int) -> int:
    """Nanoseconds."""
    return t_ms * MS_NS


def to_seconds(t_ns: int) -> float:
    """Seconds; exact to the nanosecond for the first weeks."""
    return t_ns / SECOND_NS


def from_seconds(t_s: float) -> int:
    """Nanoseconds of finite seconds."""
    return round(t_s * SECOND_NS)


def to_decimal(t_ns: int) -> str:
    """Seconds as a decimal number, exact: ``1.5``."""
    sign, t_ns = ("-", -t_ns) if t_ns < 0 else ("", t_ns)
    seconds, rest = divmod(t_ns, SECOND_NS)
    return f"{sign}{seconds}.{rest:09}".rstrip("0").rstrip(".")


def from_decimal(text: str) -> int:
    """Nanoseconds of seconds as a decimal number.

    Raises
    ------
    ValueError : it is no such number, or one that no recording has.
    """
    found = _DECIMAL.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"expected seconds, found {text[:40]!r}")
    return round(Fraction(text.strip()) * SECOND_NS)


def to_timestamp(t_ns: int) -> str:
    """``HH:MM:SS.mmm``."""
    seconds, ms = divmod(to_ms(max(t_ns, 0)), 1000)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}.{ms:03}"


def from_timestamp(text: str) -> int:
    """Nanoseconds of ``HH:MM:SS``, with or without decimals.

    Raises
    ------
    ValueError : it is no such text.
    """
    found = _TIMESTAMP.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"expected HH:MM:SS.mmm, found {text[:40]!r}")
    hours, minutes, seconds = found.groups()
    return int((int(hours) * 3600 + int(minutes) * 60 + Fraction(seconds)) * SECOND_NS)


def to_counted(start: int, end: int) -> tuple[int, int]:
    """First and last image, counted from 1, of ``[start, end)``."""
    return max(start, 0) + 1, max(end, 1)


def from_counted(first: int, last: int) -> tuple[int, int]:
    """``[start, end)`` of the images ``first`` to ``last``, counted from 1."""
    start = max(first, 1) - 1
    return start, max(last, start + 1)


# ---------------------------------------------------------------------------------------------- frames


@dataclass(frozen=True)
class FrameTimes:
    """When images begin, and which begins nearest to a time; images go on beyond the last, and none is before 0.

    Parameters
    ----------
    recorded : int64[n], times of the images, not descending; or
    uniform : how many images there are, and nanoseconds from the first to the last; or neither.
    nominal_hz : images a second where there is neither: times are then made up, and ``known`` is false.
    """

    recorded: NDArray[np.int64] | None = None
    uniform: tuple[int, int] | None = None
    nominal_hz: float = NOMINAL_HZ

    @property
    def known(self) -> bool:
        """Whether times are those of a recording."""
        return self.recorded is not None or self.uniform is not None

    @property
    def rate_hz(self) -> float:
        """Images a second."""
        if self.recorded is not None:
            return SECOND_NS / self._step
        if self.uniform is not None:
            return (self.uniform[0] - 1) * SECOND_NS / self.uniform[1]
        return self.nominal_hz

    @cached_property
    def _step(self) -> int:
        times = self.recorded
        return 1 if times is None or len(times) < 2 else max(1, int(np.median(np.diff(times))))

    def ns(self, frame: int) -> int:
        """When an image begins, nanoseconds since the session's start."""
        frame = max(frame, 0)
        if self.recorded is not None:
            last = len(self.recorded) - 1
            if frame <= last:
                return max(0, int(self.recorded[frame]))
            return max(0, int(self.recorded[last])) + (frame - last) * self._step
        if self.uniform is not None:
            steps, duration = self.uniform[0] - 1, self.uniform[1]
            return (2 * duration * frame + steps) // (2 * steps)
        return round(Fraction(frame * SECOND_NS) / Fraction(self.nominal_hz))

    def frame(self, t_ns: int) -> int:
        """The image that begins nearest to a time; the earlier of two."""
        guess = max(0, self._guess(max(t_ns, 0)))
        return min(range(max(guess - 1, 0), guess + 2), key=lambda frame: abs(self.ns(frame) - t_ns))

    def _guess(self, t_ns: int) -> int:
        """At most one beside the nearest."""
        if self.recorded is not None:
            last = len(self.recorded) - 1
            if t_ns > self.ns(last):
                return last + (t_ns - self.ns(last)) // self._step
            return int(np.searchsorted(self.recorded, t_ns))
        if self.uniform is not None:
            return t_ns * (self.uniform[0] - 1) // self.uniform[1]
        return int(t_ns * Fraction(self.nominal_hz) / SECOND_NS)

    # ---------------------------------------------------------------------------------------- stretches

    def edges_ns(self, segment: Segment) -> tuple[int, int]:
        """When a stretch starts and ends; the end is after the start."""
        start = self.ns(segment.start_frame) if segment.start_ns is None else max(segment.start_ns, 0)
        end = self.ns(segment.end_frame) if segment.end_ns is None else segment.end_ns
        return start, max(end, start + 1)

    def of_frames(self, start: int, end: int) -> Segment:
        """The stretch ``[start, end)``, of at least one image, with its times where they are known."""
        start = max(start, 0)
        end = max(end, start + 1)
        if not self.known:
            return Segment(start_frame=start, end_frame=end)
        return Segment(start_frame=start, end_frame=end, start_ns=self.ns(start), end_ns=self.ns(end))

    def of_moment(self, t_ns: int, *, within_ns: int = 0) -> Segment:
        """The image that begins nearest to a time."""
        frame = self.frame(t_ns)
        made = self.of_frames(frame, frame + 1)
        return replace(made, start_ns=self._edge(frame, t_ns, within_ns)) if self.known else made

    def of_times(self, start_ns: int, end_ns: int, *, within_ns: int = 0) -> Segment:
        """The stretch of at least one image nearest to two times, which are told as exactly as ``within_ns``."""
        start, end = self.frame(start_ns), self.frame(end_ns)
        made = self.of_frames(start, end)
        if not self.known:
            return made
        edges = ((made.start_frame, start_ns), (made.end_frame, end_ns))
        first, last = (self._edge(frame, t_ns, within_ns) for frame, t_ns in edges)
        return Segment(
            start_frame=made.start_frame, end_frame=made.end_frame, start_ns=first, end_ns=max(last, first)
        )

    def _edge(self, frame: int, t_ns: int, within_ns: int) -> int:
        exact = self.ns(frame)
        return exact if abs(exact - t_ns) <= within_ns else max(t_ns, 0)


def times_of(session: Session, nominal_hz: float = NOMINAL_HZ) -> FrameTimes:
    """The times of the images that a session's frames count."""
    manifest = session.manifest
    video = annotated_stream(manifest)
    if manifest.clock.rule == "recorded" and video is not None and session.has_table("frames"):
        found = times_of_stream(session.table("frames").to_arrow(), video.name)
        if found is not None and len(found) > 1:
            return FrameTimes(recorded=np.maximum.accumulate(found), nominal_hz=nominal_hz)
    return times_of_clock(manifest.clock, manifest.n_frames, nominal_hz)


def times_of_clock(clock: Clock, n_frames: int, nominal_hz: float = NOMINAL_HZ) -> FrameTimes:
    """The times of a session without a table of them."""
    if clock.rule == "uniform" and clock.duration_ns and clock.duration_ns >= n_frames > 1:
        return FrameTimes(uniform=(n_frames, clock.duration_ns), nominal_hz=nominal_hz)
    return FrameTimes(nominal_hz=nominal_hz)


def clock_of(n_frames: int, rate_hz: float) -> Clock:
    """The clock of images that come at a known rate."""
    if n_frames < 2:
        return Clock(rule="unknown")
    duration_ns = round(Fraction((n_frames - 1) * SECOND_NS) / Fraction(rate_hz))
    return Clock(rule="uniform", duration_ns=max(duration_ns, n_frames))
