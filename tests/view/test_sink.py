"""The way of a recording's bytes to a file, and what happens when the file takes no more."""

from __future__ import annotations

import errno
import io
from pathlib import Path
from typing import Any

import pytest
import rerun as rr
from rerun.chunk import RrdReader

from ecat.view.sink import written_to


class Full(io.RawIOBase):
    """A disk with room for a few bytes."""

    def write(self, data: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_what_is_sent_is_written_in_full(tmp_path: Path) -> None:
    stream = rr.RecordingStream("test", recording_id="r")
    file = tmp_path / "out.rrd"
    # more than a pipe holds
    text = "x" * 1_000_000
    with file.open("wb") as out, written_to(out, stream):
        stream.log("/text", rr.TextDocument(text), static=True)
    (chunk,) = [c for c in RrdReader(file).stream().to_chunks() if c.entity_path == "/text"]
    assert chunk.to_record_batch().column("TextDocument:text").to_pylist() == [[text]]


def test_a_full_disk_is_an_error_and_not_the_end_of_time() -> None:
    stream = rr.RecordingStream("test")
    full: Any = Full()
    with pytest.raises(OSError, match="No space left"), written_to(full, stream):
        # more than a pipe holds
        stream.log("/text", rr.TextDocument("x" * 1_000_000), static=True)


def test_an_error_on_the_way_closes_the_stream() -> None:
    out = io.BytesIO()
    with pytest.raises(ValueError, match="while sending"), written_to(out, rr.RecordingStream("test")):
        raise ValueError("while sending")
    assert out.getvalue().startswith(b"RRF2")
