"""What lies in space: cameras, the table, boxes with their orientation and their paths.

The world of the view is the ``table`` frame (z up); what the sensors measured hangs below ``/world/camera``,
whose transform takes ``camera/depth`` to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.records import depth_from_camera
from ecat.geometry.transforms import Floats, Rigid, matrix_from_quaternion
from ecat.model import Camera, Manifest
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
    rgba,
    rows_per_frame,
    static,
    strips,
    temporal,
    texts,
    ui_points,
)
from ecat.view.streams import depth_step, reduced, shown_streams

if TYPE_CHECKING:
    from rerun.chunk import Chunk

# without a table the camera is taken to look straight ahead: right, down, forward turn to right, forward, up
UPRIGHT = Rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
_NEAR_PLANE_M = 0.1
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


def world(
    table_plane: pa.Table | None, timebase: Timebase, travelled: tuple[Frames, Rigid] | None = None
) -> Iterator[Chunk]:
    """The world's axes, and where the depth camera stands; the table's first fit holds from the start.

    Without a table the camera starts upright, and moves as ``travelled`` (:func:`travels`) where that is known.
    """
    import rerun as rr

    yield static(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    if table_plane is not None and table_plane.num_rows:
        frames, pose = table_from_camera(table_plane)
        frames[0] = 0
    elif travelled is not None:
        frames, pose = travelled[0], UPRIGHT @ travelled[1]
    else:
        yield static(CAMERA, rr.Transform3D(translation=UPRIGHT.translation, mat3x3=UPRIGHT.rotation))
        return
    columns = rr.Transform3D.columns(translation=pose.translation, quaternion=pose.quaternion)
    yield temporal(CAMERA, timebase, frames, columns)


def travels(camera_poses: pa.Table, manifest: Manifest, timebase: Timebase) -> tuple[Frames, Rigid] | None:
    """Frames (n,) and poses (n,) of ``camera/depth`` relative to its first one; None where nothing can be placed."""
    place = Rigid.from_quaternion(numbers(camera_poses, "qx qy qz qw"), numbers(camera_poses, "x y z"))
    frames, t_ns = numbers(camera_poses, "frame t_ns").T
    if timebase.t_ns is not None:
        between = np.isnan(frames) & np.isfinite(t_ns)
        frames[between] = timebase.frames_at(t_ns[between].astype(np.int64))
    names = texts(camera_poses, "camera")
    kept = np.isfinite(frames) & finite(place.translation) & finite(place.rotation) & (names == names[0])
    if not kept.any():
        return None
    at, first = np.unique(frames[kept].astype(np.int64), return_index=True)
    place = Rigid(place.rotation[kept][first], place.translation[kept][first])
    model = manifest.camera(str(names[0]))
    world_from_depth = place if model is None else place @ depth_from_camera(manifest, model).inverse()
    start = Rigid(world_from_depth.rotation[0], world_from_depth.translation[0]).inverse()
    return at, start @ world_from_depth


def camera_path(start: Rigid, travelled: Rigid) -> Chunk:
    """The way of the depth camera from ``start`` (its first pose in the world) on."""
    import rerun as rr

    way = start.apply(travelled.translation)
    return static(
        f"{WORLD}/camera_path", rr.LineStrips3D([way], colors=[rgba((120, 128, 138))], radii=[ui_points(1.2)])
    )


def depth_outlines(outline: pa.Table, timebase: Timebase) -> Iterator[Chunk]:
    """The table's edge as it was found in depth (table ``table_outline``), from each fit on, ``camera/depth``."""
    import rerun as rr

    frames, points = integers(outline, "frame"), numbers(outline, "x y z")
    at = np.unique(frames)
    rings = [points[(frames == frame) & finite(points)] for frame in at]
    at[0] = 0
    path = f"{CAMERA}/table_outline"
    yield static(path, rr.LineStrips3D.from_fields(colors=[rgba((110, 120, 134))], radii=[ui_points(1.2)]))
    closed = [np.concatenate([ring, ring[:1]]) for ring in rings]
    yield temporal(path, timebase, at, rr.LineStrips3D.columns(strips=closed))


def camera(model: Camera, path: str, place: Rigid, distance_m: float = 0.25) -> Iterator[Chunk]:
    """A camera's ``place`` below ``/world/camera`` (from the camera to ``camera/depth``) and its projection.

    A mirrored image runs against the camera's x axis: a camera whose x axis points left in the image.
    """
    import rerun as rr

    axes = rr.ViewCoordinates.LDF if model.mirrored else rr.ViewCoordinates.RDF
    yield static(
        path, rr.Transform3D(translation=place.translation, quaternion=rr.Quaternion(xyzw=place.quaternion))
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
    """The annotated video's camera, and those of all images that are there: of depth as they are shown."""
    color = color_camera(manifest)
    if color is not None:
        yield from camera(color, IMAGE, depth_from_camera(manifest, color))
    for shown in shown_streams(manifest):
        model = shown.camera
        # infrared images come from the depth camera, which is there already
        if model is None or shown.path == IMAGE or shown.stream.kind == "infrared":
            continue
        if shown.stream.kind == "depth":
            model = reduced(model, depth_step(model.width_px))
        yield from camera(model, shown.path, depth_from_camera(manifest, model))


def border(width_px: int, height_px: int) -> Chunk:
    """The image's edge, so that marks without a video still have a place."""
    import rerun as rr

    corners = np.array([[[0, 0], [width_px, 0], [width_px, height_px], [0, height_px], [0, 0]]], float)
    return static(
        f"{IMAGE}/border", rr.LineStrips2D(strips(corners), colors=[rgba((90, 96, 104))], radii=[1.0])
    )


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
