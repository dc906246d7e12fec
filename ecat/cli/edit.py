"""What all verbs that edit an annotation share: the session, the layer, who edits, and how frames are given."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, count
from ecat.cli.verb import Verb, verb
from ecat.errors import EcatError, UsageError

if TYPE_CHECKING:
    from ecat.annotate import Editor, Record
    from ecat.model.changes import Change
    from ecat.store import Session

Fields = dict[str, Any]
Moment = Callable[[str], int]
"""The frame that a person means with ``120`` or ``4.2s``."""
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)s")

path_argument = click.argument("path", type=click.Path(path_type=Path), help="The session.")
paths_argument = click.argument(
    "path", type=click.Path(path_type=Path), help="The session, or a project: each of its sessions."
)
layer_option = click.option(
    "--layer", default="main", show_default=True, help="The layer, usually one per annotator."
)
author_option = click.option(
    "--author", envvar="ECAT_AUTHOR", help="Who edits; by default $ECAT_AUTHOR, or who is logged in."
)
steps_option = click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="How many edits; fewer if there are no more.",
)


def edits(
    name: str, *, examples: tuple[str, ...], of_projects: bool = False
) -> Callable[[Callable[..., Fields | list[Fields]]], Verb]:
    """Make a verb of a function that returns the operation meant, or several, as data.

    The function is called with the options and ``at``, which turns what was typed for a frame into one.  What it
    returns is one step for undo.  If the verb is ``of_projects``, it may be given one: each of its sessions is edited.
    """

    def make(build: Callable[..., Fields | list[Fields]]) -> Verb:
        @wraps(build)
        def run(out: Output, path: Path, layer: str, author: str | None, **options: Any) -> int:
            from ecat.store import find_sessions

            if of_projects and (folders := find_sessions(path)) != [path]:
                return _edit_all(out, path, folders, lambda folder: step(folder, layer, author, options))
            report(out, layer, step(path, layer, author, options))
            return 0

        def step(path: Path, layer: str, author: str | None, options: dict[str, Any]) -> Record:
            from ecat.annotate import operation_from_dict

            with editing(path, layer, author, new=True) as editor:
                said = build(moments(editor.session), **options)
                listed = [said] if isinstance(said, dict) else said
                return editor.apply([operation_from_dict(fields) for fields in listed])

        for option in (author_option, layer_option, paths_argument if of_projects else path_argument):
            run = option(run)
        return verb(name, examples=examples)(run)

    return make


def _edit_all(out: Output, root: Path, folders: Sequence[Path], step: Callable[[Path], Record]) -> int:
    """Edit sessions one after the other; what stops one does not stop the others."""
    done: list[dict[str, Any]] = []
    failed: list[tuple[str, EcatError]] = []
    lines: list[str] = []
    with out.progress() as progress:
        for i, folder in enumerate(folders):
            name = folder.relative_to(root).as_posix()
            progress(name, i, len(folders))
            try:
                record = step(folder)
            except EcatError as error:
                failed.append((name, error))
                lines.append(f"{name}: {error}")
            else:
                changes = sum(change.kind != "layer" for change in record.changes)
                done.append({"session": name, "revision": record.revision, "changes": changes})
                lines.append(f"{name}: {count(changes, 'change')}, revision {record.revision}")
    failures = [{"session": name, "error": error.to_dict()} for name, error in failed]
    data = {"sessions": done, "failures": failures}
    out.result(data, "\n".join(lines) or "no sessions", failed=[error for _, error in failed])
    return 1 if failed else 0


def editing(path: Path, layer: str, author: str | None, *, new: bool = False) -> Editor:
    """The editor of a session's layer, which is made if it may be ``new``."""
    from ecat.annotate import Editor
    from ecat.annotate.queries import default_author
    from ecat.store import open_session

    session = open_session(path)
    if not new:
        session.layer(layer)  # there is one, or the error says which there are
    return Editor(session, layer, author or default_author())


