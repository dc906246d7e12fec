"""Conditional random fields over the slots of a label whose dependencies make a tree, solved exactly.

The score of a labelling is the sum of a unary score for each slot, which depends on what was seen, a pairwise score
for each edge, and a start score at the root, which do not (Do, thesis on ECAT, 2018, chapter 4).  Sums over all
labellings go from the leaves to the root, in logarithms, each stabilised with its maximum; so do maxima, with
back-pointers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from ecat.errors import InputError


@dataclass(frozen=True)
class Tree:
    """Slots, how many values each may take, and edges between them that connect all and make no cycle.

    Attributes
    ----------
    sizes : values of each slot.
    edges : pairs of slots.
    root : the slot that has a start score.

    Raises
    ------
    InputError : the edges are no tree over all slots, or a slot has no values.
    """

    sizes: tuple[int, ...]
    edges: tuple[tuple[int, int], ...]
    root: int = 0

    def __post_init__(self) -> None:
        n = len(self.sizes)
        if not n or min(self.sizes) < 1:
            raise _no_tree(f"sizes {self.sizes}: each slot needs a value")
        outside = [slot for edge in (*self.edges, (self.root,)) for slot in edge if not 0 <= slot < n]
        if outside:
            raise _no_tree(f"slot {outside[0]} is not one of 0 to {n - 1}")
        group = list(range(n))
        for a, b in self.edges:
            if group[a] == group[b]:
                raise _no_tree(f"edge {a}-{b} closes a cycle")
            old, new = group[b], group[a]
            group = [new if one == old else one for one in group]
        apart = [slot for slot in range(n) if group[slot] != group[self.root]]
        if apart:
            raise _no_tree(f"slot {apart[0]} is not connected with slot {self.root}")

    @property
    def inward(self) -> list[tuple[int, int, int]]:
        """Of each edge, the slot away from the root, that towards it, and its number; those far from the root first."""
        found: list[tuple[int, int, int]] = []
        reached = [self.root]
        for slot in reached:
            for number, (a, b) in enumerate(self.edges):
                other = b if a == slot else a
                if slot in (a, b) and other not in reached:
                    found.append((other, slot, number))
                    reached.append(other)
        return found[::-1]


class TreeCRF(nn.Module):
    """Scores of pairs and of the root, which are learned, and what follows from them.

    Unary scores are one tensor (b, size) for each slot; labellings are tensors (b, slots) of places.

    Attributes
    ----------
    weight : what the scores of pairs and of the root are multiplied with.
    """

    def __init__(self, tree: Tree, *, weight: float = 1.0) -> None:
        super().__init__()
        self.tree, self.weight = tree, weight
        self.start = nn.Parameter(torch.zeros(tree.sizes[tree.root]))
        self.pairs = nn.ParameterList(torch.zeros(tree.sizes[a], tree.sizes[b]) for a, b in tree.edges)

    def log_partition(self, unary: Sequence[Tensor]) -> Tensor:
        """Logarithm (b,) of the sum of exp(score) over all labellings."""
        beliefs = self._with_start(unary)
        for child, parent, number in self.tree.inward:
            message = torch.logsumexp(beliefs[child][:, None] + self._pair(number, parent), dim=2)
            beliefs[parent] = beliefs[parent] + message
        return torch.logsumexp(beliefs[self.tree.root], dim=1)

    def score(self, unary: Sequence[Tensor], labels: Tensor) -> Tensor:
        """Scores (b,) of labellings (b, slots), one for each row of the unary scores."""
        own = sum(one.gather(1, labels[:, slot, None])[:, 0] for slot, one in enumerate(unary))
        return own + self._shared_score(labels)

    def scores(self, unary: Sequence[Tensor], vocabulary: Tensor) -> Tensor:
        """Scores (b, k) of each labelling of a vocabulary (k, slots), for each row of the unary scores."""
        own = sum(one[:, vocabulary[:, slot]] for slot, one in enumerate(unary))
        return own + self._shared_score(vocabulary)

    def loss(self, unary: Sequence[Tensor], labels: Tensor) -> Tensor:
        """Negative logarithm of the labellings' probabilities, its mean."""
        return (self.log_partition(unary) - self.score(unary, labels)).mean()

    def marginals(self, unary: Sequence[Tensor]) -> list[Tensor]:
        """Probabilities (b, size) of each slot's values: the derivatives of the log-partition by the unary scores."""
        with torch.enable_grad():
            free = [one.detach().requires_grad_() for one in unary]
            found = torch.autograd.grad(self.log_partition(free).sum(), free)
        return list(found)

    def decode(self, unary: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """The labelling (b, slots) with the highest score, and that score (b,); of equals the first."""
        beliefs = self._with_start(unary)
        pointers: dict[int, Tensor] = {}
        inward = self.tree.inward
        for child, parent, number in inward:
            best, pointers[child] = (beliefs[child][:, None] + self._pair(number, parent)).max(dim=2)
            beliefs[parent] = beliefs[parent] + best
        highest, chosen = beliefs[self.tree.root].max(dim=1)
        found = {self.tree.root: chosen}
        for child, parent, _ in reversed(inward):
            found[child] = pointers[child].gather(1, found[parent][:, None])[:, 0]
        return torch.stack([found[slot] for slot in range(len(self.tree.sizes))], dim=1), highest

    def _with_start(self, unary: Sequence[Tensor]) -> list[Tensor]:
        sizes = tuple(one.shape[1] for one in unary)
        if sizes != self.tree.sizes:
            raise InputError(
                "cannot score labellings",
                where=f"unary scores are of {sizes} values, the tree's slots have {self.tree.sizes}",
                consequence="nothing was computed",
                fix="give scores (b, n) of each slot, n as many as the tree has values of it",
            )
        beliefs = list(unary)
        beliefs[self.tree.root] = beliefs[self.tree.root] + self.weight * self.start
        return beliefs

    def _pair(self, number: int, parent: int) -> Tensor:
        """Scores (parent, child) of an edge."""
        pair = self.weight * self.pairs[number]
        return pair if self.tree.edges[number][0] == parent else pair.T

    def _shared_score(self, labels: Tensor) -> Tensor:
        parts: Any = (pair[labels[:, a], labels[:, b]] for (a, b), pair in zip(self.tree.edges, self.pairs))  # noqa: B905
        return self.weight * (self.start[labels[:, self.tree.root]] + sum(parts))


def _no_tree(where: str) -> InputError:
    return InputError("cannot make a tree of slots", where=where, fix="connect all slots, without a cycle")
