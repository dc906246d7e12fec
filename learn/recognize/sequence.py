"""Generative models of sequences: a model for each label, and a window is what explains it best.

The thesis (2018, §2.3.1) discusses hidden Markov models and linear dynamical systems as what came before recurrent
networks.
Both see distances and movements of the nine places of chapter 4 in the plane, frame by frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.special import logsumexp

from ecat.errors import InputError
from ecat.progress import Progress, silent
from learn.features.ch4 import PAIRS
from learn.features.points import SWAP_POINTS
from learn.features.windows import LENGTH, Floats, Table
from learn.recognize.context import in_context
from learn.recognize.dataset import LabelledSession, Labels, exchanged, places_of, vocabulary_of
from learn.recognize.grammar import Habits
from learn.recognize.inputs import Fitted
from learn.recognize.kept import read_arrays, write_arrays
from learn.recognize.model import Recognized, fingerprint
from learn.recognize.unusable import check_name, habits_of, labels_of, prints_of, undamaged

FEATURES = "ch4-pcas18"
SEQUENCES = "sequences.npz"
_PRIOR = 100.0
"""Frames that the statistics of all labels together count for in those of one."""
_STAY = 0.8
_STEPS = 8


class Generative(Protocol):
    """Models of sequences, one for each label."""

    def log_likelihood(self, sequences: Floats) -> Floats:
        """Logarithms (w, k) of how likely sequences (w, t, d) are under each."""
        ...


@dataclass(frozen=True)
class HiddenMarkov:
    """Hidden Markov models that go through their states from first to last, with independent normal emissions.

    Attributes
    ----------
    transitions : (k, s, s) logarithms of probabilities; a sequence begins in state 0.
    means, variances : (k, s, d)
    """

    transitions: Floats
    means: Floats
    variances: Floats

    @classmethod
    def fit(
        cls, sequences: Floats, classes: NDArray[np.int64], n_classes: int, n_states: int = 3
    ) -> HiddenMarkov:
        """Expectation and maximisation, from sequences (n, t, d) cut in equal parts."""
        pooled = np.maximum(sequences.var(axis=(0, 1)), 1e-8)
        t, d = sequences.shape[1:]
        first = np.eye(n_states)[np.arange(t) * n_states // t]
        stay = np.diag(np.full(n_states, _STAY)) + np.diag(np.full(n_states - 1, 1 - _STAY), 1)
        stay[-1, -1] = 1.0
        with np.errstate(divide="ignore"):
            start = np.log(stay)
        found = cls(
            np.repeat(start[None], n_classes, 0),
            np.zeros((n_classes, n_states, d)),
            np.ones((n_classes, n_states, d)),
        )
        for label in range(n_classes):
            mine = sequences[classes == label]
            shares = np.repeat(first[None], len(mine), 0)
            for _ in range(_STEPS):
                weight = shares.sum(axis=(0, 1))[:, None]
                mean = (np.einsum("nts,ntd->sd", shares, mine) + mine.mean(axis=(0, 1))) / (weight + 1)
                square = np.einsum("nts,ntsd->sd", shares, (mine[:, :, None] - mean) ** 2)
                found.means[label] = mean
                found.variances[label] = (square + _PRIOR * pooled * 0.1) / (weight + _PRIOR)
                shares = found._posterior(mine, label)
        return found

    def log_likelihood(self, sequences: Floats) -> Floats:
        """Logarithms (w, k) of how likely sequences (w, t, d) are under each."""
        parts = [
            logsumexp(self._forward(self._emitted(sequences, label), label)[:, -1], axis=1)
            for label in range(len(self.means))
        ]
        return np.stack(parts, axis=1)

    def _emitted(self, sequences: Floats, label: int) -> Floats:
        apart = sequences[:, :, None] - self.means[label]
        variance = self.variances[label]
        return -0.5 * (apart**2 / variance + np.log(2 * np.pi * variance)).sum(axis=3)

    def _forward(self, emitted: Floats, label: int) -> Floats:
        found = np.full_like(emitted, -np.inf)
        found[:, 0, 0] = emitted[:, 0, 0]
        for step in range(1, emitted.shape[1]):
            arrived = logsumexp(found[:, step - 1, :, None] + self.transitions[label], axis=1)
            found[:, step] = arrived + emitted[:, step]
        return found

    def _posterior(self, sequences: Floats, label: int) -> Floats:
        emitted = self._emitted(sequences, label)
        before, after = self._forward(emitted, label), np.zeros_like(emitted)
        for step in range(emitted.shape[1] - 2, -1, -1):
            following = self.transitions[label] + (after[:, step + 1] + emitted[:, step + 1])[:, None]
            after[:, step] = logsumexp(following, axis=2)
        joint = before + after
        return np.exp(joint - logsumexp(joint, axis=2, keepdims=True))


@dataclass(frozen=True)
class LinearDynamics:
    """Linear dynamical systems whose state is seen: each frame is a linear function of the last, and normal noise.

    Attributes
    ----------
    dynamics : (k, d + 1, d) of a frame and 1, the next.
    factors : (k, d, d) lower Cholesky factors of the covariances of the noise.
    means, first : (k, d), (k, d, d) of first frames, the same.
    """

    dynamics: Floats
    factors: Floats
    means: Floats
    first: Floats

    @classmethod
    def fit(cls, sequences: Floats, classes: NDArray[np.int64], n_classes: int) -> LinearDynamics:
        """Least squares, drawn to those of all sequences (n, t, d) together."""
        d = sequences.shape[2]
        before, after = _steps(sequences)
        square = before.T @ before
        pooled = linalg.solve(square + 1e-6 * np.eye(d + 1), before.T @ after, assume_a="pos")
        noise = _covariance(after - before @ pooled)
        begin = sequences[:, 0]
        spread = _covariance(begin - begin.mean(axis=0))
        prior = square * (_PRIOR / len(before))
        parts: list[tuple[Any, ...]] = []
        for label in range(n_classes):
            mine = sequences[classes == label]
            one, other = _steps(mine)
            ridge = prior + 1e-6 * np.eye(d + 1)
            dynamics = linalg.solve(one.T @ one + ridge, one.T @ other + ridge @ pooled, assume_a="pos")
            rest = other - one @ dynamics
            covariance = (rest.T @ rest + _PRIOR * noise) / (len(rest) + _PRIOR)
            mean = (mine[:, 0].sum(axis=0) + begin.mean(axis=0)) / (len(mine) + 1)
            away = mine[:, 0] - mean
            initial = (away.T @ away + _PRIOR * spread) / (len(away) + _PRIOR)
            parts.append((dynamics, np.linalg.cholesky(covariance), mean, np.linalg.cholesky(initial)))
        return cls(*(np.stack(values) for values in zip(*parts, strict=True)))

    def log_likelihood(self, sequences: Floats) -> Floats:
        """Logarithms (w, k) of how likely sequences (w, t, d) are under each."""
        n = len(sequences)
        before, after = _steps(sequences)
        found = np.empty((n, len(self.means)))
        for label in range(len(self.means)):
            moved = _log_normal(after - before @ self.dynamics[label], self.factors[label])
            begun = _log_normal(sequences[:, 0] - self.means[label], self.first[label])
            found[:, label] = moved.reshape(n, -1).sum(axis=1) + begun
        return found


KINDS: dict[str, Any] = {"hmm": HiddenMarkov, "lds": LinearDynamics}
_SHAPES = {
    "hmm": {"transitions": "kss", "means": "ksd", "variances": "ksd"},
    "lds": {"dynamics": "kid", "factors": "kdd", "means": "kd", "first": "kdd"},
}
"""Of their arrays: k labels, s states, d numbers that are seen of a frame, and i = d + 1."""


@dataclass(frozen=True)
class SequenceRecognizer:
    """Models of sequences that were fitted, and what they see.

    Attributes
    ----------
    vocabulary : (k, 5) a label for each model.
    scale : (2, d) mean and deviation of what is seen.
    trained_on : fingerprints of the sessions.
    """

    kind: str
    fitted: Fitted
    vocabulary: Labels
    habits: Habits
    scale: Floats
    models: Generative
    trained_on: frozenset[str] = frozenset()

    def on_table(self, table: Table) -> SequenceRecognizer:
        """The same for sessions whose table is known."""
        return replace(self, fitted=self.fitted.on_table(table))

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show.

        All labels are held to be as likely before.  Frames of a window tell much the same, so that together they count
        as one: this does not change what is said, only how sure it is.
        """
        if sessions:
            parts = [motion(self.fitted.windows(points)) for points in sessions]
            sequences = (np.concatenate(parts) - self.scale[0]) / self.scale[1]
            evidence = self.models.log_likelihood(sequences) / sequences.shape[1]
        else:
            evidence = np.zeros((0, len(self.vocabulary)))
        alone = np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True))
        return in_context(self.vocabulary, alone, sessions, self.vocabulary, self.habits)


