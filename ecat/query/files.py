"""Answers as files."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from ecat.errors import UsageError
from ecat.query.database import Answer
from ecat.store import staged_file

SUFFIXES = (".parquet", ".csv")


def write_answer(answer: Answer, dest: Path) -> int:
    """Write the rows to ``dest``, a Parquet or CSV file by its name, as they come; how many there were.

    Raises
    ------
    UsageError : a name that says neither; or columns that such a file cannot hold, as lists in CSV.
    ExistsError : ``dest`` is taken.
    """
    if dest.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"cannot write the answer to {dest.name}",
            where=f"expected a name that ends in {' or '.join(SUFFIXES)}",
            fix=f"--to {dest.stem or 'answer'}.parquet",
        )
    n_rows = 0
    try:
        with staged_file(dest) as staging, _writer(staging, dest, answer.schema) as writer:
            for batch in answer.batches:
                writer.write_batch(batch)
                n_rows += batch.num_rows
    except pa.ArrowException as error:
        raise UsageError(
            f"cannot write the answer to {dest.name}",
            where=str(error),
            fix="cast(... as varchar) in the question makes a text of what such a file cannot hold",
        ) from None
    return n_rows


@contextmanager
def _writer(staging: Path, dest: Path, schema: pa.Schema) -> Generator[Any]:
    if dest.suffix.lower() == ".parquet":
        with pq.ParquetWriter(staging, schema, compression="zstd") as writer:
            yield writer
        return
    nested = [field.name for field in schema if pa.types.is_nested(field.type)]
    if nested:
        raise UsageError(
            f"cannot write the answer to {dest.name}",
            where=f"CSV has no lists: {', '.join(nested)}",
            fix=f"--to {dest.stem}.parquet, or array_to_string({nested[0]}, ' ') in the question",
        )
    with csv.CSVWriter(staging, schema) as writer:
        yield writer
