"""How good a recogniser is: on sessions it has not seen, label by label, beside what knows less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ecat.cli.text import count
from ecat.errors import InputError
from ecat.progress import Progress, silent
from ecat.store import staged_file
from learn.features.windows import Floats
from learn.recognize.baselines import BASELINES
from learn.recognize.dataset import SLOTS, LabelledSession, Labels, words
from learn.recognize.folds import N_FOLDS, Kind, folds_of
from learn.recognize.kept import HEADS
from learn.recognize.model import Recognized, fingerprint
from learn.recognize.pictures import picture

PREDICTIONS = "predictions.parquet"
WAYS = ("windows", "context")
"""A window alone, and with its session."""
WAY_NAMES: dict[str, str] = dict(zip(WAYS, ("windows alone", "with the session"), strict=True))
"""As pictures call them."""
CONFUSIONS = {way: f"confusion_{way}.png" for way in WAYS}
"""Pictures of what was taken for what."""
SUSPICIOUS = frozenset(("pullpast", f"pullpast{number}") for number in range(21, 31))
"""Sessions in which the box that is said to be pulled rests, and the one that it is said to pass moves."""
Split = tuple[Sequence[LabelledSession], Sequence[LabelledSession]]
"""Sessions that are known, and sessions that are tested."""


@dataclass(frozen=True)
class Predicted:
    """Of windows of sessions, one after the other: what is true (w, 5), what was said, and how sure that is (w,)."""

    sessions: Sequence[LabelledSession]
    labels: dict[str, Labels]
    probabilities: dict[str, Floats]

    @property
    def true(self) -> Labels:
        """The labels of the sessions."""
        return np.concatenate([session.labels for session in self.sessions])


def predicted(sessions: Sequence[LabelledSession], recognized: Recognized) -> Predicted:
    """What was recognised in sessions, beside what is true."""
    found = dict(zip(WAYS, (recognized.alone, recognized.context), strict=True))
    return Predicted(
        sessions,
        {way: recognized.labels(values) for way, values in found.items()},
        {way: values.max(axis=1) for way, values in found.items()},
    )


def score(true: Labels, said: Labels) -> dict[str, Any]:
    """Shares of windows whose whole label (``tuple``) is right, and each slot of it."""
    right = true == said
    slots = dict(zip(SLOTS, right.mean(axis=0).tolist(), strict=True))
    return {"tuple": float(right.all(axis=1).mean()), "slots": slots}


def scores(found: Predicted) -> dict[str, Any]:
    """Scores of windows alone and with context, as labelled and without the suspicious sessions, with counts."""
    trusted = np.concatenate(
        [np.full(len(session.labels), session.key not in SUSPICIOUS) for session in found.sessions]
    )
    result: dict[str, Any] = {"sessions_count": len(found.sessions), "windows_count": len(found.true)}
    for way in WAYS:
        result[way] = score(found.true, found.labels[way])
    if trusted.any() and not trusted.all():
        result["without_suspicious"] = {
            way: score(found.true[trusted], found.labels[way][trusted]) for way in WAYS
        }
    return result


def write_predictions(found: Predicted, dest: Path) -> None:
    """One row per window: ``file, session, window``, of each slot ``true_*``, ``windows_*`` and ``context_*`` (null
    where it is empty), and the probabilities of the two labels that were said.
    """
    counts = [len(session.labels) for session in found.sessions]
    columns: dict[str, Any] = {
        "file": np.repeat([session.file for session in found.sessions], counts),
        "session": np.repeat([session.name for session in found.sessions], counts),
        "window": np.concatenate([np.arange(n, dtype=np.int32) for n in counts]),
    }
    for way, labels in (("true", found.true), *found.labels.items()):
        said = [words(label) for label in labels.tolist()]
        columns |= {
            f"{way}_{slot}": pa.array([label[place] for label in said], pa.string())
            for place, slot in enumerate(SLOTS)
        }
    columns |= {f"{way}_probability": found.probabilities[way] for way in WAYS}
    with staged_file(dest, replaces=HEADS[".parquet"]) as staging:
        pq.write_table(pa.table(columns), staging)


def splits_of(sessions: Sequence[LabelledSession], kind: Kind) -> list[Split]:
    """The five folds: each has four fifths of the sessions to learn from, and the last to be tested.

    Raises
    ------
    InputError : a fold has no sessions.
    """
    folds = folds_of([session.key for session in sessions], kind)
    if len(np.unique(folds)) < N_FOLDS:
        there = f"{count(len(sessions), 'session')} in {len(np.unique(folds))} of {N_FOLDS} folds"
        raise InputError("cannot cross-validate", where=there, fix="give more sessions")
    pairs = list(zip(sessions, folds.tolist(), strict=True))
    return [
        ([one for one, of in pairs if of != fold], [one for one, of in pairs if of == fold])
        for fold in range(N_FOLDS)
    ]


def baselines(splits: Sequence[Split], progress: Progress = silent) -> dict[str, Any]:
    """Scores of what knows less, over all folds."""
    found: dict[str, Any] = {}
    true = np.concatenate([session.labels for _, tested in splits for session in tested])
    for done, (name, baseline) in enumerate(BASELINES.items()):
        progress("baselines", done, len(BASELINES))
        said = np.concatenate([baseline(known, tested) for known, tested in splits])
        found[name] = score(true, said)
    progress("baselines", len(BASELINES), len(BASELINES))
    return found


def summary(seeds: Sequence[int], scored: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Mean and spread (standard deviation) of shares of whole labels over seeds, and all that was scored."""
    tuples = {way: np.array([run[way]["tuple"] for run in scored]) for way in WAYS}
    spread = 1 if len(scored) > 1 else 0
    return {
        "mean": {way: float(values.mean()) for way, values in tuples.items()},
        "spread": {way: float(values.std(ddof=spread)) for way, values in tuples.items()},
        "runs": {str(seed): run for seed, run in zip(seeds, scored, strict=True)},
    }


