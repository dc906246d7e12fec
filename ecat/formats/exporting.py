"""Writing formats a session at a time: parts that can be made anywhere, in any order, and what becomes of them.

Beside the destination ``out`` there is, while it is being made, a folder ``.out.parts``: a folder for each session,
which appears when it is complete.  A part says what it was made from; one that matches is not made again, so that the
same command goes on after an interruption, and several machines that share the disk make a share each.  The parts are
joined in the order of the sessions' paths, whoever made them.  Sessions and destination may be URLs
(:mod:`ecat.store.remote`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

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
    if isinstance(task.session, Path):
        open_session(task.session)  # what others did to it is in its manifest then
    key = _key(chosen, task)
    if (known := task.parts.known(task.label, key)) is not None:
        return Made(task=task, findings=known)
    with remote.at_hand(task.session) as folder:
        session = open_session(folder)
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
    outcomes: list[Made] = []
    for done, task in enumerate(tasks):
        progress(task.label, done, len(tasks))
        outcomes.append(make_part(task, progress if len(tasks) == 1 else silent))
    return join(dest, chosen, outcomes, progress)


def join(dest: Place, chosen: Format, outcomes: Sequence[Made], progress: Progress = silent) -> ExportReport:
    """Make ``dest`` of the parts, in the order of ``outcomes``; sessions without a part are named in the report.

    Raises
    ------
    ExistsError : ``dest`` is taken.
    EcatError : there is no part at all: what stopped the first session.
    """
    made = [outcome for outcome in outcomes if outcome.error is None]
    failures = tuple((o.task.session, o.error) for o in outcomes if o.error is not None)
    parts = outcomes[0].task.parts
    if not made:
        parts.remove()
        raise failures[0][1]
    several = len(outcomes) > 1
    findings = [f"{o.task.label}: {finding}" if several else finding for o in made for finding in o.findings]
    labels = [outcome.task.label for outcome in made]
    options = outcomes[0].task.options
    with (
        parts.data(labels) as places,
        remote.sent(dest) if isinstance(dest, str) else staged_path(dest) as new,
    ):
        found = [Part(label=label, path=place) for label, place in zip(labels, places, strict=True)]
        if chosen.merge is not None:
            findings += chosen.merge(found, new, options, progress)
        elif several:
            _lay_out(found, new, chosen.suffix)
        else:
            files.link_or_copy(found[0].path, new)
    parts.remove()
    return ExportReport(
        path=dest, format=chosen.name, sessions=len(made), findings=tuple(findings), failures=failures
    )


def _lay_out(parts: Sequence[Part], folder: Path, suffix: str) -> None:
    """A file or folder for each session, in folders as the sessions are."""
    for part in parts:
        place = folder / f"{part.label}{suffix}"
        files.make_folders(place.parent)
        files.link_or_copy(part.path, place)
