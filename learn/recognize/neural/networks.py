"""The networks: from inputs of windows to logarithms of probabilities of labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from learn.features.raw import DEPTH, N_CHANNELS, SHAPE, SWAP_CHANNELS
from learn.recognize.actions import Actions
from learn.recognize.dataset import SLOTS, Labels
from learn.recognize.neural.tree_crf import Tree, TreeCRF

SIZES = tuple(len(values) for values in SLOTS.values())
THESIS_TREE = Tree(SIZES, ((2, 1), (2, 0), (2, 4), (0, 3)), root=2)
"""Locative, which has the start, with object, subject and preposition; subject with verb (thesis chapter 4)."""
RANGE = 0.1
"""The thesis' weights begin uniformly between minus and plus this."""


class SlotNetwork(nn.Module):
    """Scores for each slot by itself, which a softmax each makes probabilities of, or one tree over all.

    Parameters
    ----------
    body : makes of inputs (b, ...) a tensor (slots, b, hidden).
    """

    def __init__(self, body: nn.Module, hidden: int, *, crf: bool) -> None:
        super().__init__()
        self.body = body
        self.heads = nn.ModuleList(nn.Linear(hidden, size) for size in SIZES)
        self.crf = TreeCRF(THESIS_TREE) if crf else None
        for values in self.parameters():
            nn.init.uniform_(values, -RANGE, RANGE)

    def unary(self, inputs: Tensor) -> list[Tensor]:
        """Scores (b, size) of each slot."""
        found: Tensor = self.body(inputs)
        return [head(part) for head, part in zip(self.heads, found, strict=True)]

    def loss(self, inputs: Tensor, targets: Tensor) -> Tensor:
        """Negative logarithm of the probability of labels (b, 5): its mean."""
        unary, labels = self.unary(inputs), targets.long()
        if self.crf is not None:
            return self.crf.loss(unary, labels)
        parts = [nn.functional.cross_entropy(one, labels[:, slot]) for slot, one in enumerate(unary)]
        return torch.stack(parts).sum()

    def log_probabilities(self, inputs: Tensor, vocabulary: Tensor) -> Tensor:
        """Logarithms (b, k) of the probabilities of labels (k, 5)."""
        unary, labels = self.unary(inputs), vocabulary.long()
        if self.crf is not None:
            return self.crf.scores(unary, labels) - self.crf.log_partition(unary)[:, None]
        apart = [one.log_softmax(1)[:, labels[:, slot]] for slot, one in enumerate(unary)]
        return torch.stack(apart).sum(0)


class SlotLSTM(nn.Module):
    """A linear layer that slots share, then a stack of LSTMs for each of them, whose last output is given.

    Outputs of each layer are dropped out in training.  The thesis' cells have one bias for each gate, these the sum of
    two; neither adds anything to the forget gate's.

    Parameters
    ----------
    keep : share of outputs that are not dropped out.
    carries : whether a batch starts with the state that the last one ended with, as the thesis' program did.
    """

    def __init__(
        self, n_inputs: int, hidden: int, layers: int, keep: float, *, carries: bool = False
    ) -> None:
        super().__init__()
        self.carries = carries
        self.shared = nn.Linear(n_inputs, hidden)
        between = 1 - keep if layers > 1 else 0.0
        self.stacks = nn.ModuleList(nn.LSTM(hidden, hidden, layers, dropout=between) for _ in SIZES)
        self.drop = nn.Dropout(1 - keep)
        self.forget()

    def forward(self, inputs: Tensor) -> Tensor:
        """Of windows (b, t, n) the last outputs (slots, b, hidden)."""
        rows = self.shared(inputs).transpose(0, 1)
        last: list[Tensor] = []
        for slot, stack in enumerate(self.stacks):
            state = self.state.get(slot)
            fits = state is not None and state[0].shape[1] == rows.shape[1]
            outputs, (h, c) = stack(rows, state if fits else None)
            last.append(outputs[-1])
            if self.carries:
                self.state[slot] = (h.detach(), c.detach())
        return self.drop(torch.stack(last))

    def forget(self) -> None:
        """Begin with no state."""
        self.state: dict[int, tuple[Tensor, Tensor]] = {}


class Dense(nn.Module):
    """Two layers of rectified units for each window; all slots are told the same."""

    def __init__(self, n_inputs: int, hidden: int, keep: float) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(n_inputs, hidden), nn.ReLU(), nn.Dropout(1 - keep),
            nn.Linear(hidden, hidden), nn.ReLU(), nn.Dropout(1 - keep),
        )  # fmt: skip

    def forward(self, inputs: Tensor) -> Tensor:
        """Of windows (b, n): (slots, b, hidden)."""
        return self.layers(inputs).expand(len(SIZES), -1, -1)


