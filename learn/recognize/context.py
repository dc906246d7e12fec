"""What a session says about its windows, whatever recognised them one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from learn.features.windows import Floats, n_windows
from learn.recognize.dataset import LabelledSession, Labels, exchanged
from learn.recognize.grammar import Grammar, Habits
from learn.recognize.model import Recognized


def vocabulary_of(sessions: Sequence[LabelledSession]) -> Labels:
    """The labels (k, 5) of sessions, with both names of the boxes, in order."""
    labels = np.concatenate([session.labels for session in sessions])
    return np.unique(np.concatenate([labels, exchanged(labels)]), axis=0)


def places_of(labels: Labels, vocabulary: Labels) -> list[int]:
    """Where each label (n, 5) is in a vocabulary that has it."""
    place = {tuple(label): number for number, label in enumerate(vocabulary.tolist())}
    return [place[tuple(label)] for label in labels.tolist()]


def in_context(
    vocabulary: Labels, alone: Floats, sessions: Sequence[Floats], seen: Labels, habits: Habits
) -> Recognized:
    """Probabilities (w, k) of windows alone, and beside them what the grammar of sessions makes of these.

    Parameters
    ----------
    vocabulary : (k, 5) labels.
    sessions : points (n, 21, 3) of each, which say where one ends.
    seen : labels that sessions for training had, with both names of the boxes: with context, no others are said.
    """
    places = places_of(seen, vocabulary)
    grammar = Grammar.of(seen, habits)
    ends = np.cumsum([n_windows(len(points)) for points in sessions])[:-1]
    context = np.zeros_like(alone)
    parts = [grammar.smooth(part) for part in np.split(alone[:, places], ends) if len(part)]
    if parts:
        context[:, places] = np.concatenate(parts)
    return Recognized(vocabulary, alone, context)