def report(out: Output, layer: str, record: Record) -> None:
    """Say what an edit did, to whom it may be needed again."""
    changes = list(record.changes)
    data = {
        "layer": layer,
        "revision": record.revision,
        "operation": record.operation,
        "changes": [change.to_dict() for change in changes],
        "added": [change.id for change in changes if change.before is None and change.kind != "layer"],
    }
    lines = [_said(change) for change in changes if change.kind != "layer"]
    out.result(data, "\n".join([*lines, f"revision {record.revision} of layer {layer}"]))


def _said(change: Change) -> str:
    what = f"{change.kind.replace('_', ' ')} {change.id}"
    if change.before is None:
        return f"added {what}"
    return f"removed {what}" if change.after is None else f"changed {what}"


def back_and_forth(
    out: Output, path: Path, layer: str, author: str | None, *, steps: int, redo: bool
) -> None:
    """Undo or redo some edits, or as many as there are, and say which."""
    with editing(path, layer, author) as editor:
        step, more = (editor.redo, editor.can_redo) if redo else (editor.undo, editor.can_undo)
        records = [step()]
        while len(records) < steps and more():
            records.append(step())
        revision = editor.revision
    lines = [_said(change) for record in records for change in record.changes if change.kind != "layer"]
    data = {"layer": layer, "revision": revision, "records": [record.to_dict() for record in records]}
    out.result(data, "\n".join([*lines, f"revision {revision} of layer {layer}"]))


def moments(session: Session) -> Moment:
    """How frames are typed for this session."""

    def at(text: str) -> int:
        if text.removeprefix("-").isdecimal():  # imported annotations may begin at -1
            return int(text)
        if match := _SECONDS.fullmatch(text):
            return _frame_at(session, float(match[1]))
        raise UsageError(
            f"cannot find frame {text!r}", where="neither a frame nor a time", fix="type 120, or 4.2s"
        )

    return at


def _frame_at(session: Session, seconds: float) -> int:
    """The image of the annotated video nearest to a time."""
    import numpy as np

    from ecat.store.media import annotated_stream
    from ecat.store.times import image_times_s

    stream = annotated_stream(session.manifest)
    if stream is None:
        where = "the session has no video whose images could be counted"
        raise UsageError(f"cannot find the frame at {seconds:g} s", where=where, fix="type frames")
    return int(np.abs(image_times_s(session, stream) - seconds).argmin())


def spans(texts: Sequence[str], at: Moment) -> list[list[int]]:
    """``120:180`` as ``[120, 180]``; half-open."""
    found: list[list[int]] = []
    for text in texts:
        start, colon, end = text.partition(":")
        if not colon:
            raise UsageError(
                f"cannot read the span {text!r}", where="it has no end", fix="type 120:180, or 4s:6.5s"
            )
        found.append([at(start), at(end)])
    return found


def pairs(texts: Sequence[str], what: str) -> dict[str, str]:
    """``Theme=o1`` as ``{"Theme": "o1"}``."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UsageError(f"cannot read the {what} {text!r}", where="it has no '='", fix="type NAME=VALUE")
        found[name] = value
    return found


def numbers(text: str) -> list[float]:
    """``10,20,30.5`` as numbers."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        fix = "type numbers with commas between: 10,20,30.5"
        raise UsageError(f"cannot read {text!r:.80}", where="not numbers", fix=fix) from None


def given(**fields: Any) -> Fields:
    """The fields that were given."""
    return {name: value for name, value in fields.items() if value is not None}


def listing(out: Output, rows: Sequence[Mapping[str, Any]], shown: Sequence[str], what: str) -> None:
    """Print elements as a table, or all of them as data."""
    cells = [list(shown), *([_cell(row.get(name)) for name in shown] for row in rows)]
    text = f"{columns(cells)}\n{count(len(rows), what)}" if rows else f"no {what}s"
    out.result({f"{what}s": list(rows)}, text)


def _cell(value: object) -> str:
    if value is None or value == "":
        return "-"
    return str(value)
