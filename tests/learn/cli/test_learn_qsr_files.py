"""``ecat learn qsr FILE``: what is wrong with a file of tracks, or too large, is one error that says where."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from learn.features.qsr import rows
from tests.learn.cli.test_learn_qsr import walks, write

if TYPE_CHECKING:
    from conftest import Ecat


def replaced(name: str, values: Any) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        table = walks()
        pq.write_table(table.set_column(table.schema.get_field_index(name), name, values), path)

    return make


def changed(name: str, row: int, value: Any) -> Callable[[Path], None]:
    values = walks()[name].to_pylist()
    values[row] = value
    return replaced(name, pa.array(values))


def truncated(path: Path) -> None:
    pq.write_table(walks(), path)
    path.write_bytes(path.read_bytes()[:-200])


def damaged(path: Path) -> None:
    pq.write_table(walks(100, 100), path, compression="snappy")
    data = bytearray(path.read_bytes())
    data[100:4000] = bytes(3900)
    path.write_bytes(data)


def twice_apart(path: Path) -> None:
    table = walks()
    pq.write_table(pa.concat_tables([table, table.slice(5, 1)]), path)


def twice_named(path: Path) -> None:
    table = walks()
    pq.write_table(table.append_column("x1", table["x1"]), path)


def not_text(path: Path) -> None:
    """A track whose name is no UTF-8, as a writer that does not look makes it."""
    ends = pa.py_buffer(np.arange(61, dtype=np.int32).tobytes())
    tracks = pa.Array.from_buffers(pa.string(), 60, [None, ends, pa.py_buffer(b"\xff" * 60)])
    pq.write_table(walks().set_column(0, "track", tracks).set_column(1, "frame", pa.array(range(60))), path)


def not_named(path: Path) -> None:
    """A column whose name is no UTF-8."""
    pq.write_table(walks().append_column("zzzz", walks()["x1"]), path, store_schema=False)
    path.write_bytes(path.read_bytes().replace(b"zzzz", b"zz\xff\xfe"))


HOSTILE: dict[str, tuple[Callable[[Path], object], str]] = {
    "nothing there": (lambda _: None, "NotFoundError"),
    "a folder": (Path.mkdir, "FormatError"),
    "a pipe": (os.mkfifo, "FormatError"),
    "an empty file": (Path.touch, "FormatError"),
    "text": (lambda path: path.write_text("track,frame\n1,2\n"), "FormatError"),
    "truncated": (truncated, "FormatError"),
    "damaged": (damaged, "FormatError"),
    "no rows": (lambda path: pq.write_table(walks().slice(0, 0), path), "InputError"),
    "no columns": (lambda path: pq.write_table(pa.table({"a": [1]}), path), "SchemaError"),
    "no frame": (lambda path: pq.write_table(walks().drop_columns(["frame"]), path), "SchemaError"),
    "no x2": (lambda path: pq.write_table(walks().drop_columns(["x2"]), path), "SchemaError"),
    "two x1": (twice_named, "SchemaError"),
    "text for numbers": (replaced("x1", pa.array(["a"] * 60)), "SchemaError"),
    "lists": (replaced("y2", pa.array([[1.0]] * 60)), "SchemaError"),
    "fractions for tracks": (replaced("track", pa.array([0.5] * 60)), "SchemaError"),
    "half floats": (replaced("frame", pa.array(np.arange(60, dtype=np.float16))), "SchemaError"),
    "a track that is no text": (not_text, "FormatError"),
    "a column that is no text": (not_named, "FormatError"),
    "long names": (replaced("track", pa.array(["a", "b" * 256, "a"] * 20)), "LimitError"),
    "names that are long as they lie there": (
        lambda path: pq.write_table(
            walks(4, 100).set_column(0, "track", pa.array([f"{k:05000}" for k in range(400)])),
            path,
            use_dictionary=False,
        ),
        "LimitError",
    ),
    "a track is null": (changed("track", 7, None), "InputError"),
    "a frame is null": (changed("frame", 7, None), "InputError"),
    "infinite": (changed("x1", 7, math.inf), "InputError"),
    "minus infinite": (changed("y2", 7, -math.inf), "InputError"),
    "absurdly far": (changed("y2", 7, 1e300), "InputError"),
    "a negative size": (changed("w1", 7, -1), "InputError"),
    "twice in a row": (changed("frame", 7, 6), "InputError"),
    "twice apart": (twice_apart, "InputError"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_bad_input_is_one_error_that_says_where(ecat: Ecat, tmp_path: Path, what: str) -> None:
    make, kind = HOSTILE[what]
    source, dest = tmp_path / "bad.parquet", tmp_path / "out.parquet"
    make(source)
    result = ecat("learn", "qsr", source, "--relation", "rcc8", "-o", dest, "--json")
    assert result.code == 1
    error = result.json["error"]
    assert error["error"] == kind
    assert "bad.parquet" in error["what"] + error["where"]
    assert error["consequence"]
    assert error["fix"]
    assert not dest.exists()
    assert not list(tmp_path.glob("*.partial"))


def test_an_error_about_a_row_names_track_frame_and_column(ecat: Ecat, tmp_path: Path) -> None:
    source = tmp_path / "bad.parquet"
    changed("y2", 47, math.inf)(source)
    result = ecat("learn", "qsr", source, "--relation", "cardir", "-o", tmp_path / "out.parquet")
    assert "track 2, frame 7: y2 is inf" in result.err


def test_more_rows_than_can_be_ordered_are_refused(
    ecat: Ecat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "MOST_UNORDERED", 50)
    dest, ordered = tmp_path / "out.parquet", write(walks(), tmp_path)
    assert ecat("learn", "qsr", ordered, "--relation", "cardir", "-o", dest).code == 0
    dest.unlink()
    shuffled = write(walks().take(pa.array(range(60)[::-1])), tmp_path)
    result = ecat("learn", "qsr", shuffled, "--relation", "cardir", "-o", dest, "--json")
    assert result.json["error"]["error"] == "LimitError"


def test_more_names_than_can_be_ordered_are_refused(
    ecat: Ecat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "MOST_NAMES", 1000)
    table = walks(20, 3).set_column(0, "track", pa.array([f"{k:0100}" for k in range(60)]))
    dest, ordered = tmp_path / "out.parquet", write(table, tmp_path)
    assert ecat("learn", "qsr", ordered, "--relation", "cardir", "-o", dest).code == 0
    dest.unlink()
    shuffled = write(table.take(pa.array(range(60)[::-1])), tmp_path)
    result = ecat("learn", "qsr", shuffled, "--relation", "cardir", "-o", dest, "--json")
    assert result.json["error"]["error"] == "LimitError"
    assert "names of tracks" in result.json["error"]["where"]


def test_the_names_of_tracks_are_not_kept_for_each_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "ROWS", 1 << 12)
    n = 200_000
    names = pa.array([letter * rows.MOST_NAME for letter in "ab"])
    tracks = pa.DictionaryArray.from_arrays(np.arange(n)[::-1].astype(np.int32) % 2, names)
    places = {f"{axis}1": pa.array(np.zeros(n, np.float32)) for axis in "xy"}
    source = write(pa.table({"track": tracks, "frame": pa.array(np.arange(n)[::-1])} | places), tmp_path)
    usual = pa.default_memory_pool()
    pool = pa.proxy_memory_pool(usual)
    pa.set_memory_pool(pool)
    try:
        assert sum(table.num_rows for table in rows.TrackFile(source).rows(["x1", "y1"])) == n
    finally:
        pa.set_memory_pool(usual)
    assert 0 < (pool.max_memory() or 0) < n * rows.MOST_NAME / 3
