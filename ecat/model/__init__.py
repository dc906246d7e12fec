"""What exists: sessions, cameras, objects, events, relations, coding schemes.

Frozen dataclasses without any input or output.  Field names are the names used in the XML, in the Parquet tables and on
the command line.  Frames count video images from zero; intervals are half-open; times are nanoseconds since the
session's start; lengths are metres; axes are right-handed.
"""

from __future__ import annotations

from ecat.model.annotation import (
    AnnotatedObject,
    Argument,
    Decision,
    Event,
    Foreign,
    KeyFrame,
    Layer,
    Link,
    Property,
    Relation,
    Role,
    Segment,
    TextPredicate,
    TextReference,
)
from ecat.model.scheme import CodingScheme, Constraint, EventType, ObjectType, PredicateType, RoleType, Tier
from ecat.model.session import (
    Camera,
    Clock,
    LayerRecord,
    Manifest,
    ProjectManifest,
    Provenance,
    Stream,
    TableRecord,
)

__all__ = [
    "AnnotatedObject",
    "Argument",
    "Camera",
    "Clock",
    "CodingScheme",
    "Constraint",
    "Decision",
    "Event",
    "EventType",
    "Foreign",
    "KeyFrame",
    "Layer",
    "LayerRecord",
    "Link",
    "Manifest",
    "ObjectType",
    "PredicateType",
    "ProjectManifest",
    "Property",
    "Provenance",
    "Relation",
    "Role",
    "RoleType",
    "Segment",
    "Stream",
    "TableRecord",
    "TextPredicate",
    "TextReference",
    "Tier",
]
