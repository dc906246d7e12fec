"""Texts of faces become numbers, and what is not a usual text is kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import FormatError
from ecat.formats.ecat2018.face_markup import Run
from ecat.formats.ecat2018.lexical import format_code
from ecat.formats.ecat2018.marks import CodeBook, Faces
from tests.formats.ecat2018.documents import CODE, CORNERS


def run(corners: Sequence[str], codes: Sequence[str] = (), frames: Sequence[int] = (), size: int = 5) -> Run:
    """A marker with one face for each text."""
    n = len(corners)
    codes = codes or [CODE] * n
    return Run(
        lambda i: 100 + i,
        np.array(frames or range(n), np.int32),
        np.full(n, size, np.int32),
        np.ones(n, np.int32),
        pa.array([text.encode() for text in corners], pa.binary()).dictionary_encode(),
        pa.array([text.encode() for text in codes], pa.binary()).dictionary_encode(),
    )


def faces(*runs: Run, dimensions: int = 2, skip_bad: bool = False) -> Faces:
    made = Faces(dimensions, "cannot import Session1/files.param", CodeBook(), skip_bad)
    for each in runs:
        made.add(each)
    made.columns()
    return made


def refusal(*runs: Run, dimensions: int = 2) -> FormatError:
    with pytest.raises(FormatError) as caught:
        faces(*runs, dimensions=dimensions)
    return caught.value


class TestCorners:
    def test_2d_corners_are_pixels_in_the_order_of_the_file(self) -> None:
        assert faces(run([CORNERS])).columns().corners.tolist() == [[859, 654, 915, 637, 916, 694, 862, 712]]

    def test_3d_corners_are_metres_in_the_axes_of_the_physical_camera(self) -> None:
        """Kinect camera space has x to the right of the mirrored image and y up."""
        found = faces(run(["1,2,3,4,5,6,7,8,9,10,11,12"]), dimensions=3).columns().corners
        assert found.tolist() == [[-1, -2, 3, -4, -5, 6, -7, -8, 9, -10, -11, 12]]

    def test_trap_02_infinity_is_a_character_and_means_missing(self) -> None:
        made = faces(run(["-∞,-∞,-∞,1,2,3,4,5,6,7,8,9"]), dimensions=3)
        assert np.isnan(made.columns().corners).tolist() == [[True] * 3 + [False] * 9]
        assert made.corner_texts == {}

    @pytest.mark.parametrize(
        "said", ["-1,-1,-1,1,2,3,4,5,6,7,8,9", "0,0,0,1,2,3,4,5,6,7,8,9", "∞,∞,∞,1,2,3,4,5,6,7,8,9"]
    )
    def test_other_ways_to_say_missing_are_missing_and_keep_their_text(self, said: str) -> None:
        made = faces(run([said]), dimensions=3)
        assert np.isnan(made.columns().corners[0, :3]).all()
        assert made.corner_texts == {0: said}

    @pytest.mark.parametrize(
        "said", ["859.0,654,915,637,916,694,862,712", " 859,654,915,637,916,694,862,712"]
    )
    def test_an_unusual_way_to_write_a_number_is_kept(self, said: str) -> None:
        assert faces(run([said])).corner_texts == {0: said}

    @pytest.mark.parametrize(
        ("said", "problem"),
        [
            ("1,2,3", "expected 8 numbers, found 3"),
            ("1,2,3,4,5,6,7,x", "'x' is not a number"),
            ("1,2,3,4,5,6,7,", "'' is not a number"),
            ('1,2,3,4,5,6,7,"8"', "'\"8\"' is not a number"),
            ("1,2,3,4,5,6,7,8\n1,2,3,4,5,6,7,8", "expected 8 numbers, found 15"),
            ("", "expected 8 numbers, found 0"),
        ],
    )
    def test_what_is_no_list_of_numbers_is_refused_with_its_place(self, said: str, problem: str) -> None:
        error = refusal(run([CORNERS, said], frames=[7, 9]))
        assert error.where == f"line 101, <face> 1 of frame 9: {problem}"
        assert error.consequence == "the rest of the session was not imported; nothing was written"
        assert error.fix == "ecat import --skip-bad-markers ..."

    @pytest.mark.parametrize("said", ["NaN," * 7 + "NaN", "1e308," * 7 + "-1e308", "1e999," * 7 + "1"])
    def test_strange_numbers_are_numbers(self, said: str) -> None:
        assert faces(run([said])).corner_texts == {0: said}

    def test_a_bad_face_may_be_kept_without_its_corners(self) -> None:
        made = faces(run([CORNERS, "a,b"]), skip_bad=True)
        assert np.isnan(made.columns().corners[1]).all()
        assert made.corner_texts == {1: "a,b"}
        assert made.findings == [
            "line 101, <face> 1 of frame 1: expected 8 numbers, found 2; the marker was kept without the bad values"
        ]

    @given(
        st.lists(
            st.lists(st.sampled_from(["1", "-2.5", "∞", "x", "", " 3", "1_0", "nan", "-0"]), max_size=9),
            min_size=1,
            max_size=4,
        )
    )
    def test_reading_many_at_once_is_reading_one_by_one(self, lists: list[list[str]]) -> None:
        """Arrow reads a batch of good texts; a bad one among them changes nothing for the others."""
        texts = [",".join(numbers) for numbers in lists]
        together = faces(run(texts), skip_bad=True)
        apart = [faces(run([text], frames=[i]), skip_bad=True) for i, text in enumerate(texts)]
        np.testing.assert_array_equal(
            together.columns().corners, np.concatenate([a.columns().corners for a in apart])
        )
        assert together.corner_texts == {i: a.corner_texts[0] for i, a in enumerate(apart) if a.corner_texts}


class TestCodes:
    def test_a_code_is_kept_as_read_cell_by_cell(self) -> None:
        """Trap 04: turning it by the leftmost corner is for whoever identifies the face."""
        made = faces(run([CORNERS]))
        assert made.book.codes[made.columns().codes[0]] == CODE.replace(" ,", "").strip()
        assert made.book.texts == [None]

    def test_equal_codes_are_stored_once(self) -> None:
        made = faces(run([CORNERS] * 3, [CODE, CODE.replace("1", "0"), CODE]))
        assert made.columns().codes.tolist() == [0, 1, 0]

    def test_24_cells_are_refused_with_the_place_and_the_way_out(self) -> None:
        error = refusal(run([CORNERS], [CODE[:-3]], frames=[1204]))
        assert str(error).split("\n") == [
            "cannot import Session1/files.param",
            "  line 100, <face> 1 of frame 1204: expected 25 cells of 0 or 1 in <code>, found 24",
            "  the rest of the session was not imported; nothing was written",
            "  try: ecat import --skip-bad-markers ...",
        ]

    def test_a_bad_code_may_be_kept_as_its_text(self) -> None:
        made = faces(run([CORNERS] * 2, ["1 ,0 ", CODE]), skip_bad=True)
        numbers = made.columns().codes
        assert [made.book.codes[i] for i in numbers] == [None, CODE.replace(" ,", "").strip()]
        assert made.book.texts[numbers[0]] == "1 ,0 "

    def test_an_unusual_way_to_write_a_code_is_kept(self) -> None:
        made = faces(run([CORNERS], [CODE.replace(" ", "")]))
        assert made.book.texts == [CODE.replace(" ", "")]

    def test_the_number_of_cells_is_that_of_the_marker(self) -> None:
        small = format_code("1001")
        made = faces(run([CORNERS], [small], size=2), run([CORNERS], [CODE], frames=[3]))
        assert made.book.codes == ["1001", CODE.replace(" ,", "").strip()]
        assert "expected 25 cells" in refusal(run([CORNERS], [small])).where


def marker_run(*markers: tuple[int, int]) -> Run:
    """Markers as (frame, number of faces)."""
    filled = [count > 0 for _, count in markers for _ in range(max(count, 1))]
    return Run(
        lambda i: i,
        np.array([frame for frame, _ in markers], np.int32),
        np.full(len(markers), 5, np.int32),
        np.array([count for _, count in markers], np.int32),
        pa.array([CORNERS.encode() if full else b"" for full in filled], pa.binary()).dictionary_encode(),
        pa.array([CODE.encode() if full else b"" for full in filled], pa.binary()).dictionary_encode(),
    )


class TestRows:
    def test_faces_are_numbered_in_their_marker_and_an_empty_marker_is_a_row_without_values(self) -> None:
        columns = faces(marker_run((3, 2), (4, 0), (6, 1))).columns()
        assert columns.frames.tolist() == [3, 3, 4, 6]
        assert columns.orders.tolist() == [0, 1, -1, 0]
        assert columns.codes.tolist() == [0, 0, -1, 0]
        assert np.isnan(columns.corners).all(axis=1).tolist() == [False, False, True, False]

    def test_no_markers_are_no_rows(self) -> None:
        made = faces()
        assert len(made) == 0
        assert made.columns().corners.shape == (0, 8)
        assert not made.put_in_order()

    def test_markers_in_order_stay(self) -> None:
        made = faces(marker_run((3, 2), (4, 0)))
        assert not made.put_in_order()

    def test_markers_are_put_in_the_order_of_frames_and_the_last_of_a_frame_counts(self) -> None:
        made = faces(marker_run((6, 1), (3, 2), (6, 2), (4, 0)))
        made.absent = {5}
        assert made.put_in_order()
        columns = made.columns()
        assert columns.frames.tolist() == [3, 3, 4, 6, 6]
        assert columns.orders.tolist() == [0, 1, -1, 0, 1]
        assert made.absent == {2}

    @given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3)), max_size=12))
    def test_order_is_that_of_a_dictionary_by_frame(self, markers: list[tuple[int, int]]) -> None:
        made = faces(marker_run(*markers)) if markers else faces()
        made.put_in_order()
        last = dict(markers)
        expected = [(f, i) for f in sorted(last) for i in (range(last[f]) if last[f] else [-1])]
        columns = made.columns()
        assert list(zip(columns.frames.tolist(), columns.orders.tolist(), strict=True)) == expected

    def test_many_runs_are_one(self) -> None:
        made = faces(*[marker_run((i, 1)) for i in range(20_000)])
        assert len(made) == 20_000
        assert made.columns().frames.tolist() == list(range(20_000))
