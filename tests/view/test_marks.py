"""Marker faces and drawn shapes, in the image and in space."""

from __future__ import annotations

import numpy as np
import pytest
from rerun.chunk import Chunk

from ecat.view.marks import between, hull_edges, hulls, markers_2d, markers_3d, outline, shapes, tracks
from ecat.view.scene import FREE, rgba
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


def test_faces_in_space_vanish_with_their_frame() -> None:
    corners = {f"{axis}{i}": [float(i)] for axis in "xyz" for i in range(4)}
    chunks = list(markers_3d(table("markers_3d", frame=[2], object_id=["o1"], **corners), scene()))
    shown = at(chunks, "/world/camera/markers/Shell", "strips")
    assert shown == {2: [[[0] * 3, [1] * 3, [2] * 3, [3] * 3, [0] * 3]], 3: []}


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
    moved = [(frame, shape.tolist(), key) for frame, shape, key in between("rectangle", keys, 9)]
    assert moved == [
        (0, [[0, 0], [0, 0]], True),
        (1, [[4, 4], [4, 4]], False),
        (2, [[8, 8], [8, 8]], True),
        (4, [], True),
    ]
    assert [frame for frame, _, _ in between("polygon", keys, 9)] == [0, 2, 4]


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
    chunks = list(shapes(keys, objects, scene(), dimensions=2))
    entity = f"/world/camera/color/shapes/{path}"
    strips, colors = at(chunks, entity, "strips"), at(chunks, entity, "colors")
    assert strips[1] == [[[1, 0], [5, 0], [5, 4], [1, 4], [1, 0]]]
    assert strips[5] == []
    assert colors == {0: [rgba(BOX.color)], 1: [rgba(DIM)], 2: [rgba(BOX.color)], 5: []}


def test_between_key_frames_nothing_is_made_up_after_the_end_of_the_recording() -> None:
    keys = [(0, np.zeros((2, 2))), (2**31 - 1, np.ones((2, 2)))]
    assert [frame for frame, _, _ in between("rectangle", keys, 3)] == [0, 1, 2, 2**31 - 1]


@pytest.mark.parametrize(("kind", "component"), [("rectangle", "strips"), ("point", "positions")])
def test_a_shape_in_space_stays_as_it_was_drawn_until_the_next_one(kind: str, component: str) -> None:
    objects = table("objects", layer=["main"], object_id=["o1"], kind=[kind])
    corners: dict[str, list[object]] = {"x": [0, 1, 2], "y": [0, 0, 3], "z": [1, 1, 1]}
    if kind == "point":
        corners = {axis: values[:1] for axis, values in corners.items()}
    n = len(corners["x"])
    rows = {axis: values * 2 for axis, values in corners.items()}
    keys = table(
        "keyframes",
        layer=["main"] * 2 * n,
        object_id=["o1"] * 2 * n,
        frame=[0] * n + [4] * n,
        dimensions=[3] * 2 * n,
        present=[True] * 2 * n,
        vertex=[*range(n)] * 2,
        **rows,
    )
    chunks = list(shapes(keys, objects, scene(), dimensions=3))
    shown = at(chunks, "/world/camera/shapes/Shell", component)
    assert list(shown) == [0, 4]
    assert shown[0] == shown[4] == ([[0, 0, 1]] if n == 1 else [[[0, 0, 1], [1, 0, 1], [2, 3, 1], [0, 0, 1]]])
    assert list(shapes(keys, objects, scene(), dimensions=2)) == []


def test_an_object_that_was_never_there_draws_nothing() -> None:
    objects = table("objects", layer=["main"], object_id=["o1"], kind=["polygon"])
    keys = table("keyframes", layer=["main"], object_id=["o1"], frame=[0], dimensions=[2], present=[False])
    assert at(
        list(shapes(keys, objects, scene(), dimensions=2)), "/world/camera/color/shapes/Shell", "strips"
    ) == {0: []}


@pytest.mark.parametrize("far", [None, 1e308])
def test_a_vertex_that_is_nowhere_is_left_out(far: float | None) -> None:
    objects = table("objects", layer=["main"], object_id=["o1"], kind=["polygon"])
    corners: dict[str, list[object]] = {"x": [far, 3.0], "y": [2.0, 4.0]}
    keys = table(
        "keyframes",
        layer=["main"] * 2,
        object_id=["o1"] * 2,
        frame=[0] * 2,
        dimensions=[2] * 2,
        present=[True] * 2,
        vertex=[0, 1],
        **corners,
    )
    shown = at(
        list(shapes(keys, objects, scene(), dimensions=2)), "/world/camera/color/shapes/Shell", "strips"
    )
    assert shown == {0: [[[3, 4]]]}


def test_a_followed_shape_tells_how_sure_it_is_and_goes_with_its_last_image() -> None:
    rows = table(
        "tracks_2d",
        frame=[0] * 3 + [1] * 3 + [2] * 3,
        object_id=["o1"] * 9,
        vertex=[0, 1, 2] * 3,
        u_px=[0.0, 4.0, 4.0] * 3,
        v_px=[0.0, 0.0, 4.0] * 3,
        status=["drawn"] * 3 + ["tracked"] * 3 + ["proposed"] * 3,
    )
    path = "/world/camera/color/tracks/Shell"
    chunks = list(tracks(rows, scene()))
    strips, colors = at(chunks, path, "strips"), at(chunks, path, "colors")
    assert strips[1] == [[[0, 0], [4, 0], [4, 4], [0, 0]]]
    assert strips[3] == []
    assert colors == {0: [rgba(BOX.color)], 1: [rgba(DIM)], 2: [rgba(FREE)], 3: []}


def test_a_hull_is_drawn_along_the_edges_of_its_surface() -> None:
    cube = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), -1).reshape(-1, 3).astype(float)
    corners = np.concatenate([cube, [[0.5, 0.5, 0.5]]])
    edges = hull_edges(corners)
    # two triangles a side, each closed; nothing of what lies inside
    assert edges.shape == (48, 3)
    assert not (edges == 0.5).any()
    rows = table("hulls", frame=[2] * 9, object_id=["o1"] * 9, vertex=range(9), status=["tracked"] * 9,
                 **dict(zip("xyz", corners.T.tolist(), strict=True)))  # fmt: skip
    shown = at(list(hulls(rows, scene())), "/world/camera/hulls/Shell", "strips")
    assert {frame: len(value) for frame, value in shown.items()} == {2: 1, 3: 0}
    assert np.allclose(shown[2][0], edges)


@pytest.mark.parametrize("n", [1, 3, 4])
def test_a_hull_that_is_flat_is_drawn_as_it_is(n: int) -> None:
    flat = np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])[:n]
    assert np.array_equal(hull_edges(flat), flat)
