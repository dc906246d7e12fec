"""Gradient boosted trees of LightGBM, kept as plain arrays: it is needed to train, and not to recognise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.progress import Progress, silent
from learn.features.windows import Features, Floats
from learn.recognize.trees import Trees, library

_SETTINGS: dict[str, Any] = {
    "objective": "multiclass",
    "learning_rate": 0.1,
    "num_leaves": 15,
    "feature_fraction": 0.15,
    "bagging_fraction": 0.5,
    "bagging_freq": 1,
    "lambda_l2": 5.0,
    "max_bin": 63,
    "extra_trees": True,
    "num_threads": 1,
    "deterministic": True,
    "force_row_wise": True,
    "verbose": -1,
}
"""Small trees that see a part of the features and of the rows: windows of a session are alike, and sessions few."""
_ROWS = 1024
"""Rows that all trees are walked with before the next, as many as stay in the cache."""
_FEWEST = 30
"""Rows in a leaf, or a fiftieth of them if that is less."""


@dataclass(frozen=True)
class Boosted(Trees):
    """Trees that add up to logarithms of probabilities, in turn one for each class.

    Attributes
    ----------
    value : (n,) of each node what a leaf adds.
    """

    value: NDArray[np.float64]

    def predict(self, features: Features) -> Floats:
        """Probabilities (n, classes) of rows (n, features)."""
        if len(features) > _ROWS:
            parts = range(0, len(features), _ROWS)
            return np.concatenate([self.predict(features[start : start + _ROWS]) for start in parts])
        n_classes = int(self.shape[1])
        found = np.zeros((n_classes, len(features)))
        for number, leaf in enumerate(self.leaves(features)):
            found[number % n_classes] += self.value[leaf]
        found = np.exp(found - found.max(axis=0))
        return (found / found.sum(axis=0)).T

    def is_sound(self) -> bool:
        """Also that every node has a finite value, and every class as many trees."""
        return (
            super().is_sound()
            and self.value.shape == self.left.shape
            and bool(np.isfinite(self.value).all())
            and (len(self.roots) - 1) % int(self.shape[1]) == 0
        )


def boost(
    features: Features,
    classes: NDArray[np.int64],
    n_classes: int,
    *,
    n_trees: int,
    n_models: int = 1,
    seed: int,
    progress: Progress = silent,
    what: str = "boosting trees",
) -> Boosted:
    """Gradient boosted trees (Friedman 2001) that tell the classes (n,) of rows (n, features).

    Parameters
    ----------
    n_trees : of each class, in each model.
    n_models : that differ in what is drawn at random; logarithms of their probabilities are averaged.
    """
    lightgbm = library("lightgbm")
    settings = _SETTINGS | {
        "num_class": n_classes,
        "min_data_in_leaf": max(2, min(_FEWEST, len(features) // 50)),
    }
    trees: list[dict[str, NDArray[np.float64]]] = []
    for model in range(n_models if n_classes > 1 else 0):

        def told(environment: Any, begun: int = model * n_trees) -> None:
            progress(what, begun + environment.iteration, n_models * n_trees)

        data = lightgbm.Dataset(features, classes.astype(np.float32))
        drawn = settings | {"seed": seed * n_models + model}
        booster = lightgbm.train(drawn, data, n_trees, callbacks=[told])
        trees += [
            _tree(text)
            for text in booster.model_to_string().split("\n\nend of trees")[0].split("\nTree=")[1:]
        ]
    progress(what, n_models * n_trees, n_models * n_trees)
    return _flat(trees or [_tree("leaf_value=0")], features.shape[1], n_classes, n_models)


def _tree(text: str) -> dict[str, NDArray[np.float64]]:
    """The arrays of one tree of LightGBM's text: its inner nodes first, and then its leaves."""
    said = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    names = ("split_feature", "threshold", "left_child", "right_child", "leaf_value")
    feature, threshold, left, right, value = (
        np.array(said.get(name, "").split(), np.float64) for name in names
    )
    n_inner, none = len(feature), np.full(len(value), -1.0)
    left, right = (np.where(child < 0, n_inner - child - 1, child) for child in (left, right))
    return {
        "left": np.concatenate([left, none]),
        "right": np.concatenate([right, none]),
        "feature": np.concatenate([feature, 0 * none]),
        "threshold": np.concatenate([threshold, 0 * none]),
        "value": np.concatenate([np.zeros(n_inner), value]),
    }


def _flat(
    trees: list[dict[str, NDArray[np.float64]]], n_features: int, n_classes: int, n_models: int
) -> Boosted:
    whole = {name: np.concatenate([tree[name] for tree in trees]) for name in trees[0]}
    return Boosted(
        roots=np.cumsum([0, *(len(tree["left"]) for tree in trees)]),
        **{name: whole[name].astype(np.int64) for name in ("left", "right", "feature")},
        threshold=whole["threshold"],
        value=whole["value"] / n_models,
        shape=np.array([n_features, n_classes]),
    )
