"""Drawn markers as key frames."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from ecat.errors import FormatError
from ecat.formats.ecat2018.key_frames import (
    coordinates_of,
    coordinates_text,
    key_frame_attributes,
    key_frame_of,
    key_frame_text,
)
from ecat.model import KeyFrame


def key(text: str, dimensions: int = 2) -> KeyFrame:
    def bad(where: str) -> None:
        raise AssertionError(where)

    return key_frame_of(etree.fromstring(text), dimensions, "cannot import it", bad)


def test_pixels_are_as_in_the_file_and_metres_in_the_axes_of_the_physical_camera() -> None:
    assert coordinates_of("1,-2,3,4.5", 2) == (1, -2, 3, 4.5)
    assert coordinates_of("1,-2,3", 3) == (-1, 2, 3)


@given(
    st.lists(st.floats(-1e6, 1e6, width=32).map(lambda x: float(f"{x:.7g}")), min_size=3, max_size=12),
    st.sampled_from([2, 3]),
)
def test_coordinates_survive(values: list[float], dimensions: int) -> None:
    if dimensions == 3:
        values = [*values[: len(values) // 3 * 3], 0.5, 0.5, 0.5]
        values = [0.25 if value in {0, -1, 1} else value for value in values]
    text = coordinates_text(values, dimensions)
    assert coordinates_of(text, dimensions) == tuple(value + 0.0 for value in values)


def test_a_text_that_would_not_be_written_so_is_kept() -> None:
    made = key('<marker type="LOCATION" frame="3">1.0,2,3,4</marker>')
    assert made.coordinates == (1, 2, 3, 4)
    assert key_frame_text(made, 2) == "1.0,2,3,4"


def test_a_kept_text_hides_no_edit() -> None:
    made = key('<marker type="LOCATION" frame="3">1.0,2,3,4</marker>')
    assert key_frame_text(replace(made, coordinates=(1, 2, 3, 5)), 2) == "1,2,3,5"


def test_attributes_come_back_in_their_order_and_with_an_edited_frame() -> None:
    made = key('<marker frame="3" type="DELETE" x="1" />')
    assert (made.frame, made.present) == (2, False)
    assert key_frame_attributes(replace(made, frame=8), 2) == [("frame", "9"), ("type", "DELETE"), ("x", "1")]


def test_3d_markers_have_no_type() -> None:
    assert key_frame_attributes(key('<marker frame="3">1,2,3</marker>', 3), 3) == [("frame", "3")]


def test_numbers_that_cannot_be_read_are_somebody_s_decision() -> None:
    places: list[str] = []
    made = key_frame_of(etree.fromstring('<marker frame="3">1,x</marker>'), 2, "", places.append)
    assert places == ["line 1, <marker> of frame 3: 'x' is not a number"]
    assert made.coordinates == ()
    assert key_frame_text(made, 2) == "1,x"
    assert key_frame_text(replace(made, coordinates=(nan,)), 2) == "-∞"


@pytest.mark.parametrize(
    "text", ['<marker type="MOVE" frame="1" />', '<marker frame="1"><face /></marker>', "<marker />"]
)
def test_what_is_no_drawn_marker_is_refused(text: str) -> None:
    with pytest.raises(FormatError, match="cannot import it"):
        key(text)
