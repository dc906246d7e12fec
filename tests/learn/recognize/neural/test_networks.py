"""The thesis' networks: probabilities over all labels, states that are carried, and the one of raw points."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from learn.features.raw import N_CHANNELS, SWAP_CHANNELS
from learn.recognize.actions import movers
from learn.recognize.dataset import Labels, exchanged, places_of
from learn.recognize.neural.networks import SIZES, Dense, Ensemble, RawNetwork, SlotLSTM, SlotNetwork

VOCABULARY: Labels = np.array(
    [
        [0, 0, 0, 0, 0],
        [1, 2, 0, 1, 0],
        [1, 2, 3, 1, 2],
        [1, 3, 0, 1, 0],
        [1, 3, 2, 1, 2],
        [2, 0, 3, 3, 1],
        [3, 0, 2, 3, 1],
    ],
    np.int8,
)
"""Nothing; a box is pushed, and from the other; a box rolls past the other; each with both names of the boxes."""
EVERY = torch.cartesian_prod(*(torch.arange(size) for size in SIZES))


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


def lstm(*, crf: bool, layers: int = 1) -> SlotNetwork:
    return SlotNetwork(SlotLSTM(6, 8, layers, 0.6), 8, crf=crf).eval()


@pytest.mark.parametrize("crf", [True, False])
def test_probabilities_of_all_labels_add_up_to_1(crf: bool) -> None:
    found = lstm(crf=crf).log_probabilities(torch.randn(3, 20, 6), EVERY)
    torch.testing.assert_close(found.exp().sum(1), torch.ones(3))


@pytest.mark.parametrize("crf", [True, False])
def test_the_loss_is_that_of_the_labels_that_are_true(crf: bool) -> None:
    network, inputs = lstm(crf=crf), torch.randn(3, 20, 6)
    labels = torch.tensor([[1, 2, 3, 4, 1], [0, 0, 0, 0, 0], [2, 0, 3, 1, 2]])
    found = network.log_probabilities(inputs, labels)
    torch.testing.assert_close(network.loss(inputs, labels), -found.diagonal().mean())


def test_the_best_of_all_labels_is_what_the_tree_decodes() -> None:
    network, inputs = lstm(crf=True), 5 * torch.randn(10, 20, 6)
    assert network.crf is not None
    best = EVERY[network.log_probabilities(inputs, EVERY).argmax(1)]
    np.testing.assert_array_equal(best, network.crf.decode(network.unary(inputs))[0])


def test_slots_do_not_share_their_stacks() -> None:
    network, inputs = lstm(crf=False), torch.randn(2, 20, 6)
    one = network.unary(inputs)[3].sum()
    one.backward()  # pyright: ignore[reportUnknownMemberType]
    body = network.body
    assert isinstance(body, SlotLSTM)
    moved = [
        any(bool(values.grad.any()) for values in stack.parameters() if values.grad is not None)
        for stack in body.stacks
    ]
    assert moved == [False, False, False, True, False]


def test_states_that_are_carried_go_on_where_the_last_batch_ended() -> None:
    carrying = SlotLSTM(6, 8, 2, 1.0, carries=True).eval()
    whole, parts = torch.randn(3, 40, 6), torch.zeros(0)
    expected = carrying(whole)
    carrying.forget()
    for start in (0, 20):
        parts = carrying(whole[:, start : start + 20])
    torch.testing.assert_close(parts, expected)
    assert carrying(whole[:2]).shape == (5, 2, 8)


def test_a_window_by_itself_has_no_state() -> None:
    body, inputs = SlotLSTM(6, 8, 1, 1.0).eval(), torch.randn(3, 20, 6)
    torch.testing.assert_close(body(inputs), body(inputs))


def test_a_dense_network_tells_all_slots_the_same() -> None:
    found = Dense(7, 5, 1.0)(torch.randn(3, 7))
    assert found.shape == (5, 3, 5)
    torch.testing.assert_close(found[0], found[4])


@pytest.fixture
def windows() -> torch.Tensor:
    return torch.randn(5, 20, N_CHANNELS) / 5


def test_the_raw_network_gives_every_label_of_its_vocabulary_a_probability(windows: torch.Tensor) -> None:
    found = RawNetwork(VOCABULARY, 16, 0.1).eval()(windows).exp()
    assert found.shape == (5, len(VOCABULARY))
    torch.testing.assert_close(found.sum(1), torch.ones(5))


@pytest.mark.parametrize("training", [True, False])
def test_exchanged_boxes_exchange_the_labels_of_the_raw_network(
    training: bool, windows: torch.Tensor
) -> None:
    network = RawNetwork(VOCABULARY, 16, 0.0).train(training)
    order = places_of(exchanged(VOCABULARY), VOCABULARY)
    torch.testing.assert_close(network(windows[..., SWAP_CHANNELS]), network(windows)[:, order])


def test_which_box_moves_is_told_apart_from_what_it_does(windows: torch.Tensor) -> None:
    """What is done by a box, given that it moves, does not depend on how sure it is that it does."""
    network = RawNetwork(VOCABULARY, 16, 0.0).eval()
    of_first = torch.from_numpy(movers(VOCABULARY) == 1)
    before = network(windows)[:, of_first].log_softmax(1)
    last = network.last[-1]
    assert isinstance(last, torch.nn.Linear)
    with torch.no_grad():
        last.weight[-1] *= 3
    torch.testing.assert_close(network(windows)[:, of_first].log_softmax(1), before)


def test_a_vocabulary_without_movement_is_sure_of_its_only_label(windows: torch.Tensor) -> None:
    found = RawNetwork(np.zeros((1, 5), np.int8), 8, 0.1).eval()(windows)
    torch.testing.assert_close(found, torch.zeros(5, 1))


def test_an_ensemble_says_the_mean_of_what_its_members_say(windows: torch.Tensor) -> None:
    members = [RawNetwork(VOCABULARY, 8, 0.1) for _ in range(2)]
    network, vocabulary = Ensemble(members).eval(), torch.from_numpy(VOCABULARY)
    each = torch.stack([member.log_probabilities(windows, vocabulary).exp() for member in members])
    torch.testing.assert_close(network.log_probabilities(windows, vocabulary).exp(), each.mean(0))
    shares = torch.eye(len(VOCABULARY))[:5]
    parts = torch.stack([member.loss(windows, shares) for member in members])
    torch.testing.assert_close(network.loss(windows, shares), parts.sum())
