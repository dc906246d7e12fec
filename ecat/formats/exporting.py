"""Writing formats a session at a time: parts that can be made anywhere, in any order, and what becomes of them.

Beside the destination ``out`` there is, while it is being made, a folder ``.out.parts``: a folder for each session,
which appears when it is complete.  A part says what it was made from; one that matches is not made again, so that the
same command goes on after an interruption, and several machines that share the disk make a share each.  The parts are
joined in the order of the sessions' paths, whoever made them.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ecat.errors import EcatError, NotFoundError
from ecat.formats import registry
from ecat.formats.format import ExportReport, Format, Part
from ecat.progress import Progress, silent
from ecat.store import files, find_sessions, open_session, write_new_file
from ecat.store.manifest import SESSION_FILE
from ecat.store.output import keep_out_of_sessions
from ecat.store.staging import refuse_taken, staged_path

_ABOUT = "part.json"
_DATA = "data"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One session to write: what a process has to know to make its part.  ``options`` are those of the format."""

    format: str
    session: Path
    label: str
    folder: Path
    options: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What became of a task: findings, or the error because of which there is no part."""

    task: Task
    findings: tuple[str, ...] = ()
    error: EcatError | None = None


def tasks_of(path: Path, dest: Path, chosen: Format, options: Any) -> list[Task]:
    """A task for each session at ``path``, in the order of their paths.

    Raises
    ------
    NotFoundError : there is no session.
    ExistsError : ``dest`` lies inside of a session.
    """
    keep_out_of_sessions(f"cannot write {dest.name}", dest)
    sessions = find_sessions(path)
    if not sessions:
        raise NotFoundError(
            f"cannot export {path}",
            where="there is no session in it",
            consequence="nothing was written",
            fix="ecat import brings recordings in",
        )
    labels = [_label(session, path) for session in sessions]
    return [
        Task(
            format=chosen.name,
            session=session,
            label=label,
            folder=parts_folder(dest) / hashlib.sha256(label.encode()).hexdigest()[:20],
            options=options,
        )
        for session, label in zip(sessions, labels, strict=True)
    ]


def parts_folder(dest: Path) -> Path:
    """Where the parts of ``dest`` are while it is being made."""
    place = dest.resolve()
    return place.with_name(f".{place.name}.parts")


def _label(session: Path, path: Path) -> str:
    inside = session.relative_to(path)
    return inside.as_posix() if inside.parts else session.resolve().name


def make_part(task: Task, progress: Progress = silent) -> Made:
    """Write one session, unless that was done already.  What stops it is in the answer; only bugs raise."""
    try:
        return _made(task, progress)
    except EcatError as error:
        return Made(task=task, error=error)


def _made(task: Task, progress: Progress) -> Made:
    chosen = registry.find(task.format)
    assert chosen.part is not None
    session = open_session(task.session)
    key = _key(chosen, task)
    if (known := _findings(task.folder, key)) is not None:
        return Made(task=task, findings=known)
    staging = task.folder.with_name(f"{task.folder.name}.{secrets.token_hex(8)}.partial")
    with files.typed_errors(f"cannot write {task.label}", task.folder, "this session is not in it"):
        files.make_folders(staging)
        try:
            findings = chosen.part(session, task.label, staging / _DATA, task.options, progress)
            about = {"key": key, "findings": list(findings)}
            write_new_file(staging / _ABOUT, [json.dumps(about).encode()])
            files.sync_tree(staging)
            files.remove(task.folder)
            files.rename(staging, task.folder)
        except BaseException:
            files.remove(staging)
            raise
    return Made(task=task, findings=findings)


def _key(chosen: Format, task: Task) -> str:
    """Everything that the bytes of a part follow from; the manifest names the hash of every file of the session."""
    said = [chosen.name, chosen.version, task.label, asdict(task.options)]
    manifest = (task.session / SESSION_FILE).read_bytes()
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode() + manifest).hexdigest()


def _findings(folder: Path, key: str) -> tuple[str, ...] | None:
    """What was said when the part was made, if it is there and is the one wanted."""
    try:
        about: Any = json.loads((folder / _ABOUT).read_bytes())
    except (OSError, ValueError):
        return None
    if not (folder / _DATA).exists() or not isinstance(about, dict) or about.get("key") != key:
        return None
    return tuple(map(str, about.get("findings", ())))


def write(path: Path, dest: Path, chosen: Format, options: Any, progress: Progress = silent) -> ExportReport:
    """Write all sessions at ``path``, one after the other, and join them.

    Raises
    ------
    EcatError : as of :func:`tasks_of` and :func:`join`.
    """
    refuse_taken(dest)
    tasks = tasks_of(path, dest, chosen, options)
    outcomes: list[Made] = []
    for done, task in enumerate(tasks):
        progress(task.label, done, len(tasks))
        outcomes.append(make_part(task, progress if len(tasks) == 1 else silent))
    return join(dest, chosen, outcomes, progress)


def join(dest: Path, chosen: Format, outcomes: Sequence[Made], progress: Progress = silent) -> ExportReport:
    """Make ``dest`` of the parts, in the order of ``outcomes``; sessions without a part are named in the report.

    Raises
    ------
    ExistsError : ``dest`` is taken.
    EcatError : there is no part at all: what stopped the first session.
    """
    made = [outcome for outcome in outcomes if outcome.error is None]
    failures = tuple((o.task.session, o.error) for o in outcomes if o.error is not None)
    if not made:
        files.remove(parts_folder(dest))
        raise failures[0][1]
    parts = [Part(label=outcome.task.label, path=outcome.task.folder / _DATA) for outcome in made]
    several = len(outcomes) > 1
    findings = [f"{o.task.label}: {finding}" if several else finding for o in made for finding in o.findings]
    with staged_path(dest) as staging:
        if chosen.merge is not None:
            findings += chosen.merge(parts, staging, outcomes[0].task.options, progress)
        elif several:
            _lay_out(parts, staging, chosen.suffix)
        else:
            files.link_or_copy(parts[0].path, staging)
    files.remove(parts_folder(dest))
    return ExportReport(
        path=dest, format=chosen.name, sessions=len(made), findings=tuple(findings), failures=failures
    )


def _lay_out(parts: Sequence[Part], folder: Path, suffix: str) -> None:
    """A file or folder for each session, in folders as the sessions are."""
    for part in parts:
        place = folder / f"{part.label}{suffix}"
        files.make_folders(place.parent)
        files.link_or_copy(part.path, place)
