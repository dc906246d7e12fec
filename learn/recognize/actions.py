"""Labels seen from the box that moves: the same action, whichever of the two boxes that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learn.features.windows import Floats
from learn.recognize.dataset import Labels, exchanged

_MANNER, _RELATION = [0, 1, 3], [2, 4]
_FIRST_BOX = 2
Told = tuple[Floats, Floats]
"""Probabilities (w,) that the first box moves, and (w, c) of actions if it does."""


@dataclass(frozen=True)
class Actions:
    """The actions of a vocabulary of labels (k, 5), which has both names of each.

    Attributes
    ----------
    mover : (k,) the box that moves, 1 or 2; 0 if the label is the same for both.
    action : (k,) the number of the label as it is when the first box moves.
    manner, relation : (c,) of each action, the numbers of its subject, object and verb, and of the rest of it.
    """

    mover: NDArray[np.int64]
    action: NDArray[np.int64]
    manner: NDArray[np.int64]
    relation: NDArray[np.int64]

    @classmethod
    def of(cls, vocabulary: Labels) -> Actions:
        """The actions of labels (k, 5)."""
        mover = movers(vocabulary)
        named = np.where((mover == 2)[:, None], exchanged(vocabulary), vocabulary)
        actions, action = np.unique(named, axis=0, return_inverse=True)
        numbers = [
            np.unique(actions[:, part], axis=0, return_inverse=True)[1].ravel()
            for part in (_MANNER, _RELATION)
        ]
        return cls(mover, action.ravel(), numbers[0], numbers[1])

    def joint(self, manner: Floats, relation: Floats) -> Floats:
        """Probabilities (w, c) of actions by those of manners and of relations; of actions that occur, no others."""
        found = manner[:, self.manner] * relation[:, self.relation] + 1e-12
        return found / found.sum(axis=1, keepdims=True)

    def labels(self, first: Told, second: Told) -> Floats:
        """Probabilities (w, k) of labels by what is told with either box as the first."""
        moves = (first[0] + 1 - second[0]) / 2
        found = np.where(self.mover != 2, moves[:, None] * first[1][:, self.action], 0.0)
        found += np.where(self.mover != 1, (1 - moves)[:, None] * second[1][:, self.action], 0.0)
        return found / found.sum(axis=1, keepdims=True)


def movers(labels: Labels) -> NDArray[np.int64]:
    """The box (k,) that moves, 1 or 2: what acts or is acted on, or else the one that is no locative; 0 if none is."""
    subject, found, locative = (labels[:, slot].astype(np.int64) - _FIRST_BOX + 1 for slot in range(3))
    found = np.where((found < 1) & (locative >= 1), 3 - locative, found)
    return np.maximum(np.where(subject >= 1, subject, found), 0)