def train(sessions: Sequence[LabelledSession], kind: str, progress: Progress = silent) -> SequenceRecognizer:
    """Models of all labels that these sessions show, with both names of the boxes.

    Raises
    ------
    InputError : there are no windows.
    """
    if not sum(len(session.labels) for session in sessions):
        raise InputError("cannot train a recogniser", where="there are no windows", fix="give more sessions")
    fitted = Fitted.of(FEATURES, [session.points for session in sessions])
    vocabulary = vocabulary_of(sessions)
    parts: list[Floats] = []
    classes: list[int] = []
    for done, session in enumerate(sessions):
        progress("computing features", done, len(sessions))
        for points, labels in (
            (session.points, session.labels),
            (session.points[:, SWAP_POINTS], exchanged(session.labels)),
        ):
            parts.append(motion(fitted.windows(points)))
            classes += places_of(labels, vocabulary)
    seen = np.concatenate(parts)
    scale = np.stack([seen.mean(axis=(0, 1)), np.maximum(seen.std(axis=(0, 1)), 1e-6)])
    models = KINDS[kind].fit((seen - scale[0]) / scale[1], np.array(classes), len(vocabulary))
    progress("computing features", len(sessions), len(sessions))
    habits = Habits.of([session.labels for session in sessions])
    known = frozenset(fingerprint(session.points) for session in sessions)
    return SequenceRecognizer(kind, fitted, vocabulary, habits, scale, models, known)


