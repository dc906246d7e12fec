"""How ECAT wrote numbers, codes, colours and escapes."""

from __future__ import annotations

import re
from math import inf, nan

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.ecat2018 import lexical
from ecat.formats.ecat2018.lexical import (
    argb_from_color,
    attribute,
    color_from_argb,
    format_code,
    format_numbers,
    missing_corners,
    parse_code,
    text,
)
from ecat.formats.ecat2018.number_text import parse_floats

USUAL = re.compile(lexical.USUAL_NUMBERS)


class TestNumbers:
    @pytest.mark.parametrize(
        ("value", "written"),
        [
            (859.0, "859"),
            (1.565, "1.565"),
            (0.9950001, "0.9950001"),
            (-3.652977e-05, "-3.652977E-05"),
            (1234567.0, "1234567"),
            (12345678.0, "1.234568E+07"),
            (0.0001, "0.0001"),
            (-0.0, "0"),
            (inf, "∞"),
            (-inf, "-∞"),
            (nan, "-∞"),
        ],
    )
    def test_a_number_has_seven_digits_and_an_exponent_in_capitals(self, value: float, written: str) -> None:
        assert format_numbers([value]) == written

    def test_a_list_is_joined_by_commas_without_blanks(self) -> None:
        assert format_numbers([1.0, -inf, 2.5e-7]) == "1,-∞,2.5E-07"

    @given(st.lists(st.floats(width=32, allow_nan=False), min_size=1))
    def test_every_number_that_is_written_is_in_its_usual_form(self, values: list[float]) -> None:
        assert USUAL.match(format_numbers(values))

    @given(st.text("0123456789.-E+∞,", max_size=14))
    def test_a_usual_text_is_what_its_numbers_are_written_as(self, said: str) -> None:
        """Else a text could be taken as usual and come back another."""
        if USUAL.match(said):
            assert format_numbers(parse_floats(said).tolist()) == said

    @pytest.mark.parametrize(
        "said", ["1.0", "-0", "1e5", "1E5", "+1", " 1", "1,", "01", "NaN", "Infinity", ".5", ""]
    )
    def test_other_ways_to_write_a_number_are_unusual(self, said: str) -> None:
        assert not USUAL.match(said)

    @given(st.lists(st.text("0123456789.-E∞,", max_size=9), min_size=1, max_size=3))
    def test_lines_are_usual_if_each_of_them_is(self, lines: list[str]) -> None:
        found = pc.match_substring_regex(pa.array(["\n".join(lines).encode()]), lexical.USUAL_LINES)
        assert found.to_pylist() == [all(USUAL.match(line) for line in lines)]

    def test_lines_with_what_is_missing_are_usual(self) -> None:
        found = pc.match_substring_regex(pa.array(["1,-∞\n∞,-0.5".encode()]), lexical.USUAL_LINES)
        assert found.to_pylist() == [True]


class TestCodes:
    def test_every_cell_is_followed_by_a_blank(self) -> None:
        assert format_code("101") == "1 ,0 ,1 "

    @given(st.text("01", min_size=1))
    def test_a_code_survives(self, code: str) -> None:
        assert parse_code(format_code(code)) == code

    @pytest.mark.parametrize("said", ["", "1 ,2 ", "1,,0", "1 ,0 ,", "10", "a"])
    def test_what_is_no_code_is_refused(self, said: str) -> None:
        assert parse_code(said) is None

    def test_blanks_do_not_matter(self) -> None:
        assert parse_code("1,0, 1 ") == "101"


class TestColors:
    @pytest.mark.parametrize(
        ("argb", "color"),
        [
            ("-65536", "#ff0000ff"),
            ("-16777216", "#000000ff"),
            ("-16744448", "#008000ff"),
            ("255", "#0000ff00"),
        ],
    )
    def test_signed_argb_is_rgba(self, argb: str, color: str) -> None:
        assert color_from_argb(argb) == color
        assert argb_from_color(color) == argb

    @pytest.mark.parametrize("said", ["", "red", "4294967296", "-2147483649", "9" * 5000])
    def test_what_is_no_color_is_none(self, said: str) -> None:
        assert color_from_argb(said) is None

    @given(st.integers(-(1 << 31), (1 << 31) - 1))
    def test_every_color_survives(self, argb: int) -> None:
        color = color_from_argb(str(argb))
        assert color is not None
        assert argb_from_color(color) == str(argb)

    def test_a_color_without_opacity_is_opaque(self) -> None:
        assert argb_from_color("#ff0000") == "-65536"


def test_attributes_escape_quotes_line_ends_and_tabs_and_texts_do_not() -> None:
    said = "a&<>\"'\r\n\t"
    assert attribute("name", said) == ' name="a&amp;&lt;&gt;&quot;\'&#xD;&#xA;&#x9;"'
    assert text(said) == "a&amp;&lt;&gt;\"'&#xD;\n\t"


class TestMissingCorners:
    def test_minus_infinity_is_the_usual_way_to_say_missing(self) -> None:
        missing, unusual = missing_corners(np.array([[[-inf, -inf, -inf], [1, 2, 3]]]))
        assert missing.tolist() == [[True, False]]
        assert unusual.tolist() == [False]

    @pytest.mark.parametrize("point", [(-1, -1, -1), (0, 0, 0), (nan, 1, 2), (inf, inf, inf), (1, 2, -inf)])
    def test_other_ways_are_missing_too_and_their_text_is_to_be_kept(self, point: tuple[float, ...]) -> None:
        """-1 was mapped offline, 0 is a pixel outside of the image."""
        missing, unusual = missing_corners(np.array([[point]]))
        assert missing.all()
        assert unusual.all()

    @pytest.mark.parametrize("point", [(-1, -1, 1), (0, 0, 1), (1e308, 1e308, 1e308), (0, -1, 0)])
    def test_other_points_are_there(self, point: tuple[float, ...]) -> None:
        missing, unusual = missing_corners(np.array([[point]]))
        assert not missing.any()
        assert not unusual.any()
