"""Is the clock sound: frame numbers without gaps, time that runs forward, streams that keep together."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.check.finding import Finding, Patient, error, note, some, warning

GAP_STEPS = 1.5
"""A step between frame numbers counts as a gap above this many usual steps: half a step of slack for streams
whose rate is no whole fraction of the video's."""
PAUSE_PERIODS = 4.0
"""A pause in time above this many usual periods: a camera that halves its rate in the dark doubles the
period, one lost frame then makes it four; more means that frames went missing without a gap in their
numbers."""
DRIFT_PERIODS = 0.5
"""Two streams drift when their offset changes by more than this many frame periods over the recording: from
there on, pairing images by their frame number pairs the wrong ones."""
DRIFT_SHARE = 0.1
"""Share of the recording, at either end, over which an offset is measured (a median, so that jitter
cancels)."""
LEAST_FPS, MOST_FPS = 1.0, 240.0
"""Cameras of people handling objects run at 15-120 frames per second; outside of these bounds the length or
the duration is wrong (a duration in other units is off by a factor of a thousand)."""
RATE_TOLERANCE = 0.02
EVEN_SHARE, DROP_PERIODS = 0.2, 1.6
"""A stream is even if most of its periods are so near the usual one; a period so much longer then lacks an image."""
OFFSET_NS = 500_000_000
NS = 1e9


def recorded_clock(patient: Patient) -> Iterator[Finding]:
    """A recorded clock needs its ``frames`` table."""
    frames = patient.table("frames")
    if patient.manifest.clock.rule == "recorded" and (frames is None or frames.num_rows == 0):
        yield error(
            "clock-missing",
            "clock",
            "the clock is recorded, but there is no table frames with the recorded times",
        )


def unmeasured_clock(patient: Patient) -> Iterator[Finding]:
    """Without recorded times, gaps, drift and repetitions of frames cannot be seen; silence would not mean health."""
    if patient.table("frames") is not None or patient.manifest.clock.rule == "recorded":
        return
    if patient.manifest.n_frames < 2:
        return
    if patient.manifest.clock.rule == "unknown":
        message = "the times of frames are unknown"
    else:
        message = "times follow from the number of frames and the duration, as there is no table frames"
    yield note("clock-unknown", "clock", f"{message}: gaps, drift and repeated frames were not looked for")


def unmeasured_streams(patient: Patient) -> Iterator[Finding]:
    """Beside streams of known times there may be images that nobody knows the times of."""
    if patient.manifest.clock.rule != "recorded" or (timed := _streams(patient)) == {}:
        return
    for stream in patient.manifest.streams:
        if stream.present and stream.kind in {"color", "depth", "infrared"} and stream.name not in timed:
            message = (
                "it is not known when its images were taken: they count as spread evenly over the session"
            )
            yield note("clock-unknown", f"stream {stream.name}", message)


def uniform_clock(patient: Patient) -> Iterator[Finding]:
    """A uniform clock implies a frame rate; it must be one that cameras have."""
    clock, n = patient.manifest.clock, patient.manifest.n_frames
    if clock.duration_ns is not None and clock.duration_ns < 0:
        message = f"the recording lasts {clock.duration_ns / NS:g} s, less than nothing"
        yield error("clock-rate", "clock", message)
    elif clock.rule == "uniform" and n > 1:
        if not clock.duration_ns:
            message = f"{n:,} frames in no time at all"
            yield error("clock-rate", "clock", message)
        elif not LEAST_FPS <= (fps := (n - 1) * NS / clock.duration_ns) <= MOST_FPS:
            yield warning(
                "clock-rate",
                "clock",
                f"{n:,} frames in {clock.duration_ns / NS:,.3f} s are {fps:,.4g} frames per second; "
                f"expected {LEAST_FPS:g} to {MOST_FPS:g}",
            )


