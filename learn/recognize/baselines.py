"""What knows less than the recogniser: the least that it has to be better than."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np

from learn.features.windows import fit_table
from learn.recognize.dataset import SLOTS, LabelledSession, Labels
from learn.recognize.model import features_of
from learn.recognize.trees import library

Baseline = Callable[[Sequence[LabelledSession], Sequence[LabelledSession]], Labels]
"""Labels (w, 5) of all windows of the second, by what was learned from the first."""


def majority(known: Sequence[LabelledSession], tested: Sequence[LabelledSession]) -> Labels:
    """Always the most frequent label."""
    labels, counts = np.unique(_labels(known), axis=0, return_counts=True)
    return np.repeat(labels[[counts.argmax()]], len(_labels(tested)), axis=0)


def marginals(known: Sequence[LabelledSession], tested: Sequence[LabelledSession]) -> Labels:
    """Each slot drawn by itself, as often as its values occur."""
    generator, labels, n = np.random.default_rng(0), _labels(known), len(_labels(tested))
    drawn = [generator.choice(labels[:, slot], n) for slot in range(len(SLOTS))]
    return np.stack(drawn, axis=1)


def logistic(known: Sequence[LabelledSession], tested: Sequence[LabelledSession]) -> Labels:
    """Multinomial logistic regression of whole labels on the same features of a window, not augmented."""
    table = fit_table(np.concatenate([session.points for session in known]))
    features, others = (features_of([one.points for one in part], table) for part in (known, tested))
    mean, deviation = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-6)
    labels, classes = np.unique(_labels(known), axis=0, return_inverse=True)
    model = library("linear_model").LogisticRegression(C=0.02, max_iter=60, tol=1e-2)
    with warnings.catch_warnings():  # sixty steps are enough for a baseline
        warnings.simplefilter("ignore", library("exceptions").ConvergenceWarning)
        model.fit(((features - mean) / deviation).clip(-5, 5), classes.ravel())
    return labels[model.predict(((others - mean) / deviation).clip(-5, 5))]


BASELINES: dict[str, Baseline] = {"majority": majority, "marginals": marginals, "logistic": logistic}


def _labels(sessions: Sequence[LabelledSession]) -> Labels:
    return np.concatenate([session.labels for session in sessions])
