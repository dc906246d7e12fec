"""Tables of what was recorded, or came with a recording."""

from __future__ import annotations

import pyarrow as pa

from ecat.tables.columns import FRAME, NAME, OBJECT, T_NS, Column, TableSchema, numbers

FRAMES = TableSchema(
    "frames",
    "The recorded clock: the device time of every frame of every stream.",
    (
        Column("t_ns", pa.int64(), "time since the session's start", "ns"),
        Column("frame", pa.int32(), "image of the stream, from zero"),
        Column("stream", NAME, "the stream"),
    ),
    ("t_ns", "stream"),
)
IMU = TableSchema(
    "imu",
    "Readings of an inertial sensor, each with its own device time.",
    (
        Column("t_ns", pa.int64(), "time since the session's start", "ns"),
        Column("sensor", NAME, "accelerometer or gyroscope"),
        *numbers("x y z", "specific force (accelerometer) or angular velocity", "m/s^2 or rad/s", "imu"),
    ),
    ("t_ns", "sensor"),
)
CAMERA_POSES = TableSchema(
    "camera_poses",
    "Where a moving camera was, as the source tracked or computed it.",
    (
        T_NS,
        Column(
            "frame", pa.int32(), "image of the annotated video, from zero; null: between images", "", "", True
        ),
        Column("camera", NAME, "the camera, or its stream where the camera is unknown"),
        *numbers("x y z", "position of the camera", "m", "world"),
        *numbers("qx qy qz qw", "rotation from the camera, unit quaternion", "", "world"),
    ),
    ("t_ns", "frame"),
)
_MARK = (
    T_NS,
    FRAME,
    OBJECT,
    Column(
        "order", pa.int16(), "position of the face in its marker; null: a marker without faces", "", "", True
    ),
    Column("present", pa.bool_(), "false: the object is absent from this frame on"),
    Column("glyph_size", pa.int16(), "cells along one side of the marker's code", "cells", "", True),
    Column(
        "code", NAME, "the cells as read, row by row, 1 = white; null: a marker without faces", "", "", True
    ),
    Column(
        "code_text",
        pa.string(),
        "the code as the source wrote it, where that is not its usual form",
        "",
        "",
        True,
    ),
    Column(
        "corners_text",
        pa.string(),
        "the corners as the source wrote them, where not in their usual form",
        "",
        "",
        True,
    ),
)
MARKERS_2D = TableSchema(
    "markers_2d",
    "Marker faces in the colour image: four corners each, clockwise on screen, the smallest u + v first.",
    (*_MARK, *numbers("u0_px v0_px u1_px v1_px u2_px v2_px u3_px v3_px", "corner", "px", "colour image")),
    ("frame", "object_id", "order"),
)
MARKERS_3D = TableSchema(
    "markers_3d",
    "Marker faces in space, as mapped through depth; the order of the corners is independent of that in markers_2d.",
    (*_MARK, *numbers("x0 y0 z0 x1 y1 z1 x2 y2 z2 x3 y3 z3", "corner", "m", "camera/depth")),
    ("frame", "object_id", "order"),
)
JOINTS = TableSchema(
    "joints",
    "Skeleton joints: one row per joint, body and frame.",
    (
        T_NS,
        FRAME,
        Column("object_id", NAME, "the annotated rig; null where the body has none", "", "", True),
        Column("body", pa.int8(), "the sensor's body slot"),
        Column("joint", NAME, "name of the joint"),
        *numbers("x y z", "position", "m", "camera/depth"),
        *numbers("u_px v_px", "position in the colour image", "px", "colour image"),
        Column("state", NAME, "tracked, inferred or not_tracked", "", "", True),
    ),
    ("frame", "body", "joint"),
)
