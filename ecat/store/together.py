"""Files of one change that are written side by side: they all come to their end, or none goes on."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextvars import ContextVar
from threading import Event

_GIVEN_UP: ContextVar[Event | None] = ContextVar("_GIVEN_UP", default=None)


class GivenUp(Exception):  # noqa: N818 - nothing is wrong with the work that ends by it
    """Ends work that is of no use, as other work beside it has failed, which is what whoever waits is told."""


def run_together(works: Sequence[Callable[[], None]]) -> None:
    """Do all of ``works``, as many at a time as there are processors, and return when they are done.

    Raises
    ------
    What the first that failed raised.  The others have ended by then, at their next :func:`go_on`.
    """
    if len(works) == 1:
        works[0]()
        return
    given_up = Event()

    def run(work: Callable[[], None]) -> None:
        _GIVEN_UP.set(given_up)
        go_on()
        try:
            work()
        except BaseException:
            given_up.set()
            raise

    with ThreadPoolExecutor(max(1, min(len(works), os.cpu_count() or 1))) as threads:
        try:
            ended = as_completed([threads.submit(run, work) for work in works])
            errors = (done.exception() for done in ended)
            failure = next((error for error in errors if not isinstance(error, GivenUp | None)), None)
        except BaseException:  # whoever waits was interrupted
            given_up.set()
            raise
    if failure is not None:
        raise failure


def go_on() -> None:
    """Called in between by work that takes long, which ends here once work beside it has failed."""
    given_up = _GIVEN_UP.get()
    if given_up is not None and given_up.is_set():
        raise GivenUp
