"""Codes are read from a few blurred pixels, and only those that are there."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import InputError, UsageError
from ecat.geometry.corners import outline
from ecat.geometry.markers import cells_of, code_of, codebooks, dictionary_code, homographies, read_codes
from ecat.model.prototype import FACES, NOMINAL_BOXES, BoxPrototype, nominal_face
from tests.geometry.printed import photograph, random_ring

MIDDLE = np.array([50.2, 49.7])
SIZE = (0.06, 0.06, 0.06)


def box(*codes: str, name: str = "box") -> BoxPrototype:
    faces = (nominal_face(face, code, 0.045, SIZE) for face, code in zip(FACES, codes, strict=False))
    return BoxPrototype(name, SIZE, tuple(faces))


def test_a_code_is_its_cells_row_by_row() -> None:
    assert cells_of("110000001").tolist() == [[1, 1, 0], [0, 0, 0], [0, 0, 1]]
    assert code_of(cells_of("110000001")) == "110000001"


@pytest.mark.parametrize(
    ("name", "number"), [("DICT_4X4_50", 7), ("DICT_6X6_250", 249), ("DICT_APRILTAG_36h11", 3)]
)
def test_codes_of_built_in_dictionaries_are_those_that_opencv_finds(name: str, number: int) -> None:
    cells = np.pad(cells_of(dictionary_code(name, number)), 1) * 255
    image = np.pad(np.kron(cells, np.ones((10, 10))), 30, constant_values=255).astype(np.uint8)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, name))))
    assert np.asarray(detector.detectMarkers(image)[1]).ravel().tolist() == [number]


def test_the_glyphs_are_aruco_markers() -> None:
    original = {dictionary_code("DICT_ARUCO_ORIGINAL", i) for i in (426, 303, 521)}
    assert {face.code for face in NOMINAL_BOXES[2].faces} == original


def test_an_unknown_dictionary_or_number_is_an_error_that_says_what_there_is() -> None:
    with pytest.raises(UsageError, match="no dictionary 'DICT_9X9'"):
        dictionary_code("DICT_9X9", 1)
    with pytest.raises(UsageError, match="no marker 50 in DICT_4X4_50"):
        dictionary_code("DICT_4X4_50", 50)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_homographies_lead_to_the_corners(seed: int) -> None:
    ring = random_ring(np.random.default_rng(seed), 30.0)
    unit = np.array([[0, 1, 1, 0], [0, 0, 1, 1], [1, 1, 1, 1]], np.complex64)
    there = homographies(ring[None]).pixels(unit)[0]
    assert np.allclose(np.stack([there.real, there.imag], 1), ring, atol=1e-3)


@pytest.mark.parametrize("blur_px", [0.2, 1.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_every_face_is_read_whichever_corner_comes_first(blur_px: float, mirrored: bool) -> None:
    rng = np.random.default_rng(6)
    (book,) = codebooks(NOMINAL_BOXES, mirrored=mirrored)
    for b, prototype in enumerate(NOMINAL_BOXES):
        for f, face in enumerate(prototype.faces):
            ring = random_ring(rng, 24.0, np.radians(60)) + MIDDLE
            shown = code_of(np.fliplr(cells_of(face.code))) if mirrored else face.code
            grey = photograph(rng, [shown], [ring], shape=(100, 100), blur_px=blur_px)
            rings = np.stack([np.roll(ring, -k, 0) for k in range(4)])
            seen = outline(grey, rings, reach_px=2)
            reading = read_codes(grey, seen, book)
            glyphs = [book.glyphs[i] for i in reading.glyph]
            assert [(g.box, g.face) for g in glyphs] == [(b, f)] * 4
            # the ring's corner with the number of the turn is the print's top left
            assert [(k + g.turn) % 4 for k, g in enumerate(glyphs)] == [0] * 4
            assert reading.certain.all()
            assert (reading.likeness > 0.97).all()
            # where it is known what is there, nothing else is compared
            known = read_codes(grey, seen, book, reading.glyph)
            assert np.allclose(known.likeness, reading.likeness)
            assert known.certain.all()
            other = read_codes(grey, seen, book, (reading.glyph + 1) % len(book.glyphs))
            assert (other.likeness < 0.9).all()
            assert not other.certain.any()


def test_a_code_with_one_other_cell_is_not_read() -> None:
    rng = np.random.default_rng(7)
    code = NOMINAL_BOXES[0].faces[0].code
    (book,) = codebooks(NOMINAL_BOXES[:1], mirrored=False)
    ring = random_ring(rng, 40.0, np.radians(30)) + MIDDLE
    for i in range(len(code)):
        wrong = code[:i] + str(1 - int(code[i])) + code[i + 1 :]
        grey = photograph(rng, [wrong], [ring], shape=(100, 100))
        assert not read_codes(grey, outline(grey, ring[None], reach_px=2), book).certain[0]


def test_a_border_that_is_not_dark_is_not_a_marker() -> None:
    rng = np.random.default_rng(8)
    code = NOMINAL_BOXES[0].faces[0].code
    (book,) = codebooks(NOMINAL_BOXES[:1], mirrored=False)
    ring = random_ring(rng, 60.0, np.radians(20)) + MIDDLE
    grey = photograph(rng, [code], [ring], shape=(100, 100))
    seen = outline(grey, ring[None], reach_px=2)
    assert read_codes(grey, seen, book).certain[0]
    top = homographies(ring[None]).pixels(np.array([[0.5], [0.07], [1]], np.complex64))[0, 0]
    cv2.circle(grey, (round(top.real), round(top.imag)), 3, 220, -1)
    assert not read_codes(grey, seen, book).certain[0]


def test_faces_that_cannot_be_told_apart_are_refused() -> None:
    code = NOMINAL_BOXES[0].faces[0].code
    turned = code_of(np.rot90(cells_of(code)))
    with pytest.raises(InputError, match=r"(?s)cannot tell the markers apart.*box \+x and box -x"):
        codebooks([box(code, turned)], mirrored=False)
    with pytest.raises(InputError, match="other -x looks the same when it is turned"):
        codebooks([box(code, "1" * 16, name="other")], mirrored=False)


def test_codes_of_different_sizes_are_kept_apart() -> None:
    four = box(dictionary_code("DICT_4X4_50", 0), name="four")
    assert [(b.n, len(b.glyphs)) for b in codebooks([*NOMINAL_BOXES, four], mirrored=True)] == [
        (4, 4),
        (5, 36),
    ]
