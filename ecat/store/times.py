"""When the images of a stream were taken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.model import Stream
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.store.media.images import times_of_stream


def image_times_s(session: Session, stream: Stream) -> NDArray[np.float64]:
    """Seconds since the session's start (n,) of every image of a stream.

    Raises
    ------
    NotFoundError : they are not known.
    """
    recorded = _recorded_ns(session, stream.name)
    if recorded is not None:
        return recorded / 1e9
    manifest, video = session.manifest, annotated_stream(session.manifest)
    if video is not None and video.name == stream.name:
        times = manifest.clock.times_ns(range(manifest.n_frames), manifest.n_frames)
        if None not in times:
            return np.array(times, np.float64) / 1e9
    raise NotFoundError(
        f"cannot tell the times of stream {stream.name}",
        where=f"{session.name}: the recording has no clock for it",
        fix="place its images evenly",
    )


def count_images(session: Session, stream: Stream) -> int:
    """How many images a stream has, as far as can be told without opening its file."""
    recorded = _recorded_ns(session, stream.name)
    if recorded is not None:
        return len(recorded)
    video = annotated_stream(session.manifest)
    if video is not None and video.name == stream.name:
        return session.manifest.n_frames
    return stream.n_frames or 0


def median_rate_hz(times_s: NDArray[np.float64]) -> float | None:
    """Images a second, by the median of the steps; None where there is no step."""
    steps = np.diff(times_s)
    step = float(np.median(steps)) if len(steps) else 0.0
    return 1 / step if step > 0 else None


def _recorded_ns(session: Session, name: str) -> NDArray[np.int64] | None:
    if not session.has_table("frames"):
        return None
    return times_of_stream(session.table("frames").to_arrow(), name)
