"""What there is to learn is seen from the box that moves, and what was learned is asked from either."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from learn.recognize.actions import Actions
from learn.recognize.dataset import exchanged
from learn.recognize.forest import Forest, grow
from learn.recognize.tellers import QUESTIONS, Tellers, lessons

SEEN = np.array([[0] * 5, [1, 2, 0, 1, 0], [1, 2, 3, 1, 3], [2, 0, 3, 4, 1]], np.int8)
VOCABULARY = np.unique(np.concatenate([SEEN, exchanged(SEEN)]), axis=0)
ACTIONS = Actions.of(VOCABULARY)
PLACE = np.arange(len(VOCABULARY))
VIEWS = {
    (swap, mirrored): np.stack(
        [PLACE, np.full(len(PLACE), swap), np.full(len(PLACE), mirrored)], axis=1
    ).astype(np.float32)
    for swap, mirrored in product((False, True), repeat=2)
}
"""Of each row its number, and from where it is seen."""


def test_actions_are_learned_as_the_box_that_moves_sees_them() -> None:
    features, manner, n_manners = lessons(VIEWS, PLACE, ACTIONS)["manner"]
    number, swapped, _ = features.T.astype(int)
    movers = ACTIONS.mover[number]
    assert (swapped[movers > 0] == (movers[movers > 0] == 2)).all()
    np.testing.assert_array_equal(manner, ACTIONS.manner[ACTIONS.action[number]])
    assert n_manners == manner.max() + 1


def test_where_nothing_moves_both_views_are_learned() -> None:
    features, _, _ = lessons(VIEWS, PLACE, ACTIONS)["relation"]
    still = features[ACTIONS.mover[features[:, 0].astype(int)] == 0]
    assert sorted(map(tuple, still[:, 1:].astype(int).tolist())) == list(product((0, 1), repeat=2))


def test_which_box_moves_is_learned_from_both_and_from_no_rest() -> None:
    features, first, _ = lessons(VIEWS, PLACE, ACTIONS)["mover"]
    number, swapped, _ = features.T.astype(int)
    assert (ACTIONS.mover[number] > 0).all()
    np.testing.assert_array_equal(first, ACTIONS.mover[number] == 1 + swapped)


@pytest.fixture(scope="module")
def tellers() -> Tellers:
    tasks = lessons(VIEWS, PLACE, ACTIONS)
    learned = (tasks[question] for question in QUESTIONS)
    return Tellers(*(grow(rows, np.eye(n)[classes], seed=0, n_estimators=3) for rows, classes, n in learned))


def test_they_tell_of_the_first_box_what_they_learned(tellers: Tellers) -> None:
    told = [tellers.tell(VIEWS[swap, False], ACTIONS) for swap in (False, True)]
    assert ACTIONS.labels(*told).argmax(axis=1).tolist() == PLACE.tolist()


def test_they_are_read_as_they_were_written(tellers: Tellers) -> None:
    again = Tellers.of_arrays(Forest, tellers.arrays("x."), "x.")
    view = VIEWS[False, False]
    for one, other in zip(again.tell(view, ACTIONS), tellers.tell(view, ACTIONS), strict=True):
        np.testing.assert_array_equal(one, other)


def test_those_of_other_labels_or_features_do_not_fit(tellers: Tellers) -> None:
    tellers.require_fit(ACTIONS, 3)
    with pytest.raises(ValueError, match="mover does not fit"):
        tellers.require_fit(ACTIONS, 4)
    with pytest.raises(ValueError, match="manner does not fit"):
        tellers.require_fit(Actions.of(VOCABULARY[:3]), 3)
