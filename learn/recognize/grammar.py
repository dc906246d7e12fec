"""What windows of one session say together: first nothing, then an action, then the same related to a place.

A session shows one action.  Its labels are [nothing] [the verb without a locative] [the verb with one], each part may
be missing, and none comes back.  So a session is an action and two boundaries, and what a window shows is the
sum over all of them: a hidden Markov model that goes from left to right, solved exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learn.features.windows import Floats
from learn.recognize.dataset import LOCATIVE, PREPOSITION, VERB, Labels

LEAST = 1e-3
"""Probability that is given to a label that a window's model rules out."""
WEIGHT = 0.35
"""Of a window's evidence: windows overlap by three quarters, and their errors go together."""
ARRIVAL_WEIGHT = 0.8
"""Of what is said about the arrival at a window."""
WHOLE_WEIGHT, WHOLE_DOUBT = 4.0, 0.003
"""Of what is said about a session as a whole, and the share that is added to every label that it may end with."""
DOUBT = 0.02
"""Probability that an arrival always has, and that it never exceeds but by this."""
LIKELY = 3
"""Actions of which it is asked when they arrive."""
Arrived = Callable[[Sequence[NDArray[np.int64]]], Sequence[Floats]]
"""Of labels (k,) of each session, by their places in the vocabulary: probabilities (n, k) that they hold at its windows
by now, if ever."""


@dataclass(frozen=True)
class Habits:
    """Of sessions, the share that begins with nothing, and that which ends before the action has a locative."""

    begins_with_nothing: float = 0.05
    never_arrives: float = 0.05

    @classmethod
    def of(cls, sessions: Sequence[Labels]) -> Habits:
        """Those of labelled sessions (n, 5), each; one more of either kind is counted than there are."""
        seen = [labels for labels in sessions if len(labels)]
        nothing = sum(labels[0, VERB] == 0 for labels in seen)
        short = sum(labels[-1, PREPOSITION] == 0 for labels in seen)
        return cls((int(nothing) + 1) / (len(seen) + 2), (int(short) + 1) / (len(seen) + 2))


