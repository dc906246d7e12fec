"""The stages of a session in their order, each run only if what it was made from has changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ecat.errors import EcatError, InputError, LimitError, UsageError
from ecat.model.prototype import BoxPrototype
from ecat.process.prototypes import session_camera, table_surface
from ecat.progress import Progress, silent
from ecat.store import Session, TableData, open_session

if TYPE_CHECKING:
    from ecat.stages.stage import Stage

CLOCK = "clock"
"""Input that is made of the manifest: every frame and its time."""
MAX_FRAMES = 1_000_000
"""Nine hours of video; the poses of two boxes then take about half a gigabyte."""
SURFACE = "keyframes"
"""Input that is part of the annotation: only the 3-D shapes count, so that other edits do not make a plane stale."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReport:
    """What was done to a session: stages that ran, stages that were up to date, and remarks."""

    path: Path
    ran: tuple[str, ...]
    skipped: tuple[str, ...]
    findings: tuple[str, ...] = ()


def _stages() -> tuple[Stage, ...]:
    from ecat.stages import STAGES

    return STAGES


def stage_names() -> tuple[str, ...]:
    """The names of the stages, in the order in which they run."""
    return tuple(stage.name for stage in _stages())


def process_session(
    path: Path,
    *,
    stages: Sequence[str] | None = None,
    force: bool = False,
    smooth: bool = False,
    prototypes: Sequence[BoxPrototype] | None = None,
    progress: Progress = silent,
) -> ProcessReport:
    """Run the stages of the session at ``path`` that are out of date.

    Parameters
    ----------
    stages : only these, by name.
    force : run them even if they are up to date.
    smooth : also run the smoother (it is kept up to date once it has run).
    prototypes : the boxes; by default those kept in the session, or calibrated from the session itself.  They are kept
        in the session.

    Raises
    ------
    UsageError : an unknown stage.
    InputError : the session has not what a stage needs.
    """
    session = open_session(path)
    unknown = set(stages or ()) - set(stage_names())
    if unknown:
        raise UsageError(
            f"unknown stage {', '.join(sorted(unknown))}", where=f"stages: {', '.join(stage_names())}"
        )
    chosen = [stage for stage in _stages() if _wanted(stage, session, stages, smooth=smooth)]
    if not session.has_table("markers_2d") and not session.has_table("markers_3d"):
        return ProcessReport(
            path=path,
            ran=(),
            skipped=tuple(stage.name for stage in chosen),
            findings=("no marks of boxes in this session: there is nothing to place on the table",),
        )
    run = _Run(session, prototypes, progress, len(chosen))
    for stage in chosen:
        run.stage(stage, force=force)
    return ProcessReport(
        path=path, ran=tuple(run.ran), skipped=tuple(run.skipped), findings=tuple(run.findings)
    )


def _wanted(stage: Stage, session: Session, names: Sequence[str] | None, *, smooth: bool) -> bool:
    if names is not None:
        return stage.name in names or (smooth and stage.name == "smooth")
    return stage.name != "smooth" or smooth or session.has_table("poses_smooth")


def stale_tables(session: Session) -> Iterator[tuple[str, str]]:
    """Derived tables that a stage would make anew, with the inputs that have changed (or ``its stage``)."""
    by_output = {name: stage for stage in _stages() for name in stage.outputs}
    for record in session.manifest.tables:
        stage = by_output.get(record.name)
        if stage is None or not record.stage:
            continue
        now = input_hashes(session, stage)
        changed = sorted(name for name, value in now.items() if record.inputs.get(name) != value)
        changed += sorted(set(record.inputs) - set(now))
        if record.stage != stage.name or record.stage_version != str(stage.version):
            changed.append("its stage")
        if changed:
            yield record.name, ", ".join(changed)