def in_order(parts: Sequence[Predicted], sessions: Sequence[LabelledSession]) -> Predicted:
    """What was said of parts of the sessions, as one, in their order."""
    where: dict[tuple[str, str], tuple[int, int, int]] = {}
    for number, part in enumerate(parts):
        start = 0
        for session in part.sessions:
            where[session.key] = number, start, start + len(session.labels)
            start += len(session.labels)
    places = [where[session.key] for session in sessions]
    return Predicted(
        sessions,
        {way: np.concatenate([parts[n].labels[way][a:b] for n, a, b in places]) for way in WAYS},
        {way: np.concatenate([parts[n].probabilities[way][a:b] for n, a, b in places]) for way in WAYS},
    )


def some_of(sessions: Sequence[LabelledSession], share: float, *, seed: int) -> list[LabelledSession]:
    """A share of the sessions of each file, one at least, drawn at random, in their order; all if it is 1 or more."""
    if share >= 1:
        return list(sessions)
    generator = np.random.default_rng(seed)
    files = np.array([session.file for session in sessions])
    drawn: list[int] = []
    for file in np.unique(files):
        mine = generator.permutation(np.flatnonzero(files == file))
        drawn += mine[: max(1, round(share * len(mine)))].tolist()
    return [sessions[place] for place in sorted(drawn)]


def trained_on(recognizer: Any, sessions: Sequence[LabelledSession]) -> list[LabelledSession]:
    """Those of the sessions that a recogniser was trained on, whatever their names: figures of them say nothing."""
    known: frozenset[str] = getattr(recognizer, "trained_on", frozenset())
    return [session for session in sessions if fingerprint(session.points) in known]


def draw_all_confusions(found: Predicted, run: Path) -> None:
    """Both pictures of what was taken for what, into the folder ``run``.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    for way, name in CONFUSIONS.items():
        draw_confusions(found, way, run / name)


def draw_confusions(found: Predicted, way: str, dest: Path) -> None:
    """A picture of what was said for what, a matrix for each slot; rows are true and add up to 100 %.

    What never occurs in a slot, neither true nor said, is left out.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    with picture(dest, (17, 4.2), "cannot draw confusions") as figure:
        result = score(found.true, found.labels[way])
        figure.suptitle(f"{WAY_NAMES[way]}: {extent(found)}, {100 * result['tuple']:.1f} % right")
        panels = figure.subplots(1, len(SLOTS))
        for place, (axes, slot) in enumerate(zip(panels, SLOTS, strict=True)):
            _draw_confusion(axes, slot, found.true[:, place], found.labels[way][:, place])
            axes.set_title(f"{slot}: {100 * result['slots'][slot]:.1f} %")
        figure.colorbar(panels[-1].images[0], ax=panels, label="of those that are true, %", pad=0.01)


def _draw_confusion(axes: Any, slot: str, true: NDArray[np.int8], said: NDArray[np.int8]) -> None:
    occurring = np.union1d(true, said)
    counts = confusion(true, said, len(SLOTS[slot]))[np.ix_(occurring, occurring)]
    shares = 100 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    names = [SLOTS[slot][place] or "none" for place in occurring.tolist()]
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="said", ylabel="true")
    for (row, column), number in np.ndenumerate(counts):
        shade = "white" if shares[row, column] > 50 else "black"
        axes.text(column, row, str(number), ha="center", va="center", color=shade, fontsize=8)


def extent(found: Predicted) -> str:
    """How many windows there are, and of how many sessions."""
    return f"{count(len(found.true), 'window')} of {count(len(found.sessions), 'session')}"


def confusion(true: NDArray[np.int8], said: NDArray[np.int8], n: int) -> NDArray[np.int64]:
    """Counts (n, n) of what was said (columns) for what is true (rows)."""
    return np.bincount(true.astype(np.int64) * n + said, minlength=n * n).reshape(n, n)
