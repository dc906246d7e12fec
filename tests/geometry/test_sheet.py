"""Printed sheets: markers at true scale, as the detector reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.geometry.detection import Detector
from ecat.geometry.markers import dictionary_code
from ecat.geometry.sheet import PAGE_MM, marker_sheets
from ecat.model.prototype import FACES, NOMINAL_BOXES, BoxPrototype, nominal_face

PX_PER_MM = 4


def cube(size: float, side: float) -> BoxPrototype:
    edges = size, size, size
    faces = (nominal_face(f, dictionary_code("DICT_5X5_50", i), side, edges) for i, f in enumerate(FACES))
    return BoxPrototype("cube <1>", edges, tuple(faces))


def drawn(page: str) -> NDArray[np.uint8]:
    """The page, black and white."""
    root = etree.fromstring(page.encode())
    assert (root.get("width"), root.get("height")) == ("210mm", "297mm")
    image = np.full([round(PX_PER_MM * mm) for mm in PAGE_MM[::-1]], 255, np.uint8)
    for rect in root.iter("{*}rect"):
        x, y, width, height = (float(rect.get(name, 0)) * PX_PER_MM for name in ("x", "y", "width", "height"))
        if rect.get("class") in {"marker", "white"}:
            where = np.s_[round(y) : round(y + height), round(x) : round(x + width)]
            image[where] = 0 if rect.get("class") == "marker" else 255
    return image


@pytest.mark.parametrize("box", [cube(0.06, 0.045), *NOMINAL_BOXES], ids=lambda box: box.name)
def test_every_face_is_on_the_sheets_once_upright_and_at_true_scale(box: BoxPrototype) -> None:
    detector = Detector([box])
    faces: list[int] = []
    for page in marker_sheets([box]):
        found = detector.search(drawn(page))
        faces += found.face.tolist()
        for face, ring in zip(found.face.tolist(), found.rings, strict=True):
            side = 1000 * box.faces[face].side_m * PX_PER_MM
            upright = ring[0] + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
            assert np.abs(ring - upright).max() < 1.0
    assert sorted(faces) == list(range(len(box.faces)))


def test_a_small_cube_fits_on_one_page_and_six_large_markers_on_several() -> None:
    assert len(marker_sheets([cube(0.05, 0.04)])) == 1
    assert len(marker_sheets([cube(0.15, 0.1)])) > 1


def test_a_marker_larger_than_the_page_is_refused() -> None:
    with pytest.raises(UsageError, match=r"(?s)cannot print the markers.*250 mm do not fit"):
        marker_sheets([cube(0.4, 0.25)])


def test_names_cannot_break_the_page(tmp_path: Path) -> None:
    (page,) = marker_sheets([cube(0.05, 0.04)])
    assert "cube &lt;1&gt; +x  40 mm" in page