def motion(places: NDArray[np.float32]) -> Floats:
    """Of windows (w, t, 18) of nine places, frame by frame: (w, t, 22).

    Distances of chapter 4's nine pairs, and how fast they grow; how both boxes move along the two axes.
    """
    points = places.astype(np.float64).reshape(*places.shape[:2], 9, 2)
    distance = np.stack(
        [np.hypot(*np.moveaxis(points[:, :, a] - points[:, :, b], -1, 0)) for a, b in PAIRS], axis=2
    )
    moved = np.gradient(points[:, :, 3:5].reshape(*places.shape[:2], 4), axis=1)
    return np.concatenate([distance, np.gradient(distance, axis=1), moved], axis=2)


def save(recognizer: SequenceRecognizer, run: Path) -> dict[str, Any]:
    """Write the models into the folder ``run``, as arrays, and say what else is to be kept, as JSON.

    Raises
    ------
    InputError : a number of them is not known (NaN).
    StoreError : they cannot be written.
    """
    write_arrays(run / SEQUENCES, {"scale": recognizer.scale, **vars(recognizer.models)})
    return {
        "model": recognizer.kind,
        "features": FEATURES,
        "fit": recognizer.fitted.fit.tolist(),
        "vocabulary": recognizer.vocabulary.tolist(),
        "habits": asdict(recognizer.habits),
        "trained_on": sorted(recognizer.trained_on),
    }


def load(run: Path, config: Mapping[str, Any]) -> SequenceRecognizer:
    """The recogniser in the folder ``run``, with what :func:`save` said; nothing in it is executed.

    Raises
    ------
    InputError : it was trained with other features.
    CorruptError : it is damaged.
    """
    with undamaged(f"cannot use the model {run}"):
        check_name(config["features"], FEATURES, run)
        kind, vocabulary = KINDS[config["model"]], labels_of(config)
        arrays = read_arrays(run / SEQUENCES, {"scale", *(field.name for field in fields(kind))})
        arrays = {name: values.astype(np.float64, casting="safe") for name, values in arrays.items()}
        scale = arrays.pop("scale")
        fitted = Fitted(FEATURES, np.array(config["fit"], np.float64))
        models, known = kind(**arrays), prints_of(config)
        found = SequenceRecognizer(
            config["model"], fitted, vocabulary, habits_of(config), scale, models, known
        )
        _require_fit(found)
    return found


def _require_fit(recognizer: SequenceRecognizer) -> None:
    """There is a model for each label, and each says how likely it is that nothing moves."""
    scale, models = recognizer.scale, vars(recognizer.models)
    d = motion(np.zeros((1, LENGTH, 18), np.float32)).shape[2]
    if scale.shape != (2, d) or not (np.isfinite(scale).all() and (scale[1] > 0).all()):
        raise ValueError(f"its scale is not that of {d} numbers")
    sizes = {"k": len(recognizer.vocabulary), "d": d, "i": d + 1, "s": models["means"].shape[1]}
    for name, letters in _SHAPES[recognizer.kind].items():
        if models[name].shape != tuple(sizes[letter] for letter in letters):
            raise ValueError(f"its {name} do not fit its labels and what is seen")
    with np.errstate(all="ignore"):
        told = recognizer.models.log_likelihood(np.zeros((1, LENGTH, d)))
    if not np.isfinite(told).all():
        raise ValueError("its models cannot tell how likely anything is")


def _steps(sequences: Floats) -> tuple[Floats, Floats]:
    """Frames and a 1 (n (t - 1), d + 1), and the frames that follow (n (t - 1), d)."""
    d = sequences.shape[2]
    before = sequences[:, :-1].reshape(-1, d)
    return np.c_[before, np.ones(len(before))], sequences[:, 1:].reshape(-1, d)


def _covariance(rows: Floats) -> Floats:
    return rows.T @ rows / len(rows) + 1e-4 * np.eye(rows.shape[1])


def _log_normal(rows: Floats, factor: Floats) -> Floats:
    """Logarithms (n,) of densities of rows (n, d) under a normal distribution about 0."""
    apart = linalg.solve_triangular(factor, rows.T, lower=True)
    constant = np.log(np.diag(factor)).sum() + 0.5 * len(factor) * np.log(2 * np.pi)
    return -0.5 * (apart**2).sum(axis=0) - constant
