"""Every Arrow schema of a session, declared once: column, type, unit, frame of reference, meaning.

``schemas/tables/*.json`` is generated from this file.  Tables are tidy and long, sorted by their ``order`` columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pyarrow as pa

SCHEMA_VERSION = 1
ROW_GROUP_ROWS = 65_536

_NAME = pa.dictionary(pa.int32(), pa.string())


@dataclass(frozen=True, slots=True)
class Column:
    """One column: Arrow type, what it means, its unit and frame of reference, and whether it may be null."""

    name: str
    type: pa.DataType
    meaning: str
    unit: str = ""
    reference: str = ""
    nullable: bool = False


@dataclass(frozen=True, slots=True)
class TableSchema:
    """One table: its columns, in order, and the columns that its rows are sorted by."""

    name: str
    meaning: str
    columns: tuple[Column, ...]
    order: tuple[str, ...] = ()

    @property
    def arrow(self) -> pa.Schema:
        """The Arrow schema, each field with its meaning, unit and reference as metadata."""
        return _arrow(self)

    def to_dict(self) -> dict[str, object]:
        """The schema as JSON-able data."""
        return {
            "name": self.name,
            "schema_version": SCHEMA_VERSION,
            "meaning": self.meaning,
            "order": list(self.order),
            "columns": [
                {
                    "name": c.name,
                    "type": str(c.type),
                    "nullable": c.nullable,
                    "unit": c.unit,
                    "reference": c.reference,
                    "meaning": c.meaning,
                }
                for c in self.columns
            ],
        }


@cache
def _arrow(schema: TableSchema) -> pa.Schema:
    return pa.schema(
        [
            pa.field(
                c.name,
                c.type,
                nullable=c.nullable,
                metadata={"meaning": c.meaning, "unit": c.unit, "reference": c.reference},
            )
            for c in schema.columns
        ],
        metadata={"ecat.table": schema.name, "ecat.schema_version": str(SCHEMA_VERSION)},
    )


_T_NS = Column(
    "t_ns", pa.int64(), "time since the session's start; null where the session has no clock", "ns", "", True
)
_FRAME = Column("frame", pa.int32(), "image of the annotated video, from zero")
_OBJECT = Column("object_id", _NAME, "the annotated object")
_LAYER = Column("layer", _NAME, "the annotation layer")
_EVENT = Column("event_id", pa.string(), "the event")
_INTERVAL = (
    Column("start_frame", pa.int32(), "first image of the interval"),
    Column("end_frame", pa.int32(), "first image after the interval; null: to the end", "", "", True),
    Column("start_ns", pa.int64(), "start of the interval", "ns", "", True),
    Column("end_ns", pa.int64(), "end of the interval", "ns", "", True),
)


def _numbers(names: str, meaning: str, unit: str, reference: str) -> tuple[Column, ...]:
    return tuple(
        Column(name, pa.float64(), f"{meaning}: {name}", unit, reference, nullable=True)
        for name in names.split()
    )


_MARK = (
    _T_NS,
    _FRAME,
    _OBJECT,
    Column(
        "order", pa.int16(), "position of the face in its marker; null: a marker without faces", "", "", True
    ),
    Column("present", pa.bool_(), "false: the object is absent from this frame on"),
    Column("glyph_size", pa.int16(), "cells along one side of the marker's code", "cells", "", True),
    Column(
        "code", _NAME, "the cells as read, row by row, 1 = white; null: a marker without faces", "", "", True
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

_POSE = (
    _T_NS,
    _FRAME,
    _OBJECT,
    *_numbers("x y z", "centre of the box", "m", "table"),
    *_numbers("qx qy qz qw", "orientation of the box's axes, unit quaternion", "", "table"),
    Column("source", _NAME, "observed, interpolated, or null where nothing is known", "", "", True),
    Column("support", _NAME, "table: resting on it; free: lifted or tilted", "", "", True),
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

MARKERS_2D = TableSchema(
    "markers_2d",
    "Marker faces in the colour image: four corners each, clockwise on screen, the smallest u + v first.",
    (*_MARK, *_numbers("u0_px v0_px u1_px v1_px u2_px v2_px u3_px v3_px", "corner", "px", "colour image")),
    ("frame", "object_id", "order"),
)
MARKERS_3D = TableSchema(
    "markers_3d",
    "Marker faces in space, as mapped through depth; the order of the corners is independent of that in markers_2d.",
    (*_MARK, *_numbers("x0 y0 z0 x1 y1 z1 x2 y2 z2 x3 y3 z3", "corner", "m", "camera/depth")),
    ("frame", "object_id", "order"),
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
        _T_NS,
        _FRAME,
        _OBJECT,
        Column("order", pa.int16(), "position of the face in its marker, as in markers_2d"),
        *_numbers("nx ny nz", "unit normal", "", "camera/depth"),
        *_numbers("d", "offset", "m", "camera/depth"),
        *_numbers("sigma_m", "one standard deviation of the plane's distance at the face's corners", "m", ""),
        *_numbers("rms_m", "distance of the pixels from the plane, along the sight line", "m", ""),
        Column("n_points", pa.int32(), "depth pixels used"),
    ),
    ("frame", "object_id", "order"),
)
TABLE_PLANE = TableSchema(
    "table_plane",
    "The table: plane n.p + d = 0 with n towards the camera, and the pose of the table frame; a row per fit.",
    (
        _T_NS,
        _FRAME,
        *_numbers("nx ny nz", "unit normal", "", "camera/depth"),
        *_numbers("d", "offset", "m", "camera/depth"),
        *_numbers("origin_x origin_y origin_z", "origin of the table frame", "m", "camera/depth"),
        *_numbers("qx qy qz qw", "rotation from the table frame, unit quaternion", "", "camera/depth"),
        *_numbers("rms_m max_m", "distance of the inliers from the plane", "m", "camera/depth"),
        Column("n_points", pa.int32(), "points offered"),
        Column("n_inliers", pa.int32(), "points used"),
        Column("evidence", _NAME, "polygon, boxes, polygon+boxes, depth, or one of these with +depth"),
    ),
    ("frame",),
)
TABLE_OUTLINE = TableSchema(
    "table_outline",
    "The table's convex outline on its plane, anticlockwise seen from above; for every row of table_plane from depth.",
    (
        _T_NS,
        _FRAME,
        Column("vertex", pa.int16(), "position of the corner in the outline"),
        *_numbers("x y z", "corner", "m", "camera/depth"),
    ),
    ("frame", "vertex"),
)
JOINTS = TableSchema(
    "joints",
    "Skeleton joints: one row per joint, body and frame.",
    (
        _T_NS,
        _FRAME,
        Column("object_id", _NAME, "the annotated rig; null where the body has none", "", "", True),
        Column("body", pa.int8(), "the sensor's body slot"),
        Column("joint", _NAME, "name of the joint"),
        *_numbers("x y z", "position", "m", "camera/depth"),
        *_numbers("u_px v_px", "position in the colour image", "px", "colour image"),
        Column("state", _NAME, "tracked, inferred or not_tracked", "", "", True),
    ),
    ("frame", "body", "joint"),
)
FRAMES = TableSchema(
    "frames",
    "The recorded clock: the device time of every frame of every stream.",
    (
        Column("t_ns", pa.int64(), "time since the session's start", "ns"),
        Column("frame", pa.int32(), "image of the stream, from zero"),
        Column("stream", _NAME, "the stream"),
    ),
    ("t_ns", "stream"),
)
IMU = TableSchema(
    "imu",
    "Readings of an inertial sensor, each with its own device time.",
    (
        Column("t_ns", pa.int64(), "time since the session's start", "ns"),
        Column("sensor", _NAME, "accelerometer or gyroscope"),
        *_numbers("x y z", "specific force (accelerometer) or angular velocity", "m/s^2 or rad/s", "imu"),
    ),
    ("t_ns", "sensor"),
)
CAMERA_POSES = TableSchema(
    "camera_poses",
    "Where a moving camera was, as the source tracked or computed it.",
    (
        _T_NS,
        Column(
            "frame", pa.int32(), "image of the annotated video, from zero; null: between images", "", "", True
        ),
        Column("camera", _NAME, "the camera, or its stream where the camera is unknown"),
        *_numbers("x y z", "position of the camera", "m", "world"),
        *_numbers("qx qy qz qw", "rotation from the camera, unit quaternion", "", "world"),
    ),
    ("t_ns", "frame"),
)
OBJECTS = TableSchema(
    "objects",
    "Annotated objects.",
    (
        _LAYER,
        Column("object_id", pa.string(), "identifier in the layer"),
        Column("name", pa.string(), "name given by the annotator"),
        Column("kind", _NAME, "rectangle, polygon, marker_box, rig, point, other"),
        Column("origin", _NAME, "manual, tracked or provided"),
        Column("dimensions", pa.int8(), "2 or 3"),
        Column("semantic_type", pa.string(), "semantic type, for instance a VoxML predicate"),
        Column("stream", pa.string(), "the video it was annotated on"),
        Column("color", pa.string(), "#rrggbbaa"),
        Column("properties", pa.map_(pa.string(), pa.string()), "free keys and values"),
    ),
)
KEYFRAMES = TableSchema(
    "keyframes",
    "Shapes drawn by a person: one row per vertex and key frame.",
    (
        _LAYER,
        Column("object_id", _NAME, "the annotated object"),
        _T_NS,
        _FRAME,
        Column("dimensions", pa.int8(), "2: pixels of the colour image; 3: metres in camera/depth"),
        Column("present", pa.bool_(), "false: the object is absent from this frame on"),
        Column("vertex", pa.int16(), "position of the vertex in the shape; null: no shape", "", "", True),
        *_numbers(
            "x y z", "the vertex (rectangles: 0 = top left corner, 1 = width and height)", "px or m", ""
        ),
    ),
    ("layer", "object_id", "dimensions", "frame", "vertex"),
)
TRACKS_2D = TableSchema(
    "tracks_2d",
    "Shapes drawn by a person, followed through the images that were not drawn: one row per vertex and image.",
    (
        _T_NS,
        _FRAME,
        _OBJECT,
        Column("vertex", pa.int16(), "position of the vertex in the shape"),
        *_numbers("u_px v_px", "the vertex", "px", "colour image"),
        Column("confidence", pa.float64(), "how sure the shape is, 0 to 1"),
        Column("status", _NAME, "drawn by a person, tracked, or proposed where confidence is low"),
    ),
    ("frame", "object_id", "vertex"),
)
HULLS = TableSchema(
    "hulls",
    "Convex hulls of what is seen of objects without markers, from depth: one row per corner and image.",
    (
        _T_NS,
        _FRAME,
        _OBJECT,
        Column("vertex", pa.int16(), "position of the corner in the hull, in no particular order"),
        *_numbers("x y z", "corner", "m", "camera/depth"),
        Column("status", _NAME, "of the shape in tracks_2d: drawn, tracked or proposed"),
    ),
    ("frame", "object_id", "vertex"),
)
EVENTS = TableSchema(
    "events",
    "Events, one row each; their stretches are in event_segments.",
    (
        _LAYER,
        _EVENT,
        Column("type", _NAME, "event type of the coding scheme"),
        Column("text", pa.string(), "free description"),
        Column("tier", _NAME, "lane"),
        Column("parent", pa.string(), "the event that this is a part of", "", "", True),
        Column("status", _NAME, "proposed or confirmed"),
        Column("unsure", pa.bool_(), "the annotator was not sure"),
        Column("author", _NAME, "who said so"),
        *_INTERVAL,
    ),
    ("layer", "start_frame"),
)
EVENT_SEGMENTS = TableSchema(
    "event_segments",
    "Stretches of events.",
    (_LAYER, _EVENT, Column("segment", pa.int16(), "position of the stretch in its event"), *_INTERVAL),
)
EVENT_LINKS = TableSchema(
    "event_links",
    "Typed links between events; a parent counts as a SUBEVENT link from it.",
    (
        _LAYER,
        _EVENT,
        Column("type", _NAME, "SUBEVENT, CAUSE, ..."),
        Column("target", pa.string(), "the other event"),
    ),
)
EVENT_ROLES = TableSchema(
    "event_roles",
    "What takes part in events; a reference found in an event's text has the role 'reference'.",
    (
        _LAYER,
        _EVENT,
        Column("role", _NAME, "name of the role"),
        Column("kind", _NAME, "object, joint or event"),
        Column("target", pa.string(), "what fills the role"),
        Column("text_start", pa.int32(), "first character of the reference in the text", "", "", True),
        Column("text_end", pa.int32(), "first character after it", "", "", True),
    ),
)
RELATIONS = TableSchema(
    "relations",
    "Predicates over objects with the interval in which each holds or is denied.",
    (
        _LAYER,
        Column("relation", pa.int32(), "position in the layer"),
        Column("predicate", _NAME, "predicate of the coding scheme"),
        Column("arguments", pa.list_(pa.string()), "object ids, or session/object id"),
        Column("polarity", pa.bool_(), "true: holds; false: denied"),
        *_INTERVAL,
        Column("source", _NAME, "marked by a person or computed"),
        Column("status", _NAME, "proposed or confirmed"),
    ),
    ("layer", "start_frame"),
)

_CONFIDENCE = Column("confidence", pa.float64(), "how sure the stage is, 0 to 1")
RELATION_PROPOSALS = TableSchema(
    "relation_proposals",
    "Relations computed from geometry, each with the interval in which it holds (docs/relations.md).",
    (
        Column("predicate", _NAME, "the relation"),
        Column("arguments", pa.list_(pa.string()), "object ids"),
        Column("polarity", pa.bool_(), "true: holds; false: denied"),
        *_INTERVAL,
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
        Column("type", _NAME, "slide, move, set or one of them with _<way>; grasp, hold, release"),
        Column("text", pa.string(), "description"),
        *_INTERVAL,
        _OBJECT,
        Column("hand", _NAME, "the grasping hand, rig/joint; null: not known", "", "", True),
        Column("landmark", _NAME, "the standing object nearest to the way", "", "", True),
        _CONFIDENCE,
    ),
    ("start_frame", "event_id"),
)

PUBLISHED = (OBJECTS, KEYFRAMES, EVENTS, EVENT_SEGMENTS, EVENT_LINKS, EVENT_ROLES, RELATIONS)
"""Tables that repeat the annotation XML for queries; written in the commit that writes the XML."""

TABLES: dict[str, TableSchema] = {
    schema.name: schema
    for schema in (
        *PUBLISHED,
        FRAMES,
        IMU,
        CAMERA_POSES,
        MARKERS_2D,
        MARKERS_3D,
        JOINTS,
        TABLE_PLANE,
        TABLE_OUTLINE,
        TRACKS_2D,
        HULLS,
        POSES,
        POSES_SMOOTH,
        RELATION_PROPOSALS,
        EVENT_PROPOSALS,
    )
}
"""Every table by name."""
