"""Labels are the same action from either box, and probabilities of actions become those of labels."""

from __future__ import annotations

import numpy as np
import pytest

from learn.recognize.actions import Actions
from learn.recognize.dataset import exchanged

SEEN = np.array(
    [[0] * 5, [1, 2, 0, 1, 0], [1, 2, 3, 1, 3], [2, 0, 3, 4, 1], [2, 0, 0, 4, 0], [1, 0, 0, 2, 0]], np.int8
)
VOCABULARY = np.unique(np.concatenate([SEEN, exchanged(SEEN)]), axis=0)
ACTIONS = Actions.of(VOCABULARY)


def place(*label: int) -> int:
    return VOCABULARY.tolist().index(list(label))


def test_a_label_and_that_with_exchanged_boxes_are_one_action() -> None:
    one, other = place(1, 2, 3, 1, 3), place(1, 3, 2, 1, 3)
    assert (ACTIONS.mover[one], ACTIONS.mover[other]) == (1, 2)
    assert ACTIONS.action[one] == ACTIONS.action[other]
    assert len(ACTIONS.manner) == len(SEEN)


@pytest.mark.parametrize("label", [(0, 0, 0, 0, 0), (1, 0, 0, 2, 0)])
def test_nothing_moves_in_labels_without_boxes(label: tuple[int, ...]) -> None:
    assert ACTIONS.mover[place(*label)] == 0


def test_a_box_that_is_only_a_locative_does_not_move() -> None:
    actions = Actions.of(np.array([[1, 0, 2, 1, 1], [1, 0, 3, 1, 1]], np.int8))
    assert actions.mover.tolist() == [2, 1]
    assert actions.action.tolist() == [0, 0]


def test_joint_probabilities_are_of_actions_that_occur() -> None:
    n_manners, n_relations = ACTIONS.manner.max() + 1, ACTIONS.relation.max() + 1
    found = ACTIONS.joint(np.eye(n_manners)[ACTIONS.manner], np.eye(n_relations)[ACTIONS.relation])
    np.testing.assert_allclose(found, np.eye(len(SEEN)), atol=1e-9)
    with_nothing = ACTIONS.joint(np.zeros((2, n_manners)), np.zeros((2, n_relations)))
    np.testing.assert_allclose(with_nothing, 1 / len(SEEN))


def test_labels_share_what_their_actions_have() -> None:
    generator = np.random.default_rng(1)
    first, second = generator.dirichlet(np.ones(6), 3), generator.dirichlet(np.ones(6), 3)
    found = ACTIONS.labels((np.full(3, 0.8), first), (np.full(3, 0.4), second))  # either says which box moves
    first, second = 0.7 * first, 0.3 * second
    np.testing.assert_allclose(found.sum(axis=1), 1)
    nothing, one, other = place(0, 0, 0, 0, 0), place(2, 0, 3, 4, 1), place(3, 0, 2, 4, 1)
    np.testing.assert_allclose(found[:, nothing], (first + second)[:, ACTIONS.action[nothing]])
    np.testing.assert_allclose(found[:, one], first[:, ACTIONS.action[one]])
    np.testing.assert_allclose(found[:, other], second[:, ACTIONS.action[one]])
