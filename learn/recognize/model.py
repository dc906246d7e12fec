"""The recogniser: two forests, one that sees a window and one that sees its session too, and a grammar.

Every session is learned four times, as it is, in a mirror, and both with the two boxes exchanged; what is recognised
is the mean of two, as it is and with the boxes exchanged.  Probabilities are over whole labels, so that all are valid.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import CorruptError, ExistsError, InputError, NotFoundError
from ecat.progress import Progress, silent
from ecat.store import staged_file
from learn.features.points import SWAP_POINTS
from learn.features.windows import (
    VERSION,
    Features,
    Floats,
    Table,
    fit_table,
    mirror,
    n_windows,
    surroundings_of,
    window_features,
    windows_of,
)
from learn.recognize.dataset import LabelledSession, Labels, exchanged
from learn.recognize.forest import N_JOBS, Forest, grow
from learn.recognize.grammar import Grammar, Habits

CONFIG, MODEL = "config.json", "model.npz"
VIEWS = ((False, False), (True, False), (False, True), (True, True))
"""Boxes exchanged, and mirrored."""


@dataclass(frozen=True)
class Settings:
    """How a recogniser is trained."""

    n_trees: int = 200
    share: float = 0.3
    context_share: float = 0.1
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
    """

    settings: Settings
    table: Table
    vocabulary: Labels
    habits: Habits
    alone: Forest
    context: Forest

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        with ThreadPoolExecutor(N_JOBS) as threads:
            found = np.mean(list(threads.map(partial(self._seen_once, sessions), (False, True))), axis=0)
        alone, context = found
        grammar = Grammar.of(self.vocabulary, self.habits)
        ends = np.cumsum([n_windows(len(points)) for points in sessions])
        parts = [grammar.smooth(part) for part in np.split(context, ends)[:-1] if len(part)]
        return Recognized(self.vocabulary, alone, np.concatenate(parts) if parts else context)

    def _seen_once(self, sessions: Sequence[Floats], swap: bool) -> Floats:  # noqa: FBT001
        """Probabilities (2, w, k) by the two forests, of the boxes as they are or exchanged."""
        features = features_of(
            [points[:, SWAP_POINTS] if swap else points for points in sessions], self.table
        )
        found = [
            forest.predict(part) for forest, part in zip((self.alone, self.context), features, strict=True)
        ]
        exchange = _places(exchanged(self.vocabulary), self.vocabulary)
        return np.stack([part[:, exchange] if swap else part for part in found])


def features_of(sessions: Sequence[Floats], table: Table) -> tuple[Features, Features]:
    """Features of all windows of sessions: of each alone, and with its session, which begin with the former."""
    around = [surroundings_of(points) for points in sessions]
    counts = [n_windows(len(points)) for points in sessions]
    alone = window_features(np.concatenate([windows_of(points) for points in sessions]), table)
    near = window_features(np.concatenate([part for part, _ in around]), table)
    whole = window_features(np.concatenate([part for _, part in around]), table).repeat(counts, axis=0)
    where = np.concatenate([_where(count) for count in counts])
    return alone, np.concatenate([alone, near, whole, where], axis=1)


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
    stacked = np.concatenate(labels)
    vocabulary = np.unique(np.concatenate([stacked, exchanged(stacked)]), axis=0)
    views: list[tuple[Features, Features]] = []
    classes: list[NDArray[np.int64]] = []
    for done, (swap, mirrored) in enumerate(VIEWS):
        progress("computing features", done, len(VIEWS))
        views.append(
            features_of([_seen(session.points, swap=swap, mirrored=mirrored) for session in sessions], table)
        )
        classes.append(_places(exchanged(stacked) if swap else stacked, vocabulary))
    progress("computing features", len(VIEWS), len(VIEWS))
    forests = [
        grow(
            np.concatenate([view[place] for view in views]),
            np.concatenate(classes),
            len(vocabulary),
            n_trees=settings.n_trees,
            share=share,
            seed=settings.seed,
            progress=progress,
            what=what,
        )
        for place, share, what in (
            (0, settings.share, "growing trees of windows"),
            (1, settings.context_share, "growing trees of sessions"),
        )
    ]
    return Recognizer(settings, table, vocabulary, Habits.of(labels), forests[0], forests[1])


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
    }
    arrays = recognizer.alone.arrays("alone") | recognizer.context.arrays("context")
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
        if config["features"] != VERSION:
            raise InputError(
                f"cannot use the model {run}",
                where=f"it was trained with the features {config['features']}, these are {VERSION}",
                consequence="nothing was recognised",
                fix="train it again",
            )
        settings, table = Settings(**config["settings"]), Table(**config["table"])
        vocabulary = np.array(config["vocabulary"], np.int8).reshape(-1, 5)
        habits = Habits(**{name: float(share) for name, share in config["habits"].items()})
        with (run / MODEL).open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            alone, context = (Forest.of_arrays(arrays, name) for name in ("alone", "context"))
    except (ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise CorruptError(
            f"cannot use the model {run}",
            where=str(error)[:200] or type(error).__name__,
            consequence="nothing was recognised",
            fix="train it again",
        ) from None
    return Recognizer(settings, table, vocabulary, habits, alone, context)


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


def _seen(points: Floats, *, swap: bool, mirrored: bool) -> Floats:
    points = points[:, SWAP_POINTS] if swap else points
    return mirror(points) if mirrored else points


def _where(n_windows: int) -> Features:
    """Where windows are in their session: from its beginning, from its end, in between, and how many there are."""
    number = np.arange(n_windows)
    left = n_windows - 1 - number
    share = number / max(n_windows - 1, 1)
    return np.stack([number, left, share, np.full(n_windows, n_windows)], axis=1).astype(np.float32)


def _places(labels: Labels, vocabulary: Labels) -> NDArray[np.int64]:
    place = {tuple(label): number for number, label in enumerate(vocabulary.tolist())}
    return np.array([place[tuple(label)] for label in labels.tolist()], np.int64)
