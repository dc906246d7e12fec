"""The stages of a session in their order: which apply to it, and which of their tables are out of date."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ecat.errors import EcatError, UsageError
from ecat.model import TableRecord
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.process.inputs import (
    CLOCK,
    MARKS,
    annotated_objects,
    box_objects,
    color_camera,
    has_marks,
    image_stream,
    input_hashes,
    mark_noise,
    session_camera,
    shapes_for,
    table_surface,
    was_tracked,
)
from ecat.process.prototypes import kept_prototypes
from ecat.store import Session

if TYPE_CHECKING:
    from ecat.stages.stage import Stage


def all_stages() -> tuple[Stage, ...]:
    """Every stage, in the order in which they run; they are slow to import."""
    from ecat.stages import STAGES

    return STAGES


def stage_names() -> tuple[str, ...]:
    """The names of the stages, in the order in which they run."""
    return tuple(stage.name for stage in all_stages())


def require_stages(names: Sequence[str]) -> None:
    """Returns if there are stages of these names.

    Raises
    ------
    UsageError : there is none of one of them.
    """
    if unknown := sorted(set(names) - set(stage_names())):
        raise UsageError(
            f"unknown stage {', '.join(unknown)}",
            where=f"stages: {', '.join(stage_names())}",
            consequence="nothing was done",
            fix="name one of them",
        )


def why_not(stage: Stage, session: Session) -> str:
    """Why a stage cannot apply to a session as it is; empty if it can."""
    for kind in stage.images:
        if kind not in stage.optional and image_stream(session, kind) is None:
            there = any(stream.kind == kind and stream.present for stream in session.manifest.streams)
            unknown = f"nothing is known of the {kind} camera: its calibration is needed to measure"
            return unknown if there else f"no {kind} video in this session"
    if "tracks_2d" in stage.outputs and not shapes_for(session, stage):
        return "nobody drew a shape in the images"
    imported = (session.manifest.table(name) for name in stage.outputs)
    if given := [record.name for record in imported if record is not None and not record.stage]:
        return f"{given[0]} came with the recording"
    seen = has_marks(session)
    by_depth = "depth" in stage.images and image_stream(session, "depth") is not None
    if not seen and not by_depth and any(name in stage.inputs for name in MARKS):
        return "no markers in this session"
    measures = stage.name != "track" and "camera" in stage.parameters.__dataclass_fields__
    needs_marks = not (by_depth and set(MARKS) <= set(stage.optional))
    if measures and seen and needs_marks and _color_is_unknown(session):
        return "nothing is known of the colour camera: its calibration is needed to measure"
    for name in stage.inputs:
        if name not in {CLOCK, *stage.optional} and not session.has_table(name):
            return f"no table {name}" if seen else f"no markers in this session, and no table {name}"
    return ""


def _color_is_unknown(session: Session) -> bool:
    """Whether marks were found in images of a camera of which nothing is known."""
    return was_tracked(session) and color_camera(session) is None


def made_by(session: Session) -> dict[str, str]:
    """The tables of a session that stages made, each with the name of its stage."""
    known = {name: stage.name for stage in all_stages() for name in stage.outputs}
    return {r.name: known[r.name] for r in session.manifest.tables if r.stage and r.name in known}


def stale_tables(session: Session) -> Iterator[tuple[str, str]]:
    """Derived tables that their stage would make anew, and what has changed since they were made.

    Raises
    ------
    InputError : the session's camera or its prototypes are not valid.
    StoreError : the annotation's tables cannot be read.
    """
    stages = {stage.name: stage for stage in all_stages()}
    boxes = kept_prototypes(session) or NOMINAL_BOXES
    for table, name in made_by(session).items():
        used = boxes_to_find(session, stages[name]) if finds(stages[name]) else boxes
        parameters = recorded(stages[name], parameters_of(session, stages[name], used))
        if changed := changes(session, table, stages[name], parameters, input_hashes(session, stages[name])):
            yield table, ", ".join(changed)


def changes(
    session: Session, table: str, stage: Stage, parameters: Mapping[str, object], hashes: Mapping[str, str]
) -> list[str]:
    """What has changed since the stage made the table; empty if the table is what the stage would make."""
    record = session.manifest.table(table)
    if record is None or not _can_be_read(session, record):
        return ["its file"]
    changed = sorted(name for name, value in hashes.items() if record.inputs.get(name) != value)
    changed += sorted(set(record.inputs) - set(hashes))
    if record.stage != stage.name or record.stage_version != str(stage.version):
        changed.append("its stage")
    names = sorted(parameters.keys() | record.parameters.keys())
    differ = (name for name in names if _json(parameters.get(name)) != _json(record.parameters.get(name)))
    return changed + [f"parameter {name}" for name in differ]


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True)


def _can_be_read(session: Session, record: TableRecord) -> bool:
    """Whether the table's file is there, whole enough to be opened, and what its record says."""
    try:
        return session.snapshot.read_table(record, lambda _: True)
    except EcatError:
        return False


def parameters_of(session: Session, stage: Stage, prototypes: Sequence[BoxPrototype]) -> Any:
    """The parameters of a stage, of its own class, for a session with these boxes."""
    fields = stage.parameters.__dataclass_fields__
    values: dict[str, Any] = {}
    if "prototypes" in fields:
        values["prototypes"] = tuple(prototypes)
    if "camera" in fields:
        no_camera = stage.name == "plane" and _color_is_unknown(session)
        values["camera"] = None if no_camera else session_camera(session)
    if "objects" in fields:
        values["objects"] = box_objects(annotated_objects(session), prototypes)
    if stage.name in {"plane", "pose"}:
        values["noise"] = mark_noise(session)
    if "surface" in fields:
        values["surface"] = table_surface(session)
    return stage.parameters(**values)


def finds(stage: Stage) -> bool:
    """Whether it is the stage that finds the marks."""
    return "markers_2d" in stage.outputs


def boxes_to_find(session: Session, stage: Stage) -> tuple[BoxPrototype, ...]:
    """The boxes whose marks are looked for, if nobody says which: those kept in the session, or else nominal ones.

    Boxes that were measured by marks of nominal ones are those that were in view, and have the faces that were seen
    together: they take the place of the nominal ones wherever it is about sizes, but not here, or else the marks would
    be looked for again.
    """
    kept, record = kept_prototypes(session), session.manifest.table("markers_2d")
    if not kept or record is None:
        return kept or NOMINAL_BOXES
    nominal = recorded(stage, parameters_of(session, stage, NOMINAL_BOXES))
    were_nominal = _json(record.parameters.get("prototypes")) == _json(nominal["prototypes"])
    codes, known = ({f.code for box in boxes for f in box.faces} for boxes in (kept, NOMINAL_BOXES))
    return NOMINAL_BOXES if were_nominal and codes <= known else kept


def recorded(stage: Stage, parameters: Any) -> dict[str, object]:
    """The parameters of a stage as they are kept with its tables: JSON-able data, arrays as lists."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        if isinstance(value, np.ndarray):
            return value.tolist()
        return value.item() if isinstance(value, np.generic) else value

    return plain(asdict(stage.recorded(parameters)))
