"""What takes longer than an answer may: processing, imports, edits of many sessions; done one after the other."""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from ecat.errors import EcatError, NotFoundError
from ecat.progress import Progress

Work: TypeAlias = Callable[[Progress], dict[str, Any]]
"""Does it, tells how far it is, and returns what came of it."""
MOST_KEPT = 100
_NICE = 10
_END_WITHIN_S = 5.0


class StoppedError(Exception):
    """Somebody does not want it any more, or the server ends."""


@dataclass
class Job:
    """One piece of work: ``step`` is what it is at, ``done`` of ``total`` (0 where unknown) steps are over.

    ``session`` is the id of the session that it is about, if it is about one.
    """

    what: str
    work: Work
    session: str = ""
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    state: Literal["waiting", "running", "done", "failed", "stopped"] = "waiting"
    step: str = ""
    done: int = 0
    total: int = 0
    result: dict[str, Any] | None = None
    error: dict[str, Any] | None = None
    wanted: bool = True

    def describe(self) -> dict[str, Any]:
        """As a page is told."""
        names = ("id", "what", "state", "step", "done", "total", "result", "error")
        return {name: getattr(self, name) for name in names}


class Jobs:
    """Does jobs in a thread of low priority, which ends with the process: what they write is whole or not there."""

    def __init__(self) -> None:
        self._jobs: dict[str, Job] = {}
        self._waiting: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._ends = threading.Event()
        self._worker: threading.Thread | None = None
        self._lock = threading.Lock()

    def start(self, what: str, work: Work, session: str = "") -> Job:
        """Do ``work`` as soon as what was started before is done."""
        job = Job(what, work, session)
        with self._lock:
            over = [old.id for old in self._jobs.values() if old.state in {"done", "failed", "stopped"}]
            for name in over[: max(0, len(self._jobs) + 1 - MOST_KEPT)]:
                del self._jobs[name]
            self._jobs[job.id] = job
            if self._worker is None:
                self._worker = threading.Thread(target=self._run, name="jobs", daemon=True)
                self._worker.start()
        self._waiting.put(job)
        return job

    def get(self, name: str) -> Job:
        """The job with this id.

        Raises
        ------
        NotFoundError : there is none, or it was long ago.
        """
        if name not in self._jobs:
            where = f"{name[:80]}: not among those of this server"
            raise NotFoundError("cannot find the job", where=where, fix="start it again")
        return self._jobs[name]

    def busy_with(self, session: str) -> bool:
        """Whether something is being done, or about to be, to a session."""
        return any(
            job.session == session and job.state in {"waiting", "running"}
            for job in list(self._jobs.values())
        )

    def stop(self, name: str) -> Job:
        """Let a job end at its next step; nothing of the step that it is in remains."""
        job = self.get(name)
        job.wanted = False
        return job

    def close(self) -> None:
        """End, and wait a little for what is under way."""
        self._ends.set()
        self._waiting.put(None)
        if self._worker is not None:
            self._worker.join(_END_WITHIN_S)

    def _run(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            # of this thread and those that it starts: an edit must not wait
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        while (job := self._waiting.get()) is not None and not self._ends.is_set():
            self._do(job)

    def _do(self, job: Job) -> None:
        def tell(what: str, done: int, total: int) -> None:
            job.step, job.done, job.total = what, done, total
            if self._ends.is_set() or not job.wanted:
                raise StoppedError

        try:
            tell("", 0, 0)
            job.state = "running"
            job.result = job.work(tell)
            job.state = "done"
        except StoppedError:
            job.state = "stopped"
        except EcatError as error:
            job.error, job.state = error.to_dict(), "failed"
        except Exception as error:  # noqa: BLE001 - a fault in one job must not end all later ones
            traceback.print_exc()
            made = EcatError(
                f"this is a bug in ecat: {type(error).__name__}",
                where="the traceback is where ecat annotate runs",
                consequence=f"{job.what} was not finished",
                fix="report it with the traceback to ecat's issue tracker",
            )
            job.error, job.state = made.to_dict(), "failed"