def _streams(patient: Patient) -> dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Times (ns) and frame numbers of every stream, in the order of the table."""
    table = patient.table("frames")
    if table is None:
        return {}
    names = table["stream"].cast(pa.string()).to_numpy()
    t, frame = table["t_ns"].to_numpy().astype(np.int64), table["frame"].to_numpy().astype(np.int64)
    return {str(name): (t[names == name], frame[names == name]) for name in np.unique(names.astype(str))}


def stream_frames(patient: Patient) -> Iterator[Finding]:
    """Within a stream every frame occurs once, later frames come later, none is missing."""
    for name, (t, frame) in _streams(patient).items():
        place = f"table frames, stream {name}"
        numbers, counts = np.unique(frame, return_counts=True)
        if (counts > 1).any():
            message = f"frames that occur more than once: {some(numbers[counts > 1])}"
            yield error("frame-duplicate", place, message)
        steps, periods = np.diff(frame), np.diff(t)
        if (steps < 0).any():
            message = f"time runs backwards after frame {some(frame[:-1][steps < 0])}"
            yield error("clock-backwards", place, message)
            continue
        yield from _gaps(place, frame, steps, periods)


def _gaps(
    place: str, frame: NDArray[np.int64], steps: NDArray[np.int64], periods: NDArray[np.int64]
) -> Iterator[Finding]:
    if not len(steps):
        return
    usual_step = max(1.0, float(np.median(steps)))
    gap = steps > GAP_STEPS * usual_step
    if gap.any():
        lost = round(float((steps[gap] / usual_step - 1).sum()))
        longest = int(steps[gap].max() / usual_step) - 1
        message = (
            f"{lost:,} of {lost + len(frame):,} frames are missing, at most {longest:,} in a row, "
            f"after frame {some(frame[:-1][gap])}"
        )
        yield warning("frame-gap", place, message)
    still = int((periods == 0).sum())
    if still:
        yield warning(
            "time-still", place, f"{still:,} of {len(frame):,} frames have the time of the one before"
        )
    usual = float(np.median(periods))
    pause = ~gap & (periods > PAUSE_PERIODS * usual)
    # a stream that numbers its own images leaves no gap in the numbers, but an even one leaves it in the times
    even = usual > 0 and float(np.quantile(np.abs(periods - usual), 0.8)) < EVEN_SHARE * usual
    dropped = ~gap & ~pause & (periods > DROP_PERIODS * usual) & even
    if dropped.any():
        lost = round(float((periods[dropped] / usual - 1).sum()))
        yield warning(
            "frame-drop",
            place,
            f"about {lost:,} images were not recorded: {int(dropped.sum()):,} periods are longer than "
            f"{DROP_PERIODS:g} usual ones ({usual / NS:.3f} s), after frame {some(frame[:-1][dropped])}",
        )
    if pause.any():
        message = (
            f"pauses of up to {periods[pause].max() / NS:.3f} s between consecutive frames "
            f"(usually {np.median(periods) / NS:.3f} s), after frame {some(frame[:-1][pause])}"
        )
        yield warning("time-gap", place, message)


def stream_drift(patient: Patient) -> Iterator[Finding]:
    """The offset between two streams at the same frame stays what it was at the start.

    A stream may have a frame for every second, third ... frame of the fastest one.
    """
    streams = sorted(_streams(patient).items(), key=lambda item: -len(item[1][0]))
    if len(streams) < 2:
        return
    reference, (t0, frame0) = streams[0]
    period = _frame_period(t0, frame0)
    if period <= 0:  # findings of its own
        return
    for name, (t, frame) in streams[1:]:
        every = _frame_period(t, frame) / period if len(t) > 1 else 1.0
        if round(every) < 1 or abs(every / round(every) - 1) > RATE_TOLERANCE:
            continue  # their frames do not belong together
        common, i, j = np.intersect1d(frame0, frame * round(every), return_indices=True)
        if len(common) < 2 / DRIFT_SHARE:
            continue
        offset = (t[j] - t0[i]).astype(float)
        few = int(len(offset) * DRIFT_SHARE)
        first, last = float(np.median(offset[:few])), float(np.median(offset[-few:]))
        if abs(last - first) > DRIFT_PERIODS * period:
            yield warning(
                "clock-drift",
                f"table frames, stream {name}",
                f"against {reference} it moves from {first / NS:+.3f} s to {last / NS:+.3f} s "
                f"over the recording, {abs(last - first) / period:.1f} frames",
            )


def _frame_period(t: NDArray[np.int64], frame: NDArray[np.int64]) -> float:
    """Nanoseconds from one frame number to the next, whether a stream counts its own images or those of another."""
    if len(t) < 2:
        return 0.0
    return float(np.median(np.diff(t))) / max(1.0, float(np.median(np.diff(frame))))


def stream_overlap(patient: Patient) -> Iterator[Finding]:
    """Streams of one recording were recorded at the same time; a clock that counts from elsewhere shows at once."""
    streams = sorted(_streams(patient).items(), key=lambda item: -len(item[1][0]))
    if len(streams) < 2:
        return
    reference, (t0, _) = streams[0]
    for name, (t, _) in streams[1:]:
        # Python's integers: times may lie further apart than 63 bits hold
        before, after = int(t0.min()) - int(t.max()), int(t.min()) - int(t0.max())
        if (apart := max(before, after)) > 0:
            yield warning(
                "clock-apart",
                f"table frames, stream {name}",
                f"it {'begins' if after > 0 else 'ends'} {apart / NS:,.3f} s "
                f"{'after the end' if after > 0 else 'before the start'} of {reference}: they never run together",
            )
        elif abs(late := int(t.min()) - int(t0.min())) > OFFSET_NS:
            message = f"it begins {abs(late) / NS:,.3f} s {'after' if late > 0 else 'before'} {reference}"
            yield note("clock-offset", f"table frames, stream {name}", message)


def frame_counts(patient: Patient) -> Iterator[Finding]:
    """A stream's declared number of frames is the number of its recorded times."""
    found = _streams(patient)
    for stream in patient.manifest.streams:
        rows = len(found[stream.name][0]) if stream.name in found else None
        if rows is not None and stream.n_frames is not None and rows != stream.n_frames:
            yield warning(
                "frame-count",
                f"stream {stream.name}",
                f"it has {stream.n_frames:,} frames, but the table frames has times for {rows:,}",
            )
    for name in found.keys() - {stream.name for stream in patient.manifest.streams}:
        message = f"the table frames has times of {name}, which is not a stream of the session"
        yield error("dangling-stream", "table frames", message)


CLOCK = (
    recorded_clock,
    unmeasured_clock,
    unmeasured_streams,
    uniform_clock,
    stream_frames,
    stream_drift,
    stream_overlap,
    frame_counts,
)