class RawNetwork(nn.Module):
    """Points and their movement, frame by frame, multiplied with each other; convolutions in time; a label in parts.

    What geometry asks for are products (of a movement and a direction, say), so the first layer is gated by itself.
    A window is seen twice, with either box as the first; what is said of the first box is how it is moved and where to,
    and what is said of both is compared, to tell which one moves.  So exchanged boxes exchange what is said, what is
    learned of one box is known of the other, and which box moves is learned from all actions at once, and not from the
    places where each of them was recorded.

    Parameters
    ----------
    vocabulary : (k, 5) labels, with both names of the boxes, all of which are valid.
    smooth : share of a label that is given to all others.
    """

    def __init__(self, vocabulary: Labels, width: int, drop: float, *, smooth: float = 0.05) -> None:
        super().__init__()
        self.smooth = smooth
        actions = Actions.of(vocabulary)
        self.mover, self.action, self.manner, self.relation = (
            torch.from_numpy(part)
            for part in (actions.mover, actions.action, actions.manner, actions.relation)
        )
        self.n_manners = int(actions.manner.max()) + 1
        n_relations = int(actions.relation.max()) + 1
        self.gate = nn.Linear(2 * N_CHANNELS, 2 * width)
        self.frame = nn.Linear(width, width)
        self.norm = nn.BatchNorm1d(width)
        self.convolutions = nn.ModuleList(
            nn.Conv1d(width, width, 3, padding=reach, dilation=reach) for reach in (1, 2, 4)
        )
        self.norms = nn.ModuleList(nn.BatchNorm1d(width) for _ in self.convolutions)
        self.drop = nn.Dropout(drop)
        self.last = nn.Sequential(
            nn.Linear(6 * width, 256),
            nn.ReLU(),
            nn.Dropout(drop),
            nn.Linear(256, self.n_manners + n_relations + 1),
        )
        scale, speed = torch.full((N_CHANNELS,), 4.0), torch.full((N_CHANNELS,), 40.0)
        scale[SHAPE], speed[SHAPE] = 25.0, 60.0
        scale[DEPTH], speed[DEPTH] = 5.0, 10.0
        self.scale, self.speed = scale, speed

    def forward(self, inputs: Tensor) -> Tensor:
        """Logarithms (b, k) of the probabilities of labels, of windows (b, 20, 75)."""
        n = len(inputs)
        found = self._seen(torch.cat([inputs, inputs[..., SWAP_CHANNELS]]))
        done = (found[:, self.manner] + found[:, self.n_manners + self.relation]).log_softmax(1)
        moves = found[:n, -1:] - found[n:, -1:]
        first = nn.functional.logsigmoid(moves) + done[:n, self.action]
        second = nn.functional.logsigmoid(-moves) + done[n:, self.action]
        either = torch.where(self.mover == 2, second, torch.logaddexp(first, second))
        return torch.where(self.mover == 1, first, either)

    def loss(self, inputs: Tensor, targets: Tensor) -> Tensor:
        """Cross-entropy with shares (b, k), which are smoothed."""
        return nn.functional.cross_entropy(self(inputs), targets, label_smoothing=self.smooth)

    def log_probabilities(self, inputs: Tensor, vocabulary: Tensor) -> Tensor:
        """Logarithms (b, k) of the probabilities of the vocabulary, which is that of training."""
        del vocabulary
        return self(inputs)

    def _seen(self, inputs: Tensor) -> Tensor:
        """Scores (b, manners + relations + 1) of what the first box does in windows, by means of two frames."""
        rows = inputs.unflatten(1, (-1, 2)).mean(2)
        middle = (rows[:, 2:] - rows[:, :-2]) / 4
        moved = torch.cat([middle[:, :1], middle, middle[:, -1:]], dim=1)
        seen: Any = torch.cat([rows * self.scale, (moved * self.speed).clamp(-4, 4)], dim=2)
        values, gates = self.gate(seen).chunk(2, dim=2)
        found = self.norm(self.frame(values * gates.sigmoid()).transpose(1, 2)).relu()
        for convolution, norm in zip(self.convolutions, self.norms, strict=True):
            found = found + self.drop(norm(convolution(found)).relu())
        knots = found.unflatten(2, (5, -1)).mean(3).flatten(1)
        return self.last(self.drop(torch.cat([knots, found.amax(2)], dim=1)))


class Ensemble(nn.Module):
    """Networks of the same kind that begin differently; what they say is the mean of their probabilities."""

    def __init__(self, members: Sequence[nn.Module]) -> None:
        super().__init__()
        self.members = nn.ModuleList(members)

    def loss(self, inputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the members' losses, so that each learns as it would by itself."""
        members: Any = self.members
        return torch.stack([member.loss(inputs, targets) for member in members]).sum()

    def log_probabilities(self, inputs: Tensor, vocabulary: Tensor) -> Tensor:
        """Logarithms (b, k) of the probabilities of labels (k, 5)."""
        members: Any = self.members
        parts = [member.log_probabilities(inputs, vocabulary) for member in members]
        return torch.stack(parts).logsumexp(0) - math.log(len(parts))
