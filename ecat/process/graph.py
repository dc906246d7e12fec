"""The stages of a session in their order, each run only if what it was made from has changed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ecat.errors import EcatError, InputError, UsageError
from ecat.model import TableRecord
from ecat.model.annotation import MACHINE
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.process.inputs import (
    CLOCK,
    MARKS,
    StageImages,
    annotated_objects,
    box_objects,
    color_camera,
    has_marks,
    image_stream,
    input_hashes,
    mark_noise,
    session_camera,
    shapes_for,
    stage_inputs,
    table_surface,
    was_tracked,
)
from ecat.process.proposals import PROPOSED, decisions, proposed_layer
from ecat.process.prototypes import boxes_in, kept_prototypes, recordings_of
from ecat.progress import Progress, silent
from ecat.store import Commit, Session, TableData, open_session

if TYPE_CHECKING:
    from ecat.stages.stage import Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReport:
    """What was done to a session: stages that ran, that were up to date, that cannot apply (and why), and remarks."""

    path: Path
    ran: tuple[str, ...]
    skipped: tuple[str, ...]
    not_applicable: Mapping[str, str] = field(default_factory=dict[str, str])
    findings: tuple[str, ...] = ()


def _stages() -> tuple[Stage, ...]:
    from ecat.stages import STAGES

    return STAGES


def stage_names() -> tuple[str, ...]:
    """The names of the stages, in the order in which they run."""
    return tuple(stage.name for stage in _stages())


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


def process_session(
    path: Path,
    *,
    stages: Sequence[str] | None = None,
    force: bool = False,
    smooth: bool = False,
    prototypes: Sequence[BoxPrototype] | None = None,
    measured: bool = False,
    progress: Progress = silent,
) -> ProcessReport:
    """Run the stages of the session at ``path`` that are out of date.

    Parameters
    ----------
    stages : only these, by name.
    force : run them even if they are up to date.
    smooth : also run the smoother (it is kept up to date once it has run).
    prototypes : the boxes; by default those kept in the session, or calibrated from the session itself.  They are kept
        in the session, from the commit of the first stage that uses them.
    measured : the boxes were measured by the marks of this session and others, which therefore stay as they are.

    Raises
    ------
    UsageError : an unknown stage.
    InputError : the session has not what a stage needs.
    """
    require_stages(stages or ())
    session = open_session(path)
    chosen = [stage for stage in _stages() if _wanted(stage, session, stages, smooth=smooth)]
    with StageImages(session) as images:
        run = _Run(session, images, prototypes, progress, len(chosen), measured=measured)
        for stage in chosen:
            run.stage(stage, force=force)
    run.keep_prototypes()
    return ProcessReport(
        path=path,
        ran=tuple(run.ran),
        skipped=tuple(run.skipped),
        not_applicable=run.not_applicable,
        findings=tuple(run.findings),
    )


def _wanted(stage: Stage, session: Session, names: Sequence[str] | None, *, smooth: bool) -> bool:
    if names is not None:
        return stage.name in names or (smooth and stage.name == "smooth")
    return stage.name != "smooth" or smooth or session.has_table("poses_smooth")


def _why_not(stage: Stage, session: Session) -> str:
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
    known = {name: stage.name for stage in _stages() for name in stage.outputs}
    return {r.name: known[r.name] for r in session.manifest.tables if r.stage and r.name in known}


def stale_tables(session: Session) -> Iterator[tuple[str, str]]:
    """Derived tables that their stage would make anew, and what has changed since they were made.

    Raises
    ------
    InputError : the session's camera or its prototypes are not valid.
    StoreError : the annotation's tables cannot be read.
    """
    stages = {stage.name: stage for stage in _stages()}
    boxes = kept_prototypes(session) or NOMINAL_BOXES
    for table, name in made_by(session).items():
        used = boxes_to_find(session, stages[name]) if _finds(stages[name]) else boxes
        parameters = recorded(stages[name], parameters_of(session, stages[name], used))
        if changed := _changes(session, table, stages[name], parameters, input_hashes(session, stages[name])):
            yield table, ", ".join(changed)


def _changes(
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


def _finds(stage: Stage) -> bool:
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


class _Run:
    """One pass over the stages of a session."""

    def __init__(
        self,
        session: Session,
        images: StageImages,
        prototypes: Sequence[BoxPrototype] | None,
        progress: Progress,
        total: int,
        *,
        measured: bool,
    ) -> None:
        self.ran: list[str] = []
        self.skipped: list[str] = []
        self.not_applicable: dict[str, str] = {}
        self.findings: list[str] = []
        self._session = session
        self._images = images
        self._progress = progress
        self._total = total
        self._prototypes = None if prototypes is None else tuple(prototypes)
        self._to_find = None if measured else self._prototypes

    def stage(self, stage: Stage, *, force: bool) -> None:
        """Run one stage if it applies and is out of date."""
        session = self._session
        if why := _why_not(stage, session):
            self.not_applicable[stage.name] = why
            return
        self._say(stage.name)
        boxes = self._boxes(stage)
        parameters = parameters_of(session, stage, boxes)
        said = recorded(stage, parameters)
        hashes = input_hashes(session, stage)
        if not force and not any(_changes(session, name, stage, said, hashes) for name in stage.outputs):
            self.skipped.append(stage.name)
            return
        made = _computed(session, self._images, stage, parameters)
        with session.write() as commit:
            if "prototypes" in said and boxes is self._prototypes:
                commit.put_prototypes([box.to_dict() for box in boxes])
            for name, table in made.items():
                commit.put_table(
                    name,
                    TableData(
                        data=table,
                        stage=stage.name,
                        stage_version=str(stage.version),
                        parameters=said,
                        inputs=hashes,
                    ),
                )
            if PROPOSED & made.keys():
                self._propose(commit, made, boxes)
        self.ran.append(stage.name)
        if "table_plane" in made and (rows := made["table_plane"].num_rows) > 1:
            moved = ", ".join(map(str, made["table_plane"]["frame"].to_pylist()[1:]))
            self.findings.append(
                f"the camera moved: the table was fitted {rows} times, anew from frame {moved}"
            )
        self._say(stage.name)

    def _propose(self, commit: Commit, made: Mapping[str, pa.Table], boxes: Sequence[BoxPrototype]) -> None:
        """Renew the layer of proposals, unless a person has decided about some of them."""
        if decided := decisions(self._session):
            self.findings.append(
                f"people have decided about {decided} of the proposals in layer {MACHINE}, and it was left as it is; "
                "take the decisions back (ecat log, ecat restore) to see new ones"
            )
        else:
            commit.put_layer(proposed_layer(self._session, made, boxes))

    def keep_prototypes(self) -> None:
        """Keep boxes that were given even if no stage had to run for them."""
        boxes = [box.to_dict() for box in self._prototypes or ()]
        if (
            boxes
            and len(self.not_applicable) < self._total
            and boxes != list(self._session.manifest.prototypes)
        ):
            with self._session.write() as commit:
                commit.put_prototypes(boxes)

    def _say(self, what: str) -> None:
        done = len(self.ran) + len(self.skipped) + len(self.not_applicable)
        self._progress(what, done, self._total)

    def _boxes(self, stage: Stage) -> tuple[BoxPrototype, ...]:
        if _finds(stage):
            return self._to_find if self._to_find is not None else boxes_to_find(self._session, stage)
        if self._prototypes is None:
            kept = kept_prototypes(self._session)
            if not kept and not has_marks(self._session):
                return NOMINAL_BOXES  # to be measured, and kept, once their marks are known
            self._prototypes = kept or self._calibrated()
        # nominal ones are not kept: with other sessions, or more marks, they may still be measured
        return self._prototypes or NOMINAL_BOXES

    def _calibrated(self) -> tuple[BoxPrototype, ...]:
        """The boxes of the session, measured; none if they cannot be."""
        self._say("calibrating the boxes")
        try:
            if recordings := recordings_of(self._session, self._images):
                return boxes_in(recordings, self._session)
        except InputError as error:
            self.findings.append(f"{error.what}: {error.where}; nominal boxes were used")
        return ()


def _computed(session: Session, images: StageImages, stage: Stage, parameters: Any) -> dict[str, pa.Table]:
    tables = stage_inputs(session, stage)
    try:
        # what is not finite in the end is null in the table; how it came about is nobody's concern
        with np.errstate(all="ignore"):
            return stage.run(tables, images.of(stage), parameters)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"cannot run the stage {stage.name} on {session.name}",
            where=f"the data admit no solution ({error})",
            consequence="nothing was changed",
            fix=f"ecat check {session.path}",
        ) from error


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
