"""Trees that tell which box moves, how, and where to: of windows, or of whole sessions, seen with either box first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.features.windows import Features
from learn.recognize.actions import Actions, Told
from learn.recognize.boosting import Boosted
from learn.recognize.forest import Forest

QUESTIONS = ("mover", "manner", "relation")
Views = Mapping[tuple[bool, bool], Features]
"""Features (n, f) by whether boxes are exchanged, and whether they are seen in a mirror."""
Lesson = tuple[Features, NDArray[np.int64], int]
"""Features, classes, and how many classes there are."""


@dataclass(frozen=True)
class Tellers:
    """Trees for each of the three questions.

    Attributes
    ----------
    mover : tells whether the first box moves.
    manner, relation : tell what is done by the first box, if it is the one that moves.
    """

    mover: Boosted | Forest
    manner: Boosted | Forest
    relation: Boosted | Forest

    def tell(self, features: Features, actions: Actions) -> Told:
        """What rows (n, f) show if the first box is the one that moves, and whether it does."""
        told = actions.joint(self.manner.predict(features), self.relation.predict(features))
        return self.mover.predict(features)[:, -1], told

    def arrays(self, prefix: str = "") -> dict[str, NDArray[Any]]:
        """What makes up the trees, by name."""
        parts = (getattr(self, name).arrays(f"{prefix}{name}") for name in QUESTIONS)
        return {name: values for part in parts for name, values in part.items()}

    @classmethod
    def of_arrays(
        cls, kind: type[Boosted] | type[Forest], arrays: Mapping[str, NDArray[Any]], prefix: str = ""
    ) -> Tellers:
        """Those that :meth:`arrays` came from.

        Raises
        ------
        ValueError : they are none.
        """
        return cls(**{name: kind.of_arrays(arrays, f"{prefix}{name}") for name in QUESTIONS})

    def require_fit(self, actions: Actions, n_features: int) -> None:
        """They tell as many classes as there are, from as many features.

        Raises
        ------
        ValueError : they do not.
        """
        for name, count in _counts(actions).items():
            if getattr(self, name).shape.tolist() != [n_features, count]:
                raise ValueError(f"its {name} does not fit its labels")


def lessons(views: Views, place: NDArray[np.int64], actions: Actions) -> dict[str, Lesson]:
    """What there is to learn for each question from rows whose labels are at ``place`` (n,) in the vocabulary.

    Each row is seen from the box that moves; in labels that are the same for both boxes, from either.
    """
    mover, action = actions.mover[place], actions.action[place]
    moved: list[Features] = []
    moving: list[Features] = []
    for mirrored in (False, True):
        own, exchanged = views[False, mirrored], views[True, mirrored]
        moved += [own[mover > 0], exchanged[mover > 0]]
        moving += [np.where((mover == 2)[:, None], exchanged, own), exchanged[mover == 0]]
    first = np.concatenate([mover[mover > 0] == 1, mover[mover > 0] == 2]).astype(np.int64)
    what = np.tile(np.concatenate([action, action[mover == 0]]), 2)
    seen, counts = np.concatenate(moving), _counts(actions)
    return {
        "mover": (np.concatenate(moved), np.tile(first, 2), counts["mover"]),
        "manner": (seen, actions.manner[what], counts["manner"]),
        "relation": (seen, actions.relation[what], counts["relation"]),
    }


def _counts(actions: Actions) -> dict[str, int]:
    return {
        "mover": 2,
        "manner": int(actions.manner.max()) + 1,
        "relation": int(actions.relation.max()) + 1,
    }
