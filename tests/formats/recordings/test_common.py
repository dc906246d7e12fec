"""Streams on their way into a session: what of a damaged one is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecat.errors import FormatError
from ecat.formats.recordings.common import depth_track

IMAGE = np.full((8, 8), 1000, np.uint16)


@pytest.mark.parametrize("lost_ns", [2**63, -(2**63) - 1, 2**80])
def test_an_image_whose_time_no_table_could_hold_is_left_out_and_that_is_said(
    lost_ns: int, tmp_path: Path
) -> None:
    times = [0, lost_ns, 33_000_000]
    track = depth_track("depth", lambda: ((t_ns, IMAGE) for t_ns in times), unit_m=0.001)
    track.write(tmp_path / "depth.mkv")
    assert track.t_ns.tolist() == [0, 33_000_000]
    assert track.notes == ["stream depth: 1 images whose time is more than a century away were left out"]


def test_a_stream_without_any_time_is_one_error(tmp_path: Path) -> None:
    track = depth_track("depth", lambda: [(2**70, IMAGE)], unit_m=0.001)
    with pytest.raises(FormatError, match="not one of its images"):
        track.write(tmp_path / "depth.mkv")
