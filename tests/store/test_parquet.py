"""Tables as Parquet: typed, deterministic, streamed in and read in slices."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ecat.errors import SchemaError
from ecat.store import Draft, TableData, create_session, snapshot
from ecat.store.files import NewFile
from ecat.store.parquet import write_table
from ecat.tables import ROW_GROUP_ROWS, TABLES
from tests.store.sessions import MANIFEST, rows


def written(path: Path, name: str, data: pa.Table | Iterator[pa.RecordBatch]) -> bytes:
    """The bytes of a table's file."""
    with NewFile(path) as file:
        write_table(file, name, TableData(data=data))
    return path.read_bytes()


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("n", [0, 1, 100])
def test_every_table_is_read_back_as_it_was(tmp_path: Path, name: str, n: int) -> None:
    table = rows(name, n)
    written(tmp_path / "t.parquet", name, table)
    read = pq.read_table(tmp_path / "t.parquet")
    assert read.schema.equals(TABLES[name].arrow, check_metadata=False)
    assert read.equals(table)
    meaning = TABLES[name].columns[0].meaning
    assert (read.schema.field(0).metadata or {})[b"meaning"] == meaning.encode()


def test_nulls_and_nans_stay_what_they_are(tmp_path: Path) -> None:
    table = rows("poses", 3)
    table = table.set_column(
        table.column_names.index("x"), table.schema.field("x"), pa.array([1.0, None, float("nan")])
    )
    written(tmp_path / "t.parquet", "poses", table)
    x = pq.read_table(tmp_path / "t.parquet")["x"]
    assert x.null_count == 1
    assert np.isnan(x[2].as_py())


def test_equal_rows_give_equal_bytes_however_they_are_cut(tmp_path: Path) -> None:
    table = rows("poses", 1000)
    names = pa.array([f"o{i % 7}" for i in range(1000)]).dictionary_encode()
    table = table.set_column(table.column_names.index("object_id"), table.schema.field("object_id"), names)
    whole = written(tmp_path / "whole", "poses", table)
    assert written(tmp_path / "cut", "poses", iter(table.to_batches(max_chunksize=99))) == whole
    # the same words in another order, and one that is not used
    words = pa.array(["unused", *(f"o{i}" for i in reversed(range(7)))])
    codes = pa.array([7 - i % 7 for i in range(1000)], pa.int32())
    other = table.set_column(
        table.column_names.index("object_id"),
        table.schema.field("object_id"),
        pa.DictionaryArray.from_arrays(codes, words),
    )
    assert written(tmp_path / "other", "poses", other) == whole


def test_row_groups_are_of_one_size_and_batches_are_not_kept(tmp_path: Path) -> None:
    peak = 0

    def batches() -> Iterator[pa.RecordBatch]:
        nonlocal peak
        piece = rows("frames", 10_000)
        start = pa.total_allocated_bytes()
        for _ in range(40):
            peak = max(peak, pa.total_allocated_bytes() - start)
            yield pa.RecordBatch.from_pydict(
                {name: piece[name].combine_chunks() for name in piece.column_names}, schema=piece.schema
            )

    written(tmp_path / "t.parquet", "frames", batches())
    file = pq.ParquetFile(tmp_path / "t.parquet")
    sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert sizes == [ROW_GROUP_ROWS] * 6 + [400_000 - 6 * ROW_GROUP_ROWS]
    assert peak < 16 * 400_000 / 2, "more was held than a few row groups"


def test_row_groups_do_not_depend_on_the_batches_either(tmp_path: Path) -> None:
    n = 2 * ROW_GROUP_ROWS + 5
    names = pa.array([f"stream{i // 50_000}" for i in range(n)]).dictionary_encode()
    table = rows("frames", n).set_column(2, TABLES["frames"].arrow.field("stream"), names)
    whole = written(tmp_path / "whole", "frames", table)
    assert written(tmp_path / "one", "frames", iter(table.combine_chunks().to_batches())) == whole
    # batches that were made one by one have dictionaries of their own
    pieces = [pa.Table.from_batches([piece]) for piece in table.to_batches(max_chunksize=40_000)]
    plain = [piece.set_column(2, "stream", piece["stream"].cast(pa.string())) for piece in pieces]
    batches = [piece.cast(table.schema).to_batches()[0] for piece in plain]
    assert written(tmp_path / "many", "frames", iter(batches)) == whole


