"""The grammar of a session is the sum over all that a session can be."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from learn.recognize.grammar import LEAST, WEIGHT, Grammar, Habits, of_one_action

HABITS = Habits(0.1, 0.2)
VOCABULARY = np.array([[0] * 5, [1, 2, 0, 1, 0], [1, 2, 3, 1, 3], [1, 3, 0, 2, 0], [1, 3, 2, 2, 1]], np.int8)


def by_hand(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
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
    smoothed = Grammar.of(VOCABULARY, HABITS).smooth([probabilities])[0]
    np.testing.assert_allclose(smoothed, by_hand(probabilities), atol=1e-12)


def test_an_action_does_not_come_back() -> None:
    sure = np.full((9, 5), 0.05)
    sure[np.arange(9), [1, 1, 1, 2, 1, 2, 2, 4, 2]] = 0.8
    assert Grammar.of(VOCABULARY, HABITS).smooth([sure])[0].argmax(axis=1).tolist() == [1] * 4 + [2] * 5


def test_a_vocabulary_without_prepositions_is_left_with_its_verbs() -> None:
    unsure = np.array([[0.1, 0.5, 0.4], [0.1, 0.8, 0.1]])
    smoothed = Grammar.of(VOCABULARY[[0, 1, 3]], HABITS).smooth([unsure])[0]
    assert smoothed.argmax(axis=1).tolist() == [1, 1]
    np.testing.assert_allclose(smoothed.sum(axis=1), 1)


def test_habits_are_those_of_the_sessions_it_was_trained_on() -> None:
    nothing, bare, full = VOCABULARY[[0, 1, 2]]
    sessions = [np.stack(rows) for rows in ([nothing, bare, full], [bare, full], [bare, bare])]
    assert Habits.of([*sessions, np.zeros((0, 5), np.int8)]) == Habits(2 / 5, 2 / 5)
    assert Habits.of([]) == Habits(1 / 2, 1 / 2)


def test_an_arrival_that_is_as_likely_everywhere_changes_nothing() -> None:
    probabilities = np.random.default_rng(3).dirichlet([0.5] * 5, 6)
    grammar = Grammar.of(VOCABULARY, HABITS)
    told = grammar.smooth([probabilities], lambda places: [np.full((6, len(places[0])), 0.5)])
    np.testing.assert_allclose(told[0], grammar.smooth([probabilities])[0], atol=1e-12)


@pytest.mark.parametrize("window", [1, 3, 5])
def test_the_arrival_decides_where_windows_do_not(window: int) -> None:
    unsure = np.tile([0.02, 0.47, 0.47, 0.02, 0.02], (6, 1))
    share = (np.arange(6) >= window).astype(np.float64)
    asked: list[list[int]] = []

    def arrived(places: Sequence[NDArray[np.int64]]) -> list[NDArray[np.float64]]:
        asked.extend(one.tolist() for one in places)
        return [np.tile(share[:, None], (1, len(one))) for one in places]

    said = Grammar.of(VOCABULARY, HABITS).smooth([unsure], arrived)[0].argmax(axis=1)
    assert said.tolist() == [1] * window + [2] * (6 - window)
    assert [sorted(places) for places in asked] == [[2, 4]]


def test_sessions_are_asked_about_together_and_do_not_mix() -> None:
    generator = np.random.default_rng(5)
    sessions = [generator.dirichlet([0.5] * 5, n) for n in (4, 0, 7)]
    shares = [generator.uniform(size=len(one)) for one in sessions]
    times: list[int] = []

    def arrived(
        places: Sequence[NDArray[np.int64]], of: Sequence[int] = (0, 1, 2)
    ) -> list[NDArray[np.float64]]:
        times.append(len(places))
        return [np.tile(shares[k][:, None], (1, len(one))) for k, one in zip(of, places, strict=True)]

    grammar = Grammar.of(VOCABULARY, HABITS)
    together = grammar.smooth(sessions, arrived)
    assert times == [3]
    for k, session in enumerate(sessions):
        np.testing.assert_array_equal(together[k], grammar.smooth([session], partial(arrived, of=[k]))[0])


def test_an_action_that_never_gets_a_locative_is_not_asked_when() -> None:
    grammar = Grammar.of(VOCABULARY[[0, 1, 3]], HABITS)
    sure = np.array([[0.1, 0.5, 0.4], [0.1, 0.8, 0.1]])

    def arrived(places: Sequence[NDArray[np.int64]]) -> list[NDArray[np.float64]]:
        assert [len(one) for one in places] == [0]
        return [np.zeros((2, 0))]

    np.testing.assert_array_equal(grammar.smooth([sure], arrived)[0], grammar.smooth([sure])[0])


def test_what_is_proposed_for_a_session_is_one_action() -> None:
    undecided = np.array(
        [[0.6, 0.2, 0.0, 0.2, 0.0], [0, 0.4, 0.1, 0.5, 0], [0, 0.2, 0.6, 0, 0.2], [0, 0, 0.4, 0, 0.6]]
    )
    assert undecided.argmax(axis=1).tolist() == [0, 3, 2, 4]
    assert of_one_action(VOCABULARY, undecided).tolist() == [0, 1, 2, 2]


def test_an_action_may_have_no_locative_in_the_vocabulary() -> None:
    assert of_one_action(VOCABULARY[[0, 1]], np.array([[0.7, 0.3], [0.2, 0.8]])).tolist() == [0, 1]
    assert of_one_action(VOCABULARY[[0]], np.ones((3, 1))).tolist() == [0, 0, 0]


def test_a_session_as_a_whole_decides_between_actions_that_windows_leave_open() -> None:
    undecided = np.array([[0.02, 0.4, 0.09, 0.4, 0.09], [0.02, 0.09, 0.4, 0.09, 0.4]])
    ends = np.array([[0, 0, 0.3, 0, 0.7], [0, 0, 0.7, 0, 0.3]])
    said = Grammar.of(VOCABULARY, HABITS).smooth([undecided] * 2, whole=ends)
    assert [one.argmax(axis=1).tolist() for one in said] == [[3, 4], [1, 2]]


def test_a_session_that_may_end_with_anything_is_told_by_its_windows() -> None:
    probabilities = np.random.default_rng(6).dirichlet([0.5] * 5, 6)
    grammar = Grammar.of(VOCABULARY, HABITS)
    told = grammar.smooth([probabilities, probabilities[:0]], whole=np.full((2, 5), 0.2))
    np.testing.assert_allclose(told[0], grammar.smooth([probabilities])[0], atol=1e-12)


def test_an_action_without_a_locative_ends_with_its_verb() -> None:
    grammar = Grammar.of(VOCABULARY[[0, 1, 3]], HABITS)
    said = grammar.smooth([np.array([[0.1, 0.5, 0.4]] * 2)], whole=np.array([[0, 0.1, 0.9]]))[0]
    assert said.argmax(axis=1).tolist() == [2, 2]
