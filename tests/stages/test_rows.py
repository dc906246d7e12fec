"""Tables of which some frames are read after the others."""

from __future__ import annotations

from collections.abc import Sequence

import pyarrow as pa
import pytest

from ecat.stages.rows import InMemory, frames_of, rows_of, stretches


def table(frames: Sequence[int]) -> pa.Table:
    return pa.table({"frame": pa.array(frames, pa.int32()), "x": [float(number) for number in frames]})


class Watched(InMemory):
    """Rows that tell how often they were read."""

    reads = 0

    def between(self, first: int, end: int) -> pa.Table:
        type(self).reads += 1
        return super().between(first, end)


@pytest.mark.parametrize("frames", [(), (0,), (3, 3, 4), (0, 1, 2, 3, 4, 5), (7, 8, 2_000_000_000)])
@pytest.mark.parametrize("n_frames", [1, 2, 1000])
def test_stretches_have_all_rows_once_and_skip_what_is_empty(frames: Sequence[int], n_frames: int) -> None:
    Watched.reads = 0
    parts = list(stretches(Watched(table(frames)), n_frames))
    assert [x for part in parts for x in part["x"].to_pylist()] == list(frames)
    assert all(part.num_rows for part in parts)
    assert Watched.reads == len(parts) <= len(frames)
    for part in parts:
        assert len({number // n_frames for number in frames_of(InMemory(part)).tolist()}) == 1


def test_a_table_is_read_as_rows_are() -> None:
    rows = rows_of(table((1, 2, 2, 5)))
    assert rows_of(rows) is rows
    assert rows.between(2, 5)["x"].to_pylist() == [2.0, 2.0]
    assert rows.select(("x",)).column_names == ["x"]
    assert frames_of(rows).tolist() == [1, 2, 2, 5]