def test_only_names_are_dictionaries_and_numbers_are_split(tmp_path: Path) -> None:
    written(tmp_path / "t.parquet", "poses", rows("poses", 50))
    group = pq.ParquetFile(tmp_path / "t.parquet").metadata.row_group(0)
    encodings = {
        group.column(i).path_in_schema: set(group.column(i).encodings) for i in range(group.num_columns)
    }
    for field in TABLES["poses"].arrow:
        if pa.types.is_fixed_size_list(field.type):
            continue
        assert ("RLE_DICTIONARY" in encodings[field.name]) == pa.types.is_dictionary(field.type)
        assert ("BYTE_STREAM_SPLIT" in encodings[field.name]) == pa.types.is_floating(field.type)
    assert group.column(0).compression == "ZSTD"


def test_columns_of_plain_types_are_cast(tmp_path: Path) -> None:
    frames = pa.table({"t_ns": [0, 1], "frame": pa.array([0, 1], pa.int64()), "stream": ["color", "depth"]})
    written(tmp_path / "t.parquet", "frames", frames.select(["stream", "frame", "t_ns"]))
    assert pq.read_table(tmp_path / "t.parquet").schema.equals(TABLES["frames"].arrow, check_metadata=False)


@pytest.mark.parametrize(
    "wrong",
    [
        {"t_ns": [0], "frame": [0]},
        {"t_ns": [0], "frame": [0], "stream": ["a"], "extra": [1]},
        {"t_ns": [0], "frame": [2**40], "stream": ["a"]},
        {"t_ns": [0], "frame": [None], "stream": ["a"]},
        {"t_ns": [0], "frame": ["x"], "stream": ["a"]},
    ],
)
def test_rows_that_do_not_fit_the_schema_are_refused(tmp_path: Path, wrong: dict[str, list[object]]) -> None:
    with pytest.raises(SchemaError, match="cannot write table frames"):
        written(tmp_path / "t.parquet", "frames", pa.table(wrong))


class Counted(io.FileIO):
    """A file that counts the bytes read from it."""

    total = 0

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(-1 if size is None else size)
        Counted.total += len(data)
        return data


def test_a_slice_reads_only_its_row_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    n = 8 * ROW_GROUP_ROWS
    session = create_session(
        tmp_path / "s", Draft(manifest=MANIFEST, tables={"poses": TableData(data=rows("poses", n))})
    )
    monkeypatch.setattr(snapshot, "open_source", lambda path: pa.PythonFile(Counted(path), mode="r"))

    def read(**bounds: float) -> tuple[int, int]:
        Counted.total = 0
        table = session.table("poses", **bounds).to_arrow()  # pyright: ignore[reportArgumentType]
        return table.num_rows, Counted.total

    all_rows, all_bytes = read()
    assert all_rows == n
    group = all_bytes / 8
    inside = 3.5 * ROW_GROUP_ROWS / 30
    rows_read, bytes_read = read(start=inside, end=inside + 30)
    assert rows_read == 900
    assert bytes_read < 1.2 * group
    boundary = 4 * ROW_GROUP_ROWS
    rows_read, bytes_read = read(start_frame=boundary - 10, end_frame=boundary)
    assert rows_read == 10
    assert bytes_read < 1.2 * group
    rows_read, bytes_read = read(start_frame=boundary - 10, end_frame=boundary + 10)
    assert rows_read == 20
    assert 1.8 * group < bytes_read < 2.2 * group
    rows_read, bytes_read = read(start=1e6)
    assert rows_read == 0
    assert bytes_read < 0.1 * group
