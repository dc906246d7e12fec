"""Every Arrow schema of a session, declared once: column, type, unit, frame of reference, meaning.

``schemas/tables/*.json`` is generated from this package.  Tables are tidy and long, sorted by their ``order`` columns.
"""

from __future__ import annotations

from ecat.tables.annotated import (
    EVENT_LINKS,
    EVENT_ROLES,
    EVENT_SEGMENTS,
    EVENTS,
    KEYFRAMES,
    OBJECTS,
    RELATIONS,
)
from ecat.tables.columns import ROW_GROUP_ROWS, SCHEMA_VERSION, Column, TableSchema
from ecat.tables.derived import (
    EVENT_PROPOSALS,
    FACE_PLANES,
    HULLS,
    POSES,
    POSES_SMOOTH,
    RELATION_PROPOSALS,
    TABLE_OUTLINE,
    TABLE_PLANE,
    TRACKS_2D,
)
from ecat.tables.recorded import (
    CAMERA_POSES,
    FRAMES,
    IMU,
    JOINTS,
    MARKERS_2D,
    MARKERS_3D,
)

__all__ = [
    "CAMERA_POSES",
    "EVENTS",
    "EVENT_LINKS",
    "EVENT_PROPOSALS",
    "EVENT_ROLES",
    "EVENT_SEGMENTS",
    "FACE_PLANES",
    "FRAMES",
    "HULLS",
    "IMU",
    "JOINTS",
    "KEYFRAMES",
    "MARKERS_2D",
    "MARKERS_3D",
    "OBJECTS",
    "POSES",
    "POSES_SMOOTH",
    "PUBLISHED",
    "RELATIONS",
    "RELATION_PROPOSALS",
    "ROW_GROUP_ROWS",
    "SCHEMA_VERSION",
    "TABLES",
    "TABLE_OUTLINE",
    "TABLE_PLANE",
    "TRACKS_2D",
    "Column",
    "TableSchema",
]

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
        FACE_PLANES,
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
