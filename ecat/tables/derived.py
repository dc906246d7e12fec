"""Tables that stages make."""

from __future__ import annotations

import pyarrow as pa

from ecat.tables.columns import FRAME, INTERVAL, NAME, OBJECT, T_NS, Column, TableSchema, numbers

_POSE = (
    T_NS,
    FRAME,
    OBJECT,
    *numbers("x y z", "centre of the box", "m", "table"),
    *numbers("qx qy qz qw", "orientation of the box's axes, unit quaternion", "", "table"),
    Column("source", NAME, "observed, interpolated, or null where nothing is known", "", "", True),
    Column("support", NAME, "table: resting on it; free: lifted or tilted", "", "", True),
    Column("n_faces", pa.int16(), "marker faces that took part", "", "", True),
    Column(
        "residual_px",
        pa.float64(),
        "root mean square reprojection error of the inlier corners",
        "px",
        "",
        True,
    ),
    Column("sigma_m", pa.float64(), "one standard deviation of the position (per axis)", "m", "", True),
    Column("sigma_rad", pa.float64(), "one standard deviation of the rotation (per axis)", "rad", "", True),
    Column(
        "covariance",
        pa.list_(pa.float64(), 21),
        "upper triangle, row by row, of the covariance of x, y, z and the turns about the table's x, y, z axes",
        "m^2, m rad, rad^2",
        "table",
        True,
    ),
    Column(
        "alternative",
        pa.list_(pa.float64(), 7),
        "x, y, z, qx, qy, qz, qw of the other pose that explains the frame nearly as well; null: the pose is certain",
        "m",
        "table",
        True,
    ),
)
POSES = TableSchema(
    "poses",
    "Pose of every box at every frame, each solved from that frame alone.",
    _POSE,
    ("frame", "object_id"),
)
POSES_SMOOTH = TableSchema(
    "poses_smooth",
    "Pose of every box at every frame, smoothed in time without lag, short gaps filled.",
    _POSE,
    ("frame", "object_id"),
)
FACE_PLANES = TableSchema(
    "face_planes",
    "Planes through the depth inside marker faces: n.p + d = 0 with n towards the camera.",
    (
        T_NS,
        FRAME,
        OBJECT,
        Column("order", pa.int16(), "position of the face in its marker, as in markers_2d"),
        *numbers("nx ny nz", "unit normal", "", "camera/depth"),
        *numbers("d", "offset", "m", "camera/depth"),
        *numbers("sigma_m", "one standard deviation of the plane's distance at the face's corners", "m", ""),
        *numbers("rms_m", "distance of the pixels from the plane, along the sight line", "m", ""),
        Column("n_points", pa.int32(), "depth pixels used"),
    ),
    ("frame", "object_id", "order"),
)
TABLE_PLANE = TableSchema(
    "table_plane",
    "The table: plane n.p + d = 0 with n towards the camera, and the pose of the table frame; a row per fit.",
    (
        T_NS,
        FRAME,
        *numbers("nx ny nz", "unit normal", "", "camera/depth"),
        *numbers("d", "offset", "m", "camera/depth"),
        *numbers("origin_x origin_y origin_z", "origin of the table frame", "m", "camera/depth"),
        *numbers("qx qy qz qw", "rotation from the table frame, unit quaternion", "", "camera/depth"),
        *numbers("rms_m max_m", "distance of the inliers from the plane", "m", "camera/depth"),
        Column("n_points", pa.int32(), "points offered"),
        Column("n_inliers", pa.int32(), "points used"),
        Column("evidence", NAME, "polygon, boxes, polygon+boxes, depth, or one of these with +depth"),
        Column(
            "tie",
            NAME,
            "what the table frame has in common with that of the row before: boxes that stood still, or the outline; "
            "null: nothing, so that places before and after are not comparable",
            "",
            "",
            True,
        ),
    ),
    ("frame",),
)
TABLE_OUTLINE = TableSchema(
    "table_outline",
    "The table's convex outline on its plane, anticlockwise seen from above; for every row of table_plane from depth.",
    (
        T_NS,
        FRAME,
        Column("vertex", pa.int16(), "position of the corner in the outline"),
        *numbers("x y z", "corner", "m", "camera/depth"),
    ),
    ("frame", "vertex"),
)
TRACKS_2D = TableSchema(
    "tracks_2d",
    "Shapes drawn by a person, followed through the images that were not drawn: one row per vertex and image.",
    (
        T_NS,
        FRAME,
        OBJECT,
        Column("vertex", pa.int16(), "position of the vertex in the shape"),
        *numbers("u_px v_px", "the vertex", "px", "colour image"),
        Column("confidence", pa.float64(), "how sure the shape is, 0 to 1"),
        Column("status", NAME, "drawn by a person, tracked, or proposed where confidence is low"),
    ),
    ("frame", "object_id", "vertex"),
)
HULLS = TableSchema(
    "hulls",
    "Convex hulls of what is seen of objects without markers, from depth: one row per corner and image.",
    (
        T_NS,
        FRAME,
        OBJECT,
        Column("vertex", pa.int16(), "position of the corner in the hull, in no particular order"),
        *numbers("x y z", "corner", "m", "camera/depth"),
        Column("status", NAME, "of the shape in tracks_2d: drawn, tracked or proposed"),
    ),
    ("frame", "object_id", "vertex"),
)
_CONFIDENCE = Column("confidence", pa.float64(), "how sure the stage is, 0 to 1")
RELATION_PROPOSALS = TableSchema(
    "relation_proposals",
    "Relations computed from geometry, each with the interval in which it holds (docs/relations.md).",
    (
        Column("predicate", NAME, "the relation"),
        Column("arguments", pa.list_(pa.string()), "object ids"),
        Column("polarity", pa.bool_(), "true: holds; false: denied"),
        *INTERVAL,
        _CONFIDENCE,
    ),
    ("start_frame", "predicate"),
)
EVENT_PROPOSALS = TableSchema(
    "event_proposals",
    "Events computed from geometry: actions, and their parts as rows of their own (docs/relations.md).",
    (
        Column("event_id", pa.string(), "identifier in this table"),
        Column("parent", pa.string(), "the action that this is a part of; null: an action", "", "", True),
        Column("type", NAME, "slide, move, set or one of them with _<way>; grasp, hold, release"),
        Column("text", pa.string(), "description"),
        *INTERVAL,
        OBJECT,
        Column("hand", NAME, "the grasping hand, rig/joint; null: not known", "", "", True),
        Column("landmark", NAME, "the standing object nearest to the way", "", "", True),
        _CONFIDENCE,
    ),
    ("start_frame", "event_id"),
)
