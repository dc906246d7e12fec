"""``ecat learn recognize predict``: what a trained recogniser sees in sessions, as proposals in them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output, printable
from ecat.cli.text import count
from ecat.cli.verb import verb
from ecat.errors import EcatError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ecat.model import Event
    from ecat.progress import Progress
    from learn.recognize.predict import Action
    from learn.recognize.runs import Recognizer


@verb(
    "predict",
    examples=(
        "ecat learn recognize predict my_session --run runs/first",
        "ecat learn recognize predict my_project --run runs/first --json",
        'ecat learn recognize predict my_session --run runs/first --objects "Shell" "Stella Artois"',
        "ecat learn recognize predict my_session --remove",
    ),
)
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    metavar="SESSION...",
    type=click.Path(path_type=Path),
    help="Sessions, projects or workspaces.",
)
@click.option(
    "--run",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="The folder of a trained recogniser (`ecat learn recognize train`).",
)
@click.option(
    "--objects",
    nargs=2,
    metavar="A B",
    help="The two boxes, by id or by name; of more than two, the one that moves most and the nearest by default.",
)
@click.option(
    "--layer",
    default="machine",
    show_default=True,
    metavar="NAME",
    help="Where to propose; the page shows proposals of the layer machine.",
)
@click.option("--remove", is_flag=True, help="Take the recogniser's proposals out again.")
def predict(
    out: Output,
    *,
    paths: tuple[Path, ...],
    run: Path | None,
    objects: tuple[str, str] | None,
    layer: str,
    remove: bool,
) -> int:
    """Propose who does what to which box in sessions.

    What is recognised becomes events in the layer `machine`, to be accepted or rejected like those of `ecat process`:
    in `ecat annotate`, or by `ecat proposal`; `ecat view` shows them.  There is one for each movement, with its span, a
    text, the roles Subject, Object and Locative, a confidence, and a preposition; what comes before the other box
    matters is a sub-event of it.  Proposals of an earlier call are replaced, but for those that people have decided
    about; what others proposed or people said stays as it is.

    Best after `ecat process`, which tells where the table and the boxes are.  What a session lacks is said, and what
    was left out: windows in which a box is mostly unseen, or over which the clock jumps, say nothing.  A movement of
    which more than a window is left out becomes two.  Without a skeleton actions are recognised by the boxes alone, and
    less well, above all who acts.
    """
    from ecat.cli.describe import sessions_at
    from ecat.errors import UsageError
    from learn.recognize.runs import load

    if (run is None) != remove:
        where = "--remove needs no run" if remove else "no run is given"
        raise UsageError("cannot recognise actions", where=where, fix="give either --run RUN or --remove")
    trained = None if run is None else (load(run), run)
    sessions = list(dict.fromkeys(session for path in paths for session in sessions_at(path)))
    done: list[dict[str, Any]] = []
    failed: list[tuple[Path, EcatError]] = []
    with out.progress() as progress:
        for session in sessions:
            try:
                done.append(_predicted(session, trained, objects or (), layer, progress))
            except EcatError as error:
                if len(sessions) == 1:
                    raise
                failed.append((session, error))
    for session in done:
        if session["guessed"] and not out.quiet:
            click.echo(printable(f"{session['path']}: {session['guessed']}"), err=True)
    data = {"sessions": done, "failures": [{"path": str(path), "error": e.to_dict()} for path, e in failed]}
    lines = [line for session in done for line in _lines(session)] + [f"{path}: {e}" for path, e in failed]
    errors = [error for _, error in failed]
    out.result(data, "\n".join(lines) or "no sessions: there was nothing to do", failed=errors)
    return 1 if failed else 0


def _predicted(
    path: Path,
    trained: tuple[Recognizer, Path] | None,
    objects: tuple[str, ...],
    layer: str,
    progress: Progress,
) -> dict[str, Any]:
    from ecat.store import open_session
    from learn.features.recordings import read_session
    from learn.recognize.predict import recognize
    from learn.recognize.proposals import AUTHOR, events_of, replace_proposals, require_free_layer

    session = open_session(path)
    events, findings, guessed = (), list[str](), ""
    require_free_layer(session, layer)
    if trained is not None:
        recognizer, run = trained
        recording = read_session(session, objects)
        findings += recording.findings
        actions = recognize(recording, recognizer, progress, run=run, findings=findings)
        events = events_of(session, recording, actions)
        guessed = _guessed(actions)
    replaced = replace_proposals(session, AUTHOR, events, layer=layer)
    return {
        "path": str(path),
        "proposed": [
            {**_said(event), "parts": [_said(part) for part in replaced.events if part.parent == event.id]}
            for event in replaced.events
            if not event.parent
        ],
        "added": replaced.added,
        "removed": replaced.removed,
        "kept": replaced.kept,
        "findings": findings,
        "guessed": guessed,
    }


def _guessed(actions: Sequence[Action]) -> str:
    """That it is hardly known who acts, where no joints were seen; nothing if they were."""
    blind = sum(not action.has_joints for action in actions)
    if not blind:
        return ""
    return (
        f"no joints were seen in {blind:,} of {count(len(actions), 'action')}: the performer's were made up, as they "
        "usually are, so who acts (Subject) is less sure than the confidence says"
    )


def _said(event: Event) -> dict[str, Any]:
    properties = {one.name: one.value for one in event.properties}
    return {
        "type": event.type,
        "text": event.text,
        "start_frame": event.segments[0].start_frame,
        "end_frame": event.segments[0].end_frame,
        **{role.name.lower(): role.target for role in event.roles},
        **properties,
        "confidence": float(properties["confidence"]),
    }


def _lines(session: dict[str, Any]) -> list[str]:
    said = [f"proposed {count(session['added'], 'event')}"]
    if session["removed"]:
        said.append(f"took out {count(session['removed'], 'earlier proposal')}")
    if session["kept"]:
        said.append(f"left {session['kept']:,} that people have decided about")
    rows = [
        f"  {one['start_frame']:>6} to {one['end_frame']:<6} {one['confidence']:.2f}  {one['text']}"
        for one in session["proposed"]
    ]
    return [f"{session['path']}: {'; '.join(said)}", *(f"  {each}" for each in session["findings"]), *rows]