class _Run:
    """One pass over the stages of a session."""

    def __init__(
        self, session: Session, prototypes: Sequence[BoxPrototype] | None, progress: Progress, total: int
    ) -> None:
        self.ran: list[str] = []
        self.skipped: list[str] = []
        self.findings: list[str] = []
        self._session = session
        self._progress = progress
        self._total = total
        self._prototypes = self._boxes(prototypes)

    def _boxes(self, given: Sequence[BoxPrototype] | None) -> tuple[BoxPrototype, ...]:
        kept = tuple(BoxPrototype.from_dict(box) for box in self._session.manifest.prototypes)
        boxes = tuple(given) if given is not None else kept or self._calibrated()
        if boxes != kept:
            with self._session.write() as commit:
                commit.put_prototypes([box.to_dict() for box in boxes])
        return boxes

    def _calibrated(self) -> tuple[BoxPrototype, ...]:
        from ecat.model.prototype import NOMINAL_BOXES
        from ecat.process.prototypes import recording_of
        from ecat.stages.calibrate import CalibrationParameters, calibrate_boxes

        self._progress("calibrating the boxes", 0, self._total)
        recording = recording_of(self._session, table_surface(self._session))
        try:
            if recording is not None:
                parameters = CalibrationParameters(camera=session_camera(self._session))
                return calibrate_boxes([recording], parameters).prototypes
        except InputError as error:
            self.findings.append(f"{error.what}: {error.where}; nominal boxes were used")
        return NOMINAL_BOXES

    def stage(self, stage: Stage, *, force: bool) -> None:
        """Run one stage if it is out of date."""
        self._progress(stage.name, len(self.ran) + len(self.skipped), self._total)
        session = self._session
        parameters = self._parameters(stage)
        said = _jsonable(parameters)
        hashes = input_hashes(session, stage)
        if not force and all(_is_current(session, name, stage, said, hashes) for name in stage.outputs):
            self.skipped.append(stage.name)
            return
        made = stage.run(_inputs(session, stage), parameters)
        with session.write() as commit:
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
        self.ran.append(stage.name)
        self._progress(stage.name, len(self.ran) + len(self.skipped), self._total)

    def _parameters(self, stage: Stage) -> Any:
        known = {
            "prototypes": self._prototypes,
            "camera": session_camera(self._session),
            "surface": table_surface(self._session),
        }
        fields = stage.parameters.__dataclass_fields__
        return stage.parameters(**{name: value for name, value in known.items() if name in fields})


def _inputs(session: Session, stage: Stage) -> dict[str, pa.Table]:
    found: dict[str, pa.Table] = {}
    for name in stage.inputs:
        if name == CLOCK:
            found[name] = clock_table(session)
        elif session.has_table(name):
            found[name] = session.table(name).to_arrow()
        elif name not in stage.optional:
            raise InputError(
                f"cannot run the stage {stage.name} on {session.name}",
                where=f"there is no table {name}",
                consequence="nothing was changed",
                fix=f"ecat process {session.path}",
            )
    return found


def clock_table(session: Session) -> pa.Table:
    """Every frame of the session with its time: columns ``frame`` int32, ``t_ns`` int64 (null without a clock)."""
    manifest = session.manifest
    n = manifest.n_frames
    for name in ("markers_2d", "markers_3d"):
        # marks beyond the end of a recording of known length are mistakes; ecat check names them
        if not manifest.n_frames and session.has_table(name):
            frames = session.table(name, columns=["frame"]).to_arrow()["frame"]
            n = max(n, int(np.asarray(frames).max(initial=-1)) + 1)
    if n > MAX_FRAMES:
        raise LimitError(
            f"cannot process {session.name}",
            where=f"{n:,} frames, at most {MAX_FRAMES:,} are placed at once",
            consequence="nothing was changed",
            fix="ecat check says whether the number can be right; split a longer recording",
        )
    times = [manifest.clock.t_ns(frame, manifest.n_frames) for frame in range(n)]
    return pa.table({"frame": pa.array(range(n), pa.int32()), "t_ns": pa.array(times, pa.int64())})


def input_hashes(session: Session, stage: Stage) -> dict[str, str]:
    """The hash of each input of a stage that is there."""
    hashes: dict[str, str] = {}
    for name in stage.inputs:
        record = session.manifest.table(name)
        if name == CLOCK:
            clock = session.manifest.clock
            hashes[name] = _hash([clock.rule, clock.duration_ns, session.manifest.n_frames])
        elif name == SURFACE and record is not None:
            rows = session.table(name).to_arrow().to_pylist()
            hashes[name] = _hash([row for row in rows if row["dimensions"] == 3])
        elif record is not None:
            hashes[name] = record.sha256
    return hashes


def _hash(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def _is_current(
    session: Session, table: str, stage: Stage, parameters: dict[str, object], hashes: Mapping[str, str]
) -> bool:
    record = session.manifest.table(table)
    return (
        record is not None
        and record.stage == stage.name
        and record.stage_version == str(stage.version)
        and json.dumps(record.parameters, sort_keys=True) == json.dumps(parameters, sort_keys=True)
        and record.inputs == dict(hashes)
        and _can_be_read(session, table)
    )


def _can_be_read(session: Session, table: str) -> bool:
    """Whether the table's file is there and whole enough to be opened."""
    try:
        return session.table(table).num_rows >= 0 and len(session.table(table).schema) > 0
    except EcatError:
        return False


def _jsonable(parameters: Any) -> dict[str, object]:
    """A parameters dataclass as JSON-able data; arrays become lists."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        if isinstance(value, np.ndarray):
            return value.tolist()
        return value.item() if isinstance(value, np.generic) else value

    return plain(asdict(parameters))
