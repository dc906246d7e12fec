"""Extremely randomised trees kept as plain arrays: scikit-learn grows them, and walks them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.features.windows import Features, Floats
from learn.recognize.trees import Trees, library


@dataclass(frozen=True)
class Forest(Trees):
    """Trees whose mean is a probability of each class.

    Attributes
    ----------
    value : (n, classes) of each node what a leaf says.
    """

    value: NDArray[np.float64]

    def predict(self, features: Features) -> Floats:
        """Probabilities (n, classes) of rows (n, features)."""
        found = np.zeros((len(features), int(self.shape[1])))
        for leaf in self.leaves(features):
            found += self.value[leaf]
        return found / (len(self.roots) - 1)

    def is_sound(self) -> bool:
        """Also that every node says probabilities of as many classes."""
        return (
            super().is_sound()
            and self.value.shape == (len(self.left), int(self.shape[1]))
            and bool(((self.value >= 0) & (self.value <= 1)).all())
        )


def grow(features: Features, shares: Floats, *, seed: int, **settings: float) -> Forest:
    """Extremely randomised trees (Geurts et al. 2006) that tell shares (n, classes) of rows (n, features), from 0 to 1.

    Without any rows they say the same of all classes.
    """
    n_classes = shares.shape[1]
    if not len(features):
        features, shares = (
            np.zeros((1, features.shape[1]), np.float32),
            np.full((1, n_classes), 1 / n_classes),
        )
    forest: Any = library("ensemble").ExtraTreesRegressor(**settings, n_jobs=1, random_state=seed)
    forest.fit(features, shares if n_classes > 1 else shares[:, 0])
    grown = [tree.tree_ for tree in forest.estimators_]
    return Forest(
        roots=np.cumsum([0, *(tree.node_count for tree in grown)]),
        left=np.concatenate([tree.children_left for tree in grown]).astype(np.int64),
        right=np.concatenate([tree.children_right for tree in grown]).astype(np.int64),
        feature=np.concatenate([np.maximum(tree.feature, 0) for tree in grown]).astype(np.int64),
        threshold=np.concatenate([tree.threshold for tree in grown]),
        value=np.clip(np.concatenate([tree.value[:, :, 0] for tree in grown]), 0.0, 1.0),
        shape=np.array([features.shape[1], n_classes]),
    )
