"""Trees and a network asked together: they err on different windows, so that both are better than either.

What they say is their geometric mean: a label that one of them rules out is hardly said, however sure the other is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecat.progress import Progress, beginning, silent
from learn.features.windows import Floats, Table
from learn.recognize import model as trees
from learn.recognize.dataset import LabelledSession
from learn.recognize.model import Recognized
from learn.recognize.trees import library
from learn.recognize.unusable import undamaged

PARTS = ("trees", "neural")
"""Folders in that of the run."""
LEAST = 1e-4
"""Probability that either gives to a label that it rules out."""


@dataclass(frozen=True)
class Mixture:
    """Boosted trees, and the network that sees raw points, trained on the same sessions."""

    trees: trees.Recognizer
    neural: Any

    @property
    def trained_on(self) -> frozenset[str]:
        """Fingerprints of the sessions."""
        return self.trees.trained_on

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        seen, neural = self.trees.seen(sessions), self.neural.alone(sessions, thorough=False)
        both = np.sqrt(np.maximum(seen.windows, LEAST) * np.maximum(neural, LEAST))
        both /= both.sum(axis=1, keepdims=True)
        return self.trees.in_context(replace(seen, windows=both), sessions)

    def on_table(self, table: Table) -> Mixture:
        """The same for sessions whose table is known."""
        return Mixture(self.trees.on_table(table), self.neural.on_table(table))


def train(
    sessions: Sequence[LabelledSession],
    settings: trees.Settings,
    network: Any,
    *,
    checkpoint: Path | None = None,
    progress: Progress = silent,
) -> tuple[Mixture, Any]:
    """Both, trained on these sessions and nothing else, and how the training of the network went.

    Parameters
    ----------
    network : its settings.
    checkpoint : of the network, as in its own training.

    Raises
    ------
    MissingExtraError : LightGBM is not installed.
    InputError : there are no windows, or nothing happens in them; or the checkpoint is of other settings or sessions.
    """
    from learn.recognize.neural import recognizer as neural

    trees.require_actions(sessions)
    library("lightgbm")  # before minutes of training the network
    course = neural.train(
        sessions, replace(network, model="neural"), checkpoint=checkpoint, progress=progress
    )
    return Mixture(trees.train(sessions, settings, beginning("trees", progress)), course.recognizer), course


def joined(parts: Sequence[Any], run: Path) -> Mixture:
    """A mixture of the two that were read from ``run``.

    Raises
    ------
    CorruptError : they are others, or do not know the same labels.
    """
    from learn.recognize.neural.recognizer import NeuralRecognizer

    first, second = parts
    with undamaged(f"cannot use the model {run}"):
        if not isinstance(first, trees.Recognizer) or not isinstance(second, NeuralRecognizer):
            raise TypeError("its parts are no trees and a network")
        if second.settings.model != "neural" or not np.array_equal(first.vocabulary, second.vocabulary):
            raise ValueError("its trees and its network know different labels")
        return Mixture(first, second)
