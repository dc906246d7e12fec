"""Markers of one list become arrays, and what is laid out in another way is told apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ecat.formats.ecat2018.face_markup import Run, join_runs, read_markers
from tests.formats.ecat2018.documents import CODE, CORNERS, POINTS, box_marker, face

FRAMES = (0, 7, 12, 345, 6789, 123456789)


def markup(*markers: str) -> bytes:
    return "".join(markers).strip().encode()


def run_of(*markers: str, dimensions: int = 2) -> Run:
    run = read_markers(markup(*markers), dimensions, 1)
    assert isinstance(run, Run)
    return run


def test_frames_of_any_length_are_numbers() -> None:
    run = run_of(*(box_marker(frame, face()) for frame in FRAMES))
    assert run.frames.tolist() == list(FRAMES)
    assert run.sizes.tolist() == [5] * len(FRAMES)


@pytest.mark.parametrize(("dimensions", "corners"), [(2, CORNERS), (3, POINTS)])
def test_every_face_has_its_texts(dimensions: int, corners: str) -> None:
    faces = (face(corners), face(corners.replace("1", "2")))
    run = run_of(
        box_marker(1, faces[0], dimensions=dimensions),
        box_marker(2, *faces, dimensions=dimensions),
        dimensions=dimensions,
    )
    assert run.counts.tolist() == [1, 2]
    assert run.corners.to_pylist() == [c.encode() for c in (corners, corners, corners.replace("1", "2"))]
    assert run.codes.to_pylist() == [CODE.encode()] * 3
    distinct: Any = run.codes
    assert distinct.dictionary.to_pylist() == [CODE.encode()]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("</bounding>", "</boundinG>"),
        ("</marker>\n        <marker", "</marker>x\n        <marker"),
        ("</code>\n          </face>", "</code> </face>"),
        ("<code>" + CODE, "<code>"),
        ('frame="3"', 'frame=""'),
        ('frame="3"', 'frame="1234567890"'),
        ('frame="3"', 'frame="3x"'),
        ('glyphSize="5"', 'glyphSize="6"'),
    ],
)
def test_markers_before_the_first_odd_one_are_counted(old: str, new: str) -> None:
    plain = [box_marker(frame, face()) for frame in range(6)]
    whole = markup(*plain)
    at = whole.rindex(old.encode(), 0, whole.index(b'frame="4"'))
    odd = whole[:at] + new.encode() + whole[at + len(old.encode()) :]
    found = read_markers(odd, 2, 1)
    assert found in {2, 3, 4}
    assert isinstance(read_markers(odd.split(b"</marker>")[0] + b"</marker>", 2, 1), Run)


def test_what_starts_otherwise_has_none() -> None:
    assert read_markers(b"x" + markup(box_marker(1, face())), 2, 1) == 0
    assert read_markers(markup(box_marker(1, face())), 3, 1) == 0


def test_joined_runs_know_the_lines_of_all() -> None:
    def run(line: int, frames: list[int], counts: list[int]) -> Run:
        n = sum(counts)
        numbers = (np.array(found, np.int32) for found in (frames, [5] * len(frames), counts))
        texts = pa.array([b"%d" % line] * n, pa.binary()).dictionary_encode()
        frame, size, count = numbers
        return Run(lambda i: line + i, frame, size, count, texts, texts)

    joined = join_runs([run(10, [1], [2]), run(50, [2], [1])])
    assert [joined.line(i) for i in range(3)] == [10, 11, 50]
    assert (joined.frames.tolist(), joined.counts.tolist()) == ([1, 2], [2, 1])
    assert joined.corners.to_pylist() == [b"10", b"10", b"50"]