@dataclass(frozen=True)
class Grammar:
    """Actions of a vocabulary of labels: for each, where its three parts are in the vocabulary.

    Attributes
    ----------
    parts : (actions, 3) nothing, without locative, with locative; -1 where the vocabulary lacks it.
    habits : of the sessions that it was made for.
    """

    parts: NDArray[np.int64]
    habits: Habits

    @classmethod
    def of(cls, vocabulary: Labels, habits: Habits) -> Grammar:
        """The actions that labels (k, 5) of a vocabulary make up."""
        place = {tuple(label): number for number, label in enumerate(vocabulary.tolist())}
        bare = vocabulary.copy()
        bare[:, [LOCATIVE, PREPOSITION]] = 0
        arrived = vocabulary[:, PREPOSITION] > 0
        without = [place.get(tuple(label), -1) for label in bare.tolist()]
        nothing = place.get((0,) * 5, -1)
        related = {without[number] for number in np.flatnonzero(arrived)}
        rows = [(nothing, without[number], number) for number in np.flatnonzero(arrived).tolist()]
        rows += [
            (nothing, number, -1)
            for number in np.flatnonzero(~arrived & (vocabulary[:, VERB] > 0)).tolist()
            if number not in related
        ]
        rows = rows or [(nothing, -1, -1)]
        return cls(np.array(rows, np.int64), habits)

    def smooth(
        self,
        sessions: Sequence[Floats],
        arrived: Arrived | None = None,
        whole: Floats | None = None,
    ) -> list[Floats]:
        """Of the windows (n, k) of each session, probabilities of labels (n, k) given all of them.

        Parameters
        ----------
        arrived : also says how probable it is that an action has got its locative by a window, whatever that shows; it
            is asked once, about all sessions.
        whole : (s, k) also says of each session, seen as a whole, how probable it is that it ends with a label.
        """
        emitted = [self._emitted(probabilities) for probabilities in sessions]
        if whole is not None:
            last = np.where(self.parts[:, 2] >= 0, self.parts[:, 2], self.parts[:, 1])
            last = np.where(last >= 0, last, self.parts[:, 0])
            for windows, ends in zip(emitted, whole, strict=True):
                windows[:1] += WHOLE_WEIGHT * np.log(ends[last] + WHOLE_DOUBT)
        joint = [self._joint(one) if len(one) else one for one in emitted]
        if arrived is not None:
            likely = [_likely(one) if len(one) else np.zeros(0, np.int64) for one in joint]
            related = [actions[self.parts[actions, 2] >= 0] for actions in likely]
            shares = arrived([self.parts[actions, 2] for actions in related])
            told = map(_with_arrival, emitted, likely, related, shares)
            joint = [self._joint(one) if len(one) else one for one in told]
        return [
            self._labels(one, probabilities.shape) for one, probabilities in zip(joint, sessions, strict=True)
        ]

    def _emitted(self, probabilities: Floats) -> Floats:
        """Logarithms (n, part, action) of what windows (n, k) show."""
        evidence = WEIGHT * np.log(np.maximum(probabilities, LEAST))
        return np.moveaxis(np.where(self.parts >= 0, evidence[:, self.parts], -np.inf), 2, 1)

    def _labels(self, joint: Floats, shape: tuple[int, ...]) -> Floats:
        """Probabilities of labels (n, k), of which an action and its part (n, part, action) have this logarithm."""
        found = np.zeros(shape)
        if not len(joint):
            return found
        weights = np.exp(joint - joint.max(axis=(1, 2), keepdims=True))
        known = self.parts.T >= 0
        for place, weight in zip(self.parts.T[known], weights[:, known].T, strict=True):
            found[:, place] += weight
        return found / found.sum(axis=1, keepdims=True)

    def _joint(self, emitted: Floats) -> Floats:
        """Logarithms (n, part, action) of how probable it is that an action is at its part at a window."""
        nothing, short = np.log(self.habits.begins_with_nothing), np.log(self.habits.never_arrives)
        start = np.array([nothing, 0.0, 0.0])[:, None]
        end = np.array([short, short, 0.0])[:, None]
        before, after = np.empty_like(emitted), np.empty_like(emitted)
        before[0] = emitted[0] + start
        for window in range(1, len(emitted)):
            before[window] = emitted[window] + np.logaddexp.accumulate(before[window - 1], axis=0)
        after[-1] = end
        for window in range(len(emitted) - 2, -1, -1):
            following = (after[window + 1] + emitted[window + 1])[::-1]
            after[window] = np.logaddexp.accumulate(following, axis=0)[::-1]
        return before + after


def _likely(joint: Floats) -> NDArray[np.int64]:
    """The actions that a session most probably shows, by what is known (n, part, action) of its windows."""
    return np.argsort(-np.logaddexp.reduce(joint[0], axis=0), kind="stable")[:LIKELY]


def _with_arrival(
    emitted: Floats, likely: NDArray[np.int64], related: NDArray[np.int64], share: Floats
) -> Floats:
    """What windows show (n, part, action) of likely actions, and how probably (n, k) related ones have arrived."""
    kept = np.full_like(emitted, -np.inf)
    kept[..., likely] = emitted[..., likely]
    share = np.clip(share, DOUBT, 1 - DOUBT)
    kept[:, :2, related] += ARRIVAL_WEIGHT * np.log(1 - share)[:, None]
    kept[:, 2, related] += ARRIVAL_WEIGHT * np.log(share)
    return kept


def of_one_action(vocabulary: Labels, probabilities: Floats) -> NDArray[np.int64]:
    """Of a session's windows (n, k) the places (n,) of labels that are most probable, all of them of one action.

    Window by window, what is most probable may be of one action here and of another there.
    """
    parts = Grammar.of(vocabulary, Habits()).parts
    share = np.where(parts >= 0, probabilities.sum(axis=0)[parts], 0.0)[:, 1:].sum(axis=1)
    places = parts[share.argmax()]
    places = places[places >= 0]
    return places[probabilities[:, places].argmax(axis=1)]
