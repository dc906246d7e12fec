"""Decision trees as plain arrays, one behind the other: checked when they are read, and walked in C."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ecat.errors import MissingExtraError
from learn.features.windows import Features


@dataclass(frozen=True)
class Trees:
    """Trees whose nodes point to their children, counted from the first node of their tree.

    Attributes
    ----------
    roots : (t + 1,) where each tree begins, and the end.
    left, right, feature : (n,) of each node; -1, -1 and any in a leaf.
    threshold : (n,) up to this a row goes to the left.
    shape : (2,) numbers of features and of classes.
    """

    roots: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    feature: NDArray[np.int64]
    threshold: NDArray[np.float64]
    shape: NDArray[np.int64]

    def arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """What makes up the trees, by name."""
        return {f"{prefix}.{field.name}": getattr(self, field.name) for field in fields(self)}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Self:
        """The trees that :meth:`arrays` came from.

        Raises
        ------
        ValueError : they are none, or lead outside of themselves.
        """
        try:
            kept: dict[str, Any] = {
                field.name: arrays[f"{prefix}.{field.name}"].astype(
                    np.float64 if "float" in str(field.type) else np.int64, casting="safe"
                )
                for field in fields(cls)
            }
            found = cls(**kept)
            sound = found.is_sound()
        except (KeyError, ValueError, TypeError, IndexError):
            found, sound = None, False
        if found is None or not sound:
            raise ValueError(f"its trees {prefix} are damaged")
        return found

    def is_sound(self) -> bool:
        """Whether every walk from a root ends in a leaf of its tree."""
        n, tree_of = len(self.left), np.diff(self.roots)
        if not (len(tree_of) and self.roots[0] == 0 and self.roots[-1] == n and (tree_of > 0).all()):
            return False
        size = np.repeat(tree_of, tree_of)
        own = np.arange(n) - np.repeat(self.roots[:-1], tree_of)
        inner = self.left >= 0
        children = np.stack([self.left, self.right])[:, inner]
        return bool(
            self.shape.shape == (2,)
            and (self.shape > 0).all()
            and len({n, len(self.right), len(self.feature), len(self.threshold)}) == 1
            and (self.left >= -1).all()  # less would not count as a leaf where they are walked
            and (children > own[inner]).all()
            and (children < size[inner]).all()
            and ((self.feature[inner] >= 0) & (self.feature[inner] < self.shape[0])).all()
        )

    def leaves(self, rows: Features) -> list[NDArray[np.int64]]:
        """Of each tree, the node (n,) that each row (n, features) ends in, among those of all trees.

        Raises
        ------
        ValueError : they are of other features.
        """
        rows = np.ascontiguousarray(rows, np.float32)
        if rows.shape[1] != self.shape[0]:
            raise ValueError(f"{rows.shape[1]} features for trees of {self.shape[0]}")
        return [tree.apply(rows) + start for start, tree in zip(self.roots[:-1], self._walkers, strict=True)]

    @cached_property
    def _walkers(self) -> list[Any]:
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


def library(name: str) -> Any:
    """A part of scikit-learn, or ``lightgbm``, which is imported when it is needed.

    Raises
    ------
    MissingExtraError : it is not installed, or lacks a library of the system.
    """
    whole, module = ("LightGBM", name) if name == "lightgbm" else ("scikit-learn", f"sklearn.{name}")
    what = "cannot recognise actions"
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingExtraError(
            what, where=f"{whole} is not installed", fix="pip install 'ecat[learn]'"
        ) from None
    except OSError as error:
        fix = "install OpenMP: apt-get install libgomp1, or brew install libomp"
        raise MissingExtraError(what, where=f"{whole} cannot be loaded: {error}", fix=fix) from None
