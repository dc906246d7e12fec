"""Writing many sessions in a foreign format: in several processes, on several machines, in a cluster."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ecat import formats
from ecat.batch.engines import Engine, Workers
from ecat.batch.faults import fault
from ecat.batch.shards import Shard
from ecat.errors import EcatError, UsageError
from ecat.formats import ExportReport, exporting, registry
from ecat.formats.exporting import Made, Task
from ecat.formats.options import read_options
from ecat.progress import Progress, silent
from ecat.store import remote


def export_sessions(
    path: Path | str,
    dest: Path | str,
    *,
    format: str,  # noqa: A002  (the name of the option)
    options: Mapping[str, str] | None = None,
    jobs: int | None = None,
    engine: Engine = "processes",
    shard: Shard | None = None,
    progress: Progress = silent,
) -> ExportReport:
    """:func:`ecat.formats.export`, several sessions at once; the bytes are the same.

    Parameters
    ----------
    path, dest : paths, or URLs that fsspec knows.
    jobs : how many at once; by default :func:`ecat.batch.engines.usual_jobs`.
    shard : make only the parts of this share of the sessions, beside ``dest``; the call without a shard, made when
        every share is done, takes them as they are and joins them.

    Raises
    ------
    UsageError : as of ``formats.export``; or a share of a format that is only written as a whole; or a script that
        does not say ``if __name__ == "__main__"``, see :func:`ecat.batch.engines.pool`.
    StoreError : as of ``formats.export``.
    """
    path, dest = remote.place_of(path), remote.place_of(dest)
    with Workers(engine, jobs, registry.own_modules(format)) as workers:
        chosen = registry.find(format)
        if chosen.part is None:
            if shard is not None:
                raise UsageError(
                    f"cannot export a share of {path}",
                    where=f"{chosen.name} is written as a whole",
                    fix="leave out --shard, or choose another format",
                )
            return formats.export(path, dest, format=format, options=options, progress=progress)
        chosen_options: Any = read_options(chosen.options, options or {}, chosen.name)
        tasks = exporting.tasks_of(path, dest, chosen, chosen_options)
        if shard is not None:
            with closing(_all(shard.of(tasks), workers, progress)) as outcomes:
                return _share(tasks[0], list(outcomes))
        return exporting.join(dest, chosen, tasks, _all(tasks, workers, progress), progress)


def _share(any_task: Task, outcomes: Sequence[Made]) -> ExportReport:
    """What was made of a share, which waits beside ``dest`` to be joined with the others."""
    return ExportReport(
        path=remote.place_of(str(any_task.parts)),
        format=any_task.format,
        sessions=sum(outcome.error is None for outcome in outcomes),
        findings=tuple(f"{o.task.label}: {finding}" for o in outcomes for finding in o.findings),
        failures=tuple((o.task.session, o.error) for o in outcomes if o.error is not None),
    )


def _all(tasks: Sequence[Task], workers: Workers, progress: Progress) -> Generator[Made]:
    """What becomes of them, in their order, each as soon as it and those before it are done."""
    if len(tasks) == 1:
        yield exporting.make_part(tasks[0], progress)
        return
    done = 0

    def keep(outcome: Made) -> None:
        nonlocal done
        done += 1
        progress(outcome.task.label, done, len(tasks))

    progress("starting", 0, len(tasks))
    if workers.here(len(tasks)):
        for task in tasks:
            outcome = _outcome(task)
            keep(outcome)
            yield outcome
        return
    for place in (tasks[0].session, str(tasks[0].parts)):
        if remote.is_own_memory(place):
            raise UsageError(
                "cannot write several sessions at once",
                where=f"{place}: what is at memory:// is in the process that put it there, and no other sees it",
                fix="--jobs 1, or a URL that every process can reach",
            )
    yield from workers.run(_outcome, tasks, died=_died, keep=keep)
    workers.end()


def _outcome(task: Task) -> Made:
    try:
        return exporting.make_part(task)
    except Exception as error:  # noqa: BLE001  a fault met in one session is no reason to leave out the others
        again = f"ecat export {task.session} OTHER --format {task.format}"
        return Made(task=task, error=fault(error, again))


def _died(task: Task) -> Made:
    error = EcatError(
        f"cannot export {task.label}",
        where=f"{task.session}: the process that worked on it was killed; perhaps there was too little memory",
        consequence="this session is not in the export",
        fix="the same command with --jobs 1",
    )
    return Made(task=task, error=error)
