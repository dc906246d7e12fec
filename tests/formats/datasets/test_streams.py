"""Several tables in one private file."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import CorruptError
from ecat.formats.datasets.streams import StreamsReader, StreamsWriter

NUMBERS = pa.schema([pa.field("n", pa.int64(), metadata={"unit": "m"}), pa.field("word", pa.string())])


def table(numbers: list[int]) -> pa.Table:
    columns = [pa.array(numbers, pa.int64()), pa.array(map(str, numbers), pa.string())]
    return pa.table(columns, schema=NUMBERS)


@given(
    st.dictionaries(
        st.text(min_size=1, max_size=9),
        st.lists(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=9), max_size=4),
        max_size=5,
    )
)
def test_tables_come_back_by_their_names_in_any_order(tables: dict[str, list[list[int]]]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "streams")
        with StreamsWriter(path) as out:
            for name, pieces in tables.items():
                with out.stream(name, NUMBERS) as stream:
                    for piece in pieces:
                        stream.write_table(table(piece))
        with StreamsReader(path) as found:
            assert found.names == list(tables)
            for name in reversed(found.names):
                rows = pa.Table.from_batches(found.batches(name), found.schema(name))
                assert rows.equals(table([n for piece in tables[name] for n in piece]))
                assert rows.schema.equals(NUMBERS, check_metadata=True)


def test_rows_outlive_the_file(tmp_path: Path) -> None:
    with StreamsWriter(tmp_path / "streams") as out, out.stream("a", NUMBERS) as stream:
        stream.write_table(table([1, 2, 3]))
    with StreamsReader(tmp_path / "streams") as found:
        rows = list(found.batches("a"))
    (tmp_path / "streams").unlink()
    assert pa.Table.from_batches(rows)["n"].to_pylist() == [1, 2, 3]


def test_a_file_that_was_not_finished_cannot_be_read(tmp_path: Path) -> None:
    def stop() -> None:
        with StreamsWriter(tmp_path / "half") as out, out.stream("a", NUMBERS) as stream:
            stream.write_table(table([1]))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    with pytest.raises(CorruptError):
        StreamsReader(tmp_path / "half")


@given(st.data())
def test_a_file_that_is_cut_off_is_named_with_what_to_do(data: st.DataObject) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "streams")
        with StreamsWriter(path) as out, out.stream("a", NUMBERS) as stream:
            stream.write_table(table([1, 2, 3]))
        whole = path.read_bytes()
        path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
        with pytest.raises(CorruptError, match="remove"):
            StreamsReader(path)
