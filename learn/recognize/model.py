"""The recogniser: which box moves, how, and where to, told by trees, and what a session makes of that.

Windows are seen twice, with either box as the one that moves.  Seen from the box that does, the two names of a label
become one, an action, so that every session teaches both; in training each is also seen in a mirror.  Boosted trees
tell the box, the manner (who moves it, and the verb) and the relation (locative and preposition).  Probabilities are
over whole labels that occur, so that all are valid.  Other trees know when an action gets its locative, by the way of
the box through the session, which the grammar of sessions asks.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import ExistsError, InputError, NotFoundError
from ecat.progress import Progress, beginning, silent
from ecat.store import staged_file
from learn.features.journey import journey_features
from learn.features.points import N_POINTS, SWAP_POINTS
from learn.features.windows import (
    LENGTH,
    VERSION,
    Features,
    Floats,
    Table,
    fit_table,
    mirror,
    n_windows,
    window_features,
    windows_of,
)
from learn.recognize.actions import Actions
from learn.recognize.arrival import Shares, arrival_width, arrived, grow
from learn.recognize.boosting import Boosted, boost
from learn.recognize.dataset import LabelledSession, Labels, places_of, vocabulary_of
from learn.recognize.grammar import Arrived, Grammar, Habits
from learn.recognize.unusable import check_name, damaged

CONFIG, MODEL = "config.json", "model.npz"
N_JOBS = 2
_TREES, _ARRIVAL = ("mover", "manner", "relation"), "arrival"


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
class Recognizer:
    """A trained recogniser.

    Attributes
    ----------
    vocabulary : (k, 5) the labels that it knows, in order, with both names of the boxes.
    mover : tells whether the first box moves.
    manner, relation : tell what is done by the first box, if it is the one that moves.
    arrival : tell when an action gets its locative; none if none ever did.
    trained_on : fingerprints of the sessions.
    """

    settings: Settings
    table: Table
    vocabulary: Labels
    habits: Habits
    mover: Boosted
    manner: Boosted
    relation: Boosted
    arrival: Shares | None = None
    trained_on: frozenset[str] = frozenset()

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        return self.in_context(self.alone(sessions), sessions)

    def alone(self, sessions: Sequence[Floats]) -> Floats:
        """Probabilities (w, k) of windows without their session."""
        with ThreadPoolExecutor(N_JOBS) as threads:
            seen = list(threads.map(partial(self._seen_from, sessions), (False, True)))
        first, second = (mover for mover, _ in seen)
        moves = (first + 1 - second) / 2
        parts = [share[:, None] * found for share, (_, found) in zip((moves, 1 - moves), seen, strict=True)]
        return Actions.of(self.vocabulary).labels(parts[0], parts[1])

    def on_table(self, table: Table) -> Recognizer:
        """The same for sessions whose table is known."""
        return replace(self, table=table)

    def in_context(self, alone: Floats, sessions: Sequence[Floats]) -> Recognized:
        """Probabilities (w, k) of the windows of sessions alone, and beside them what the sessions make of these."""
        grammar = Grammar.of(self.vocabulary, self.habits)
        sessions = [points for points in sessions if n_windows(len(points))]
        ends = np.cumsum([n_windows(len(points)) for points in sessions])
        parts = grammar.smooth(np.split(alone, ends)[:-1], self._arrived(sessions))
        return Recognized(self.vocabulary, alone, np.concatenate(parts) if parts else alone)

    def _arrived(self, sessions: Sequence[Floats]) -> Arrived | None:
        if (trees := self.arrival) is None:
            return None
        return lambda places: arrived(
            trees,
            [journey_features(points, self.table) for points in sessions],
            [self.vocabulary[of_session] for of_session in places],
        )

    def _seen_from(self, sessions: Sequence[Floats], swap: bool) -> tuple[Floats, Floats]:  # noqa: FBT001
        """Probabilities (w,) that the first box moves, and (w, actions) of what it then does; of exchanged boxes."""
        features = features_of([_seen(points, swap=swap) for points in sessions], self.table)
        actions = Actions.of(self.vocabulary)
        told = actions.joint(self.manner.predict(features), self.relation.predict(features))
        return self.mover.predict(features)[:, -1], told


def features_of(sessions: Sequence[Floats], table: Table) -> Features:
    """Features of all windows of sessions, one after the other."""
    return window_features(np.concatenate([windows_of(points) for points in sessions]), table)


def fingerprint(points: Floats) -> str:
    """What tells whether two sessions are the same recording, whatever their names."""
    return hashlib.sha256(np.ascontiguousarray(points, "<f8").tobytes()).hexdigest()[:16]


def train(
    sessions: Sequence[LabelledSession], settings: Settings | None = None, progress: Progress = silent
) -> Recognizer:
    """A recogniser that has seen these sessions and nothing else.

    Raises
    ------
    InputError : there are no windows.
    """
    settings = settings or Settings()
    labels = [session.labels for session in sessions]
    if not sum(map(len, labels)):
        raise InputError("cannot train a recogniser", where="there are no windows", fix="give more sessions")
    table = fit_table(np.concatenate([session.points for session in sessions]))
    vocabulary = vocabulary_of(sessions)
    boosted = _boost_all(_tasks(sessions, table, vocabulary, progress), settings, progress)
    known = frozenset(fingerprint(session.points) for session in sessions)
    arrival = grow(sessions, table, settings.seed)
    return Recognizer(
        settings, table, vocabulary, Habits.of(labels), **boosted, arrival=arrival, trained_on=known
    )


def _tasks(
    sessions: Sequence[LabelledSession], table: Table, vocabulary: Labels, progress: Progress
) -> dict[str, tuple[Features, NDArray[np.int64], int]]:
    """What each of the three has to learn: features, classes, and how many there are."""
    actions = Actions.of(vocabulary)
    place = places_of(np.concatenate([session.labels for session in sessions]), vocabulary)
    mover, action = actions.mover[place], actions.action[place]
    moved: list[Features] = []
    moving: list[Features] = []
    for done, mirrored in enumerate((False, True)):
        progress("computing features", done, 2)
        views = [
            features_of([_seen(one.points, swap=swap, mirrored=mirrored) for one in sessions], table)
            for swap in (False, True)
        ]
        moved += [view[mover > 0] for view in views]
        moving += [np.where((mover == 2)[:, None], views[1], views[0]), views[1][mover == 0]]
    progress("computing features", 2, 2)
    first = np.concatenate([mover[mover > 0] == 1, mover[mover > 0] == 2]).astype(np.int64)
    what = np.tile(np.concatenate([action, action[mover == 0]]), 2)
    features = np.concatenate(moving)
    return {
        "mover": (np.concatenate(moved), np.tile(first, 2), 2),
        "manner": (features, actions.manner[what], int(actions.manner.max()) + 1),
        "relation": (features, actions.relation[what], int(actions.relation.max()) + 1),
    }


def _boost_all(
    tasks: dict[str, tuple[Features, NDArray[np.int64], int]], settings: Settings, progress: Progress
) -> dict[str, Boosted]:
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
        return dict(zip(_TREES, threads.map(one, _TREES), strict=True))


def save(recognizer: Recognizer, run: Path) -> None:
    """Write the recogniser into the folder ``run``: how it was made as JSON, its trees as arrays.

    Raises
    ------
    ExistsError : there is one already.
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
    trees = {name: getattr(recognizer, name) for name in (*_TREES, _ARRIVAL)}
    arrays = {k: v for name, kept in trees.items() if kept is not None for k, v in kept.arrays(name).items()}
    with staged_file(run / MODEL) as staging, staging.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **{k: _small(v) for k, v in arrays.items()})
    with staged_file(run / CONFIG) as staging:
        staging.write_text(json.dumps(config, indent=1) + "\n", "utf-8")


