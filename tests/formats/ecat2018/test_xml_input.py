"""Foreign XML is read safely, and numbers the way ECAT 2018 writes them."""

from __future__ import annotations

import os
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError, LimitError, NotFoundError
from ecat.formats.ecat2018 import xml_input
from ecat.formats.ecat2018.number_text import format_float32, parse_floats
from ecat.formats.ecat2018.xml_input import (
    MAX_SIBLINGS,
    MAX_SIBLINGS_OF_WHOLE,
    iter_records,
    iterparse_safe,
    parse_safe,
)

WHAT = "cannot read it"


def parsed(data: bytes, *tags: str) -> list[str]:
    return [f"{e.tag}:{e.text or ''}" for e in iterparse_safe(data, tags=tags, what=WHAT)]


def refused(data: bytes, kind: type[FormatError] | type[LimitError] = FormatError) -> str:
    """The place named by both readers, which must agree."""
    with pytest.raises(kind, match=WHAT) as streamed:
        list(iterparse_safe(data, tags=("x",), what=WHAT))
    with pytest.raises(kind, match=WHAT) as whole:
        parse_safe(data, what=WHAT)
    assert streamed.value.to_dict() == whole.value.to_dict()
    return whole.value.where


class TestStreaming:
    def test_the_root_comes_first_so_that_its_attributes_are_known_even_when_nothing_follows(self) -> None:
        root = next(iter(iterparse_safe(b'<session name="s"/>', tags=(), what=WHAT)))
        assert root.attrib == {"name": "s"}

    def test_wanted_elements_come_complete_and_in_document_order(self) -> None:
        document = b"<r><a><b>1</b></a><c><a>2</a></c><a>3</a></r>"
        stream = iterparse_safe(document, tags=("a",), what=WHAT)
        assert next(stream).tag == "r"
        found = [(e.tag, "".join(e.itertext())) for e in stream]
        assert found == [("a", "1"), ("a", "2"), ("a", "3")]

    def test_a_wanted_element_inside_another_comes_before_it_and_is_then_emptied(self) -> None:
        document = b'<r><s n="1"><f>1</f><f>2</f><k>kept</k></s><s n="2"/></r>'
        stream = iterparse_safe(document, tags=("f", "s"), what=WHAT)
        assert next(stream).tag == "r"
        got = [(e.tag, e.get("n"), [c.tag for c in e if c.text]) for e in stream]
        assert got == [
            ("f", None, []),
            ("f", None, []),
            ("s", "1", ["k"]),
            ("s", "2", []),
        ]

    @pytest.mark.parametrize("flood", [b"<junk/>", b"<a>text</a>", b"text<a/>text", b"<!-- c --><?p i?>"])
    def test_memory_does_not_grow_with_the_document(self, flood: bytes, tmp_path: Path) -> None:
        psutil = pytest.importorskip("psutil")
        path = tmp_path / "flood.xml"
        path.write_bytes(b"<r>" + flood * (4_000_000 // len(flood)) + b"</r>")
        before = psutil.Process().memory_info().rss
        count = sum(1 for _ in iterparse_safe(path, tags=("a",), what=WHAT))
        assert count >= 1
        assert psutil.Process().memory_info().rss - before < 25e6

    def test_text_around_comments_is_one_text(self) -> None:
        assert parsed(b"<r><a>Timestamp<!-- no -->/@frame</a></r>", "a") == ["r:", "a:Timestamp/@frame"]

    def test_what_was_complete_before_a_fault_is_yielded_before_the_error(self) -> None:
        stream = iterparse_safe(b"<r>\n<a>1</a>\n<a>2</a>\n<a>3", tags=("a",), what=WHAT)
        assert [next(stream).text for _ in range(3)][1:] == ["1", "2"]
        with pytest.raises(FormatError, match="line 4: the file ends too early"):
            next(stream)

    @given(st.lists(st.sampled_from([b"<a>", b"</a>", b"<b/>", b"x", b"<!--c-->", b"&lt;"]), max_size=30))
    def test_streaming_sees_what_a_whole_parse_sees(self, pieces: list[bytes]) -> None:
        document = b"<r>" + b"".join(pieces) + b"</r>"
        try:
            whole = ["".join(e.itertext()) for e in parse_safe(document, what=WHAT).iter("b")]
        except FormatError:
            with pytest.raises(FormatError):
                list(iterparse_safe(document, tags=("b",), what=WHAT))
        else:
            stream = iterparse_safe(document, tags=("b",), what=WHAT)
            next(stream)
            assert ["".join(e.itertext()) for e in stream] == whole


class TestRefusals:
    @pytest.mark.parametrize(
        ("document", "place"),
        [
            (b"", "the file is empty"),
            (b"\xef\xbb\xbf", "line 1: not XML"),
            (b"hello", "line 1: not XML"),
            (b"<a>\n<b>\n</a>", "line 3: Opening and ending tag mismatch"),
            (b"<a>\n\n<b>", "line 3: the file ends too early"),
            (b"<a b='1", "the file ends too early"),
            (b"<a/>\n<b/>", "line 2: Extra content"),
            (b"<a>\n&foo;</a>", "line 2: Entity 'foo' not defined"),
            (b"<a>\xff</a>", "line 1: Invalid bytes"),
            (b"<a>\x01</a>", "line 1: PCDATA invalid Char"),
            (b"<a>\n\n\x00</a>", "line 3: a NUL byte"),
        ],
    )
    def test_malformed_documents_name_the_line(self, document: bytes, place: str) -> None:
        assert place in refused(document)

    @pytest.mark.parametrize("declaration", [b"<!DOCTYPE r>", b"<!doctype r>", b'<!ENTITY x "y">'])
    def test_a_document_type_is_refused_before_it_is_parsed(self, declaration: bytes) -> None:
        assert "declaration, which is refused unread" in refused(b"\n" + declaration + b"<r/>")

    def test_billion_laughs_cost_nothing(self) -> None:
        entities = b"".join(b'<!ENTITY a%d "&a%d;&a%d;">' % (n + 1, n, n) for n in range(64))
        tracemalloc.start()
        refused(b'<!DOCTYPE r [<!ENTITY a0 "ha">' + entities + b"]><r>&a64;</r>")
        assert tracemalloc.get_traced_memory()[1] < 1e6
        tracemalloc.stop()

    def test_a_declaration_split_between_two_reads_is_still_seen(self) -> None:
        for shift in range(12):
            before = b"<?xml version='1.0'?>".ljust((1 << 16) - shift)
            assert "document type" in refused(before + b"<!DOCTYPE r><r/>")

    @pytest.mark.parametrize("codec", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
    def test_utf_16_and_32_are_refused_by_name(self, codec: str) -> None:
        assert "UTF-16 or UTF-32" in refused("<r>text</r>".encode(codec))

    @pytest.mark.parametrize("name", ["utf-16", "iso-8859-1", "utf-7", "windows-1252", "no-such"])
    def test_other_declared_encodings_are_refused_by_name(self, name: str) -> None:
        document = f'<?xml version="1.0" encoding="{name}"?><r/>'.encode()
        assert f"declared encoding '{name}'" in refused(document)

    @pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"])
    @pytest.mark.parametrize("name", [None, "utf-8", "UTF-8", "us-ascii"])
    def test_utf_8_with_or_without_bom_and_ascii_are_read(self, start: bytes, name: str | None) -> None:
        head = f'<?xml version="1.0" encoding="{name}"?>'.encode() if name else b""
        assert parse_safe(start + head + "<r>∞</r>".encode(), what=WHAT).text == "∞"


class TestLimits:
    def test_nesting_up_to_256_is_read_and_deeper_is_a_limit(self) -> None:
        assert parse_safe(b"<a>" * 256 + b"</a>" * 256, what=WHAT).tag == "a"
        assert "deeper than 256" in refused(b"<a>" * 257 + b"</a>" * 257, LimitError)
        assert "deeper than 256" in refused(b"<a>" * 100_000, LimitError)

    @pytest.mark.parametrize("document", [b"<a>%s</a>", b"<a b='%s'/>", b"<a><![CDATA[%s]]></a>", b"<%s/>"])
    def test_a_text_or_name_above_10_mb_is_a_limit(self, document: bytes) -> None:
        refused(document.replace(b"%s", b"x" * 11_000_000), LimitError)

    def test_more_elements_than_memory_should_hold_are_a_limit(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(xml_input, "MAX_LIVE_ELEMENTS", 1000)
        with pytest.raises(LimitError, match="too large to hold"):
            list(iterparse_safe(b"<r><x>" + b"<y/>" * 1001 + b"</x></r>", tags=("x",), what=WHAT))
        assert (
            sum(1 for _ in iterparse_safe(b"<r>" + b"<x/>" * 5000 + b"</r>", tags=("x",), what=WHAT)) == 5001
        )
        with pytest.raises(LimitError, match="more than 1,000 elements"):
            parse_safe(b"<r>" + b"<x/>" * 1001 + b"</r>", what=WHAT)

    def test_max_bytes_stops_the_reading(self, tmp_path: Path) -> None:
        path = tmp_path / "long.xml"
        path.write_bytes(b"<r>" + b" " * 200_000)
        with pytest.raises(LimitError, match="more than 100,000 bytes"):
            list(iterparse_safe(path, tags=(), what=WHAT, max_bytes=100_000))


class TestFiles:
    def test_a_missing_file_is_not_found(self, tmp_path: Path) -> None:
        with pytest.raises(NotFoundError, match="missing"):
            parse_safe(tmp_path / "missing.xml", what=WHAT)

    def test_a_folder_and_a_pipe_are_refused_instead_of_waited_for(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe")
        for path in (tmp_path, tmp_path / "pipe"):
            with pytest.raises(FormatError, match="not a regular file"):
                parse_safe(path, what=WHAT)


class TestNumbers:
    def test_infinity_is_the_character_not_the_word(self) -> None:
        """Trap: ECAT writes ``∞`` and ``-∞`` (UTF-8 E2 88 9E)."""
        np.testing.assert_array_equal(parse_floats("-∞,∞,1.5"), [-np.inf, np.inf, 1.5])
        assert format_float32([-np.inf, np.inf, np.nan]) == "-∞,∞,NaN"

    def test_words_for_infinity_and_nan_are_accepted(self) -> None:
        np.testing.assert_array_equal(parse_floats("Infinity,-Infinity,NaN"), [np.inf, -np.inf, np.nan])

    @pytest.mark.parametrize(
        "garbage", ["1,x", "1,,2", "1,", ",", "1_0", "\u0661", "0x10", "1;2", "1 2", "\u22121", "∞∞"]
    )
    def test_anything_else_is_refused(self, garbage: str) -> None:
        with pytest.raises(FormatError, match="is not a number"):
            parse_floats(garbage)

    def test_the_count_is_checked_and_the_place_named(self) -> None:
        with pytest.raises(FormatError, match=re.escape("line 3: expected 4 numbers, found 2")):
            parse_floats("1,2", 4, what=WHAT, where="line 3")

    def test_empty_text_is_no_numbers(self) -> None:
        assert parse_floats(" \n").shape == (0,)

    @pytest.mark.parametrize(
        "token", ["-3.652977E-05", "0.9950001", "1.565", "859", "1E+07", "-0.08930299", "0.0001", "9999999"]
    )
    def test_real_tokens_come_back_as_they_were(self, token: str) -> None:
        assert format_float32(parse_floats(token)) == token

    @given(st.lists(st.floats(width=32, allow_nan=False)))
    def test_seven_digits_survive_a_round_trip(self, values: list[float]) -> None:
        text = format_float32(values)
        assert format_float32(parse_floats(text, len(values))) == text

    def test_a_double_too_large_for_a_float_is_infinite(self) -> None:
        assert format_float32(parse_floats("1e308")) == "∞"

    def test_every_coordinate_of_the_real_sessions_is_in_this_format(self, shared: Path) -> None:
        text = next((shared / "ecat_kinect").glob("*/*/files.param")).read_text(encoding="utf-8-sig")
        lists = re.findall(r"<bounding>([^<]*)</bounding>", text)
        assert len(lists) > 5000
        assert all(format_float32(parse_floats(numbers)) == numbers for numbers in lists)


class TestRecords:
    def test_what_gathers_around_records_is_dropped(self) -> None:
        data = b"<r>" + b"<w><a/></w><j/>" * 100_000 + b"</r>"
        most = 0
        for number, record in enumerate(iter_records(data, tags=("a",), whole=(), what="cannot read it")):
            # counting takes as long as there are siblings
            if number % 50 == 0:
                most = max(most, len(record.getroottree().getroot()))
        # what one piece of the document brings, and those that may gather, besides a thousand records
        assert most < 40_000 + MAX_SIBLINGS + 2 * 1024

    def test_what_must_stay_whole_stays_until_its_end(self) -> None:
        data = b"<r><o>" + b"<j/>" * 5000 + b"<a/><k/></o></r>"
        found = [
            (e.tag, len(e)) for e in iter_records(data, tags=("a", "o"), whole=("o",), what="cannot read it")
        ]
        assert found == [("a", 0), ("o", 5002)]

    def test_a_crowd_in_one_whole_element_is_refused(self) -> None:
        data = b"<r><o>" + b"<j/>" * (MAX_SIBLINGS_OF_WHOLE + 1) + b"<a/></o></r>"
        with pytest.raises(LimitError, match="cannot read it") as caught:
            list(iter_records(data, tags=("a",), whole=("o",), what="cannot read it"))
        assert "elements in <o>" in caught.value.where

    def test_too_much_between_two_records_is_refused(self) -> None:
        data = b"<r>" + b" " * 3000 + b"<a/></r>"
        with pytest.raises(LimitError):
            list(iter_records(data, tags=("a",), whole=(), what="cannot read it", max_record_bytes=2000))
