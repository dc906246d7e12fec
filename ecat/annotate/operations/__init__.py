"""Everything that can be done to an annotation, as values: :data:`OPERATIONS` by name.

In JSON an operation is ``{"op": "<name>", ...fields}``.
"""

from __future__ import annotations

from ecat.annotate.operations.base import Edit, Operation
from ecat.annotate.operations.events import (
    AddEvent,
    EditEvent,
    MergeEvents,
    RemoveEvent,
    SetParent,
    SplitEvent,
)
from ecat.annotate.operations.layer import AddWindows, SetScheme
from ecat.annotate.operations.objects import AddObject, CopyObjects, EditObject, RemoveObject, SetProperty
from ecat.annotate.operations.parts import LinkEvents, SetRole, SetSlots, UnlinkEvents
from ecat.annotate.operations.proposals import AcceptProposal, RejectProposal
from ecat.annotate.operations.relations import AddRelation, EditRelation, RemoveRelation
from ecat.annotate.operations.shapes import RemoveKeyFrame, SetAbsent, SetKeyFrame, SetPresence
from ecat.annotate.operations.spans import AddSegment, MoveEdge, MoveEvent, RemoveSegment, SetSegments
from ecat.annotate.operations.text import AddReference, FindReferences, RemoveReference, SetPredicates

OPERATIONS: dict[str, type[Operation]] = {
    kind.op: kind
    for kind in (
        AddObject, EditObject, RemoveObject, SetProperty, SetKeyFrame, SetAbsent, RemoveKeyFrame, SetPresence,
        CopyObjects, AddEvent, EditEvent, RemoveEvent, SetSegments, MoveEdge, MoveEvent, AddSegment,
        RemoveSegment, SplitEvent, MergeEvents, SetParent, LinkEvents, UnlinkEvents, SetRole, AddReference,
        RemoveReference, FindReferences, SetPredicates, SetSlots, AddRelation, EditRelation, RemoveRelation,
        AcceptProposal, RejectProposal, SetScheme, AddWindows,
    )
}  # fmt: skip
"""The operations by their name."""

__all__ = [
    "OPERATIONS",
    "AcceptProposal",
    "AddEvent",
    "AddObject",
    "AddReference",
    "AddRelation",
    "AddSegment",
    "AddWindows",
    "CopyObjects",
    "Edit",
    "EditEvent",
    "EditObject",
    "EditRelation",
    "FindReferences",
    "LinkEvents",
    "MergeEvents",
    "MoveEdge",
    "MoveEvent",
    "Operation",
    "RejectProposal",
    "RemoveEvent",
    "RemoveKeyFrame",
    "RemoveObject",
    "RemoveReference",
    "RemoveRelation",
    "RemoveSegment",
    "SetAbsent",
    "SetKeyFrame",
    "SetParent",
    "SetPredicates",
    "SetPresence",
    "SetProperty",
    "SetRole",
    "SetScheme",
    "SetSegments",
    "SetSlots",
    "SplitEvent",
    "UnlinkEvents",
]
