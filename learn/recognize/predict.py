"""The actions that a recogniser sees in a whole session: one for each movement of its boxes.

Where boxes are not seen for a while a movement is recognised in parts, which are still of one action.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ecat.errors import CorruptError
from ecat.progress import Progress, silent
from learn.features.points import JOINTS
from learn.features.recordings import Recording
from learn.features.windows import HOP, LENGTH, Floats
from learn.recognize.actions import movers
from learn.recognize.dataset import PREPOSITION, VERB, Labels, words
from learn.recognize.episodes import Episode, episodes
from learn.recognize.grammar import of_one_action
from learn.recognize.model import Recognized
from learn.recognize.runs import Recognizer

_REST_M, _GONE_M = 0.01, 0.03
"""By its poses a box rests that goes less far than the one, and moves if it goes farther than the other."""


@dataclass(frozen=True)
class Action:
    """What was recognised from frame ``start`` to before ``end``: words in the slots, how probable windows make them,
    if a joint was seen then, without which it is hardly known who acts, and the part of it ``before`` it gets its
    locative, if there is one.
    """

    start: int
    end: int
    words: tuple[str | None, ...]
    confidence: float
    has_joints: bool = True
    before: Action | None = None


def recognize(
    recording: Recording,
    recognizer: Recognizer,
    progress: Progress = silent,
    *,
    run: Path | None = None,
    findings: list[str] | None = None,
) -> list[Action]:
    """The actions in a recording, one of each movement, in their order; none where windows say that nothing is done.

    Parameters
    ----------
    run : the folder that the recogniser was read from, to be named in errors.
    findings : gets lines about what was left out, and why.

    Raises
    ------
    InputError : it is shorter than a window.
    CorruptError : the recogniser says what is no probability.
    """
    movements: list[list[_Seen]] = []
    stretches = episodes(recording, findings)
    for done, episode in enumerate(stretches):
        progress("recognising", done, len(stretches))
        asked = recognizer if episode.table is None else recognizer.on_table(episode.table)
        seen = asked.recognize([episode.points])
        _require_probabilities(recording, run, seen)
        if not episode.goes_on:
            movements.append([])
        movements[-1].append(_Seen(episode, seen.vocabulary, seen.context))
    progress("recognising", len(stretches), len(stretches))
    return [action for parts in movements if (action := _action(recording, parts)) is not None]


@dataclass(frozen=True)
class _Seen:
    """Labels (k, 5), and how probable each window (w, k) of an episode makes them."""

    episode: Episode
    vocabulary: Labels
    probable: Floats

    def edges(self) -> list[tuple[int, int]]:
        """The frames that windows are about: from half a hop before the middle of each to half a hop after it."""
        # a session that was not cut begins and ends with its windows, others with their movement
        places = [HOP * window + (LENGTH - HOP) // 2 for window in range(len(self.probable) + 1)]
        frames = [round(float(self.episode.frame[place])) for place in places]
        return list(pairwise(frames))


def _agreeing(recording: Recording, parts: Sequence[_Seen]) -> Floats:
    """Probabilities (w, k) of labels in the windows of a movement, without those that move a box which by its poses
    rests while the other moves.
    """
    probable = np.concatenate([part.probable for part in parts])
    if recording.tracks is None:
        return probable
    place = np.concatenate([part.episode.places(recording.tracks) for part in parts], axis=1)
    farthest = np.linalg.norm(place - place[:, :1], axis=-1).max(axis=1)
    rests = (farthest < _REST_M) & (farthest[::-1] > _GONE_M)
    mover = movers(parts[0].vocabulary)
    impossible = (mover > 0) & rests[np.maximum(mover, 1) - 1]
    if impossible.all():
        return probable
    left = np.where(impossible, 0.0, probable + np.finfo(float).tiny)
    return left / left.sum(axis=1, keepdims=True)


def _action(recording: Recording, parts: Sequence[_Seen]) -> Action | None:
    """What a movement shows: one action, from the first window to the last in which anything is done, whose label is
    the one with a locative if any window says it; None if nothing is done.
    """
    probable = _agreeing(recording, parts)
    labels = of_one_action(parts[0].vocabulary, probable)
    sure = np.take_along_axis(probable, labels[:, None], axis=1)[:, 0]
    edges = [edge for part in parts for edge in part.edges()]
    said = [tuple(words(label)) for label in parts[0].vocabulary[labels].tolist()]
    done = [window for window, label in enumerate(said) if label[VERB] is not None]
    if not done:
        return None
    has_joints = any(bool(np.isfinite(part.episode.points[:, : len(JOINTS)]).any()) for part in parts)

    def over(windows: Sequence[int], end: int, before: Action | None = None) -> Action:
        start, mean = edges[windows[0]][0], float(sure[list(windows)].mean())
        label = max((said[window] for window in windows), key=lambda label: label[PREPOSITION] is not None)
        return Action(start, max(end, start + 1), label, mean, has_joints, before)

    arrival = next((window for window in done if said[window][PREPOSITION] is not None), done[0])
    bare = done[: done.index(arrival)]
    before = over(bare, edges[arrival][0]) if bare else None
    return over(done, edges[done[-1]][1], before)


def _require_probabilities(recording: Recording, run: Path | None, seen: Recognized) -> None:
    if not np.isfinite(seen.context).all():
        raise CorruptError(
            f"cannot use the model {run}" if run else "cannot use the model",
            where=f"what it says of session {recording.name} are no probabilities",
            consequence="nothing was recognised, and no proposals were replaced",
            fix="train it again",
        )
