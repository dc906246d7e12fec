"""Marks and shapes in the colour image."""

from __future__ import annotations

import numpy as np
import pytest
from rerun.chunk import Chunk

from ecat.view.image import between, border, markers_2d, outline, shapes_2d
from ecat.view.scene import rgba
from tests.view.chunks import BOX, DIM, PALE, at, scene, table

CORNERS = {"u0_px": 1, "v0_px": 2, "u1_px": 3, "v1_px": 2, "u2_px": 3, "v2_px": 4, "u3_px": 1, "v3_px": 4}
RING = [[1, 2], [3, 2], [3, 4], [1, 4], [1, 2]]
MARKERS = "/world/camera/color/markers/Shell"


def marks(frames: list[int], first_u: list[float | None]) -> list[Chunk]:
    columns: dict[str, list[object]] = {name: [value] * len(frames) for name, value in CORNERS.items()}
    rows = table("markers_2d", frame=frames, object_id=["o1"] * len(frames), **columns | {"u0_px": first_u})
    return list(markers_2d(rows, scene(6)))


def test_a_face_is_a_closed_ring() -> None:
    assert at(marks([0], [1]), MARKERS, "strips")[0] == [RING]


def test_two_faces_of_a_frame_are_shown_together() -> None:
    assert len(at(marks([2, 2], [1, 0]), MARKERS, "strips")[2]) == 2


def test_a_frame_without_faces_shows_none() -> None:
    shown = at(marks([0, 1, 4], [1, 1, 1]), MARKERS, "strips")
    assert {frame: len(value) for frame, value in shown.items()} == {0: 1, 1: 1, 2: 0, 4: 1, 5: 0}


def test_a_mark_without_corners_is_a_frame_without_faces() -> None:
    assert at(marks([0, 1], [1, None]), MARKERS, "strips") == {0: [RING], 1: []}


def test_measured_marks_are_paler_than_their_object() -> None:
    assert at(marks([0], [1]), MARKERS, "colors")[None] == [rgba(PALE)]


def test_a_rectangle_is_given_by_its_corner_and_its_size() -> None:
    drawn = outline("rectangle", np.array([[10.0, 20.0], [3.0, 4.0]]))
    assert drawn.tolist() == [[10, 20], [13, 20], [13, 24], [10, 24], [10, 20]]


def test_a_polygon_is_closed_and_a_line_is_not() -> None:
    assert outline("polygon", np.eye(3)[:, :2]).tolist() == [[1, 0], [0, 1], [0, 0], [1, 0]]
    assert outline("polygon", np.eye(2)).tolist() == [[1, 0], [0, 1]]


def test_rectangles_move_between_key_frames_and_other_shapes_stay() -> None:
    keys = [(0, np.zeros((2, 2))), (2, np.full((2, 2), 8.0)), (4, np.zeros((0, 2)))]
    moved = [(frame, shape.tolist(), key) for frame, shape, key in between("rectangle", keys)]
    assert moved == [
        (0, [[0, 0], [0, 0]], True),
        (1, [[4, 4], [4, 4]], False),
        (2, [[8, 8], [8, 8]], True),
        (4, [], True),
    ]
    assert [frame for frame, _, _ in between("polygon", keys)] == [0, 2, 4]


@pytest.mark.parametrize(("layer", "path"), [("main", "Shell"), ("second", "second/Shell")])
def test_a_drawn_shape_stays_until_its_absence_and_is_dark_where_nobody_drew_it(
    layer: str, path: str
) -> None:
    objects = table("objects", layer=[layer], object_id=["o1"], kind=["rectangle"])
    keys = table(
        "keyframes",
        layer=[layer] * 5,
        object_id=["o1"] * 5,
        frame=[0, 0, 2, 2, 5],
        dimensions=[2] * 5,
        present=[True] * 4 + [False],
        vertex=[0, 1, 0, 1, None],
        x=[0, 4, 2, 4, None],
        y=[0, 4, 0, 4, None],
    )
    chunks = list(shapes_2d(keys, objects, scene()))
    entity = f"/world/camera/color/shapes/{path}"
    strips, colors = at(chunks, entity, "strips"), at(chunks, entity, "colors")
    assert strips[1] == [[[1, 0], [5, 0], [5, 4], [1, 4], [1, 0]]]
    assert strips[5] == []
    assert colors == {0: [rgba(BOX.color)], 1: [rgba(DIM)], 2: [rgba(BOX.color)], 5: []}


def test_an_object_that_was_never_there_draws_nothing() -> None:
    objects = table("objects", layer=["main"], object_id=["o1"], kind=["polygon"])
    keys = table("keyframes", layer=["main"], object_id=["o1"], frame=[0], dimensions=[2], present=[False])
    assert at(list(shapes_2d(keys, objects, scene())), "/world/camera/color/shapes/Shell", "strips") == {
        0: []
    }


def test_the_border_is_as_large_as_the_image() -> None:
    assert at([border(1920, 1080)], "/world/camera/color/border", "strips")[None][0][2] == [1920, 1080]
