"""When an action has come to be related to a place: "pull" becomes "pull past" at some window of a session.

A window alone hardly tells; how far the box has come, of what it will have come when the session ends, does.  An action
that is so related is said to have arrived.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from learn.features.journey import journey_features
from learn.features.points import N_POINTS
from learn.features.scene import Table
from learn.features.windows import LENGTH, Features, Floats
from learn.recognize.actions import movers
from learn.recognize.dataset import PREPOSITION, SLOTS, SUBJECT, VERB, LabelledSession, Labels
from learn.recognize.forest import Forest, grow

_PERFORMER = 1
_SETTINGS = {"n_estimators": 200, "min_samples_leaf": 3, "max_features": 0.4}


def arrived(trees: Forest, journeys: Sequence[Sequence[Features]], labels: Sequence[Labels]) -> list[Floats]:
    """Of sessions, probabilities (w, k) that at its windows, if its action is one of its labels (k, 5), it has arrived.

    Parameters
    ----------
    journeys : of both boxes of each, :func:`learn.features.journey.journey_features`.
    """
    shapes = [(len(asked), len(journey[0])) for asked, journey in zip(labels, journeys, strict=True)]
    rows = [_rows(journey, label) for journey, asked in zip(journeys, labels, strict=True) for label in asked]
    told = trees.predict(np.concatenate(rows))[:, 0] if rows else np.zeros(0)
    ends = np.cumsum([k * w for k, w in shapes])[:-1]
    return [part.reshape(shape).T for part, shape in zip(np.split(told, ends), shapes, strict=True)]


def grow_arrival(sessions: Sequence[LabelledSession], table: Table, seed: int) -> Forest | None:
    """Trees that know when actions of sessions arrive; none if none ever do."""
    rows: list[Features] = []
    said: list[NDArray[np.bool_]] = []
    for session in sessions:
        related = session.labels[:, PREPOSITION] > 0
        if related.any():
            rows.append(_rows(journey_features(session.points, table), session.labels[related][0]))
            said.append(related)
    if not rows:
        return None
    shares = np.concatenate(said).astype(np.float64)[:, None]
    return grow(np.concatenate(rows), shares, seed=seed, **_SETTINGS)


def arrival_width() -> int:
    """How many features the trees see."""
    nowhere = np.zeros((LENGTH, N_POINTS, 3))
    return _rows(journey_features(nowhere, Table(0.0, -1.0)), np.zeros(len(SLOTS), np.int8)).shape[1]


def _rows(journeys: Sequence[Features], label: NDArray[np.int8]) -> Features:
    """Features of the windows of a session whose action, once it has arrived, has a label (5,)."""
    journey = journeys[max(int(movers(label[None])[0]), 1) - 1]
    said = [
        *(label[VERB] == np.arange(1, len(SLOTS["verb"]))),
        *(label[PREPOSITION] == np.arange(1, len(SLOTS["preposition"]))),
        label[SUBJECT] > _PERFORMER,
    ]
    return np.concatenate([journey, np.tile(np.array(said, np.float32), (len(journey), 1))], axis=1)
