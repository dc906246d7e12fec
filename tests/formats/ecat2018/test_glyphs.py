"""Glyph files hold a marker pattern as printed; codes in sessions are its mirror image."""

from __future__ import annotations

import re
from contextlib import suppress
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ecat.errors import EcatError, FormatError, NotFoundError, UsageError
from ecat.formats.ecat2018.glyphs import GLYPHS, Cells, code_of, identify, mirror, read_glyph, write_glyph

cells = arrays(np.uint8, (5, 5), elements=st.integers(0, 1))


def test_the_shipped_files_hold_the_patterns_of_the_facts_table(shared: Path) -> None:
    files = {int(path.stem): path for path in (shared / "ecat_program" / "glyphs").glob("*.glyph")}
    assert set(files) == set(GLYPHS)
    for glyph_id, path in files.items():
        np.testing.assert_array_equal(read_glyph(path), code_of(glyph_id))
        assert write_glyph(code_of(glyph_id)) == path.read_bytes()


@given(cells, st.sampled_from(["\n", "\r\n"]))
def test_reading_a_written_glyph_gives_it_back(pattern: Cells, newline: str) -> None:
    np.testing.assert_array_equal(read_glyph(write_glyph(pattern, newline=newline)), pattern)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"11111",
        b"11111\n" * 4,
        b"11111\n" * 6,
        b"11112\n" * 5,
        b"111 1\n" * 5,
        b"\xef\xbb\xbf" + b"11111\n" * 5,
    ],
)
def test_anything_but_five_rows_of_five_cells_is_refused(data: bytes) -> None:
    with pytest.raises(FormatError, match="5 lines of 5 characters"):
        read_glyph(data)


def test_a_pattern_of_another_size_is_not_written() -> None:
    with pytest.raises(UsageError):
        write_glyph(np.zeros((4, 4)))
    with pytest.raises(UsageError):
        write_glyph(np.full((5, 5), 2))


@given(st.binary(max_size=40))
def test_any_bytes_give_a_pattern_or_one_typed_error(data: bytes) -> None:
    with suppress(EcatError):
        assert read_glyph(data).shape == (5, 5)


def test_glyphs_are_the_aruco_original_markers_some_of_them_turned() -> None:
    """Trap: the nine glyphs are ids of ArUco's original dictionary, and not all are stored upright."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    turned = {
        303: 0,
        426: 0,
        521: 0,
        5: -1,
        6: -1,
        71: -1,
        155: -1,
        477: -1,
        566: 1,
    }  # quarter turns, + = ccw
    for glyph_id, turns in turned.items():
        marker = dictionary.generateImageMarker(glyph_id, 7)[1:-1, 1:-1] // 255
        np.testing.assert_array_equal(code_of(glyph_id), np.rot90(marker, turns))


def test_every_turned_and_mirrored_code_is_identified() -> None:
    ambiguous: set[int] = set()
    for glyph_id, mirrored, turns in product(GLYPHS, (False, True), range(4)):
        seen = np.rot90(mirror(code_of(glyph_id)) if mirrored else code_of(glyph_id), turns)
        found = identify(seen)
        assert found is not None
        assert found.id == glyph_id
        as_told = mirror(code_of(found.id)) if found.mirrored else code_of(found.id)
        np.testing.assert_array_equal(np.rot90(as_told, found.quarter_turns), seen)
        if (found.mirrored, found.quarter_turns) != (mirrored, turns):
            assert found.mirrored
            ambiguous.add(glyph_id)
    assert ambiguous == {477}


def test_an_unknown_code_is_nobody_and_an_unknown_id_has_no_code() -> None:
    assert identify(np.zeros((5, 5))) is None
    assert identify(np.zeros((3, 3))) is None
    with pytest.raises(NotFoundError, match="no glyph 7"):
        code_of(7)


def test_codes_in_real_sessions_are_mirrored(shared: Path) -> None:
    """Trap: Kinect colour images are mirrored, and so is every code in a session."""
    text = (shared / "ecat_kinect" / "SlideAway" / "Session1" / "files.param").read_text(encoding="utf-8-sig")
    codes = set(re.findall(r"<code>([01 ,]+)</code>", text))
    found = [identify(np.array([int(c) for c in code.split(",")]).reshape(5, 5)) for code in codes]
    assert len(found) == 13
    assert all(identity is not None and identity.mirrored for identity in found)
