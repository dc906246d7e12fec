"""Processing many sessions: in several processes, on several machines, in a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from ecat.batch.engines import Engine, Workers
from ecat.batch.faults import fault
from ecat.batch.shards import Shard
from ecat.errors import EcatError
from ecat.model.prototype import BoxPrototype
from ecat.process import ProcessReport, calibrate_together, process_session, require_stages, to_be_tracked
from ecat.progress import Progress, beginning, silent

_FIRST = "track"
"""The stage that finds the marks by which boxes are measured."""
_IMPORTS = ("ecat.stages",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one session: a report, or the error that stopped it."""

    path: Path
    report: ProcessReport | None = None
    error: EcatError | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Task:
    """What a process has to know to do one session."""

    path: Path
    stages: tuple[str, ...] | None
    force: bool
    smooth: bool
    prototypes: tuple[BoxPrototype, ...] | None
    measured: bool = False


def process_sessions(
    paths: Sequence[Path],
    *,
    jobs: int | None = None,
    engine: Engine = "processes",
    shard: Shard | None = None,
    stages: Sequence[str] | None = None,
    force: bool = False,
    smooth: bool = False,
    prototypes: Sequence[BoxPrototype] | None = None,
    name: Callable[[Path], str] = str,
    progress: Progress = silent,
) -> list[Outcome]:
    """Process several sessions; what stops one does not stop the others.  The outcomes are in the order of ``paths``.

    A fault of ecat itself is an outcome as well, unless there is one session only: there it is raised as it is.

    Each session commits by itself, so that after an interruption another call does what is left.  Sessions without
    boxes of their own get those that all sessions of their camera show (:func:`calibrate_together`): marks are looked
    for in all videos before anything is made of them.

    Parameters
    ----------
    jobs : how many at once; by default :func:`ecat.batch.engines.usual_jobs`.
    shard : process only this share of the sessions.  Boxes are measured by all of ``paths`` even so; as long as marks
        are still to be looked for in a video of another share, those of this one are found and the rest is left to
        a second call, which the outcomes say.
    stages, force, smooth, prototypes : as of :func:`process_session`.
    name : what ``progress`` calls a session.

    Raises
    ------
    UsageError : an unknown stage; or a script that does not say ``if __name__ == "__main__"``, see
        :func:`ecat.batch.engines.pool`.
    MissingExtraError : Ray is wanted and is not installed.
    """
    require_stages(stages or ())
    paths = list(dict.fromkeys(paths))
    tasks = [
        _Task(
            path=path,
            stages=tuple(stages) if stages else None,
            force=force,
            smooth=smooth,
            prototypes=None if prototypes is None else tuple(prototypes),
        )
        for path in (paths if shard is None else shard.of(paths))
    ]
    if len(paths) == 1 and tasks and engine == "processes":
        return [_attempt(tasks[0], progress)]
    with Workers(engine, jobs if jobs is None else min(jobs, len(tasks)), _IMPORTS) as workers:
        spread = _Spread(None if workers.here(len(tasks)) else workers, name, progress)
        if prototypes is None and set(stages or ()) != {_FIRST}:
            return _with_boxes(tasks, paths, spread)
        return spread.all(tasks)


def _with_boxes(tasks: Sequence[_Task], paths: Sequence[Path], spread: _Spread) -> list[Outcome]:
    """Measure the boxes by all ``paths`` first: several sessions show a box better than one does."""
    tracked = _tracked(tasks, paths, spread)
    mine = {task.path for task in tasks}
    tracks = any(task.stages is None or _FIRST in task.stages for task in tasks)
    if tracks and (waiting := to_be_tracked([p for p in paths if p not in mine], again=False)):
        return [_put_off(task.path, tracked.get(task.path), len(waiting)) for task in tasks]
    together = calibrate_together(paths, spread.progress)
    tasks = [
        replace(task, prototypes=together.get(task.path), measured=task.path in together) for task in tasks
    ]
    return [_with_tracking(outcome, tracked) for outcome in spread.all(tasks)]


