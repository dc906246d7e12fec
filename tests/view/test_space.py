"""Cameras, table and boxes in space."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import Chunk

from ecat.geometry.transforms import Rigid
from ecat.model import Camera, Manifest
from ecat.view.scene import FREE, UNOBSERVED, rgba
from ecat.view.space import (
    UPRIGHT,
    border,
    boxes,
    camera,
    camera_path,
    depth_outlines,
    pose_state,
    table_outline,
    table_surface,
    travels,
    world,
)
from tests.view.chunks import BOX, at, scene, table

POSE = {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0, "x": 1.0, "y": 2.0, "z": 0.1}
BODY = "/world/boxes/Shell"
# how Rerun numbers the directions of a camera's axes
DOWN, RIGHT, LEFT, FORWARD = 2, 3, 4, 5


def poses(rows: Sequence[Mapping[str, object]]) -> list[Chunk]:
    """The box of rows that are poses on the table unless they say otherwise."""
    usual: dict[str, object] = {"object_id": "o1", "source": "observed", "support": "table", **POSE}
    names = {"frame", *usual}
    full = [{**usual, **row} for row in rows]
    return list(boxes(table("poses", **{name: [row[name] for row in full] for name in names}), scene()))


NOTHING: Mapping[str, object] = dict.fromkeys([*POSE, "source", "support"])


def test_a_frame_without_a_pose_removes_the_box() -> None:
    chunks = poses([{"frame": 0}, {"frame": 1, **NOTHING}, {"frame": 2, **NOTHING}, {"frame": 3}])
    for path, component, many in (
        (BODY, "half_sizes", 1),
        (BODY, "centers", 1),
        (BODY, "colors", 1),
        (f"{BODY}/axes", "vectors", 3),
    ):
        shown = at(chunks, path, component)
        assert {frame: len(value) for frame, value in shown.items()} == {0: many, 1: 0, 3: many, 4: 0}


def test_a_missing_row_removes_the_box_as_well() -> None:
    assert list(at(poses([{"frame": 0}, {"frame": 5}]), BODY, "centers").items())[1] == (1, [])


def test_a_box_is_where_and_as_large_as_its_pose_and_prototype_say() -> None:
    chunks = poses([{"frame": 0}])
    assert np.allclose(at(chunks, BODY, "centers")[0], [[1, 2, 0.1]])
    assert np.allclose(at(chunks, BODY, "half_sizes")[0], [[0.1, 0.1, 0.1]])


def test_the_axes_leave_the_box_through_its_faces() -> None:
    half_turn = {"qx": 0.0, "qy": 0.0, "qz": 1.0, "qw": 0.0}
    chunks = poses([{"frame": 0} | half_turn])
    origins, vectors = (np.array(at(chunks, f"{BODY}/axes", c)[0]) for c in ("origins", "vectors"))
    assert np.allclose(origins, [[0.9, 2, 0.1], [1, 1.9, 0.1], [1, 2, 0.2]])
    assert np.allclose(vectors / np.linalg.norm(vectors, axis=1)[:, None], np.diag([-1, -1, 1]), atol=1e-6)


def test_resting_lifted_and_interpolated_boxes_look_different() -> None:
    chunks = poses([{"frame": 0}, {"frame": 1, "support": "free"}, {"frame": 2, "source": "interpolated"}])
    shown = [value for value in at(chunks, BODY, "colors").values() if value]
    assert shown == [[rgba(BOX.color)], [rgba(FREE)], [rgba(UNOBSERVED, 150)]]


def test_what_is_interpolated_is_so_wherever_the_box_is() -> None:
    source, support = np.array(["interpolated", "observed", "", ""]), np.array(["free", "free", "", "table"])
    states = pose_state(source, support, np.array([True, True, False, True]))
    assert states.tolist() == ["interpolated", "free", "", "table"]


def test_the_path_joins_neighbouring_frames_only() -> None:
    chunks = poses([{"frame": 0}, {"frame": 1, "x": 2.0}, {"frame": 2, **NOTHING}, {"frame": 3}])
    paths = at(chunks, "/world/paths/Shell", "strips")
    assert {frame: len(value) for frame, value in paths.items()} == {1: 1, 2: 0}
    assert np.allclose(paths[1], [[[1, 2, 0.1], [2, 2, 0.1]]])


def test_a_box_of_unknown_size_shows_its_axes_alone() -> None:
    rows = table(
        "poses", frame=[0], object_id=["stranger"], **{name: [value] for name, value in POSE.items()}
    )
    assert {c.entity_path for c in boxes(rows, scene())} == {
        "/world/boxes/stranger/axes",
        "/world/paths/stranger",
    }


def test_the_border_is_as_large_as_the_image() -> None:
    assert at([border(1920, 1080)], "/world/camera/color/border", "strips")[None][0][2] == [1920, 1080]


def plane(frames: list[int]) -> dict[str, list[float]]:
    """A table a metre before a camera that looks straight down."""
    turn = {"qx": 1.0, "qy": 0.0, "qz": 0.0, "qw": 0.0}
    place = {"origin_x": 0.0, "origin_y": 0.0, "origin_z": 1.0}
    return {"frame": list(map(float, frames))} | {
        name: [value] * len(frames) for name, value in (turn | place).items()
    }


def test_the_camera_stands_over_the_table_from_the_first_frame_on() -> None:
    rows = plane([3, 7])
    fits = table("table_plane", **rows | {"frame": [3, 7]})
    placed = at(list(world(fits, scene().timebase)), "/world/camera", "translation")
    assert list(placed) == [0, 7]
    assert np.allclose(placed[0], [[0, 0, 1]])


def test_without_a_table_the_camera_looks_straight_ahead_and_down_is_down() -> None:
    chunks = list(world(None, scene().timebase))
    # Rerun keeps matrices column by column
    matrix = np.reshape(at(chunks, "/world/camera", "mat3x3")[None][0], (3, 3)).T
    assert np.allclose(matrix @ [0, 0, 1], [0, 1, 0])
    assert np.allclose(matrix @ [0, 1, 0], [0, 0, -1])


@pytest.mark.parametrize(
    ("mirrored", "axes"), [(True, [LEFT, DOWN, FORWARD]), (False, [RIGHT, DOWN, FORWARD])]
)
def test_a_mirrored_image_runs_to_the_left_of_its_camera(mirrored: bool, axes: list[int]) -> None:
    model = Camera(
        name="color", width_px=8, height_px=6, fx_px=5, fy_px=5, cx_px=4, cy_px=3, mirrored=mirrored,
    )  # fmt: skip
    place = Rigid.from_quaternion(np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 2.0, 3.0]))
    chunks = list(camera(model, "/c", place))
    assert at(chunks, "/c", "camera_xyz")[None] == [axes]
    assert at(chunks, "/c", "translation")[None] == [[1, 2, 3]]
    assert at(chunks, "/c", "quaternion")[None] == [[0, 0, 1, 0]]


def test_the_table_holds_what_was_drawn_and_where_the_boxes_were_but_no_stray_one() -> None:
    drawn = np.array([[0, 0, 0], [1, 0, 0.01], [1, 1, -0.01], [0, 1, 0], [9, 9, 0.5]])
    resting = np.tile([0.5, 1.4, 0.1], (200, 1))
    stray = np.array([[50.0, 50.0, 3.0], [np.nan] * 3])
    ring = table_outline(drawn, np.concatenate([resting, stray]), margin_m=0.1)
    assert np.allclose(ring.min(0), [0, 0], atol=1e-6)
    assert np.allclose(ring.max(0), [1, 1.5], atol=1e-6)
    edges = np.roll(ring, -1, axis=0) - ring
    turns = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
    assert (turns > 0).all()


def test_a_table_of_which_nothing_is_known_is_drawn_around_its_origin() -> None:
    ring = table_outline(np.zeros((0, 3)), np.zeros((0, 3)))
    assert np.allclose([ring.min(), ring.max()], [-0.5, 0.5])


def test_the_table_faces_up() -> None:
    chunks = list(table_surface(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])))
    corners = np.array(at(chunks, "/world/table", "vertex_positions")[None])
    triangles = np.array(at(chunks, "/world/table", "triangle_indices")[None])
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert math.isclose(np.abs(np.cross(b - a, c - a)[:, 2]).sum() / 2, 1.0)


def test_the_pose_of_the_camera_is_that_of_the_plane_turned_round() -> None:
    turn = Rigid.from_quaternion(np.array([1.0, 0, 0, 0]), np.array([0, 0, 1.0])).inverse()
    quaternion = at(
        list(world(table("table_plane", **plane([0]) | {"frame": [0]}), scene().timebase)),
        "/world/camera",
        "quaternion",
    )
    assert np.allclose(np.abs(quaternion[0][0]), np.abs(turn.quaternion))


EYE = Camera(
    name="color", width_px=8, height_px=6, fx_px=5, fy_px=5, cx_px=4, cy_px=3, reference="depth",
    translation_m=(0.1, 0.0, 0.0),
)  # fmt: skip
MANIFEST = Manifest(name="s", created="2024-01-01T00:00:00", n_frames=10, cameras=(EYE,))


def moved(frames: Sequence[int | None], x: Sequence[float], t_ns: Sequence[int] | None = None) -> pa.Table:
    """The colour camera moves along x of a world in which it lies on its side."""
    turn = {"qx": 0.0, "qy": 0.0, "qz": math.sqrt(0.5), "qw": math.sqrt(0.5)}
    flat = {name: [value] * len(x) for name, value in (turn | {"y": 0.0, "z": 0.0}).items()}
    times = t_ns or [None] * len(x)
    return table("camera_poses", frame=frames, t_ns=times, camera=["color"] * len(x), x=x, **flat)


def test_a_camera_that_moves_starts_upright_and_goes_where_the_recording_says() -> None:
    travelled = travels(moved([0, 4], [7.0, 9.0]), MANIFEST, scene().timebase)
    assert travelled is not None
    placed = at(list(world(None, scene().timebase, travelled)), "/world/camera", "translation")
    assert list(placed) == [0, 4]
    # two metres along the world's x are two metres up along the camera's -y, which is the view's z
    assert np.allclose([placed[0][0], placed[4][0]], [[0, 0, 0], [0, 0, 2]], atol=1e-6)
    path = at([camera_path(UPRIGHT, travelled[1])], "/world/camera_path", "strips")
    assert np.allclose(path[None], [[[0, 0, 0], [0, 0, 2]]], atol=1e-6)


def test_camera_poses_between_images_fall_on_the_image_on_show() -> None:
    between = moved([None, None], [0.0, 1.0], [5, 25])
    travelled = travels(between, MANIFEST, scene(step_ns=10).timebase)
    assert travelled is not None
    assert travelled[0].tolist() == [0, 2]
    assert travels(between, MANIFEST, scene().timebase) is None


def test_the_outline_of_the_table_is_closed_and_holds_from_the_start() -> None:
    corners = {"x": [0.0, 1.0, 1.0], "y": [0.0, 0.0, 1.0], "z": [1.0] * 3}
    found = table("table_outline", frame=[3] * 3, vertex=[0, 1, 2], **corners)
    shown = at(list(depth_outlines(found, scene().timebase)), "/world/camera/table_outline", "strips")
    assert shown == {0: [[[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 0, 1]]]}
