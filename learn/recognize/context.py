"""What a session says about its windows, whatever recognised them one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from learn.features.windows import Floats, n_windows
from learn.recognize.dataset import Labels, places_of
from learn.recognize.grammar import Grammar, Habits
from learn.recognize.model import Recognized


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
    parts = grammar.smooth(np.split(alone[:, places], ends)) if sessions else []
    if parts:
        context[:, places] = np.concatenate(parts)
    return Recognized(vocabulary, alone, context)
