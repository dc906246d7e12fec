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
from multiprocessing import forkserver
from typing import Any, Literal, TypeVar

from ecat.errors import MissingExtraError, UsageError

Engine = Literal["processes", "ray"]
_T = TypeVar("_T")
_R = TypeVar("_R")

FEW = 4
"""Fewer tasks are done before other processes have started."""
_WAITING = 8
"""Tasks handed over for each process, so that none waits and memory does not grow with the number of tasks."""


def usual_jobs(n_tasks: int) -> int:
    """How many processes to use for so many tasks: one for a few, else one for each processor."""
    affinity: Callable[[int], set[int]] | None = getattr(os, "sched_getaffinity", None)
    processors = len(affinity(0)) if affinity else os.cpu_count() or 1
    return 1 if n_tasks < FEW else min(processors, n_tasks)


class Workers(AbstractContextManager["Workers"]):
    """Who does the work, for the time of the block: processes, or the workers of Ray.

    What takes them a second or more to start is begun when the block is entered, while the caller finds out what there
    is to do.

    Parameters
    ----------
    jobs : how many at once. imports : names of modules that the work needs, to be imported on the way.

    Raises
    ------
    MissingExtraError : Ray is wanted and is not installed.
    """

    def __init__(self, engine: Engine, jobs: int, imports: Sequence[str] = ()) -> None:
        self._jobs = max(1, jobs)
        self._ray = _Cluster(self._jobs, imports) if engine == "ray" else None
        if self._ray is None and self._jobs > 1:
            _prepare(imports)

    def __exit__(self, *failure: object) -> None:
        if self._ray is not None:
            self._ray.end()

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
        UsageError : Ray's cluster cannot be started or reached.
        """
        done: dict[int, _R] = {}
        following = 0
        many = self._jobs
        ray = self._ray
        made = _surviving(work, tasks, many, died) if ray is None else _in_ray(ray, work, tasks, died)
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
    with pool(jobs) as processes:
        try:
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
    """Processes that end with the block, at once if it fails: a commit is made whole or not at all."""
    others = set(multiprocessing.active_children())
    processes = ProcessPoolExecutor(
        jobs, mp_context=_context(), initializer=_begin, initargs=(dict(os.environ),)
    )
    try:
        yield processes
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        # the pool waits for its processes in a thread of its own; of two that wait for one, only one hears of its end
        processes.shutdown(cancel_futures=True)
        raise
    processes.shutdown()


def _context() -> multiprocessing.context.BaseContext:
    """On Linux processes are copies of one that has imported what they need, once; elsewhere a copy is not safe."""
    return multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")


def _prepare(imports: Sequence[str]) -> None:
    """Start the process that the others are copied from; it imports what they need meanwhile."""
    if sys.platform == "linux":
        # pyarrow imports pandas with its first array, if it is there
        forkserver.set_forkserver_preload(["ecat.batch", "pandas", *imports])
        forkserver.ensure_running()


def _begin(environment: dict[str, str]) -> None:
    """What a process does first: leave it to the one that started it to end it, and not outlive that one."""
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
    """The results of Ray core tasks, as they come."""
    ray = cluster.begun()
    # a task that kills its worker is tried once more, as another may have taken the memory
    remote = ray.remote(max_retries=1)(work)
    left, under_way = iter(enumerate(tasks)), dict[Any, int]()
    while True:
        for index, task in _first(left, cluster.jobs * _WAITING - len(under_way)):
            under_way[remote.remote(task)] = index
        if not under_way:
            return
        [finished], _ = ray.wait(list(under_way))
        index = under_way.pop(finished)
        try:
            result = ray.get(finished)
        except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError):
            result = died(tasks[index])
        yield index, result


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
        self._begun = self._thread.submit(self._begin)

    def begun(self) -> Any:
        """The module ``ray``, once the cluster can be used.

        Raises
        ------
        UsageError : it cannot.
        """
        return self._begun.result()

    def end(self) -> None:
        """End what was begun here."""
        self._thread.shutdown()
        if self._own:
            self.begun().shutdown()

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
        for _ in range(0 if address else self.jobs):
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
