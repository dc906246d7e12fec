"""Tables of what people said, published from the annotation layers."""

from __future__ import annotations

import pyarrow as pa

from ecat.tables.columns import EVENT, FRAME, INTERVAL, LAYER, NAME, T_NS, Column, TableSchema, numbers

OBJECTS = TableSchema(
    "objects",
    "Annotated objects.",
    (
        LAYER,
        Column("object_id", pa.string(), "identifier in the layer"),
        Column("name", pa.string(), "name given by the annotator"),
        Column("kind", NAME, "rectangle, polygon, marker_box, rig, point, other"),
        Column("origin", NAME, "manual, tracked or provided"),
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
        LAYER,
        Column("object_id", NAME, "the annotated object"),
        T_NS,
        FRAME,
        Column("dimensions", pa.int8(), "2: pixels of the colour image; 3: metres in camera/depth"),
        Column("present", pa.bool_(), "false: the object is absent from this frame on"),
        Column("vertex", pa.int16(), "position of the vertex in the shape; null: no shape", "", "", True),
        *numbers(
            "x y z", "the vertex (rectangles: 0 = top left corner, 1 = width and height)", "px or m", ""
        ),
    ),
    ("layer", "object_id", "dimensions", "frame", "vertex"),
)
EVENTS = TableSchema(
    "events",
    "Events, one row each; their stretches are in event_segments.",
    (
        LAYER,
        EVENT,
        Column("type", NAME, "event type of the coding scheme"),
        Column("text", pa.string(), "free description"),
        Column("tier", NAME, "lane"),
        Column("parent", pa.string(), "the event that this is a part of", "", "", True),
        Column("status", NAME, "proposed or confirmed"),
        Column("unsure", pa.bool_(), "the annotator was not sure"),
        Column("author", NAME, "who said so"),
        *INTERVAL,
    ),
    ("layer", "start_frame"),
)
EVENT_SEGMENTS = TableSchema(
    "event_segments",
    "Stretches of events.",
    (LAYER, EVENT, Column("segment", pa.int16(), "position of the stretch in its event"), *INTERVAL),
)
EVENT_LINKS = TableSchema(
    "event_links",
    "Typed links between events; a parent counts as a SUBEVENT link from it.",
    (
        LAYER,
        EVENT,
        Column("type", NAME, "SUBEVENT, CAUSE, ..."),
        Column("target", pa.string(), "the other event"),
    ),
)
EVENT_ROLES = TableSchema(
    "event_roles",
    "What takes part in events; a reference found in an event's text has the role 'reference'.",
    (
        LAYER,
        EVENT,
        Column("role", NAME, "name of the role"),
        Column("kind", NAME, "object, joint or event"),
        Column("target", pa.string(), "what fills the role"),
        Column("text_start", pa.int32(), "first character of the reference in the text", "", "", True),
        Column("text_end", pa.int32(), "first character after it", "", "", True),
    ),
)
RELATIONS = TableSchema(
    "relations",
    "Predicates over objects with the interval in which each holds or is denied.",
    (
        LAYER,
        Column("relation", pa.int32(), "position in the layer"),
        Column("predicate", NAME, "predicate of the coding scheme"),
        Column("arguments", pa.list_(pa.string()), "object ids, or session/object id"),
        Column("polarity", pa.bool_(), "true: holds; false: denied"),
        *INTERVAL,
        Column("source", NAME, "marked by a person or computed"),
        Column("status", NAME, "proposed or confirmed"),
    ),
    ("layer", "start_frame"),
)
