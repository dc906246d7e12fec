"""Which model is in a run's folder, how it is trained, and how it is read again."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

from ecat.cli.text import count
from ecat.errors import ExistsError, InputError, NotFoundError
from ecat.progress import Progress, silent
from learn.features.windows import Floats, Table
from learn.recognize import model as boosted
from learn.recognize.dataset import LabelledSession
from learn.recognize.evaluation import CONFUSIONS, Predicted, draw_all_confusions, predicted
from learn.recognize.kept import CONFIG, read_config, require_free, write_json
from learn.recognize.mixture import PARTS, Mixture, joined
from learn.recognize.model import Recognized

Model = Literal[
    "trees",
    "mlp",
    "quant-lstm",
    "quant-lstm-crf",
    "qual-lstm-crf",
    "sparse-lstm-crf",
    "hmm",
    "lds",
    "neural",
    "mixture",
]
MODELS: tuple[str, ...] = get_args(Model)
BEST: Model = "mixture"
MOST_VALIDATION = 0.5
"""Of the sessions, that may say when to stop."""
METRICS, CURVES, CHECKPOINT = "metrics.json", "curves.png", "checkpoint.npz"
CROSSVAL, FOLDS = "crossval.json", "folds"
"""Of a cross-validation: its figures, and what was said of each fold."""
_FILES = {"trees": "model.npz", "hmm": "sequences.npz", "lds": "sequences.npz"}
"""Of what is no network."""


class Recognizer(Protocol):
    """Whatever says what windows show."""

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        ...

    def on_table(self, table: Table) -> Recognizer:
        """The same recogniser for sessions whose table is known; one that knows of no table stays as it is."""
        ...


@dataclass(frozen=True)
class Options:
    """What may be said about training; what is not, is as usual for the model.

    Attributes
    ----------
    trees : of boosted trees, of each class in each of their models.
    epochs, hidden, layers, rate, validation : of a network.
    """

    seed: int = 0
    trees: int | None = None
    epochs: int | None = None
    hidden: int | None = None
    layers: int | None = None
    rate: float | None = None
    validation: float | None = None

    def of_trees(self) -> boosted.Settings:
        """Settings of boosted trees."""
        usual = boosted.Settings(seed=self.seed)
        return usual if self.trees is None else replace(usual, n_trees=self.trees)

    def of_network(self, name: str) -> Any:
        """Settings of a network."""
        from learn.recognize.neural.recognizer import RECIPES

        said = {
            "epochs": self.epochs,
            "hidden": self.hidden,
            "layers": self.layers,
            "rate": self.rate,
            "validation": self.validation,
        }
        recipe = RECIPES["neural" if name == "mixture" else name]
        return replace(recipe, seed=self.seed, **{k: v for k, v in said.items() if v is not None})


def refuse_other_work(run: Path, *, training: bool) -> None:
    """Say before the work that ``run`` is of a training, or otherwise of a cross-validation, and not of this.

    Both write predictions and pictures of the same names, and each would replace what is the other's.

    Raises
    ------
    ExistsError : it is of the other.
    """
    if training:
        others, of, what = (CROSSVAL, FOLDS), "a cross-validation", f"cannot train into {run}"
    else:
        parts = [f"{part}/{CONFIG}" for part in PARTS]
        others = (CONFIG, METRICS, CHECKPOINT, *parts)
        of, what = "a recogniser", f"cannot cross-validate into {run}"
    if there := next((name for name in others if (run / name).exists()), None):
        raise ExistsError(
            what,
            where=f"{run / there} is of {of}",
            consequence="nothing was trained",
            fix="name another folder (--run)",
        )


def refuse_taken(run: Path, name: str) -> None:
    """Say before the work, and not after it, that a model of this name cannot be kept in ``run``.

    A model is there as soon as its config.json is, which is written last; what else there is may be what was left when
    training was interrupted, and is replaced.

    Raises
    ------
    ExistsError : there is a model in it already, or a cross-validation.
    StoreError : files cannot be written there.
    """
    refuse_other_work(run, training=True)
    parts = [run / part for part in PARTS] if name == "mixture" else []
    for taken in (run / CONFIG, *(part / METRICS for part in parts)):
        if taken.exists():
            raise ExistsError(
                f"cannot train into {run}",
                where=f"there is a model in {taken.parent}",
                consequence="nothing was trained",
                fix="name another folder",
            )
    files = [f"{part.name}/{file}" for part in parts for file in (CONFIG, _file(part.name))]
    require_free(run, [CONFIG, METRICS, CURVES, *CONFUSIONS.values(), *(files or [_file(name)])])


def unstopped(name: str, options: Options, sessions: Sequence[LabelledSession]) -> str:
    """That no session says when to stop training a network although a share of each file was to, as there are too few;
    empty if that is not so.
    """
    if name in _FILES:
        return ""
    from learn.recognize.neural.examples import held_out

    settings = options.of_network(name)
    if not settings.validation or held_out(sessions, settings)[1]:
        return ""
    most = max(Counter(session.file for session in sessions).values())
    share = math.ceil(100 * (0.5 / most + 0.001)) / 100
    fix = f"--validation {share:g} sets some aside" if share <= MOST_VALIDATION else "give more sessions"
    return (
        f"nothing says when to stop: of {count(len(sessions), 'session')}, {most:,} a file or fewer, a share of "
        f"{settings.validation:g} is none, so all {settings.epochs:,} epochs are trained; {fix}"
    )


def train(
    name: str,
    sessions: Sequence[LabelledSession],
    options: Options,
    *,
    run: Path | None = None,
    progress: Progress = silent,
) -> tuple[Recognizer, dict[str, Any]]:
    """A recogniser that has seen these sessions and nothing else, and what is to be known of how that went.

    Parameters
    ----------
    name : one of :data:`MODELS`.
    run : a folder in which the training of a network is kept after every epoch, and from which it goes on.
    """
    if name == "trees":
        return boosted.train(sessions, options.of_trees(), progress), {}
    if name in ("hmm", "lds"):
        from learn.recognize import sequence

        return sequence.train(sessions, name, progress), {}
    from learn.recognize.neural import recognizer

    kept = None if run is None else run / CHECKPOINT
    settings = options.of_network(name)
    if name == "mixture":
        from learn.recognize import mixture

        trained, found = mixture.train(
            sessions, options.of_trees(), settings, checkpoint=kept, progress=progress
        )
    else:
        found = recognizer.train(sessions, settings, checkpoint=kept, progress=progress)
        trained = found.recognizer
    said = {"history": vars(found.history), "validation": [list(key) for key in found.validation]}
    return trained, said


def save(recognizer: Recognizer, run: Path) -> None:
    """Write a recogniser into the folder ``run``, and its config.json last.

    Raises
    ------
    InputError : a number of it is not known (NaN).
    StoreError : it cannot be written.
    """
    if isinstance(recognizer, boosted.Recognizer):
        boosted.save(recognizer, run)
        return
    if isinstance(recognizer, Mixture):
        for part in PARTS:
            save(getattr(recognizer, part), run / part)
        config: Any = {"model": "mixture", "parts": list(PARTS)}
    else:
        config = _module_of(recognizer).save(recognizer, run)
    write_json(config, run / CONFIG)


def validated(
    recognizer: Recognizer, sessions: Sequence[LabelledSession], course: dict[str, Any]
) -> Predicted | None:
    """What a recogniser says of the sessions that were set aside for validation; none if there were not any."""
    held = {tuple(key) for key in course.get("validation", ())}
    tested = [session for session in sessions if session.key in held]
    if not tested:
        return None
    return predicted(tested, recognizer.recognize([session.points for session in tested]))


def forget_training(run: Path) -> None:
    """Remove the checkpoint of a training that has been finished."""
    (run / CHECKPOINT).unlink(missing_ok=True)


def draw_training(course: dict[str, Any], found: Predicted | None, run: Path) -> None:
    """Pictures of how a training went, and of what was taken for what in validation.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    if "history" in course:
        from learn.recognize.neural.pictures import draw_curves
        from learn.recognize.neural.training import History

        draw_curves(History(**course["history"]), run / CURVES)
    if found is not None:
        draw_all_confusions(found, run)


