"""Cross-validation of any model by the folds that are written down, fold by fold, so that it can be interrupted."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import CorruptError, ExistsError
from ecat.progress import Progress, beginning, silent
from learn.features import raw, windows
from learn.recognize.dataset import LabelledSession
from learn.recognize.evaluation import (
    WAYS,
    Predicted,
    Split,
    baselines,
    in_order,
    predicted,
    scores,
    some_of,
    splits_of,
    summary,
)
from learn.recognize.folds import N_FOLDS, Kind
from learn.recognize.kept import read_arrays, read_json, write_arrays
from learn.recognize.runs import CROSSVAL, Options, train
from learn.recognize.unusable import undamaged

_SESSIONS = "sessions_sha256"
_UNTRAINED, _ELSEWHERE = "nothing was trained", "name another folder (--run)"
Recognize = Callable[[Split, Progress], Predicted]
"""Learn from the known, and say what the tested show."""


def recognized_by(name: str, options: Options) -> Recognize:
    """What a model says that is trained on what is known; nothing is fitted to what is tested."""

    def recognize(split: Split, progress: Progress) -> Predicted:
        recognizer, _ = train(name, split[0], options, progress=progress)
        return predicted(split[1], recognizer.recognize([session.points for session in split[1]]))

    return recognize


def made_of(name: str, options: Options) -> str:
    """What a model's words depend on, besides the sessions: options, and the features if these have versions."""
    versions = {"trees": windows.VERSION, "neural": raw.VERSION, "mixture": windows.VERSION + raw.VERSION}
    parts: list[object] = [options]
    if name in ("trees", "mixture"):
        parts.append(options.of_trees())
    if name not in ("trees", "hmm", "lds"):
        parts.append(options.of_network(name))
    return repr(parts) + versions.get(name, "")


def said_of(name: str, kind: Kind, share: float, options: Options) -> dict[str, Any]:
    """What was asked for, as the figures have it: model, folds, share, and those of the options that were given."""
    given = {key: value for key, value in vars(options).items() if key != "seed" and value is not None}
    return {"model": name, "folds": kind, "share": share, "options": given}


def refuse_another(run: Path, said: dict[str, Any]) -> None:
    """Say before the work that the figures in ``run`` are of another cross-validation than ``said``: they and the
    pictures would be replaced, and folds of which only the options differ.

    Raises
    ------
    ExistsError : they are.
    CorruptError : it cannot be read what they are of.
    """
    if not (run / CROSSVAL).exists():
        return
    with _readable(run):
        there = {"options": {}, **read_json(run / CROSSVAL)}
        words = {key: there[key] for key in ("model", "folds", "share")} | there["options"]
    if any(there[key] != value for key, value in said.items()):
        raise _taken(run, "another: " + " ".join(f"--{key} {value}" for key, value in words.items()))


def refuse_others(run: Path, sessions: Sequence[LabelledSession]) -> None:
    """Say before the work that the figures in ``run`` are of other sessions, or of other labels of them; those that do
    not say of which they are may be replaced.

    Raises
    ------
    ExistsError : they are.
    CorruptError : it cannot be read what they are of.
    """
    if not (run / CROSSVAL).exists():
        return
    known = _known(sessions)
    with _readable(run):
        there = read_json(run / CROSSVAL).get(_SESSIONS, known)
    if there != known:
        raise _taken(run, "other sessions, or of others as well")


def _readable(run: Path) -> AbstractContextManager[None]:
    what = f"cannot cross-validate into {run}: {CROSSVAL} cannot be read"
    return undamaged(what, consequence=_UNTRAINED, fix=_ELSEWHERE)


def _taken(run: Path, of: str) -> ExistsError:
    return ExistsError(
        f"cannot cross-validate into {run}",
        where=f"{run / CROSSVAL} is of {of}",
        consequence=_UNTRAINED,
        fix=_ELSEWHERE,
    )


def kept_or(
    recognize: Recognize, split: Split, keep: Path | None, what: str, progress: Progress = silent
) -> Predicted:
    """What is said of the tested sessions: read from a file if it is there, and otherwise written to it.

    Parameters
    ----------
    keep : the file; one that was made of other sessions, or with another ``what``, counts as none.
    what : everything that what is said depends on, besides the sessions.
    """
    identity = _identity(split, what)
    if keep is not None and keep.exists():
        kept = _read(keep, split, identity)
        if kept is not None:
            return kept
    found = recognize(split, progress)
    if keep is not None:
        arrays: dict[str, Any] = {f"labels.{way}": found.labels[way] for way in WAYS}
        arrays |= {f"probabilities.{way}": found.probabilities[way] for way in WAYS}
        write_arrays(keep, {"identity": _bytes(identity), **arrays}, compressed=True)
    return found


def cross_validate_model(
    sessions: Sequence[LabelledSession],
    name: str,
    kind: Kind,
    options: Sequence[Options],
    *,
    share: float = 1.0,
    keep: Path | None = None,
    progress: Progress = silent,
) -> tuple[dict[str, Any], Predicted]:
    """Scores of every fifth of the sessions by models that saw the other four, and what the first of ``options`` said.

    Parameters
    ----------
    options : of each repetition, which differ in their seeds.
    share : of all sessions, how many are learned from, four fifths at most; drawn anew by each seed.
    keep : a folder for what was said of each fold; those that are there are not computed again.

    Returns
    -------
    scores : what was asked for, and of which sessions; ``mean`` and ``spread`` over the seeds (standard deviation), and
        ``runs`` of each; of trees, ``baselines``.

    Raises
    ------
    InputError : a fold has no sessions.
    """
    splits = splits_of(sessions, kind)
    runs: list[Predicted] = []
    for one in options:
        parts = [
            kept_or(
                recognized_by(name, one),
                (some_of(split[0], share * N_FOLDS / (N_FOLDS - 1), seed=one.seed), split[1]),
                None if keep is None else keep / f"{name}-{kind}-{one.seed}-{fold}.npz",
                made_of(name, one),
                beginning(f"{name}, seed {one.seed}, fold {fold + 1} of {N_FOLDS}", progress),
            )
            for fold, split in enumerate(splits)
        ]
        runs.append(in_order(parts, sessions))
    scored = [scores(run) for run in runs]
    return {
        **said_of(name, kind, share, options[0]),
        _SESSIONS: _known(sessions),
        **({"baselines": baselines(splits, progress)} if name == "trees" else {}),
        **summary([one.seed for one in options], scored),
    }, runs[0]


def _read(source: Path, split: Split, identity: str) -> Predicted | None:
    try:
        with undamaged(f"cannot use {source}"):
            kept = read_arrays(source)
            if not np.array_equal(kept["identity"], _bytes(identity)):
                return None
            labels = {way: kept[f"labels.{way}"].astype(np.int8, casting="safe") for way in WAYS}
            sure = {way: kept[f"probabilities.{way}"].astype(np.float64, casting="safe") for way in WAYS}
    except CorruptError:  # it is computed anew
        return None
    return Predicted(split[1], labels, sure)


def _identity(split: Split, what: str) -> str:
    digest = hashlib.sha256(what.encode())
    for part in split:
        digest.update(b"|")
        for session in part:
            digest.update(session.content)
    return digest.hexdigest()


def _known(sessions: Sequence[LabelledSession]) -> str:
    """Changes when any of the sessions does, not with their order."""
    digest = hashlib.sha256()
    for session in sorted(sessions, key=lambda one: one.key):
        digest.update(session.content)
    return digest.hexdigest()


def _bytes(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode(), np.uint8)
