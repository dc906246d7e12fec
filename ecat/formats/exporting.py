"""Writing formats a session at a time: parts that can be made anywhere, in any order, and what becomes of them.

Beside the destination ``out`` there is, while it is being made, a folder ``.out.parts``: a file or folder for each
session, and when that is complete, a file that says what it was made from.  A part that matches is not made again, so
that the same command goes on after an interruption, and several machines that share the disk make a share each.  The
parts are joined in the order of the sessions' paths, whoever made them.  Sessions and destination may be URLs
(:mod:`ecat.store.remote`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path, PurePosixPath
from typing import Any, overload

from ecat.errors import EcatError, NotFoundError
from ecat.formats import registry
from ecat.formats.format import ExportReport, Format, Part
from ecat.formats.parts import LocalParts, RemoteParts, parts_of
from ecat.progress import Progress, silent
from ecat.store import files, find_sessions, open_session, remote
from ecat.store.manifest import SESSION_FILE
from ecat.store.output import keep_out_of_sessions
from ecat.store.staging import refuse_taken, staged_path

Place = Path | str
"""A path, or a URL."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One session to write: what a process has to know to make its part.  ``options`` are those of the format."""

    format: str
    session: Place
    label: str
    parts: LocalParts | RemoteParts
    options: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What became of a task: findings, or the error because of which there is no part."""

    task: Task
    findings: tuple[str, ...] = ()
    error: EcatError | None = None


def tasks_of(path: Place, dest: Place, chosen: Format, options: Any) -> list[Task]:
    """A task for each session at ``path``, in the order of their paths.

    Raises
    ------
    NotFoundError : there is no session.
    ExistsError : ``dest`` is taken, or lies inside of a session.
    """
    if isinstance(dest, str):
        remote.refuse_taken(dest)
    else:
        keep_out_of_sessions(f"cannot write {dest.name}", dest)
        refuse_taken(dest)
    sessions: Sequence[Place] = remote.find_sessions(path) if isinstance(path, str) else find_sessions(path)
    if not sessions:
        raise NotFoundError(
            f"cannot export {path}",
            where="there is no session in it",
            consequence="nothing was written",
            fix="ecat import brings recordings in",
        )
    parts = parts_of(dest)
    return [
        Task(format=chosen.name, session=session, label=_label(session, path), parts=parts, options=options)
        for session in sessions
    ]


def _label(session: Place, path: Place) -> str:
    inside = PurePosixPath(Path(session).relative_to(path).as_posix())
    if inside.parts:
        return str(inside)
    return session.resolve().name if isinstance(session, Path) else PurePosixPath(session).name


def make_part(task: Task, progress: Progress = silent) -> Made:
    """Write one session, unless that was done already.  What stops it is in the answer; only bugs raise."""
    try:
        return _made(task, progress)
    except EcatError as error:
        return Made(task=task, error=error)


def _made(task: Task, progress: Progress) -> Made:
    chosen = registry.find(task.format)
    write = chosen.part
    assert write is not None
    # what others did to it is in its manifest then
    here = open_session(task.session) if isinstance(task.session, Path) else None
    key = _key(chosen, task)
    if (known := task.parts.known(task.label, key)) is not None:
        return Made(task=task, findings=known)
    with remote.at_hand(task.session) as folder:
        session = here or open_session(folder)
        findings = task.parts.put(
            task.label, key, lambda dest: write(session, task.label, dest, task.options, progress)
        )
    return Made(task=task, findings=findings)


def _key(chosen: Format, task: Task) -> str:
    """Everything that the bytes of a part follow from; the manifest names the hash of every file of the session."""
    said = [chosen.name, chosen.version, task.label, asdict(task.options)]
    place = task.session
    manifest = (place / SESSION_FILE).read_bytes() if isinstance(place, Path) else remote.read_manifest(place)
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode() + manifest).hexdigest()


def write(
    path: Place, dest: Place, chosen: Format, options: Any, progress: Progress = silent
) -> ExportReport:
    """Write all sessions at ``path``, one after the other, and join them.

    Raises
    ------
    EcatError : as of :func:`tasks_of` and :func:`join`.
    """
    tasks = tasks_of(path, dest, chosen, options)

    def outcomes() -> Generator[Made]:
        for done, task in enumerate(tasks):
            progress(task.label, done, len(tasks))
            yield make_part(task, progress if len(tasks) == 1 else silent)

    return join(dest, chosen, tasks, outcomes(), progress)


def join(
    dest: Place,
    chosen: Format,
    tasks: Sequence[Task],
    outcomes: Generator[Made],
    progress: Progress = silent,
) -> ExportReport:
    """Make ``dest`` of the parts, in the order of the tasks; sessions without a part are named in the report.

    Parameters
    ----------
    outcomes : what becomes of ``tasks``, in their order.  Parts are joined as they come, while others are being made.

    Raises
    ------
    ExistsError : ``dest`` is taken.
    EcatError : there is no part at all: what stopped the first session.
    """
    parts, several = tasks[0].parts, len(tasks) > 1
    with closing(outcomes), parts.data() as place:
        made = _Coming(outcomes, place)
        if not made.any():
            parts.remove()
            raise made.failures[0][1]
        # among the parts: after an interruption it goes where they go
        staged = remote.sent(dest) if isinstance(dest, str) else staged_path(dest, Path(str(parts)))
        with staged as new:
            findings: list[str] = []
            if chosen.merge is not None:
                findings += chosen.merge(made, new, tasks[0].options, progress)
            elif several:
                _lay_out(made, new, chosen.suffix)
            else:
                files.link_or_copy(made[0].path, new)
            n_made = len(made)
    parts.remove()
    return ExportReport(
        path=dest,
        format=chosen.name,
        sessions=n_made,
        findings=(*made.findings(named=several), *findings),
        failures=tuple(made.failures),
    )


class _Coming(Sequence[Part]):
    """The parts of sessions, in their order; to iterate is to wait for one after the other, all else waits for all."""

    def __init__(self, outcomes: Iterator[Made], place: Callable[[str], Path]) -> None:
        self._outcomes, self._place = outcomes, place
        self._made: list[Made] = []
        self._parts: list[Part] = []
        self.failures: list[tuple[Place, EcatError]] = []

    def _wait(self) -> bool:
        """Wait for another part; whether there is one."""
        for outcome in self._outcomes:
            if outcome.error is None:
                label = outcome.task.label
                self._parts.append(Part(label=label, path=self._place(label)))
                self._made.append(outcome)
                return True
            self.failures.append((outcome.task.session, outcome.error))
        return False

    def any(self) -> bool:
        """Whether there is any part at all."""
        return bool(self._parts) or self._wait()

    def findings(self, *, named: bool) -> list[str]:
        """What the formats could not carry; ``named``, with the session in front."""
        return [f"{o.task.label}: {said}" if named else said for o in self._made for said in o.findings]

    def __iter__(self) -> Iterator[Part]:
        for index in count():
            if index == len(self._parts) and not self._wait():
                return
            yield self._parts[index]

    def __len__(self) -> int:
        while self._wait():
            pass
        return len(self._parts)

    @overload
    def __getitem__(self, index: int) -> Part: ...
    @overload
    def __getitem__(self, index: slice) -> list[Part]: ...
    def __getitem__(self, index: int | slice) -> Part | list[Part]:
        len(self)
        return self._parts[index]


def _lay_out(parts: Sequence[Part], folder: Path, suffix: str) -> None:
    """A file or folder for each session, in folders as the sessions are."""
    for part in parts:
        place = folder / f"{part.label}{suffix}"
        files.make_folders(place.parent)
        files.link_or_copy(part.path, place)
