"""The sessions of a project, one after the other or in several processes at once."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from ecat.errors import EcatError
from ecat.model.prototype import BoxPrototype
from ecat.process.graph import ProcessReport, process_session, require_stages
from ecat.process.prototypes import calibrate_together, to_be_tracked
from ecat.progress import Progress, silent

_FIRST = "track"
"""The stage that finds the marks by which boxes are measured."""
FEW = 4
"""Fewer sessions are done before other processes have started."""


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


def usual_jobs(n_sessions: int) -> int:
    """How many processes to use for so many sessions: one for a few, else one for each processor."""
    affinity: Callable[[int], set[int]] | None = getattr(os, "sched_getaffinity", None)
    processors = len(affinity(0)) if affinity else os.cpu_count() or 1
    return 1 if n_sessions < FEW else min(processors, n_sessions)


def process_sessions(
    paths: Sequence[Path],
    *,
    jobs: int | None = None,
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
    jobs : how many processes; by default :func:`usual_jobs`.
    stages, force, smooth, prototypes : as of :func:`process_session`.
    name : what ``progress`` calls a session.

    Raises
    ------
    UsageError : an unknown stage.
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
        for path in paths
    ]
    if len(tasks) == 1:
        return [_attempt(tasks[0], progress)]
    tracked: dict[Path, ProcessReport] = {}
    if prototypes is None and set(stages or ()) != {_FIRST}:
        # several sessions show a box better than one does; a single session calibrates its own
        tracked = _tracked(tasks, jobs, name, progress)
        together = calibrate_together(paths, progress)
        tasks = [
            replace(task, prototypes=together.get(task.path), measured=task.path in together)
            for task in tasks
        ]
    return [_with_tracking(outcome, tracked) for outcome in _all(tasks, jobs, name, progress)]


def _all(
    tasks: Sequence[_Task], jobs: int | None, name: Callable[[Path], str], progress: Progress
) -> list[Outcome]:
    """What became of all of them."""
    jobs = usual_jobs(len(tasks)) if jobs is None else min(jobs, len(tasks))
    if jobs > 1:
        return _side_by_side(tasks, jobs, name, progress)
    return [_outcome(task, _within(progress, name(task.path), i, len(tasks))) for i, task in enumerate(tasks)]


def _tracked(
    tasks: Sequence[_Task], jobs: int | None, name: Callable[[Path], str], progress: Progress
) -> dict[Path, ProcessReport]:
    """Look for marks where that is to be done, if there are boxes to be measured by them; what it came to.

    What goes wrong goes wrong again where the whole session is processed, and is said there.
    """
    wanted = to_be_tracked(task.path for task in tasks if task.stages is None or _FIRST in task.stages)
    first = [replace(task, stages=(_FIRST,), force=False, smooth=False) for task in tasks]
    outcomes = _all([task for task in first if task.path in wanted], jobs, name, progress)
    return {outcome.path: outcome.report for outcome in outcomes if outcome.report is not None}


def _with_tracking(outcome: Outcome, tracked: Mapping[Path, ProcessReport]) -> Outcome:
    """The same, with the stage that ran before the others counted among those that ran."""
    first, then = tracked.get(outcome.path), outcome.report
    if first is None or then is None:
        return outcome
    ran = tuple(name for name in first.ran if name not in then.ran)
    skipped = tuple(name for name in then.skipped if name not in ran)
    return replace(outcome, report=replace(then, ran=(*ran, *then.ran), skipped=skipped))


def _within(progress: Progress, name: str, index: int, n_sessions: int) -> Progress:
    """The same, with the session's name in front."""
    return lambda what, done, total: progress(f"{name} ({index + 1} of {n_sessions}): {what}", done, total)


def _outcome(task: _Task, progress: Progress = silent) -> Outcome:
    try:
        return _attempt(task, progress)
    except Exception as error:  # noqa: BLE001  a fault met in one session is no reason to leave out the others
        return Outcome(path=task.path, error=_fault(task.path, error))


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


def _fault(path: Path, error: Exception) -> EcatError:
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    line = (
        "" if place is None else f" ({Path(place.tb_frame.f_code.co_filename).name}, line {place.tb_lineno})"
    )
    return EcatError(
        f"this is a bug in ecat: {type(error).__name__}",
        where=f"{str(error).partition(chr(10))[0]}{line}",
        consequence="what was finished before is kept",
        fix=f"ecat process {path} shows all of it; report it to ecat's issue tracker",
    )


def _side_by_side(
    tasks: Sequence[_Task], jobs: int, name: Callable[[Path], str], progress: Progress
) -> list[Outcome]:
    done: dict[Path, Outcome] = {}

    def keep(outcome: Outcome) -> None:
        done[outcome.path] = outcome
        progress(name(outcome.path), len(done), len(tasks))

    progress("starting", 0, len(tasks))
    _run(tasks, jobs, keep)
    # when a process dies, those beside it are lost too: what is left is done in a process each, so that one is named
    for task in tasks:
        if task.path not in done:
            _run([task], 1, keep)
        if task.path not in done:
            keep(Outcome(path=task.path, error=_died(task.path)))
    return [done[task.path] for task in tasks]


def _died(path: Path) -> EcatError:
    return EcatError(
        f"cannot process {path.name}",
        where=f"{path}: the process that worked on it was killed; perhaps there was too little memory",
        consequence="what was finished before is kept",
        fix=f"ecat process {path} --jobs 1",
    )


def _run(tasks: Sequence[_Task], jobs: int, keep: Callable[[Outcome], None]) -> None:
    """Hand over the outcomes as they come, of all tasks whose process did not die."""
    with _pool(jobs) as pool, contextlib.suppress(BrokenProcessPool):
        for future in as_completed([pool.submit(_outcome, task) for task in tasks]):
            with contextlib.suppress(BrokenProcessPool):
                keep(future.result())


@contextlib.contextmanager
def _pool(jobs: int) -> Generator[ProcessPoolExecutor]:
    """Processes that end with the block, at once if it fails: a commit is made whole or not at all."""
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        # the pool waits for its processes in a thread of its own; of two that wait for one, only one hears of its end
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begin() -> None:
    """What a process does first: leave it to the one that started it to end it, and not outlive that one."""
    # Ctrl-C reaches every process of a terminal
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
