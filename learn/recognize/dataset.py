"""Sessions with labelled windows, from the learning exports of ECAT."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError, InputError, NotFoundError
from ecat.formats.ecat2018.learning_export import ExportedSession, read_learning_export
from ecat.progress import Progress, silent
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
Labels = NDArray[np.int8]

_VERBS = {None: 0, "pushes": 1, "pulls": 2, "rolls": 3, "slides": 4}
_PREPOSITIONS = {None: 0, "Past": 1, "From": 2, "To": 3}
_ROLES = {"Subject": 0, "Object": 1, "Theme": 2}
_ACTORS = ("rig_role", "box1_role", "box2_role")
_EXCHANGED = np.array([0, 1, 3, 2], np.int8)


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


def read_exports(folder: Path, progress: Progress = silent) -> list[LabelledSession]:
    """The sessions of all learning exports (``*.txt``) below ``folder``, by path and then in order.

    Sessions that were named but not exported are left out.

    Raises
    ------
    NotFoundError : no such folder, or no export in it.
    FormatError : a file is no learning export.
    InputError : labels that are not known, all of them with their counts; or a session that is too short, in which a
        box was never seen, whose labels are not one for each window, or that is there twice.
    """
    paths = sorted(path for path in folder.rglob("*.txt") if path.is_file()) if folder.is_dir() else []
    if not paths:
        there = "there is no *.txt in it" if folder.is_dir() else "there is no such folder"
        raise NotFoundError(
            f"cannot read learning exports of {folder}",
            where=there,
            fix="name the folder that holds the exports",
        )
    found: list[LabelledSession] = []
    unknown: Counter[str] = Counter()
    for done, path in enumerate(paths):
        progress("reading exports", done, len(paths))
        exported = (session for session in read_learning_export(path) if not session.empty)
        found.extend(_labelled(path, session, unknown) for session in exported)
    progress("reading exports", len(paths), len(paths))
    if unknown:
        counted = tuple(f"{label}: {count} times" for label, count in unknown.most_common())
        raise InputError(
            f"cannot learn from {folder}: {len(unknown)} labels are not known",
            where=counted,
            consequence="nothing was learned",
            fix=f"use the verbs {_known(_VERBS)}, the prepositions {_known(_PREPOSITIONS)}, the roles {_known(_ROLES)}",
        )
    twice = [" ".join(key) for key, count in Counter(session.key for session in found).items() if count > 1]
    if twice:
        raise _unfit(f"{folder}", f"two sessions are called {twice[0]}", "rename one of the files")
    if not found:
        raise _unfit(f"{folder}", "all sessions of its exports are empty", "give exports with frames")
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


def _labelled(path: Path, session: ExportedSession, unknown: Counter[str]) -> LabelledSession:
    where = f"session {session.name} of {path}"
    parts = [_axes(session.joints, 13), _axes(session.boxes, 8)]
    points = np.concatenate(parts, axis=1) * KINECT_FROM_CAMERA
    n_frames = len(points)
    if n_frames < LENGTH:
        raise _unfit(where, f"it has {n_frames} frames, a window {LENGTH}", "leave the session out")
    for box, corners in ((1, points[:, 13:17]), (2, points[:, 17:21])):
        if not (np.isfinite(corners) & (corners != -1)).any():
            raise _unfit(where, f"box {box} was never seen", "give sessions in which two boxes are handled")
    if session.events.num_rows != n_windows(n_frames):
        stated = (
            f"{session.events.num_rows} labels for the {n_windows(n_frames)} windows of its {n_frames} frames"
        )
        raise _unfit(where, stated, f"label each window of {LENGTH} frames, every {HOP} frames")
    labels = [_label(row, unknown, where) for row in session.events.to_pylist()]
    return LabelledSession(path.stem, session.name, points, np.array(labels, np.int8).reshape(-1, 5))


def _axes(table: pa.Table, count: int) -> Floats:
    return np.column_stack([table[axis].to_numpy() for axis in "xyz"]).reshape(-1, count, 3)


def _label(row: dict[str, Any], unknown: Counter[str], where: str) -> list[int]:
    label = [0, 0, 0, _VERBS.get(row["verb"], 0), _PREPOSITIONS.get(row["preposition"], 0)]
    unknown.update(f"verb {row['verb']}" for _ in range(row["verb"] not in _VERBS))
    unknown.update(
        f"preposition {row['preposition']}" for _ in range(row["preposition"] not in _PREPOSITIONS)
    )
    for actor, column in enumerate(_ACTORS, start=1):
        role = row[column]
        if role is not None and role not in _ROLES:
            unknown[f"role {role}"] += 1
        elif role is not None and label[_ROLES[role]]:
            frame = row["first_frame"]
            raise FormatError(f"cannot read {where}", where=f"two are {role} in the event from frame {frame}")
        elif role is not None:
            label[_ROLES[role]] = actor
    return label


def _known(words: dict[Any, int]) -> str:
    return ", ".join(word for word in words if word)


def _unfit(what: str, where: str, fix: str) -> InputError:
    return InputError(f"cannot learn from {what}", where=where, consequence="nothing was learned", fix=fix)
