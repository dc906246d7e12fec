"""Many lists of numbers are read at once as each would be alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.number_text import parse_float_lines, parse_floats

WIDTH = 3
NUMBERS = st.sampled_from(["1", "-2.5", "∞", "-∞", "0.1234567", "-3.652977E-05", "NaN", "1e308"])
ODD = st.sampled_from(["", "x", " 3", "1_0", "٣", "\r", "1\n2", "é"])


@given(st.lists(st.lists(NUMBERS, min_size=WIDTH, max_size=WIDTH), min_size=1))
def test_lines_are_the_rows(rows: list[list[str]]) -> None:
    lines = [",".join(row) for row in rows]
    found = parse_float_lines("\n".join(lines).encode(), WIDTH)
    assert found is not None
    np.testing.assert_array_equal(found, [parse_floats(line) for line in lines])


@given(st.lists(st.lists(NUMBERS | ODD, max_size=5), min_size=1, max_size=4))
def test_what_is_read_at_once_is_what_each_is_alone(rows: list[list[str]]) -> None:
    """Nothing is read at once that is not a list of numbers alone."""
    text = "\n".join(",".join(row) for row in rows)
    found = parse_float_lines(text.encode(), WIDTH)
    if found is not None:
        np.testing.assert_array_equal(found, [parse_floats(line, WIDTH) for line in text.split("\n")])


@pytest.mark.parametrize(
    "lines", ["1,2,3,4\n5,6", "1,2\n3,4,5,6", "1,2,3\n4,5", "1,2,3,\n4,5", "1,2,3\n", "", ","]
)
def test_numbers_of_one_line_do_not_count_for_another(lines: str) -> None:
    assert parse_float_lines(lines.encode(), WIDTH) is None
    with pytest.raises(FormatError):
        [parse_floats(line, WIDTH) for line in lines.split("\n")]
