"""The grammar of a session is the sum over all that a session can be."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from learn.recognize.grammar import LEAST, WEIGHT, Grammar, Habits

HABITS = Habits(0.1, 0.2)
VOCABULARY = np.array([[0] * 5, [1, 2, 0, 1, 0], [1, 2, 3, 1, 3], [1, 3, 0, 2, 0], [1, 3, 2, 2, 1]], np.int8)


def by_hand(
    probabilities: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Every action with every pair of boundaries, one at a time."""
    n = len(probabilities)
    found = np.zeros_like(probabilities)
    for (bare, full), begin, arrive in product(((1, 2), (3, 4)), range(n + 1), range(n + 1)):
        if begin > arrive:
            continue
        said = [0] * begin + [bare] * (arrive - begin) + [full] * (n - arrive)
        weight = sum(WEIGHT * np.log(max(probabilities[t, k], LEAST)) for t, k in enumerate(said))
        weight += np.log(0.1) * (begin > 0) + np.log(0.2) * (arrive == n)
        for t, k in enumerate(said):
            found[t, k] += np.exp(weight)
    return found / found.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("n", [1, 2, 6])
def test_it_equals_the_enumeration(n: int) -> None:
    probabilities = np.random.default_rng(n).dirichlet([0.5] * 5, n)
    smoothed = Grammar.of(VOCABULARY, HABITS).smooth(probabilities)
    np.testing.assert_allclose(smoothed, by_hand(probabilities), atol=1e-12)


def test_an_action_does_not_come_back() -> None:
    sure = np.full((9, 5), 0.05)
    sure[np.arange(9), [1, 1, 1, 2, 1, 2, 2, 4, 2]] = 0.8
    assert Grammar.of(VOCABULARY, HABITS).smooth(sure).argmax(axis=1).tolist() == [1] * 4 + [2] * 5


def test_a_vocabulary_without_prepositions_is_left_with_its_verbs() -> None:
    smoothed = Grammar.of(VOCABULARY[[0, 1, 3]], HABITS).smooth(np.array([[0.1, 0.5, 0.4], [0.1, 0.8, 0.1]]))
    assert smoothed.argmax(axis=1).tolist() == [1, 1]
    np.testing.assert_allclose(smoothed.sum(axis=1), 1)


def test_habits_are_those_of_the_sessions_it_was_trained_on() -> None:
    nothing, bare, full = VOCABULARY[[0, 1, 2]]
    sessions = [np.stack(rows) for rows in ([nothing, bare, full], [bare, full], [bare, bare])]
    assert Habits.of([*sessions, np.zeros((0, 5), np.int8)]) == Habits(2 / 5, 2 / 5)
    assert Habits.of([]) == Habits(1 / 2, 1 / 2)
