"""Extremely randomised trees as plain arrays, so that reading a model from a disk never runs what is in it."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ecat.errors import CorruptError, MissingExtraError
from ecat.progress import Progress, silent
from learn.features.windows import Features, Floats

N_JOBS = 2
_BATCH = 25
"""Trees that are grown between two reports of progress."""


@dataclass(frozen=True)
class Forest:
    """Trees one behind the other; a node's children are counted from the first node of its tree.

    Attributes
    ----------
    roots : (t + 1,) where each tree begins, and the end.
    left, right, feature : (n,) of each node; -1, -1 and any in a leaf.
    threshold : (n,) up to this a row goes to the left.
    bounds : (n + 1,) where each node's classes begin in the next two; those of inner nodes are none.
    classes, shares : classes in a leaf and the share of each, which add up to 1.
    shape : (2,) numbers of features and of classes.
    """

    roots: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    feature: NDArray[np.int64]
    threshold: NDArray[np.float64]
    bounds: NDArray[np.int64]
    classes: NDArray[np.int64]
    shares: NDArray[np.float64]
    shape: NDArray[np.int64]

    def predict(self, features: Features) -> Floats:
        """Probabilities (n, classes) of rows (n, features): means over the trees."""
        found = np.zeros((len(features), int(self.shape[1])))
        rows = np.ascontiguousarray(features, np.float32)
        for start, tree in zip(self.roots, self._trees, strict=False):
            found += self._leaves[tree.apply(rows) + start].toarray()
        return found / len(self._trees)

    def arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """What makes up the forest, by name."""
        return {f"{prefix}.{field.name}": getattr(self, field.name) for field in fields(self)}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Forest:
        """The forest that :meth:`arrays` came from.

        Raises
        ------
        CorruptError : they are none, or lead outside of themselves.
        """
        real = {"threshold", "shares"}
        try:
            kept: dict[str, Any] = {
                field.name: np.asarray(
                    arrays[f"{prefix}.{field.name}"], np.float64 if field.name in real else np.int64
                )
                for field in fields(cls)
            }
            found = cls(**kept)
            sound = found._is_sound()
        except (KeyError, ValueError, TypeError, IndexError):
            found, sound = None, False
        if found is None or not sound:
            raise CorruptError(
                "cannot use the model",
                where=f"its {prefix} forest is damaged",
                consequence="nothing was recognised",
                fix="train it again",
            )
        return found

    def _is_sound(self) -> bool:
        n, tree_of = len(self.left), np.diff(self.roots)
        size = np.repeat(tree_of, tree_of)
        own = np.arange(n) - np.repeat(self.roots[:-1], tree_of)
        inner = self.left >= 0
        children = np.stack([self.left, self.right])[:, inner]
        return bool(
            len(tree_of)
            and self.roots[0] == 0
            and self.roots[-1] == n
            and (tree_of > 0).all()
            and len({n, len(self.right), len(self.feature), len(self.threshold), len(self.bounds) - 1}) == 1
            and (children > own[inner]).all()
            and (children < size[inner]).all()
            and ((self.feature[inner] >= 0) & (self.feature[inner] < self.shape[0])).all()
            and (np.diff(self.bounds) >= 0).all()
            and self.bounds[0] == 0
            and self.bounds[-1] == len(self.classes) == len(self.shares)
            and ((self.classes >= 0) & (self.classes < self.shape[1])).all()
        )

    @cached_property
    def _leaves(self) -> Any:
        shape = (len(self.left), int(self.shape[1]))
        return sparse.csr_array((self.shares, self.classes, self.bounds), shape=shape)

    @cached_property
    def _trees(self) -> list[Any]:
        """Scikit-learn's own trees, which are walked in C."""
        kind: Any = library("tree._tree").Tree
        found: list[Any] = []
        for start, end in zip(self.roots[:-1], self.roots[1:], strict=True):
            tree = kind(int(self.shape[0]), np.array([1], np.intp), 1)
            nodes: Any = np.zeros(end - start, tree.__getstate__()["nodes"].dtype)
            nodes["left_child"], nodes["right_child"] = self.left[start:end], self.right[start:end]
            nodes["feature"], nodes["threshold"] = self.feature[start:end], self.threshold[start:end]
            values = np.ones((end - start, 1, 1))
            tree.__setstate__(
                {"max_depth": 0, "node_count": int(end - start), "nodes": nodes, "values": values}
            )
            found.append(tree)
        return found


def grow(
    features: Features,
    classes: NDArray[np.int64],
    n_classes: int,
    *,
    n_trees: int,
    share: float,
    seed: int,
    progress: Progress = silent,
    what: str = "growing trees",
) -> Forest:
    """Extremely randomised trees (Geurts, Ernst, Wehenkel 2006) that tell the classes (n,) of rows (n, features).

    Parameters
    ----------
    share : of the features, how many are tried at a node.
    """
    model: Any = library("ensemble").ExtraTreesClassifier(
        n_estimators=0, max_features=share, n_jobs=N_JOBS, random_state=seed, warm_start=True
    )
    while model.n_estimators < n_trees:
        progress(what, model.n_estimators, n_trees)
        model.n_estimators = min(n_trees, model.n_estimators + _BATCH)
        model.fit(features, classes)
    progress(what, n_trees, n_trees)
    return _flat([tree.tree_ for tree in model.estimators_], model.classes_, features.shape[1], n_classes)


def _flat(trees: list[Any], classes: NDArray[np.int64], n_features: int, n_classes: int) -> Forest:
    nodes = np.concatenate([tree.__getstate__()["nodes"] for tree in trees])
    leaf = nodes["left_child"] < 0
    values = np.concatenate([tree.value[:, 0] for tree in trees]) * leaf[:, None]
    shares = sparse.csr_array(values / np.maximum(values.sum(axis=1, keepdims=True), 1e-12))
    return Forest(
        roots=np.cumsum([0, *(tree.node_count for tree in trees)]),
        left=nodes["left_child"].astype(np.int64),
        right=nodes["right_child"].astype(np.int64),
        feature=np.where(leaf, 0, nodes["feature"]),
        threshold=nodes["threshold"].copy(),
        bounds=shares.indptr.astype(np.int64),
        classes=np.asarray(classes, np.int64)[shares.indices],
        shares=shares.data,
        shape=np.array([n_features, n_classes]),
    )


def library(part: str) -> Any:
    """A part of scikit-learn, which is imported when it is needed.

    Raises
    ------
    MissingExtraError : it is not installed.
    """
    try:
        return importlib.import_module(f"sklearn.{part}")
    except ImportError:
        raise MissingExtraError(
            "cannot recognise actions",
            where="scikit-learn is not installed",
            fix="pip install 'ecat[learn]'",
        ) from None
