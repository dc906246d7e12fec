"""What the tree says is what counting all labellings says, on any tree."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import InputError
from learn.recognize.neural.tree_crf import Tree, TreeCRF


@st.composite
def trees(draw: st.DrawFn) -> Tree:
    """Any tree: each slot but the first hangs on an earlier one, then all are renamed."""
    n = draw(st.integers(1, 5))
    names = draw(st.permutations(range(n)))
    edges: list[tuple[int, int]] = []
    for slot in range(1, n):
        child, parent = names[slot], names[draw(st.integers(0, slot - 1))]
        edges.append((child, parent) if draw(st.booleans()) else (parent, child))
    sizes = tuple(draw(st.lists(st.integers(1, 4), min_size=n, max_size=n)))
    return Tree(sizes, tuple(draw(st.permutations(edges))), draw(st.integers(0, n - 1)))


def drawn(tree: Tree, seed: int, spread: float = 2.0, rows: int = 3) -> tuple[TreeCRF, list[torch.Tensor]]:
    """Random scores in double precision, with a weight that is not 1."""
    generator = torch.Generator().manual_seed(seed)
    crf = TreeCRF(tree, weight=0.7).double()
    with torch.no_grad():
        for values in crf.parameters():
            values.copy_(spread * torch.randn(values.shape, generator=generator, dtype=torch.float64))
    unary = [
        spread * torch.randn(rows, size, generator=generator, dtype=torch.float64) for size in tree.sizes
    ]
    return crf, unary


def counted(crf: TreeCRF, unary: list[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
    """All labellings (k, slots) and their scores (b, k), written out."""
    tree = crf.tree
    every = list(product(*(range(size) for size in tree.sizes)))
    rows = [
        torch.stack(
            [
                sum((one[row, value] for one, value in zip(unary, labels, strict=True)), torch.zeros(()))
                + crf.weight * crf.start[labels[tree.root]]
                + crf.weight
                * sum(pair[labels[a], labels[b]] for (a, b), pair in zip(tree.edges, crf.pairs, strict=True))
                for labels in every
            ]
        )
        for row in range(len(unary[0]))
    ]
    return torch.tensor(every), torch.stack(rows)


@settings(max_examples=40, deadline=None)
@given(trees(), st.integers(0, 1000))
def test_sums_marginals_and_the_best_are_those_of_all_labellings(tree: Tree, seed: int) -> None:
    crf, unary = drawn(tree, seed)
    every, scores = counted(crf, unary)
    torch.testing.assert_close(crf.scores(unary, every), scores)
    torch.testing.assert_close(crf.score(unary, every[:1].expand(3, -1)), scores[:, 0])
    torch.testing.assert_close(crf.log_partition(unary), torch.logsumexp(scores, 1))
    labels, highest = crf.decode(unary)
    torch.testing.assert_close(highest, scores.max(1).values)
    torch.testing.assert_close(crf.score(unary, labels), highest)
    shares = torch.softmax(scores, 1)
    for slot, found in enumerate(crf.marginals(unary)):
        expected = [shares[:, every[:, slot] == value].sum(1) for value in range(tree.sizes[slot])]
        torch.testing.assert_close(found, torch.stack(expected, 1))


@settings(max_examples=10, deadline=None)
@given(trees(), st.integers(0, 1000))
def test_gradients_are_those_of_all_labellings(tree: Tree, seed: int) -> None:
    crf, unary = drawn(tree, seed)
    free = [one.requires_grad_() for one in unary]
    targets = torch.zeros(3, len(tree.sizes), dtype=torch.long)
    learned = [*free, *crf.parameters()]
    found = torch.autograd.grad(crf.loss(free, targets), learned, allow_unused=True)
    _, scores = counted(crf, free)
    by_counting = (torch.logsumexp(scores, 1) - scores[:, 0]).mean()
    expected = torch.autograd.grad(by_counting, learned, allow_unused=True)
    for one, other in zip(found, expected, strict=True):
        assert one is not None
        assert other is not None
        torch.testing.assert_close(one, other)


def test_gradients_are_those_of_finite_differences() -> None:
    crf, unary = drawn(Tree((3, 2, 4), ((1, 0), (1, 2)), 2), 5)
    targets = torch.tensor([[2, 1, 0], [0, 0, 3], [1, 1, 1]])
    free = tuple(one.requires_grad_() for one in unary)

    def loss(*given: torch.Tensor) -> torch.Tensor:
        return crf.loss(given, targets)

    assert torch.autograd.gradcheck(loss, free)


@pytest.mark.parametrize("spread", [1e3, 1e6])
def test_scores_that_lie_far_apart_do_not_overflow(spread: float) -> None:
    """In single precision exp(89) is infinite already."""
    tree = Tree((4, 4, 4, 5, 4), ((2, 1), (2, 0), (2, 4), (0, 3)), 2)
    crf, unary = drawn(tree, 1, spread)
    crf, unary = crf.float(), [one.float().requires_grad_() for one in unary]
    loss = crf.loss(unary, crf.decode(unary)[0])
    loss.backward()  # pyright: ignore[reportUnknownMemberType]
    assert torch.isfinite(loss)
    assert all(one.grad is not None and torch.isfinite(one.grad).all() for one in unary)
    for found in crf.marginals(unary):
        torch.testing.assert_close(found.sum(1), torch.ones(3))


def test_a_weight_of_nothing_leaves_slots_by_themselves() -> None:
    crf, unary = drawn(Tree((2, 3), ((0, 1),)), 3)
    crf.weight = 0.0
    labels, _ = crf.decode(unary)
    np.testing.assert_array_equal(labels, torch.stack([one.argmax(1) for one in unary], 1))


@pytest.mark.parametrize(
    ("sizes", "edges", "root", "said"),
    [
        ((2, 2, 2), ((0, 1), (1, 2), (2, 0)), 0, "cycle"),
        ((2, 2), ((0, 0),), 0, "cycle"),
        ((2, 2, 2, 2), ((0, 1), (2, 3)), 0, "slot 2 is not connected"),
        ((2, 2), (), 1, "slot 0 is not connected"),
        ((2, 2), ((0, 2),), 0, "slot 2 is not one of"),
        ((2, 2), ((0, 1),), 5, "slot 5"),
        ((2, 0), ((0, 1),), 0, "needs a value"),
        ((), (), 0, "needs a value"),
    ],
)
def test_what_is_no_tree_is_refused(
    sizes: tuple[int, ...], edges: tuple[tuple[int, int], ...], root: int, said: str
) -> None:
    with pytest.raises(InputError, match="tree") as error:
        Tree(sizes, edges, root)
    assert said in str(error.value)


def test_unary_scores_of_another_shape_are_refused() -> None:
    crf, unary = drawn(Tree((2, 3), ((0, 1),)), 3)
    with pytest.raises(InputError, match="cannot score"):
        crf.log_partition(unary[::-1])
