"""``ecat learn recognize``: train a recogniser of actions, and say how good it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import Group, verb


class Share(click.FloatRange):
    """A number in a range, and not NaN, which click takes for one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number, or a wrong call."""
        found = super().convert(value, param, ctx)
        return self.fail(f"{value} is no number.", param, ctx) if math.isnan(found) else found


SOURCE = click.argument(
    "source",
    metavar="EXPORTS",
    type=click.Path(path_type=Path),
    help="A learning export of ECAT, or a folder with some (*.txt), wherever in it they lie.",
)
RUN = click.option(
    "--run",
    type=click.Path(path_type=Path),
    required=True,
    metavar="RUN",
    help="The folder of the run: model, settings, figures.",
)
MODEL = click.option(
    "--model",
    type=click.Choice(
        (
            *("trees", "mlp", "quant-lstm", "quant-lstm-crf", "qual-lstm-crf", "sparse-lstm-crf"),
            *("hmm", "lds", "neural", "mixture"),
        )
    ),
    default="mixture",
    show_default=True,
    help="mixture: trees and neural together, the best, in minutes.  trees: boosted trees, in seconds.  neural: a "
    "network that sees raw points.  hmm, lds: generative.  The others: networks of the thesis.",
)
TREES = click.option(
    "--trees",
    type=click.IntRange(1, 5000),
    metavar="N",
    help="Of trees: how many of each class in each model.",
)
EPOCHS = click.option(
    "--epochs",
    type=click.IntRange(1, 10_000),
    metavar="N",
    help="Of a network: how often it sees every window.",
)
HIDDEN = click.option(
    "--hidden", type=click.IntRange(1, 4096), metavar="N", help="Of a network: units of a layer."
)
LAYERS = click.option("--layers", type=click.IntRange(1, 8), metavar="N", help="Of an LSTM: layers.")
RATE = click.option(
    "--rate",
    type=Share(0, 100, min_open=True),
    metavar="R",
    help="Of a network: the rate at which it learns.",
)
VALIDATION = click.option(
    "--validation",
    type=Share(0, 0.5),  # MOST_VALIDATION, of what is too slow to import for a help text
    metavar="SHARE",
    help="Of a network: share of the sessions that say when to stop; 0 trains for all epochs.",
)


@verb(
    "train",
    examples=(
        "ecat learn recognize train exports --run runs/first",
        "ecat learn recognize train exports --run runs/quick --model trees --trees 50 --seed 3",
        "ecat learn recognize train exports --run runs/neural --model neural",
    ),
)
@SOURCE
@RUN
@click.option(
    "--seed",
    type=click.IntRange(0, 2**31 - 1),
    default=0,
    show_default=True,
    metavar="N",
    help="The same seed makes the same model.",
)
@MODEL
@TREES
@EPOCHS
@HIDDEN
@LAYERS
@RATE
@VALIDATION
def train(out: Output, *, source: Path, run: Path, model: str, **said: Any) -> None:
    """Train a recogniser on all sessions of a folder.

    RUN gets config.json (features, settings, labels), metrics.json (what it was trained on, and how that went), and
    the model as arrays: reading it executes nothing.  A folder in which there is a model or a cross-validation is
    refused.  The training of a network is kept after every epoch, and the same command goes on where it was
    interrupted; its learning curves and, where sessions were set aside for validation, the confusions in them become
    pictures.
    """
    import time

    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import scores
    from learn.recognize.kept import write_json
    from learn.recognize.runs import (
        METRICS,
        draw_training,
        forget_training,
        refuse_taken,
        save,
        unstopped,
        validated,
    )
    from learn.recognize.runs import train as trained

    options = _options(model, **said)
    refuse_taken(run, model)
    started = time.monotonic()
    findings: list[str] = []
    with out.progress() as progress:
        sessions = read_exports(source, progress, findings)
        findings += filter(None, [unstopped(model, options, sessions)])
        recognizer, course = trained(model, sessions, options, run=run, progress=progress)
        save(recognizer, run)
    forget_training(run)
    metrics: dict[str, Any] = {
        "model": model,
        "sessions": len(sessions),
        "windows": sum(len(session.labels) for session in sessions),
        "labels": len({tuple(label) for session in sessions for label in session.labels.tolist()}),
        "training_s": round(time.monotonic() - started, 1),
        **course,
    }
    if (found := validated(recognizer, sessions, course)) is not None:
        metrics["validation_scores"] = scores(found)
    write_json(metrics, run / METRICS)
    findings += _drawn(lambda: draw_training(course, found, run))
    text = (
        f"trained on {count(metrics['windows'], 'window')} of {count(len(sessions), 'session')}; wrote {run}"
    )
    out.result({"run": str(run), **metrics, "findings": findings}, "\n".join([text, *findings]))


@verb(
    "evaluate",
    examples=(
        "ecat learn recognize evaluate others --run runs/first",
        "ecat learn recognize evaluate others --run runs/first --json",
    ),
)
@SOURCE
@RUN
def evaluate(out: Output, *, source: Path, run: Path) -> None:
    """Say how often a trained recogniser is right.

    Of all sessions of a folder, shares of windows are printed whose whole label is right (tuple), and each slot of
    it: of windows alone, which see 20 frames, and with context, which see their session.  RUN/predictions.parquet
    gets a row for each window with its true and its predicted slots and how probable these are; RUN/evaluation.json
    the figures, and pictures show what was taken for what.  They say something only about sessions that the
    recogniser was not trained on.
    """
    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import (
        CONFUSIONS,
        PREDICTIONS,
        draw_all_confusions,
        predicted,
        scores,
        trained_on,
        write_predictions,
    )
    from learn.recognize.kept import require_free, write_json
    from learn.recognize.runs import load

    recognizer = load(run)
    require_free(run, (PREDICTIONS, "evaluation.json", *CONFUSIONS.values()))
    findings: list[str] = []
    with out.progress() as progress:
        sessions = read_exports(source, progress, findings)
        found = predicted(sessions, recognizer.recognize([session.points for session in sessions]))
    known = len(trained_on(recognizer, sessions))
    result = {**scores(found), "trained_on_count": known}
    write_json(result, run / "evaluation.json")
    write_predictions(found, run / PREDICTIONS)
    findings += _drawn(lambda: draw_all_confusions(found, run))
    notes = (
        [f"{count(known, 'session')} of these were trained on: figures of them say nothing"] if known else []
    )
    lines = [_table(result), *notes, *findings]
    out.result({"run": str(run), **result, "findings": findings}, "\n".join(lines))


@verb(
    "crossval",
    examples=(
        "ecat learn recognize crossval exports --run runs/folds",
        "ecat learn recognize crossval exports --run runs/blocks --folds blocks --seeds 3",
        "ecat learn recognize crossval exports --run runs/lstm --model qual-lstm-crf --hidden 64",
    ),
)
@SOURCE
@RUN
@click.option(
    "--folds",
    "kind",
    type=click.Choice(("random", "blocks")),
    default="random",
    show_default=True,
    help="Fifths of each file: dealt out at random, or contiguous by the number in a session's name.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 20),
    default=1,
    show_default=True,
    metavar="N",
    help="Repeat with the seeds 0 to N - 1.",
)
@click.option(
    "--share",
    type=Share(0, 1, min_open=True),
    default=1.0,
    metavar="SHARE",
    help="Learn from so many of all sessions, four fifths at most.",
)
@MODEL
@TREES
@EPOCHS
@HIDDEN
@LAYERS
@RATE
@VALIDATION
def crossval(
    out: Output, *, source: Path, run: Path, kind: Any, seeds: int, share: float, model: str, **said: Any
) -> None:
    """Say how good a recogniser is on sessions it has not seen.

    There are five folds, always the same.  Each fifth of the sessions is recognised by what was trained on the other
    four; nothing is fitted to a session that is tested.  RUN gets crossval.json (with baselines for trees; also
    without the sessions whose labels look inverted), predictions.parquet, pictures of the confusions, and limits.json
    and limits.png: how errors lie about changes of the label, and in which slots.  Folds are kept in RUN/folds: the
    same command goes on where it was interrupted, also with more seeds.  Another model, other folds, other options or
    other sessions need another RUN.
    """
    from dataclasses import replace

    from learn.recognize.crossval import cross_validate_model, refuse_another, refuse_others, said_of
    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import (
        CONFUSIONS,
        PREDICTIONS,
        draw_all_confusions,
        splits_of,
        write_predictions,
    )
    from learn.recognize.kept import require_free, write_json
    from learn.recognize.limits import draw_limits, limits
    from learn.recognize.runs import CROSSVAL, FOLDS, refuse_other_work, unstopped

    options = _options(model, **said)
    pictures = ("limits.png", *CONFUSIONS.values())
    refuse_other_work(run, training=False)
    require_free(run, (PREDICTIONS, CROSSVAL, "limits.json", *pictures))
    refuse_another(run, said_of(model, kind, share, options))
    findings: list[str] = []
    with out.progress() as progress:
        sessions = read_exports(source, progress, findings)
        refuse_others(run, sessions)
        findings += filter(None, [unstopped(model, options, splits_of(sessions, kind)[0][0])])
        repeated = [replace(options, seed=seed) for seed in range(seeds)]
        result, found = cross_validate_model(
            sessions, model, kind, repeated, share=share, keep=run / FOLDS, progress=progress
        )
    write_json(result, run / CROSSVAL)
    write_json(limits(found), run / "limits.json")
    write_predictions(found, run / PREDICTIONS)
    findings += _drawn(
        lambda: draw_all_confusions(found, run), lambda: draw_limits(found, run / "limits.png")
    )
    lines = [_table(result["runs"]["0"])]
    lines += [
        f"{name:<24}{100 * one['tuple']:6.1f}  (baseline)"
        for name, one in result.get("baselines", {}).items()
    ]
    lines += [
        f"{way}: {100 * result['mean'][way]:.1f} +- {100 * result['spread'][way]:.1f} over {count(seeds, 'seed')}"
        for way in (result["mean"] if seeds > 1 else ())
    ]
    out.result({"run": str(run), **result, "findings": findings}, "\n".join([*lines, *findings]))


@verb("folds", examples=("ecat learn recognize folds exports -o folds.csv",))
@SOURCE
@click.option(
    "--output",
    "-o",
    "dest",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE",
    help="The CSV file to write.",
)
def folds(out: Output, *, source: Path, dest: Path) -> None:
    """Deal sessions out to five folds.

    They are dealt out twice, at random and in blocks.  The CSV has the columns file, session, random, blocks.  The
    folds that crossval uses were made like this once and come with ecat; sessions that are not among them are dealt
    out by a hash of their file and name.
    """
    from learn.recognize.dataset import read_exports
    from learn.recognize.folds import make_folds, write_folds

    findings: list[str] = []
    with out.progress() as progress:
        sessions = read_exports(source, progress, findings)
    write_folds(make_folds([session.key for session in sessions]), dest)
    text = f"wrote the folds of {count(len(sessions), 'session')} to {dest}"
    result = {"path": str(dest), "sessions": len(sessions), "findings": findings}
    out.result(result, "\n".join([text, *findings]))


recognize = Group(
    "recognize",
    [train, evaluate, crossval, folds],
    """Recognise who does what to which box, window by window.""",
    examples=(
        "ecat learn recognize train exports --run runs/first --model trees",
        "ecat learn recognize evaluate others --run runs/first",
        "ecat learn recognize predict my_session --run runs/first",
    ),
)


def _options(model: str, **said: Any) -> Any:
    """Refuse what the model has no use for."""
    from ecat.errors import UsageError
    from learn.recognize.runs import Options

    network = model not in ("trees", "hmm", "lds")
    known = {"seed": True, "trees": model in ("trees", "mixture"), "layers": "lstm" in model}
    for name, value in said.items():
        if value is not None and not known.get(name, network):
            raise UsageError(
                "cannot train", where=f"the model {model} has no --{name}", fix="leave the option out"
            )
    return Options(**{name: value for name, value in said.items() if value is not None})


def _drawn(*pictures: Callable[[], None]) -> list[str]:
    """Draw, after all else has been written; that a library for it is missing is told, and nothing fails for it."""
    from ecat.errors import MissingExtraError

    try:
        for picture in pictures:
            picture()
    except MissingExtraError as error:
        return [f"{error.what}: {error.where}; {error.fix}"]
    return []


def _table(result: dict[str, Any]) -> str:
    """Percentages, a line for each way of looking at windows."""
    rows = [(way, result[way]) for way in ("windows", "context")]
    rows += [(f"{way}, trusted", one) for way, one in result.get("without_suspicious", {}).items()]
    slots = list(rows[0][1]["slots"])
    lines = [
        f"{'% of ' + str(result['windows_count']):<24}" + "".join(f"{name:>12}" for name in ("tuple", *slots))
    ]
    for name, one in rows:
        values = (one["tuple"], *one["slots"].values())
        lines.append(f"{name:<24}" + "".join(f"{100 * value:12.1f}" for value in values))
    return "\n".join(lines)