def load(run: Path) -> Recognizer:
    """The recogniser in the folder ``run``; nothing in it is executed.

    Raises
    ------
    NotFoundError : there is none.
    InputError : it was trained with other features.
    CorruptError : it is damaged.
    """
    if not (run / CONFIG).is_file() or not (run / MODEL).is_file():
        fix = f"ecat learn recognize train DIR --run {run}"
        raise NotFoundError(f"cannot use the model {run}", where=f"there is no {CONFIG} and {MODEL}", fix=fix)
    try:
        config: dict[str, Any] = json.loads((run / CONFIG).read_text("utf-8"))
        check_name(config["features"], VERSION, run)
        settings, table = Settings(**config["settings"]), Table(**config["table"])
        vocabulary = np.array(config["vocabulary"], np.int8).reshape(-1, 5)
        habits = Habits(**{name: float(share) for name, share in config["habits"].items()})
        with (run / MODEL).open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            boosted = {name: Boosted.of_arrays(arrays, name) for name in _TREES}
            arrives = any(name.startswith(f"{_ARRIVAL}.") for name in arrays)
            arrival = Shares.of_arrays(arrays, _ARRIVAL) if arrives else None
        known = frozenset(str(one) for one in config["trained_on"])
        recognizer = Recognizer(
            settings, table, vocabulary, habits, **boosted, arrival=arrival, trained_on=known
        )
        _require_fit(recognizer)
    except (ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise damaged(run, error) from None
    return recognizer


def refuse_taken(run: Path) -> None:
    """Say before the work, and not after it, that there is a model in ``run`` already.

    Raises
    ------
    ExistsError : there is.
    """
    if (run / MODEL).exists() or (run / CONFIG).exists():
        raise ExistsError(
            f"cannot train into {run}",
            where="there is a model in it",
            consequence="nothing was trained",
            fix="name another folder",
        )


def _small(values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype == np.int64:
        return values.astype(np.int32)
    return values


def _require_fit(recognizer: Recognizer) -> None:
    """Its trees tell as many classes as its labels have, from as many features as there are."""
    actions = Actions.of(recognizer.vocabulary)
    n_features = features_of([np.zeros((LENGTH, N_POINTS, 3))], Table(0.0, -1.0)).shape[1]
    classes = {
        "mover": 2,
        "manner": int(actions.manner.max()) + 1,
        "relation": int(actions.relation.max()) + 1,
    }
    for name, count in classes.items():
        if getattr(recognizer, name).shape.tolist() != [n_features, count]:
            raise ValueError(f"its {name} does not fit its labels")
    if (trees := recognizer.arrival) is not None and trees.shape.tolist() != [arrival_width(), 1]:
        raise ValueError("its arrival does not fit the features")


def _seen(points: Floats, *, swap: bool, mirrored: bool = False) -> Floats:
    points = points[:, SWAP_POINTS] if swap else points
    return mirror(points) if mirrored else points
