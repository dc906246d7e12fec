"""Annotation: operations on a layer, their history, and what they may do.

    with Editor(open_session("my_session"), author="ann") as editor:
        editor.apply(AddObject(kind="rectangle", name="cup", frame=0, coordinates=(10, 20, 30, 40)))
        editor.undo()

Everything that a person does to an annotation, from the page, the command line or Python, is one
:class:`~ecat.annotate.operations.Operation`.
"""

from __future__ import annotations

from ecat.annotate.codec import operation_from_dict, operation_to_dict, operations_from_list
from ecat.annotate.editor import Editor
from ecat.annotate.operations import (
    OPERATIONS,
    AcceptProposal,
    AddEvent,
    AddObject,
    AddReference,
    AddRelation,
    AddSegment,
    AddWindows,
    CopyObjects,
    Edit,
    EditEvent,
    EditObject,
    EditRelation,
    FindReferences,
    LinkEvents,
    MergeEvents,
    MoveEdge,
    MoveEvent,
    Operation,
    RejectProposal,
    RemoveEvent,
    RemoveKeyFrame,
    RemoveObject,
    RemoveReference,
    RemoveRelation,
    RemoveSegment,
    SetAbsent,
    SetKeyFrame,
    SetParent,
    SetPredicates,
    SetPresence,
    SetProperty,
    SetRole,
    SetScheme,
    SetSegments,
    SetSlots,
    SplitEvent,
    UnlinkEvents,
)
from ecat.annotate.schemes import find_scheme, read_scheme, scheme_names, write_scheme
from ecat.model.changes import Change
from ecat.model.document import Document
from ecat.model.record import Record

__all__ = [
    "OPERATIONS",
    "AcceptProposal",
    "AddEvent",
    "AddObject",
    "AddReference",
    "AddRelation",
    "AddSegment",
    "AddWindows",
    "Change",
    "CopyObjects",
    "Document",
    "Edit",
    "EditEvent",
    "EditObject",
    "EditRelation",
    "Editor",
    "FindReferences",
    "LinkEvents",
    "MergeEvents",
    "MoveEdge",
    "MoveEvent",
    "Operation",
    "Record",
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
    "find_scheme",
    "operation_from_dict",
    "operation_to_dict",
    "operations_from_list",
    "read_scheme",
    "scheme_names",
    "write_scheme",
]