@dataclass(frozen=True, slots=True)
class _Spread:
    """Who does the work (None: this process), and who hears of it."""

    workers: Workers | None
    name: Callable[[Path], str]
    progress: Progress

    def all(self, tasks: Sequence[_Task]) -> list[Outcome]:
        """What became of all of them, in their order."""
        if self.workers is None or not tasks:
            return [_outcome(task, self._within(task.path, i, len(tasks))) for i, task in enumerate(tasks)]
        done = 0

        def keep(outcome: Outcome) -> None:
            nonlocal done
            done += 1
            self.progress(self.name(outcome.path), done, len(tasks))

        self.progress("starting", 0, len(tasks))
        with closing(self.workers.run(_outcome, tasks, died=_died, keep=keep)) as work:
            return list(work)

    def _within(self, path: Path, index: int, n_sessions: int) -> Progress:
        """The progress of one, with the session's name in front."""
        return beginning(f"{self.name(path)} ({index + 1} of {n_sessions})", self.progress)


def _tracked(tasks: Sequence[_Task], paths: Sequence[Path], spread: _Spread) -> dict[Path, Outcome]:
    """Look for marks where that is to be done, if there are boxes to be measured by them; what it came to.

    What goes wrong goes wrong again where the whole session is processed, and is said there.
    """
    wanted = to_be_tracked(paths)
    first = [
        replace(task, stages=(_FIRST,), force=False, smooth=False)
        for task in tasks
        if task.path in wanted and (task.stages is None or _FIRST in task.stages)
    ]
    return {outcome.path: outcome for outcome in spread.all(first)}


def _put_off(path: Path, tracked: Outcome | None, n_sessions: int) -> Outcome:
    """Only marks could be found, as the boxes wait for those of the other shares."""
    if tracked is not None and tracked.error is not None:
        return tracked
    report = (
        ProcessReport(path=path, ran=(), skipped=())
        if tracked is None or tracked.report is None
        else tracked.report
    )
    finding = (
        f"boxes are measured by all sessions together, and {n_sessions:,} of other shares are still without marks: "
        "when their jobs are done, the same command does the rest"
    )
    return Outcome(path=path, report=replace(report, findings=(*report.findings, finding)))


def _with_tracking(outcome: Outcome, tracked: Mapping[Path, Outcome]) -> Outcome:
    """The same, with the stage that ran before the others counted among those that ran."""
    before, then = tracked.get(outcome.path), outcome.report
    if before is None or before.report is None or then is None:
        return outcome
    ran = tuple(name for name in before.report.ran if name not in then.ran)
    skipped = tuple(name for name in then.skipped if name not in ran)
    return replace(outcome, report=replace(then, ran=(*ran, *then.ran), skipped=skipped))


def _outcome(task: _Task, progress: Progress = silent) -> Outcome:
    try:
        return _attempt(task, progress)
    except Exception as error:  # noqa: BLE001  a fault met in one session is no reason to leave out the others
        return Outcome(path=task.path, error=fault(error, f"ecat process {task.path}"))


def _died(task: _Task) -> Outcome:
    error = EcatError(
        f"cannot process {task.path.name}",
        where=f"{task.path}: the process that worked on it was killed; perhaps there was too little memory",
        consequence="what was finished before is kept",
        fix=f"ecat process {task.path} --jobs 1",
    )
    return Outcome(path=task.path, error=error)


def _attempt(task: _Task, progress: Progress) -> Outcome:
    try:
        report = process_session(
            task.path,
            stages=task.stages,
            force=task.force,
            smooth=task.smooth,
            prototypes=task.prototypes,
            measured=task.measured,
            progress=progress,
        )
    except EcatError as error:
        return Outcome(path=task.path, error=error)
    return Outcome(path=task.path, report=report)
