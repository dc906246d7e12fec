"""The scene at a moment as PLY and GLB, read by trimesh (and Open3D where it is installed)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.errors import NotFoundError, UsageError
from ecat.formats.robotics import glb, ply
from ecat.formats.robotics.scene import table_fits, things_of
from ecat.formats.robotics.still import StillOptions, still
from ecat.geometry.transforms import Rigid
from ecat.sample import GroundTruth
from ecat.store import Session
from ecat.store.media import open_images
from tests.formats.robotics.scenes import HIDDEN, bare, exported

trimesh = pytest.importorskip("trimesh")
_UNIT = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2


def corners(truth: GroundTruth, box: int, frame: int) -> NDArray[np.float64]:
    """The corners (8, 3) of a block as it really stood, table frame."""
    size = np.array(truth.prototypes[box].size_m)
    return Rigid.from_quaternion(truth.quaternion[box, frame], truth.position[box, frame]).apply(_UNIT * size)


def rows(points: Any) -> set[tuple[float, ...]]:
    return {tuple(point) for point in np.asarray(points).round(4).tolist()}


def test_blocks_stand_in_the_ply_where_they_stood(filmed: tuple[Session, GroundTruth], out: Path) -> None:
    session, truth = filmed
    exported(ply.FORMAT, session, out, frame="60")
    mesh = trimesh.load(out, file_type="ply", process=False)
    for box in (0, 1):
        near = [np.abs(np.asarray(mesh.vertices) - corner).sum(1).min() for corner in corners(truth, box, 60)]
        assert max(near) < 1e-5


def test_every_solid_of_the_ply_has_its_colour(session: Session, out: Path) -> None:
    exported(ply.FORMAT, session, out, frame="60", points="0", skeleton="false")
    mesh = trimesh.load(out, file_type="ply", process=False)
    colors = {tuple(color[:3]) for color in np.asarray(mesh.visual.vertex_colors).tolist()}
    things = things_of(session)
    assert {things["o2"].color, things["o3"].color} <= colors
    # two boxes and the table's four corners
    assert len(mesh.vertices) == 8 + 8 + 4
    assert len(mesh.faces) == 12 + 12 + 2


def test_boxes_are_closed_and_face_outwards(session: Session) -> None:
    scene = still(session, "it", StillOptions(frame=60, points=0))
    for solid in scene.solids:
        if solid.name in {"Shell", "Stella Artois"}:
            box = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
            assert box.is_watertight
            assert box.volume == pytest.approx(0.1524**3)


def test_the_table_is_seen_from_above(session: Session) -> None:
    (table,) = (s for s in still(session, "it", StillOptions(frame=60, points=0)).solids if s.name == "table")
    mesh = trimesh.Trimesh(table.vertices, table.faces, process=False)
    assert (np.asarray(mesh.face_normals)[:, 2] > 0.99).all()


def test_points_lie_on_what_was_seen(filmed: tuple[Session, GroundTruth]) -> None:
    """The generated depth image is exact to some millimetres, and so are the points on the table and on the blocks."""
    session, truth = filmed
    scene = still(session, "it", StillOptions(frame=60, skeleton=False))
    assert scene.reference == "table"
    middle = (np.abs(scene.points[:, :2]) < [0.5, 0.3]).all(1)
    on_table = scene.points[middle & (np.abs(scene.points[:, 2]) < 0.03)]
    assert len(on_table) > 100
    assert np.abs(on_table[:, 2]).mean() < 0.006
    depth_at_60 = 60 - 60 % 3
    for box in (0, 1):
        pose = Rigid.from_quaternion(truth.quaternion[box, depth_at_60], truth.position[box, depth_at_60])
        inside = np.abs(pose.inverse().apply(scene.points)) < 0.1524 / 2 + 0.01
        assert inside.all(1).sum() > 20


def test_points_have_the_colours_of_the_image(session: Session) -> None:
    scene = still(session, "it", StillOptions(frame=60))
    with open_images(session, "color") as images:
        (image,) = images.read([60])
    there = {tuple(color) for color in image[..., ::-1].reshape(-1, 3).tolist()}
    seen = [tuple(color) in there for color in scene.colors.tolist()]
    assert np.mean(seen) > 0.5
    assert set(map(tuple, scene.colors[~np.array(seen)].tolist())) <= {(170, 170, 170)}


def test_no_more_points_than_asked_for(session: Session) -> None:
    scene = still(session, "it", StillOptions(frame=60, points=1000))
    assert 500 <= len(scene.points) <= 1000
    assert any("was kept" in line for line in scene.findings)


# ---------------------------------------------------------------------------------------------------- GLB


def document(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    n, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert n % 4 == 0
    m, kind = struct.unpack_from("<I4s", data, 20 + n)
    assert (kind, 28 + n + m) == (b"BIN\0", len(data))
    return json.loads(data[20 : 20 + n])


def test_blocks_stand_in_the_glb_by_name_with_y_up(filmed: tuple[Session, GroundTruth], out: Path) -> None:
    session, truth = filmed
    exported(glb.FORMAT, session, out, frame="60")
    scene = trimesh.load(out, file_type="glb")
    assert set(scene.geometry) == {"table", "Shell", "Stella Artois", "Performer 1", "points"}
    for box, name in enumerate(("Shell", "Stella Artois")):
        matrix, geometry = scene.graph.get(name)
        placed = trimesh.transform_points(scene.geometry[geometry].vertices, matrix)
        x, y, z = corners(truth, box, 60).T
        assert rows(placed) == rows(np.column_stack([x, z, -y]))


def test_the_glb_says_which_moment_it_is(session: Session, out: Path) -> None:
    told = exported(glb.FORMAT, session, out, time_s="2")
    extras = document(out)["scenes"][0]["extras"]
    assert extras["session"] == session.name
    assert abs(extras["t_ns"] - 2e9) < 20e6
    assert any(f"frame {extras['frame']} (" in line for line in told)


def test_colours_are_linear_light(session: Session, out: Path) -> None:
    exported(glb.FORMAT, session, out, frame="60", points="0", skeleton="false")
    found = document(out)
    color = things_of(session)["o2"].color
    (material,) = (m for m in found["materials"] if m["name"] == "Shell")
    expected = [((c / 255 + 0.055) / 1.055) ** 2.4 for c in color]
    np.testing.assert_allclose(material["pbrMetallicRoughness"]["baseColorFactor"], [*expected, 1])
    assert "extensionsUsed" not in found


def test_parts_of_the_buffer_are_aligned_and_inside(session: Session, out: Path) -> None:
    exported(glb.FORMAT, session, out, frame="60", points="999")
    found = document(out)
    views, size = found["bufferViews"], found["buffers"][0]["byteLength"]
    assert all(view["byteOffset"] % 4 == 0 for view in views)
    assert all(view["byteOffset"] + view["byteLength"] <= size for view in views)
    for accessor in found["accessors"]:
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]] * 4
        assert views[accessor["bufferView"]]["byteLength"] == width * accessor["count"]


# ---------------------------------------------------------------------------------------------------- moments


def test_by_default_it_is_the_first_moment_that_shows_most(session: Session) -> None:
    assert still(session, "it", StillOptions(points=0)).frame == 0


def test_a_block_that_is_not_known_is_named(session: Session) -> None:
    scene = still(session, "it", StillOptions(frame=HIDDEN[3], points=0))
    assert "Shell" not in {solid.name for solid in scene.solids}
    assert any("Shell is not there" in line for line in scene.findings)


@pytest.mark.parametrize(
    "options",
    [StillOptions(frame=10**6), StillOptions(time_s=1e6), StillOptions(frame=1, time_s=1.0)],
    ids=["frame", "time", "both"],
)
def test_a_moment_that_is_not_there_is_a_wrong_call(session: Session, options: StillOptions) -> None:
    with pytest.raises(UsageError):
        still(session, "it", options)


def test_a_session_without_anything_in_space_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        still(bare(tmp_path / "s"), "it", StillOptions())
    with pytest.raises(UsageError, match="scene"):
        still(bare(tmp_path / "t"), "it", StillOptions(time_s=0.0))


def test_open3d_reads_the_same_ply(session: Session, out: Path) -> None:
    open3d = pytest.importorskip("open3d")
    path = out.with_suffix(".ply")
    exported(ply.FORMAT, session, path, frame="60", points="500")
    scene = still(session, "it", StillOptions(frame=60, points=500))
    mesh = open3d.io.read_triangle_mesh(str(path))
    assert len(mesh.triangles) == sum(len(solid.faces) for solid in scene.solids)
    cloud = np.asarray(open3d.io.read_point_cloud(str(path)).points)
    np.testing.assert_allclose(cloud[-len(scene.points) :], scene.points, atol=1e-5)
    assert table_fits(session) is not None
