"""Where work is done: in this process, in several beside it, or in a Ray cluster.  The results are the same.

A task is small, picklable data; ``work`` is a function of a module.  Whoever dies while doing a task (out of memory,
killed) takes nobody else's work along: what was under way beside it is done again, and the task itself is given up.
"""

from __future__ import annotations

import contextlib
import importlib.util
import multiprocessing
import multiprocessing.context
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from itertools import pairwise
from multiprocessing import forkserver
from multiprocessing.synchronize import Event
from typing import Any, Literal, TypeVar

from ecat.errors import MissingExtraError, UsageError

Engine = Literal["processes", "ray"]
_T = TypeVar("_T")
_R = TypeVar("_R")

FEW = 4
"""Fewer tasks are done before other processes have started."""
_WAITING = 8
"""Tasks handed over for each process, so that none waits and memory does not grow with the number of tasks."""
_OF_RAY = 8
"""Tasks that are one of Ray's, if there are many."""


def usual_jobs(n_tasks: int) -> int:
    """How many processes to use for so many tasks: one for a few, else one for each processor."""
    affinity: Callable[[int], set[int]] | None = getattr(os, "sched_getaffinity", None)
    processors = len(affinity(0)) if affinity else os.cpu_count() or 1
    return 1 if n_tasks < FEW else min(processors, n_tasks)


class Workers(AbstractContextManager["Workers"]):
    """Who does the work, for the time of the block: processes, or the workers of Ray.

    What takes them a second or more to start is begun at once, while the caller finds out what there is to do; for
    processes, if it is said that several are wanted.

    Parameters
    ----------
    jobs : how many at once; by default as many as are usual for the tasks.
    imports : names of modules that the work needs, to be imported on the way.

    Raises
    ------
    MissingExtraError : Ray is wanted and is not installed.
    """

    def __init__(self, engine: Engine, jobs: int | None, imports: Sequence[str] = ()) -> None:
        _end_if_imported_again()
        self._jobs = jobs
        self._imports = imports
        self._ray = _Cluster(self.jobs(sys.maxsize), imports) if engine == "ray" else None
        if engine == "processes" and jobs is not None and jobs > 1:
            _prepare(imports)

    def jobs(self, n_tasks: int) -> int:
        """How many of so many tasks are done at once."""
        return usual_jobs(n_tasks) if self._jobs is None else max(1, min(self._jobs, n_tasks))

    def here(self, n_tasks: int) -> bool:
        """Whether so many tasks are no work for others: one process does them, and the caller is one."""
        return self._ray is None and self.jobs(n_tasks) == 1

    def end(self) -> None:
        """No more work will come; what has to be ended is, while the caller goes on."""
        if self._ray is not None:
            self._ray.end()

    def __exit__(self, *failure: object) -> None:
        if self._ray is not None:
            self._ray.end()
            self._ray.wait()

    def run(
        self,
        work: Callable[[_T], _R],
        tasks: Sequence[_T],
        *,
        died: Callable[[_T], _R],
        keep: Callable[[_R], None],
    ) -> Generator[_R]:
        """``work`` of every task, in the order of the tasks, each as soon as it and those before it are done.

        While the caller is busy with one, those behind it are worked on.  Whoever stops early closes it.

        Parameters
        ----------
        died : the result of a task during which its process died. keep : is given every result as it comes, in this
            process.

        Raises
        ------
        UsageError : Ray's cluster cannot be started or reached; or processes cannot, as of :func:`pool`.
        """
        done: dict[int, _R] = {}
        following = 0
        jobs = self.jobs(len(tasks))
        if self._ray is not None:
            made = _in_ray(self._ray, work, tasks, died)
        else:
            if jobs > 1:
                _prepare(self._imports)
            made = _surviving(work, tasks, jobs, died)
        with contextlib.closing(made):
            for index, result in made:
                keep(result)
                done[index] = result
                while following in done:
                    yield done.pop(following)
                    following += 1


def _surviving(
    work: Callable[[_T], _R], tasks: Sequence[_T], jobs: int, died: Callable[[_T], _R]
) -> Generator[tuple[int, _R]]:
    left = dict(enumerate(tasks))
    while left:
        suspects = yield from _in_processes(work, left, left, jobs)
        # when a process dies, those beside it are lost too: each is done by itself, so that the one is named
        for index in suspects:
            if (yield from _in_processes(work, left, [index], 1)):
                yield index, died(left.pop(index))


def _in_processes(
    work: Callable[[_T], _R], left: dict[int, _T], which: Iterable[int], jobs: int
) -> Generator[tuple[int, _R], None, list[int]]:
    """The results as they come, their tasks out of ``left``.  If a process dies, this ends with what was under way."""
    waiting = iter(list(which))
    under_way: dict[Future[_R], int] = {}
    try:
        with pool(jobs) as processes:
            while True:
                for index in _first(waiting, jobs * _WAITING - len(under_way)):
                    under_way[processes.submit(work, left[index])] = index
                if not under_way:
                    return []
                finished = next(iter(wait(under_way, return_when=FIRST_COMPLETED).done))
                result = finished.result()
                index = under_way.pop(finished)
                del left[index]
                yield index, result
    except BrokenProcessPool:
        return sorted(under_way.values())


def _first(items: Iterator[_T], n: int) -> Iterator[_T]:
    for _ in range(n):
        try:
            yield next(items)
        except StopIteration:
            return


