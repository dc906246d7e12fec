"""Where verbs print: results as text or JSON on stdout; progress and errors on stderr."""

from __future__ import annotations

import json
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import click

from ecat.errors import EcatError, one_line
from ecat.progress import Progress, silent

BROKEN_PIPE = 141
"""128 + SIGPIPE, what the shell reports of other programs whose reader went away."""
LINE_EVERY_S = 1.0
"""Least time between two progress lines where there is no terminal."""
LINES = 10
"""Most lines for one piece of work whose length is known."""


@dataclass(frozen=True)
class Output:
    """How one call of a verb wants its output."""

    as_json: bool = False
    quiet: bool = False

    def say(self, text: str) -> None:
        """Print text for a person, unless JSON or silence was asked for."""
        if not (self.as_json or self.quiet):
            print(printable(text))  # noqa: T201

    def result(
        self, data: Mapping[str, object], text: str, *, ok: bool = True, failed: Iterable[EcatError] = ()
    ) -> None:
        """Print the result: ``text`` for a person or ``{"ok": ok, **data}`` for a program.

        Parameters
        ----------
        failed : what went wrong of much that did not, and is told of in ``text``: it is all that is said in quiet.
        """
        failed = tuple(failed)
        ok = ok and not failed
        if self.as_json:
            print_json({"ok": ok, **data})
        elif self.quiet:
            for error in failed:
                click.echo(f"ecat: {printable(str(error))}", err=True)
        elif text:
            self.say(text)

    @contextmanager
    def progress(self) -> Generator[Progress]:
        """A callback that shows progress: a bar on a terminal, now and then a line elsewhere."""
        if self.quiet:
            yield silent
        elif sys.stderr.isatty():
            with _bar() as bar:
                yield bar
        else:
            yield _Lines(time.monotonic)


@contextmanager
def _bar() -> Generator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:,.0f} of {task.total:,.0f}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Bars(
        *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False
    ) as bars:
        task = bars.add_task("", total=0)

        def show(what: str, done: int, total: int) -> None:
            bars.update(task, description=one_line(what), completed=done, total=total)

        yield show


class _Lines:
    """Progress as plain lines on stderr."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._said_s = clock()
        self._part = 0

    def __call__(self, what: str, done: int, total: int) -> None:
        part = done * LINES // total if total else -1
        now_s = self._clock()
        if now_s - self._said_s < LINE_EVERY_S or (total and part == self._part):
            return
        amount = f"{done:,} of {total:,} ({done / total:.0%})" if total else f"{done:,}"
        print(f"{one_line(what)}: {amount}", file=sys.stderr, flush=True)  # noqa: T201
        self._said_s, self._part = now_s, part


def printable(text: str) -> str:
    """``text`` with every line as :func:`ecat.errors.one_line` shows it."""
    return "\n".join(map(one_line, text.split("\n")))


def print_json(data: Mapping[str, object]) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(data, ensure_ascii=False, indent=2, allow_nan=False, default=str))  # noqa: T201


def print_error(error: EcatError, *, as_json: bool) -> None:
    """Print an error: ``ecat: <what>`` and indented lines on stderr, or as JSON on stdout."""
    if as_json:
        print_json({"ok": False, "error": error.to_dict()})
    else:
        print(f"ecat: {error}", file=sys.stderr)  # noqa: T201


def print_bug(error: Exception, *, as_json: bool) -> None:
    """Print a traceback and where to report it."""
    traceback.print_exception(error, file=sys.stderr)
    made = EcatError(
        f"this is a bug in ecat: {type(error).__name__}",
        where=next(iter(str(error).splitlines()), "") or "the traceback says where",
        consequence="what was finished before is kept",
        fix="report it with the lines above and the output of `ecat --version` to ecat's issue tracker",
    )
    print_error(made, as_json=as_json)