def load(run: Path) -> Recognizer:
    """The recogniser in the folder ``run``; nothing in it is executed.

    Raises
    ------
    NotFoundError : there is none.
    InputError : it was trained with other features.
    CorruptError : it is damaged.
    """
    if (run / CROSSVAL).exists() and not (run / CONFIG).exists():
        raise NotFoundError(
            f"cannot use the model {run}",
            where=f"it is of a cross-validation ({CROSSVAL}), which keeps no model",
            fix="ecat learn recognize train EXPORTS --run ANOTHER",
        )
    config = read_config(run)
    name = config.get("model", "trees")
    if name not in MODELS:
        raise InputError(
            f"cannot use the model {run}",
            where=f"it is a {str(name)[:100]}, known are {', '.join(MODELS)}",
            consequence="nothing was recognised",
            fix="train it again",
        )
    if name == "trees":
        return boosted.load(run)
    if name == "mixture":
        return joined([load(run / part) for part in PARTS], run)
    if name in ("hmm", "lds"):
        from learn.recognize import sequence

        return sequence.load(run, config)
    from learn.recognize.neural import recognizer

    return recognizer.load(run, config)


def _module_of(recognizer: Recognizer) -> Any:
    from learn.recognize import sequence

    if isinstance(recognizer, sequence.SequenceRecognizer):
        return sequence
    from learn.recognize.neural import recognizer as neural

    return neural


def _file(name: str) -> str:
    return _FILES.get(name, "network.npz")
