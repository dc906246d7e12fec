"""The recogniser: which box moves, how, and where to, told by trees, and what a session makes of that.

Windows are seen twice, with either box as the one that moves.  Seen from the box that does, the two names of a label
become one, an action, so that every session teaches both; in training each is also seen in a mirror.  Boosted trees
tell the box, the manner (who moves it, and the verb) and the relation (locative and preposition).  Probabilities are
over whole labels that occur, so that all are valid.  The grammar of sessions asks two kinds of other trees: some are
asked the same three questions about a session as a whole, and some know when an action gets its locative, by the way
of the box through the session.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.progress import Progress, beginning, silent
from learn.features.journey import journey_features
from learn.features.points import N_POINTS
from learn.features.windows import (
    LENGTH,
    VERSION,
    Features,
    Floats,
    Table,
    chunks_of,
    either_way,
    fit_table,
    mirror,
    n_windows,
    session_features,
    window_features,
    windows_of,
)
from learn.recognize.actions import Actions, Told, movers
from learn.recognize.arrival import arrival_width, arrived, grow_arrival
from learn.recognize.boosting import Boosted, boost
from learn.recognize.dataset import LabelledSession, Labels, places_of, vocabulary_of
from learn.recognize.forest import Forest, grow
from learn.recognize.grammar import Arrived, Grammar, Habits
from learn.recognize.kept import CONFIG, read_arrays, read_config, write_arrays, write_json
from learn.recognize.tellers import QUESTIONS, Lesson, Tellers, Views, lessons
from learn.recognize.unusable import check_name, habits_of, labels_of, prints_of, undamaged

MODEL = "model.npz"
N_JOBS = 2
_WHOLE, _ARRIVAL = "whole.", "arrival"
_OF_SESSIONS = {"n_estimators": 200, "min_samples_leaf": 1, "max_features": 0.1}


@dataclass(frozen=True)
class Settings:
    """How a recogniser is trained.

    Attributes
    ----------
    n_trees : of each class, in each model.
    n_models : whose mean is taken; they differ in what is drawn at random.
    """

    n_trees: int = 150
    n_models: int = 1
    seed: int = 0


@dataclass(frozen=True)
class Recognized:
    """Of the windows of sessions, one after the other: probabilities (w, k) of the labels (k, 5) of a vocabulary."""

    vocabulary: Labels
    alone: Floats
    context: Floats

    def labels(self, probabilities: Floats) -> Labels:
        """The most probable labels (w, 5)."""
        return self.vocabulary[probabilities.argmax(axis=1)]


@dataclass(frozen=True)
class Seen:
    """Probabilities of labels: ``windows`` (w, k) by themselves, and (s, k) of what ``sessions`` end with; of those
    that have a window.
    """

    windows: Floats
    sessions: Floats


@dataclass(frozen=True)
class Recognizer:
    """A trained recogniser.

    Attributes
    ----------
    vocabulary : (k, 5) the labels that it knows, in order, with both names of the boxes.
    windows, whole : tell what a window shows, and what a session ends with.
    arrival : tell when an action gets its locative; none if none ever did.
    trained_on : fingerprints of the sessions.
    """

    settings: Settings
    table: Table
    vocabulary: Labels
    habits: Habits
    windows: Tellers
    whole: Tellers
    arrival: Forest | None = None
    trained_on: frozenset[str] = frozenset()

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        return self.in_context(self.seen(sessions), sessions)

    def seen(self, sessions: Sequence[Floats]) -> Seen:
        """What windows show without their session, and what sessions show as a whole."""
        actions = Actions.of(self.vocabulary)
        counts = [count for points in sessions if (count := n_windows(len(points)))]

        def told(features: Features) -> tuple[Told, Told]:
            whole = session_features(features, counts)
            return self.windows.tell(features, actions), self.whole.tell(whole, actions)

        with ThreadPoolExecutor(N_JOBS) as threads:
            first, second = threads.map(told, features_either_way(sessions, self.table))
        return Seen(*(actions.labels(*pair) for pair in zip(first, second, strict=True)))

    def on_table(self, table: Table) -> Recognizer:
        """The same for sessions whose table is known."""
        return replace(self, table=table)

    def in_context(self, seen: Seen, sessions: Sequence[Floats]) -> Recognized:
        """Probabilities of windows alone, as they were seen, and beside them what their sessions make of them."""
        grammar = Grammar.of(self.vocabulary, self.habits)
        sessions = [points for points in sessions if n_windows(len(points))]
        ends = np.cumsum([n_windows(len(points)) for points in sessions])
        parts = grammar.smooth(np.split(seen.windows, ends)[:-1], self._arrived(sessions), seen.sessions)
        return Recognized(self.vocabulary, seen.windows, np.concatenate(parts) if parts else seen.windows)

    def _arrived(self, sessions: Sequence[Floats]) -> Arrived | None:
        if (trees := self.arrival) is None:
            return None
        return lambda places: arrived(
            trees,
            [journey_features(points, self.table) for points in sessions],
            [self.vocabulary[of_session] for of_session in places],
        )


def features_of(sessions: Sequence[Floats], table: Table) -> Features:
    """Features of all windows of sessions, one after the other."""
    return window_features(np.concatenate([windows_of(points) for points in sessions]), table)


def features_either_way(sessions: Sequence[Floats], table: Table) -> tuple[Features, Features]:
    """Features of all windows of sessions, one after the other, and of the same with the boxes exchanged."""
    windows = np.concatenate([windows_of(points) for points in sessions])
    with ThreadPoolExecutor(N_JOBS) as threads:
        parts = list(threads.map(lambda chunk: either_way(chunk, table), chunks_of(windows)))
    return np.concatenate([first for first, _ in parts]), np.concatenate([second for _, second in parts])


def fingerprint(points: Floats) -> str:
    """What tells whether two sessions are the same recording, whatever their names."""
    return hashlib.sha256(np.ascontiguousarray(points, "<f8").tobytes()).hexdigest()[:16]


def train(
    sessions: Sequence[LabelledSession], settings: Settings | None = None, progress: Progress = silent
) -> Recognizer:
    """A recogniser that has seen these sessions and nothing else.

    Raises
    ------
    InputError : there are no windows, or nothing happens in them.
    """
    settings = settings or Settings()
    require_actions(sessions)
    sessions = [session for session in sessions if len(session.labels)]
    labels = [session.labels for session in sessions]
    table, vocabulary = (
        fit_table(np.concatenate([session.points for session in sessions])),
        vocabulary_of(sessions),
    )
    views, actions = _views(sessions, table, progress), Actions.of(vocabulary)
    place = np.array(places_of(np.concatenate(labels), vocabulary))
    windows = _boost_all(lessons(views, place, actions), settings, progress)
    counts = [len(one) for one in labels]
    wholes = {key: session_features(view, counts) for key, view in views.items()}
    return Recognizer(
        settings,
        table,
        vocabulary,
        Habits.of(labels),
        windows,
        _grow_all(lessons(wholes, place[np.cumsum(counts) - 1], actions), settings.seed),
        grow_arrival(sessions, table, settings.seed),
        frozenset(fingerprint(session.points) for session in sessions),
    )


def _views(sessions: Sequence[LabelledSession], table: Table, progress: Progress) -> Views:
    found: dict[tuple[bool, bool], Features] = {}
    for mirrored in (False, True):
        progress("computing features", len(found), 4)
        seen = [mirror(one.points) if mirrored else one.points for one in sessions]
        found[False, mirrored], found[True, mirrored] = features_either_way(seen, table)
    progress("computing features", 4, 4)
    return found


def _boost_all(tasks: dict[str, Lesson], settings: Settings, progress: Progress) -> Tellers:
    def one(name: str) -> Boosted:
        features, classes, n_classes = tasks[name]
        told = beginning(name, progress)
        return boost(
            features,
            classes,
            n_classes,
            n_trees=settings.n_trees,
            n_models=settings.n_models,
            seed=settings.seed,
            progress=told,
        )

    with ThreadPoolExecutor(N_JOBS) as threads:
        return Tellers(*threads.map(one, QUESTIONS))


def _grow_all(tasks: dict[str, Lesson], seed: int) -> Tellers:
    def one(name: str) -> Forest:
        features, classes, n_classes = tasks[name]
        return grow(features, np.eye(n_classes)[classes], seed=seed, **_OF_SESSIONS)

    with ThreadPoolExecutor(N_JOBS) as threads:
        return Tellers(*threads.map(one, QUESTIONS))


def require_actions(sessions: Sequence[LabelledSession]) -> None:
    """Refuse to learn where nothing happens.

    Raises
    ------
    InputError : there are no windows, or no label says that a box moves.
    """
    labels = [session.labels for session in sessions if len(session.labels)]
    if not labels or not movers(np.concatenate(labels)).any():
        raise InputError(
            "cannot train a recogniser",
            where="no label says that a box moves" if labels else "there are no windows",
            consequence="nothing was trained",
            fix="give sessions that are labelled with actions",
        )


def save(recognizer: Recognizer, run: Path) -> None:
    """Write the recogniser into the folder ``run``: its trees as arrays, and last how it was made, as JSON.

    Raises
    ------
    InputError : a number of it is not known (NaN).
    StoreError : it cannot be written.
    """
    config = {
        "features": VERSION,
        "settings": asdict(recognizer.settings),
        "table": asdict(recognizer.table),
        "vocabulary": recognizer.vocabulary.tolist(),
        "habits": asdict(recognizer.habits),
        "trained_on": sorted(recognizer.trained_on),
    }
    arrays = recognizer.windows.arrays() | recognizer.whole.arrays(_WHOLE)
    if recognizer.arrival is not None:
        arrays |= recognizer.arrival.arrays(_ARRIVAL)
    write_arrays(run / MODEL, {name: _small(values) for name, values in arrays.items()}, compressed=True)
    write_json(config, run / CONFIG)


def load(run: Path) -> Recognizer:
    """The recogniser in the folder ``run``; nothing in it is executed.

    Raises
    ------
    NotFoundError : there is none.
    InputError : it was trained with other features.
    CorruptError : it is damaged.
    """
    config = read_config(run)
    with undamaged(f"cannot use the model {run}"):
        check_name(config["features"], VERSION, run)
        arrays = read_arrays(run / MODEL)
        arrives = any(name.startswith(f"{_ARRIVAL}.") for name in arrays)
        recognizer = Recognizer(
            Settings(**config["settings"]),
            Table(**{name: float(number) for name, number in config["table"].items()}),
            labels_of(config),
            habits_of(config),
            Tellers.of_arrays(Boosted, arrays),
            Tellers.of_arrays(Forest, arrays, _WHOLE),
            Forest.of_arrays(arrays, _ARRIVAL) if arrives else None,
            prints_of(config),
        )
        _require_fit(recognizer)
    return recognizer


def _small(values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype == np.int64:
        return values.astype(np.int32)
    return values


def _require_fit(recognizer: Recognizer) -> None:
    """Its trees tell as many classes as its labels have, from as many features as there are."""
    actions = Actions.of(recognizer.vocabulary)
    n_features = features_of([np.zeros((LENGTH, N_POINTS, 3))], Table(0.0, -1.0)).shape[1]
    recognizer.windows.require_fit(actions, n_features)
    recognizer.whole.require_fit(actions, 2 * n_features)
    if (trees := recognizer.arrival) is not None and trees.shape.tolist() != [arrival_width(), 1]:
        raise ValueError("its arrival does not fit the features")
