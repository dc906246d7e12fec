"""When the images of a stream were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import NotFoundError
from ecat.model import Clock, Manifest, Stream
from ecat.store import Draft, Session, TableData, create_session
from ecat.store.times import count_images, image_times_s, median_rate_hz
from ecat.tables import TABLES

COLOR = Stream(name="color", kind="color", file="media/color.mp4", n_frames=5)
DEPTH = Stream(name="depth", kind="depth", file="media/depth.mkv", n_frames=3)


def session(path: Path, clock: Clock, frames: list[tuple[int, int, str]] | None = None) -> Session:
    tables: dict[str, TableData] = {}
    if frames is not None:
        rows = [{"t_ns": t_ns, "frame": frame, "stream": stream} for t_ns, frame, stream in frames]
        tables["frames"] = TableData(data=pa.Table.from_pylist(rows, schema=TABLES["frames"].arrow))
    manifest = Manifest(
        name="s", created="2026-01-01T00:00:00Z", n_frames=5, clock=clock, streams=(COLOR, DEPTH)
    )
    return create_session(path / "s", Draft(manifest=manifest, tables=tables))


def test_recorded_times_are_those_of_the_stream_in_the_order_of_its_images(tmp_path: Path) -> None:
    rows = [(0, 0, "color"), (10**9, 0, "depth"), (2 * 10**9, 1, "color"), (3 * 10**9, 1, "depth")]
    made = session(tmp_path, Clock(rule="recorded"), rows)
    assert image_times_s(made, COLOR).tolist() == [0.0, 2.0]
    assert image_times_s(made, DEPTH).tolist() == [1.0, 3.0]
    assert (count_images(made, COLOR), count_images(made, DEPTH)) == (2, 2)


def test_an_even_clock_counts_the_images_of_the_annotated_video_only(tmp_path: Path) -> None:
    made = session(tmp_path, Clock(rule="uniform", duration_ns=4 * 10**9))
    assert image_times_s(made, COLOR).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    with pytest.raises(NotFoundError, match="depth"):
        image_times_s(made, DEPTH)
    assert (count_images(made, COLOR), count_images(made, DEPTH)) == (5, 3)


def test_without_a_clock_there_are_no_times(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match="no clock"):
        image_times_s(session(tmp_path, Clock()), COLOR)


def test_the_median_rate_is_not_moved_by_a_gap() -> None:
    assert median_rate_hz(np.array([0.0, 0.1, 0.2, 5.2])) == pytest.approx(10)
    assert median_rate_hz(np.array([1.0])) is None
    assert median_rate_hz(np.zeros(3)) is None
