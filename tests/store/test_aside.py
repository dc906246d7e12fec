"""Rows that are made part by part are read as they were made, from a file that nobody sees."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from ecat.errors import DiskError
from ecat.store import set_aside

SCHEMA = pa.schema(
    [("frame", pa.int32()), ("word", pa.dictionary(pa.int32(), pa.string())), ("x", pa.float64())]
)


def part(*rows: tuple[int, str, float | None]) -> pa.Table:
    return pa.Table.from_pylist([dict(zip(SCHEMA.names, row, strict=True)) for row in rows], schema=SCHEMA)


PARTS = (part((0, "a", 1.5), (1, "b", None)), part(), part((2, "c", -0.0)), part((3, "a", 2.0)))


@pytest.mark.parametrize("count", range(5))
def test_rows_come_back_in_their_order_whatever_words_the_parts_have(tmp_path: Path, count: int) -> None:
    with set_aside(iter(PARTS[:count]), tmp_path, "cannot do it") as rows:
        found = pa.Table.from_batches(rows, SCHEMA)
    assert found.to_pylist() == [row for table in PARTS[:count] for row in table.to_pylist()]


def test_the_file_has_no_name(tmp_path: Path) -> None:
    def watched() -> Iterator[pa.Table]:
        for table in PARTS:
            yield table
            assert not list(tmp_path.iterdir())

    with set_aside(watched(), tmp_path, "cannot do it") as rows:
        assert not list(tmp_path.iterdir())
        assert sum(batch.num_rows for batch in rows) == 4


def test_what_fails_while_rows_are_made_is_what_one_hears_of(tmp_path: Path) -> None:
    def failing() -> Iterator[pa.Table]:
        yield from PARTS
        raise ArithmeticError("no more")

    with pytest.raises(ArithmeticError, match="no more"), set_aside(failing(), tmp_path, "cannot do it"):
        pytest.fail("there are no rows to be read")
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_one_error_that_says_what_could_not_be_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("ecat.store.files.tempfile.TemporaryFile", full)
    with pytest.raises(DiskError, match="cannot do it"), set_aside(iter(PARTS), tmp_path, "cannot do it"):
        pytest.fail("there are no rows to be read")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk here that is always full")
def test_a_disk_that_fills_up_in_the_middle_is_the_same_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def on_a_full_disk(**_: Any) -> Any:
        return Path("/dev/full").open("wb+")

    monkeypatch.setattr("ecat.store.files.tempfile.TemporaryFile", on_a_full_disk)
    with pytest.raises(DiskError, match="cannot do it"), set_aside(iter(PARTS), tmp_path, "cannot do it"):
        pytest.fail("there are no rows to be read")
