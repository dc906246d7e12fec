"""What lies in space: cameras, the table, marker faces, boxes with their orientation, skeletons.

The world of the view is the ``table`` frame (z up); what the sensors measured hangs below ``/world/camera``,
whose transform takes ``camera/depth`` to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model import Camera, Manifest
from ecat.view.image import key_shapes, kind_of_objects, outline, shape_part
from ecat.view.media import DEPTH_STEP, reduced
from ecat.view.scene import (
    CAMERA,
    FREE,
    IMAGE,
    UNOBSERVED,
    WORLD,
    Frames,
    Rgb,
    Scene,
    Thing,
    Timebase,
    by_object,
    finite,
    integers,
    numbers,
    pale,
    rgba,
    rows_per_frame,
    static,
    strips,
    temporal,
    texts,
    ui_points,
)

if TYPE_CHECKING:
    from rerun.chunk import Chunk

# without a table the camera is taken to look straight ahead: right, down, forward turn to right, forward, up
UPRIGHT = Rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
_NEAR_PLANE_M = 0.1
_RING = np.array([0, 1, 2, 3, 0])
_AXIS_COLORS = np.array([0xFF5C5CFF, 0x5CE07AFF, 0x5C9CFFFF], np.uint32)


def table_from_camera(table_plane: pa.Table) -> tuple[Frames, Rigid]:
    """Frames (fits,) and transforms (fits,) from ``camera/depth`` to ``table`` of table ``table_plane``."""
    camera_from_table = Rigid.from_quaternion(
        numbers(table_plane, "qx qy qz qw"), numbers(table_plane, "origin_x origin_y origin_z")
    )
    return integers(table_plane, "frame"), camera_from_table.inverse()


def first_table_from_camera(table_plane: pa.Table) -> Rigid:
    """The first of :func:`table_from_camera`."""
    _, pose = table_from_camera(table_plane)
    return Rigid(pose.rotation[0], pose.translation[0])


def world(table_plane: pa.Table | None, timebase: Timebase) -> Iterator[Chunk]:
    """The world's axes, and where the depth camera stands; the table's first fit holds from the start."""
    import rerun as rr

    yield static(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    if table_plane is None or not table_plane.num_rows:
        yield static(CAMERA, rr.Transform3D(translation=UPRIGHT.translation, mat3x3=UPRIGHT.rotation))
        return
    frames, pose = table_from_camera(table_plane)
    frames[0] = 0
    columns = rr.Transform3D.columns(translation=pose.translation, quaternion=pose.quaternion)
    yield temporal(CAMERA, timebase, frames, columns)


def camera(model: Camera, path: str, distance_m: float = 0.25) -> Iterator[Chunk]:
    """A camera's place below ``/world/camera`` and its projection.

    A mirrored image runs against the camera's x axis: a camera whose x axis points left in the image.
    """
    import rerun as rr

    axes = rr.ViewCoordinates.LDF if model.mirrored else rr.ViewCoordinates.RDF
    yield static(
        path, rr.Transform3D(translation=model.translation_m, quaternion=rr.Quaternion(xyzw=model.rotation))
    )
    yield static(
        path,
        rr.Pinhole(
            focal_length=[model.fx_px, model.fy_px],
            principal_point=[model.cx_px, model.cy_px],
            width=model.width_px,
            height=model.height_px,
            camera_xyz=axes,
            image_plane_distance=distance_m,
            color=[120, 128, 138],
        ),
    )


def cameras(manifest: Manifest) -> Iterator[Chunk]:
    """The colour camera, and where there are depth images the depth camera as reduced as they are shown."""
    color = color_camera(manifest)
    if color is not None:
        yield from camera(color, IMAGE)
    for stream in manifest.streams:
        model = manifest.camera(stream.camera)
        if stream.kind == "depth" and stream.present and model is not None:
            yield from camera(reduced(model, DEPTH_STEP), f"{CAMERA}/depth")
            return


def color_camera(manifest: Manifest) -> Camera | None:
    """The camera of the annotated video."""
    names = [stream.camera for stream in manifest.streams if stream.kind == "color"]
    return next((found for name in [*names, "color"] if (found := manifest.camera(name))), None)


def table_outline(drawn: Floats, poses: Floats, margin_m: float = 0.1) -> Floats:
    """A convex ring (n, 2) in the ``table`` frame, metres, to draw the table by, anticlockwise from above.

    Around the corners (n, 3) that were ``drawn`` on the table and the boxes' centres ``poses`` (n, 3); if
    there is neither, half a metre around the origin.
    """
    import cv2

    on_table = drawn[np.abs(drawn[:, 2]) < _NEAR_PLANE_M][:, :2]
    flat = poses[finite(poses)][:, :2]
    if len(flat):
        # a box that was thrown or misread must not stretch the table to the next room
        low, high = np.percentile(flat, [1, 99], axis=0)
        flat = flat[((flat >= low) & (flat <= high)).all(axis=1)]
    elif not len(on_table):
        flat = np.zeros((1, 2))
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (margin_m if len(flat) > 1 else 0.5)
    points = np.concatenate([on_table, (flat[:, None] + square).reshape(-1, 2)])
    return cv2.convexHull(points.astype(np.float32), clockwise=False)[:, 0].astype(float)


def table_surface(ring: Floats) -> Iterator[Chunk]:
    """The table: a convex surface with edge ``ring`` (n, 2) at z = 0 of the world, and its frame's axes."""
    import rerun as rr

    n = len(ring)
    corners = np.column_stack([ring, np.zeros(n)])
    yield static(
        f"{WORLD}/table",
        rr.Mesh3D(
            # a millimetre lower, so that what lies on the table is not drawn half inside it
            vertex_positions=corners - [0, 0, 0.001],
            triangle_indices=[[0, i, i + 1] for i in range(1, n - 1)],
            vertex_normals=np.tile([0.0, 0.0, 1.0], (n, 1)),
            albedo_factor=(58, 64, 74),
        ),
    )
    closed = np.concatenate([corners, corners[:1]])
    yield static(
        f"{WORLD}/table/edge",
        rr.LineStrips3D(strips(closed[None]), colors=[rgba((110, 120, 134))], radii=[0.0015]),
    )
    yield static(
        f"{WORLD}/table/axes",
        rr.Arrows3D(vectors=np.eye(3) * 0.1, origins=np.zeros((3, 3)), colors=_AXIS_COLORS, radii=[0.002]),
    )