@contextlib.contextmanager
def pool(jobs: int) -> Generator[ProcessPoolExecutor]:
    """Processes that end with the block, at once if it fails: a commit is made whole or not at all.

    Raises
    ------
    UsageError : a process has ended before it began.
    """
    _end_if_imported_again()
    others = set(multiprocessing.active_children())
    begun = _context().Event()
    processes = ProcessPoolExecutor(
        jobs, mp_context=_context(), initializer=_begin, initargs=(dict(os.environ), begun)
    )
    try:
        yield processes
    except BaseException as error:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        # the pool waits for its processes in a thread of its own; of two that wait for one, only one hears of its end
        processes.shutdown(cancel_futures=True)
        if isinstance(error, BrokenProcessPool) and not begun.is_set():
            raise _without_guard() from error
        raise
    processes.shutdown()


def _without_guard() -> UsageError:
    return UsageError(
        "cannot do several sessions at once",
        where="the other processes, which import the program's own file again, ended before they had begun",
        consequence="no session was worked on",
        fix='in a script, call ecat below `if __name__ == "__main__":`, or with jobs=1',
    )


def _end_if_imported_again() -> None:
    """End a process whose only purpose was to do a task, and that does all of the program's work instead.

    It imports the file of the program that has started it (``multiprocessing``, "Safe importing of main module").
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(1)


def _context() -> multiprocessing.context.BaseContext:
    """On Linux processes are copies of one that has imported what they need, once; elsewhere a copy is not safe."""
    return multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")


def _prepare(imports: Sequence[str]) -> None:
    """Start the process that the others are copied from; it imports what they need meanwhile."""
    if sys.platform == "linux":
        # pyarrow imports pandas with its first array, if it is there
        forkserver.set_forkserver_preload(["ecat.batch", "pandas", *imports])
        forkserver.ensure_running()


def _begin(environment: dict[str, str], begun: Event) -> None:
    """What a process does first: leave it to the one that started it to end it, and not outlive that one."""
    begun.set()
    os.environ.update(environment)
    # Ctrl-C reaches every process of a terminal
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def _in_ray(
    cluster: _Cluster, work: Callable[[_T], _R], tasks: Sequence[_T], died: Callable[[_T], _R]
) -> Generator[tuple[int, _R]]:
    """The results of Ray core tasks, as they come; if there are many, a few of ours are one of Ray's."""
    ray = cluster.begun()
    # Ray serves one function's tasks in the order in which they come
    remote = ray.remote(_each)
    # the last are handed over one by one, so that all end at about the same time
    last = max(0, len(tasks) - cluster.jobs * _WAITING)
    at_once = max(1, min(_OF_RAY, len(tasks) // (cluster.jobs * _WAITING)))
    starts = [*range(0, last, at_once), *range(last, len(tasks)), len(tasks)]
    waiting = [range(start, end) for start, end in pairwise(starts)][::-1]
    under_way = dict[Any, range]()
    while waiting or under_way:
        while waiting and len(under_way) < cluster.jobs * _WAITING:
            some = waiting.pop()
            # a task that kills its worker is tried once more, as another may have taken the memory
            tried = remote.options(max_retries=1 if len(some) == 1 else 0)
            under_way[tried.remote(work, [tasks[i] for i in some])] = some
        [finished], _ = ray.wait(list(under_way))
        some = under_way.pop(finished)
        try:
            yield from zip(some, ray.get(finished), strict=True)
        except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError):
            if len(some) == 1:
                yield some[0], died(tasks[some[0]])
            waiting += [range(i, i + 1) for i in some] if len(some) > 1 else []


def _each(work: Callable[[_T], _R], tasks: Sequence[_T]) -> list[_R]:
    return [work(task) for task in tasks]


class _Cluster:
    """The one that ``RAY_ADDRESS`` names, or that the program uses already; else one on this machine.

    It is begun in a thread.
    """

    def __init__(self, jobs: int, imports: Sequence[str]) -> None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        if not _installed("ray"):
            raise MissingExtraError(
                "cannot use --engine ray",
                where="Ray is not installed",
                fix="pip install 'ecat[ray]', or leave out --engine",
            )
        self.jobs = jobs
        self._imports = ("ecat.batch", "pandas", *imports)
        self._own = False
        self._thread = ThreadPoolExecutor(1)
        self._ended: Future[None] | None = None
        self._begun = self._thread.submit(self._begin)

    def begun(self) -> Any:
        """The module ``ray``, once the cluster can be used.

        Raises
        ------
        UsageError : it cannot.
        """
        return self._begun.result()

    def end(self) -> None:
        """End what was begun here, in the background."""
        # in the thread that has begun it: what Ray has started on this machine is killed when that one ends
        self._ended = self._ended or self._thread.submit(self._end)

    def wait(self) -> None:
        """Wait until it has ended."""
        self._thread.shutdown()

    def _end(self) -> None:
        if self._own:
            _ray().shutdown()

    def _begin(self) -> Any:
        ray = _ray()
        if ray.is_initialized():
            return ray
        address = os.environ.get("RAY_ADDRESS")
        own = {} if address else {"num_cpus": self.jobs, "include_dashboard": False}
        try:
            ray.init(address=address, log_to_driver=False, logging_level="ERROR", **own)
        except (
            Exception
        ) as error:  # a machine that is too busy to start it in time is told so by just this class
            raise UsageError(
                "cannot use --engine ray",
                where=f"RAY_ADDRESS={address or ''}: {error}",
                fix="start a cluster (ray start --head), or unset RAY_ADDRESS to have one on this machine",
            ) from error
        self._own = True
        for _ in range(self.jobs):
            ray.remote(_import).remote(self._imports)
        return ray


def _installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ValueError:  # what is None among the modules cannot be imported
        return False


def _ray() -> Any:
    import ray

    return ray


def _import(modules: Sequence[str]) -> None:
    """What a process needs before its first task; what is missing is missed there, if it is needed."""
    for module in modules:
        with contextlib.suppress(ImportError):
            importlib.import_module(module)
