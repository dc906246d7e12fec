"""What to do about each kind of finding that ``--repair`` leaves alone."""

from __future__ import annotations

import shlex
from pathlib import Path

from ecat.check.finding import Finding

_LOOK = "look at the recording there: ecat view {path}"
_EDIT = (
    "correct it in {path}/annotations, then have the edit taken over and its tables published: "
    "ecat check {path} --repair"
)
_AGAIN = "take the file from a copy of the session, or import the recording again: ecat import RECORDING NEW_FOLDER"
_MANIFEST = (
    "correct {path}/session.json and examine it again: ecat check {path}; or import the recording again: "
    "ecat import RECORDING NEW_FOLDER"
)
_CLOCK = "the recording itself is so; if its times were read wrongly, import it again: ecat import RECORDING NEW_FOLDER"
_PROJECT = "correct {path}/project.json, or take it from a copy; then examine it again: ecat check {path}"

ADVICE: dict[str, str] = {
    "leftover": "nothing has to be done if another program is writing to it now; else: ecat check {path} --repair",
    "interrupted-commit": "nothing has to be done",
    "project-unreadable": _PROJECT,
    "session-unreadable": "take {path}/session.json from a copy, or import the recording again: "
    "ecat import RECORDING NEW_FOLDER",
    "layer-unreadable": _EDIT,
    "layer-edited": _EDIT,
    "journal-misfit": "take the journal from a copy of the session; or go on without its history: "
    "ecat check {path} --repair",
    "journal-link": "put the journal itself in the place of the link, then examine it again: ecat check {path}",
    "reference-unchecked": "mend what cannot be read first, then examine it again: ecat check {path}",
    "table-missing": _AGAIN,
    "table-unlisted": "take {path}/session.json from a copy; a table that a stage made can be made again: "
    "ecat process {path}",
    "table-damaged": _AGAIN,
    "table-stale": "ecat process {path}",
    "table-value": _AGAIN,
    "table-unsorted": _AGAIN,
    "stream-damaged": _AGAIN,
    "camera-value": _MANIFEST,
    "prototype-value": "measure the boxes again: ecat calibrate {path} -o boxes.json, then: "
    "ecat process {path} --prototypes boxes.json",
    "clock-missing": _CLOCK,
    "clock-offset": "nothing has to be done if the stream really began then",
    "frame-drop": "the recording itself is so; a faster disk or a smaller image may help the next time",
    "clock-unknown": "nothing has to be done if the recorder wrote no times",
    "clock-rate": _CLOCK,
    "clock-backwards": _CLOCK,
    "clock-drift": _CLOCK,
    "clock-apart": _CLOCK,
    "frame-duplicate": _CLOCK,
    "frame-gap": _CLOCK,
    "time-gap": _CLOCK,
    "time-still": _CLOCK,
    "frame-count": _CLOCK,
    "dangling-stream": _MANIFEST,
    "mark-duplicate": _AGAIN,
    "mark-outside": _AGAIN,
    "mark-absurd": "such numbers count as missing; if they were read wrongly, import the recording again: "
    "ecat import RECORDING NEW_FOLDER",
    "depth-holes": _LOOK,
    "depth-missing": _LOOK,
    "marker-coverage": _LOOK,
    "marker-loss": _LOOK,
    "mark-jump": _LOOK,
    "frame-repeat": _LOOK,
    "pose-jump": _LOOK + "; the smoother takes such jumps for errors: ecat process {path} --smooth",
    "camera-moved": "nothing has to be done",
    "table-untied": "what is smoothed and proposed ends there; have a marked box stand still while the camera is moved",
    "duplicate-id": _EDIT,
    "dangling-reference": _EDIT,
    "dangling-session-reference": _EDIT,
    "parent-cycle": _EDIT,
    "bad-span": _EDIT,
    "interval-reversed": _EDIT,
    "interval-empty": _EDIT,
    "outside-recording": _EDIT,
    "key-frame-order": _EDIT,
    "key-frame-value": _EDIT,
    "sub-event-outside": _EDIT,
    "off-scheme": _EDIT,
}
"""Text by code; ``{path}`` is the folder, as a shell takes it.  Commands end the text, or a clause of it."""


def advice(finding: Finding, folder: Path) -> str:
    """What to do about a finding in ``folder``: the command that repairs it, or what a person has to do."""
    path = shlex.quote(str(folder))
    return f"ecat check {path} --repair" if finding.repair else ADVICE[finding.code].format(path=path)