def markers_3d(table: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Marker faces as measured through depth (table ``markers_3d``), quadrilaterals in ``camera/depth``."""
    import rerun as rr

    for object_id, rows in by_object(table):
        corners = numbers(rows, "x0 y0 z0 x1 y1 z1 x2 y2 z2 x3 y3 z3").reshape(-1, 4, 3)
        seen = finite(corners)
        frames, counts = rows_per_frame(integers(rows, "frame")[seen], scene.timebase.n_frames)
        thing = scene.thing(object_id)
        path = f"{CAMERA}/markers/{thing.part}"
        yield static(
            path,
            rr.LineStrips3D.from_fields(colors=[rgba(pale(thing.color))], radii=[ui_points(1.2)]),
        )
        yield temporal(
            path,
            scene.timebase,
            frames,
            rr.LineStrips3D.columns(strips=strips(corners[seen][:, _RING])).partition(counts),
        )


def shapes_3d(keyframes: pa.Table, objects: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Drawn shapes (tables ``keyframes``, ``objects``) in ``camera/depth``; each stays until the next one."""
    import rerun as rr

    kinds = kind_of_objects(objects)
    solid = keyframes.filter(pa.array(integers(keyframes, "dimensions") == 3))
    for layer in np.unique(texts(solid, "layer")):
        mine = solid.filter(pa.array(texts(solid, "layer") == layer))
        for object_id, rows in by_object(mine):
            thing = scene.thing(object_id)
            kind = kinds.get((str(layer), object_id), "other")
            keys = [(frame, outline(kind, shape)) for frame, shape in key_shapes(rows, 3)]
            path = f"{CAMERA}/shapes/{shape_part(str(layer), thing.part)}"
            style = rr.LineStrips3D.from_fields(
                colors=[rgba(thing.color)], radii=[ui_points(1.5)], labels=[thing.name]
            )
            yield static(path, style)
            columns = rr.LineStrips3D.columns(strips=[line for _, line in keys if len(line)])
            counts = [int(len(line) > 0) for _, line in keys]
            yield temporal(
                path, scene.timebase, np.array([f for f, _ in keys], np.int64), columns.partition(counts)
            )


def pose_state(
    source: NDArray[np.str_], support: NDArray[np.str_], known: NDArray[np.bool_]
) -> NDArray[np.str_]:
    """What is known of a box at each row: ``table``, ``free``, ``interpolated``, or nothing."""
    state = np.where(source == "interpolated", "interpolated", np.where(support == "free", "free", "table"))
    return np.where(known, state, "")


def state_color(state: str, thing: Thing) -> tuple[Rgb, int]:
    """Colour and opacity of a box: its own on the table, amber when free, pale grey when interpolated."""
    if state == "interpolated":
        return UNOBSERVED, 150
    return (FREE if state == "free" else thing.color), 255


def boxes(poses: pa.Table, scene: Scene) -> Iterator[Chunk]:
    """Boxes (table ``poses`` or ``poses_smooth``), ``table`` frame: body, face axes, the path that it took.

    A row without a pose removes the box from that frame on.  A box of unknown size shows its axes alone.
    """
    for object_id, rows in by_object(poses):
        thing = scene.thing(object_id)
        centre, quaternion = numbers(rows, "x y z"), numbers(rows, "qx qy qz qw")
        known = finite(centre) & finite(quaternion)
        states = pose_state(texts(rows, "source"), texts(rows, "support"), known)
        at = integers(rows, "frame")
        frames, counts = rows_per_frame(at[known], scene.timebase.n_frames)
        if thing.size_m is not None:
            yield from _body(
                thing, scene.timebase, frames, counts, (centre[known], quaternion[known], states[known])
            )
        yield from _axes(thing, scene.timebase, frames, counts, (centre[known], quaternion[known]))
        yield from _path(thing, scene.timebase, at[known], centre[known])


def _body(
    thing: Thing,
    timebase: Timebase,
    frames: Frames,
    counts: NDArray[np.int64],
    poses: tuple[Floats, Floats, NDArray[np.str_]],
) -> Iterator[Chunk]:
    import rerun as rr

    centre, quaternion, states = poses
    path = f"{WORLD}/boxes/{thing.part}"
    yield static(
        path,
        rr.Boxes3D.from_fields(
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
            radii=[ui_points(1.2)],
            labels=[thing.name],
        ),
    )
    number = {state: rgba(*state_color(state, thing)) for state in np.unique(states)}
    columns = rr.Boxes3D.columns(
        centers=centre,
        quaternions=quaternion,
        half_sizes=np.tile(np.array(thing.size_m) / 2, (len(centre), 1)),
        colors=np.array([number[state] for state in states], np.uint32),
    )
    yield temporal(path, timebase, frames, columns.partition(counts))


def _axes(
    thing: Thing, timebase: Timebase, frames: Frames, counts: NDArray[np.int64], poses: tuple[Floats, Floats]
) -> Iterator[Chunk]:
    """An arrow out of each positive face: x red, y green, z blue."""
    import rerun as rr

    centre, quaternion = poses
    half = np.array(thing.size_m or (0.0, 0.0, 0.0)) / 2
    axes = np.swapaxes(matrix_from_quaternion(quaternion), -1, -2)
    path = f"{WORLD}/boxes/{thing.part}/axes"
    length = 0.4 * half.max() if half.any() else 0.05
    yield static(path, rr.Arrows3D.from_fields(colors=_AXIS_COLORS, radii=[0.05 * length]))
    columns = rr.Arrows3D.columns(
        vectors=(axes * length).reshape(-1, 3),
        origins=(centre[:, None] + axes * half[:, None]).reshape(-1, 3),
    )
    yield temporal(path, timebase, frames, columns.partition(counts * 3))


def _path(thing: Thing, timebase: Timebase, at: Frames, centre: Floats) -> Iterator[Chunk]:
    """A line from each frame's position to the next one's; the blueprint shows the last few seconds."""
    import rerun as rr

    steps = np.stack([centre[:-1], centre[1:]], 1)[np.diff(at) == 1]
    path = f"{WORLD}/paths/{thing.part}"
    frames, counts = rows_per_frame(at[1:][np.diff(at) == 1], timebase.n_frames)
    yield static(path, rr.LineStrips3D.from_fields(colors=[rgba(thing.color, 160)], radii=[ui_points(1.0)]))
    yield temporal(path, timebase, frames, rr.LineStrips3D.columns(strips=strips(steps)).partition(counts))
