"""Answers as files."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from ecat.errors import ExistsError, UsageError
from ecat.query import Answer, write_answer

TABLE = pa.table({"session": ["a", "b, c"], "n": [1, None]})


def answer(table: pa.Table = TABLE) -> Answer:
    return Answer(schema=table.schema, batches=iter(table.to_batches()))


def test_a_parquet_file_holds_the_rows_as_they_are(tmp_path: Path) -> None:
    assert write_answer(answer(), tmp_path / "out.parquet") == 2
    assert pq.read_table(tmp_path / "out.parquet").equals(TABLE)


def test_a_csv_file_holds_them_as_text(tmp_path: Path) -> None:
    write_answer(answer(), tmp_path / "out.CSV")
    assert csv.read_csv(tmp_path / "out.CSV").to_pylist() == TABLE.to_pylist()


def test_csv_has_no_lists_and_other_names_say_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot write the answer") as caught:
        write_answer(answer(pa.table({"many": [[1, 2]]})), tmp_path / "out.csv")
    assert "many" in caught.value.where
    with pytest.raises(UsageError, match=r"out.xlsx"):
        write_answer(answer(), tmp_path / "out.xlsx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["out.csv", "out.parquet"])
def test_what_a_file_cannot_hold_is_said(tmp_path: Path, name: str) -> None:
    spans = pa.array([None], pa.month_day_nano_interval())
    with pytest.raises(UsageError, match="cannot write the answer") as caught:
        write_answer(answer(pa.table({"span": spans})), tmp_path / name)
    assert "cast" in caught.value.fix
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "out.csv").write_text("precious")
    with pytest.raises(ExistsError):
        write_answer(answer(), tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == "precious"
