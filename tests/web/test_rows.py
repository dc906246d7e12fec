"""Tables and curves as columns of numbers."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ecat.store import open_session
from ecat.web.binary import Array, Words, columns_of, pack

if TYPE_CHECKING:
    from tests.web.conftest import Browser

TYPES = {"f4": "<f4", "f8": "<f8", "i4": "<i4", "dict": "<i4"}


def unpack(data: bytes) -> dict[str, Any]:
    """What a page reads, by the description of the format alone; texts as lists with None."""
    (length,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + length])
    start = 4 + length
    assert start % 8 == 0
    found: dict[str, Any] = {}
    for column in header["columns"]:
        assert column["offset"] % 8 == 0
        at = start + column["offset"]
        values = np.frombuffer(data, TYPES[column["type"]], header["rows"], at)
        words = column.get("values")
        found[column["name"]] = values if words is None else [None if c < 0 else words[c] for c in values]
    return found


def columns(browser: Browser, path: str) -> dict[str, Any]:
    answer = browser.get(path)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/octet-stream"
    return unpack(answer.content)


def values(column: Any) -> NDArray[np.float64]:
    return np.asarray(column.to_numpy(zero_copy_only=False), float)


def test_a_table_arrives_as_it_is(reader: Browser, made_once: Path) -> None:
    table = open_session(made_once / "slide").table("poses").to_arrow()
    sent = columns(reader, "columns/poses")
    assert "covariance" not in sent  # lists are not sent
    np.testing.assert_array_equal(sent["frame"], table["frame"].to_numpy())
    np.testing.assert_allclose(sent["t_s"], values(table["t_ns"]) / 1e9)
    assert sent["t_s"].dtype == np.float64
    for name in ("x", "qw", "sigma_m"):
        np.testing.assert_array_equal(sent[name], values(table[name]).astype("<f4"))
    for name in ("object_id", "source"):
        assert sent[name] == table[name].to_pylist()


def test_only_what_was_asked_for_is_sent_in_that_order(reader: Browser) -> None:
    sent = columns(reader, "columns/joints?columns=z,joint,frame,z,t_ns&start_frame=10&end_frame=12")
    assert list(sent) == ["z", "joint", "frame", "t_s"]
    assert set(sent["frame"].tolist()) == {10, 11}
    assert len(sent["frame"]) == 2 * len(set(sent["joint"]))


def test_the_rows_of_one_object_can_be_asked_for(reader: Browser) -> None:
    everything = columns(reader, "columns/markers_2d")
    (first, *_) = everything["object_id"]
    some = columns(reader, f"columns/markers_2d?columns=frame,present&object_id={first}&start_frame=3")
    expected = [
        f for f, o in zip(everything["frame"], everything["object_id"], strict=True) if o == first and f >= 3
    ]
    assert some["frame"].tolist() == expected
    assert set(some["present"].tolist()) <= {0, 1}
    assert len(columns(reader, "columns/poses?object_id=nobody")["frame"]) == 0


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("columns/nothing", 404),
        ("columns/hulls", 404),
        ("columns/..%2Fsession", 404),
        ("columns/poses?columns=nothing", 400),
        ("columns/poses?columns=covariance", 400),
        ("columns/poses?start_frame=5&end_frame=2", 400),
        ("columns/poses?start_frame=x", 422),
        ("columns/poses?start_frame=99999999999999999999", 422),
        ("columns/relations?object_id=o1", 400),
        (f"columns/poses?columns={'x' * 3000}", 422),
        ("series/nothing", 404),
    ],
)
def test_what_is_not_there_is_refused(reader: Browser, path: str, status: int) -> None:
    answer = reader.get(path)
    assert answer.status_code == status, answer.text
    assert answer.json()["error"]["fix"]


def test_curves_tell_how_fast_and_how_far(reader: Browser, made_once: Path) -> None:
    offered = {series["name"]: series for series in reader.json("series")}
    assert {series["unit"] for series in offered.values()} == {"m/s", "m"}
    assert sum(name.startswith("speed") for name in offered) == 2
    assert sum(name.startswith("distance") for name in offered) == 1
    assert sum(name.startswith("hand") for name in offered) == 4
    sent = {name: columns(reader, f"series/{name}") for name in offered}
    for curve in sent.values():
        assert np.all(np.diff(curve["frame"]) > 0)
        assert np.isfinite(curve["value"]).all()
        assert (curve["value"] >= 0).all()
    # one box is slid next to the other, which stands
    moved, stood = sorted((c["value"].max() for n, c in sent.items() if n.startswith("speed")), reverse=True)
    assert moved > 0.1 > stood
    (distance,) = (c["value"] for n, c in sent.items() if n.startswith("distance"))
    assert distance[-1] < distance[0]


words = st.builds(
    lambda codes, n: Words(np.array([min(c, n - 1) for c in codes], np.int32), [f"w{i}" for i in range(n)]),
    st.lists(st.integers(-1, 5), min_size=3, max_size=3),
    st.integers(0, 5),
)
numbers = st.sampled_from(["f4", "f8", "i4"]).map(lambda kind: np.arange(3).astype(kind))


@given(st.dictionaries(st.text(max_size=5), words | numbers, max_size=6))
def test_what_is_packed_is_what_is_read(made: dict[str, Array]) -> None:
    found = unpack(pack(made))
    assert list(found) == list(made)
    for name, array in made.items():
        if isinstance(array, Words):
            assert found[name] == [None if c < 0 else array.values[c] for c in array.codes]
        else:
            np.testing.assert_array_equal(found[name], array)


def test_nulls_are_told_apart_from_numbers() -> None:
    table = pa.table(
        {
            "start_ns": pa.array([1_500_000_000, None], pa.int64()),
            "n": pa.array([None, 7], pa.int16()),
            "there": pa.array([True, None]),
            "x": pa.array([None, 0.5]),
            "name": pa.array(["a", None]),
        }
    )
    found = unpack(pack(columns_of(table)))
    np.testing.assert_array_equal(found["start_s"], [1.5, np.nan])
    assert found["n"].tolist() == [-1, 7]
    assert found["there"].tolist() == [1, -1]
    np.testing.assert_array_equal(found["x"], [np.nan, 0.5])
    assert found["name"] == ["a", None]


def test_a_table_without_rows_is_sent_too() -> None:
    table = pa.table(
        {"frame": pa.array([], pa.int32()), "name": pa.array([], pa.dictionary(pa.int32(), pa.string()))}
    )
    found = unpack(pack(columns_of(table)))
    assert found["frame"].tolist() == []
    assert found["name"] == []
