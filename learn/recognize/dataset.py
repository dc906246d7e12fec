"""Sessions with labelled windows, from the learning exports of ECAT."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.cli.text import count
from ecat.errors import FormatError, InputError, NotFoundError
from ecat.formats.ecat2018.learning_export import (
    ExportedSession,
    learning_exports_below,
    read_learning_export,
)
from ecat.process.inputs import MOST_COORDINATE
from ecat.progress import Progress, silent
from ecat.store import find_sessions
from learn.features.points import KINECT_FROM_CAMERA
from learn.features.windows import HOP, LENGTH, Floats, n_windows

SLOTS: dict[str, tuple[str | None, ...]] = {
    "subject": (None, "Performer", "Object_1", "Object_2"),
    "object": (None, "Performer", "Object_1", "Object_2"),
    "locative": (None, "Performer", "Object_1", "Object_2"),
    "verb": (None, "push", "pull", "roll", "slide"),
    "preposition": (None, "Past", "From", "To"),
}
"""The five slots of a label and what may stand in each; a label is five places in these (thesis chapter 4)."""
SUBJECT, OBJECT, LOCATIVE, VERB, PREPOSITION = range(len(SLOTS))
"""Where the slots are in a label."""
Labels = NDArray[np.int8]

_VERBS = {None: 0, "pushes": 1, "pulls": 2, "rolls": 3, "slides": 4}
_PREPOSITIONS = {None: 0, "Past": 1, "From": 2, "To": 3}
_ROLES = {"Subject": 0, "Object": 1, "Theme": 2}
_KNOWN = {"verb": _VERBS, "preposition": _PREPOSITIONS}
_ACTORS = ("rig_role", "box1_role", "box2_role")
_EXCHANGED = np.array([0, 1, 3, 2], np.int8)
_UNUSED = "none of these sessions was used"
_MOST, _FEW = 20, 3
"""Labels that an error names, and sessions of each."""


@dataclass(frozen=True)
class LabelledSession:
    """A session of an export.

    Attributes
    ----------
    file, name : the export without ``.txt``, and the session in it; together they are unique.
    points : (n, 21, 3) metres in the Kinect's camera space (x to its left, y up), NaN where nothing was seen: 13
        joints, then four corners of a marker of each box.
    labels : (w, 5) places in :data:`SLOTS`, one row for each window of 20 frames, every 5 frames.
    """

    file: str
    name: str
    points: Floats
    labels: Labels

    @property
    def key(self) -> tuple[str, str]:
        """File and name."""
        return self.file, self.name

    @property
    def content(self) -> bytes:
        """Changes when anything of it does."""
        return repr(self.key).encode() + self.points.tobytes() + self.labels.tobytes()


def read_exports(
    source: Path, progress: Progress = silent, findings: list[str] | None = None
) -> list[LabelledSession]:
    """The sessions of a learning export, or of all those (``*.txt``) below a folder, by path and then in order.

    Sessions that were named but not exported are left out, and so are other files: those that are not XML.

    Parameters
    ----------
    findings : gets a line for each file that was left out, and for each with points that have no place.

    Raises
    ------
    NotFoundError : nothing is there, or no export in it.
    FormatError : a file is no learning export.
    InputError : labels that are not known, all of them, with their counts and sessions; or a session that is too short,
        in which a box was never seen, whose labels are not one for each window, or that is there twice.
    """
    paths = _paths(source, findings if findings is not None else [])
    found: list[LabelledSession] = []
    files: dict[tuple[str, str], Path] = {}
    unseen: Counter[Path] = Counter()
    unknown: dict[str, Counter[str]] = {}
    for done, path in enumerate(paths):
        progress("reading exports", done, len(paths))
        for session in (session for session in read_learning_export(path) if not session.empty):
            labelled = _labelled(path, session, unknown)
            if labelled.key in files:
                raise _twice(path, session.name, files[labelled.key])
            files[labelled.key] = path
            found.append(labelled)
            unseen[path] += int((~np.isfinite(labelled.points)).any(axis=2).sum())
    progress("reading exports", len(paths), len(paths))
    if findings is not None:
        said = "with no place, or one beyond 1,000 km: these were taken as not seen"
        findings += [f"{path} has {count(n, 'point')} {said}" for path, n in unseen.items() if n]
    if unknown:
        raise _unknown(source, unknown)
    if not found:
        raise _unfit(f"{source}", "all its sessions are empty", "give exports with frames")
    return found


def exchanged(labels: Labels) -> Labels:
    """Labels (..., 5) as they are when the two boxes change names."""
    found = labels.copy()
    found[..., :3] = _EXCHANGED[labels[..., :3]]
    return found


def vocabulary_of(sessions: Sequence[LabelledSession]) -> Labels:
    """The labels (k, 5) of sessions, with both names of the boxes, in order."""
    labels = np.concatenate([session.labels for session in sessions])
    return np.unique(np.concatenate([labels, exchanged(labels)]), axis=0)


def places_of(labels: Labels, vocabulary: Labels) -> list[int]:
    """Where each label (n, 5) is in a vocabulary that has it."""
    place = {tuple(label): number for number, label in enumerate(vocabulary.tolist())}
    return [place[tuple(label)] for label in labels.tolist()]


def words(label: Sequence[int]) -> list[str | None]:
    """What stands in the five slots."""
    return [values[place] for values, place in zip(SLOTS.values(), label, strict=True)]


def _paths(source: Path, findings: list[str]) -> list[Path]:
    if source.is_file():
        return [source]
    paths, others = learning_exports_below(source) if source.is_dir() else ([], [])
    if not paths:
        there = others or (
            "there is no *.txt in it" if source.is_dir() else "there is no such file or folder",
        )
        raise NotFoundError(
            f"cannot read learning exports of {source}",
            where=tuple(there),
            consequence="nothing was read",
            fix=_how_to_export(source) or "name a learning export, or the folder that holds them",
        )
    findings += others
    return paths


def _how_to_export(source: Path) -> str:
    """What makes an export of the sessions in a folder; empty if there are none."""
    with suppress(NotFoundError):
        find_sessions(source)
        return f"ecat export {source} exports.txt --format ecat-learning, and name exports.txt"
    return ""


def _labelled(path: Path, session: ExportedSession, unknown: dict[str, Counter[str]]) -> LabelledSession:
    where = f"session {session.name} of {path}"
    points = _points(session)
    frames = count(len(points), "frame")
    if len(points) < LENGTH:
        raise _unfit(where, f"it has {frames}, a window {LENGTH}", "leave the session out")
    for box, corners in ((1, points[:, 13:17]), (2, points[:, 17:21])):
        if not (np.isfinite(corners) & (corners != -1)).any():
            raise _unfit(where, f"box {box} was never seen", "give sessions in which two boxes are handled")
    if session.events.num_rows != (windows := n_windows(len(points))):
        stated = f"it has {count(session.events.num_rows, 'label')}, and {count(windows, 'window')} in its {frames}"
        raise _unfit(where, stated, f"label each window of {LENGTH} frames, every {HOP} frames")
    labels: list[list[int]] = []
    for row in session.events.to_pylist():
        label, strange = _label(row, where)
        labels.append(label)
        for one in strange:
            unknown.setdefault(one, Counter())[f"session {session.name} of {path.name}"] += 1
    return LabelledSession(path.stem, session.name, points, np.array(labels, np.int8).reshape(-1, 5))


def _points(session: ExportedSession) -> Floats:
    """Points (n, 21, 3); what is farther than anything can be is not known."""
    parts = [_axes(session.joints, 13), _axes(session.boxes, 8)]
    points = np.concatenate(parts, axis=1) * KINECT_FROM_CAMERA
    return np.where((np.abs(points) <= MOST_COORDINATE).all(axis=2, keepdims=True), points, np.nan)


def _axes(table: pa.Table, count: int) -> Floats:
    return np.column_stack([table[axis].to_numpy() for axis in "xyz"]).reshape(-1, count, 3)


def _label(row: dict[str, Any], where: str) -> tuple[list[int], list[str]]:
    """A label as places, and what in it is not known."""
    label = [0, 0, 0, _VERBS.get(row["verb"], 0), _PREPOSITIONS.get(row["preposition"], 0)]
    strange = [f"{slot} {row[slot]}" for slot, known in _KNOWN.items() if row[slot] not in known]
    for actor, column in enumerate(_ACTORS, start=1):
        role = row[column]
        if role is not None and role not in _ROLES:
            strange.append(f"role {role}")
        elif role is not None and label[_ROLES[role]]:
            frame = row["first_frame"]
            raise FormatError(f"cannot read {where}", where=f"two are {role} in the event from frame {frame}")
        elif role is not None:
            label[_ROLES[role]] = actor
    return label, strange


def _unknown(source: Path, unknown: dict[str, Counter[str]]) -> InputError:
    """Labels that are not known, the most frequent first, each with the sessions that have it."""
    ordered = sorted(unknown.items(), key=lambda item: -item[1].total())
    lines = [
        f"{label}: {count(sessions.total(), 'time')}, in {_some(list(sessions))}"
        for label, sessions in ordered
    ]
    known = [
        f"the {slot}s {', '.join(filter(None, words))}" for slot, words in (*_KNOWN.items(), ("role", _ROLES))
    ]
    return InputError(
        f"cannot use {source}: {count(len(unknown), 'label')} not known",
        where=(*lines[:_MOST], *[f"and {len(lines) - _MOST:,} more"][: len(lines) > _MOST]),
        consequence=_UNUSED,
        fix=f"use {', '.join(known)}",
    )


def _some(sessions: Sequence[str]) -> str:
    """The first of them, and how many more there are."""
    rest = len(sessions) - _FEW
    return ", ".join(sessions[:_FEW]) + (f" and {count(rest, 'session')} more" if rest > 0 else "")


def _twice(path: Path, name: str, other: Path) -> InputError:
    where = "another session of the file is called the same"
    if path != other:
        where = f"a session of {other} is called the same, and so are the files"
    return _unfit(f"session {name} of {path}", where, "rename one of the two")


def _unfit(what: str, where: str, fix: str) -> InputError:
    return InputError(f"cannot use {what}", where=where, consequence=_UNUSED, fix=fix)
