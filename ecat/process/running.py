"""Running the stages of a session that are out of date, side by side where none needs what the other makes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pyarrow as pa

from ecat.errors import EcatError, InputError
from ecat.model.annotation import MACHINE
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.process.graph import (
    all_stages,
    boxes_to_find,
    changes,
    finds,
    parameters_of,
    recorded,
    require_stages,
    why_not,
)
from ecat.process.inputs import StageImages, has_marks, input_hashes, stage_inputs
from ecat.process.memory import give_back
from ecat.process.proposals import PROPOSED, decisions, proposed_layer
from ecat.process.prototypes import boxes_in, kept_prototypes, recordings_of
from ecat.progress import Progress, silent
from ecat.store import Commit, Session, TableData, open_session, set_aside
from ecat.store.together import run_together

if TYPE_CHECKING:
    from ecat.stages.images import ImagesByKind
    from ecat.stages.stage import Stage

_Rows: TypeAlias = pa.Table | Iterable[pa.RecordBatch]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReport:
    """What was done to a session: stages that ran, that were up to date, that cannot apply (and why), and remarks."""

    path: Path
    ran: tuple[str, ...]
    skipped: tuple[str, ...]
    not_applicable: Mapping[str, str] = field(default_factory=dict[str, str])
    findings: tuple[str, ...] = ()


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
    chosen = [stage for stage in all_stages() if _wanted(stage, session, stages, smooth=smooth)]
    with StageImages(session) as images:
        run = _Run(session, images, prototypes, progress, len(chosen), measured=measured)
        for independent in side_by_side(chosen):
            run.stages(independent, force=force)
            images.rest()
            give_back()
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


def side_by_side(stages: Sequence[Stage]) -> Iterator[tuple[Stage, ...]]:
    """The stages in their order, together where they follow one another and none needs what another makes.

    Those that look at no images are alone: they take memory rather than time, and end in the thread that asks when
    somebody interrupts it.
    """
    found: list[Stage] = []
    for stage in stages:
        made = {name for other in found for name in other.outputs}
        if found and (made & set(stage.inputs) or not (stage.images and found[-1].images)):
            yield tuple(found)
            found = []
        found.append(stage)
    if found:
        yield tuple(found)


@dataclass(frozen=True, eq=False)
class _Due:
    """A stage that is out of date: what it is run with, and what is kept of that with its tables."""

    stage: Stage
    parameters: Any
    said: dict[str, object]
    hashes: dict[str, str]
    boxes: Sequence[BoxPrototype]


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

    def stages(self, independent: Sequence[Stage], *, force: bool) -> None:
        """Run those that apply and are out of date side by side, and keep what they make in their order."""
        due = [job for stage in independent if (job := self._due(stage, force=force)) is not None]
        if due:
            self._say(", ".join(job.stage.name for job in due))
        with ExitStack() as aside:
            for job, made in zip(due, _all_computed(self._session, self._images, due, aside), strict=True):
                if isinstance(made, EcatError):
                    raise made
                self._keep(job, made)

    def _due(self, stage: Stage, *, force: bool) -> _Due | None:
        """What a stage is run with, if it applies and is out of date."""
        session = self._session
        if why := why_not(stage, session):
            self.not_applicable[stage.name] = why
            return None
        boxes = self._boxes(stage)
        parameters = parameters_of(session, stage, boxes)
        said = recorded(stage, parameters)
        hashes = input_hashes(session, stage)
        if not force and not any(changes(session, name, stage, said, hashes) for name in stage.outputs):
            self.skipped.append(stage.name)
            self._say(stage.name)
            return None
        return _Due(stage, parameters, said, hashes, boxes)

    def _keep(self, job: _Due, made: Mapping[str, _Rows]) -> None:
        """Write the tables that a stage made, and what follows from them."""
        stage, session = job.stage, self._session
        with session.write() as commit:
            if "prototypes" in job.said and job.boxes is self._prototypes:
                commit.put_prototypes([box.to_dict() for box in job.boxes])
            for name, table in made.items():
                commit.put_table(
                    name,
                    TableData(
                        data=table,
                        stage=stage.name,
                        stage_version=str(stage.version),
                        parameters=job.said,
                        inputs=job.hashes,
                    ),
                )
            whole = {name: table for name, table in made.items() if isinstance(table, pa.Table)}
            if PROPOSED & whole.keys():
                self._propose(commit, whole, job.boxes)
        self.ran.append(stage.name)
        if "table_plane" in whole and (rows := whole["table_plane"].num_rows) > 1:
            moved = ", ".join(map(str, whole["table_plane"]["frame"].to_pylist()[1:]))
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
        if finds(stage):
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


def _all_computed(
    session: Session, images: StageImages, due: Sequence[_Due], aside: ExitStack
) -> list[dict[str, _Rows] | EcatError]:
    """What each of the stages makes, or why it makes nothing, which keeps none of the others from coming to its end.

    What is made part by part can be read, once, while ``aside`` is open.
    """
    made: list[dict[str, _Rows] | EcatError] = [{} for _ in due]

    def run(place: int, job: _Due) -> None:
        try:
            made[place] = _computed(session, images.of(job.stage), job, aside)
        except EcatError as error:
            made[place] = error

    run_together([partial(run, place, job) for place, job in enumerate(due)])
    return made


def _computed(session: Session, images: ImagesByKind, job: _Due, aside: ExitStack) -> dict[str, _Rows]:
    inputs = stage_inputs(session, job.stage)
    what = f"cannot run the stage {job.stage.name} on {session.name}"
    try:
        # what is not finite in the end is null in the table; how it came about is nobody's concern
        with np.errstate(all="ignore"):
            if job.stage.parts is None:
                return dict[str, _Rows](job.stage.run(inputs, images, job.parameters))
            parts = job.stage.parts(inputs, images, job.parameters)
            return {job.stage.outputs[0]: aside.enter_context(set_aside(parts, session.path, what))}
    except np.linalg.LinAlgError as error:
        raise InputError(
            what,
            where=f"the data admit no solution ({error})",
            consequence="nothing was changed",
            fix=f"ecat check {session.path}",
        ) from error
