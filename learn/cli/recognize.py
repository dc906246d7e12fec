"""``ecat learn recognize``: train a recogniser of actions, and say how good it is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import Group, verb

if TYPE_CHECKING:
    from learn.recognize.evaluation import Predicted

SOURCE = click.argument(
    "source",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="A folder with learning exports of ECAT (*.txt), wherever in it they lie.",
)
RUN = click.option(
    "--run",
    type=click.Path(path_type=Path),
    required=True,
    metavar="RUN",
    help="The folder of the run: model, settings, figures.",
)
TREES = click.option(
    "--trees",
    type=click.IntRange(1, 5000),
    default=200,
    show_default=True,
    metavar="N",
    help="Trees in each of the two forests.",
)


@verb(
    "train",
    examples=(
        "ecat learn recognize train exports --run runs/first",
        "ecat learn recognize train exports --run runs/quick --trees 50 --seed 3",
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
    help="The same seed grows the same trees.",
)
@TREES
def train(out: Output, *, source: Path, run: Path, seed: int, trees: int) -> None:
    """Train a recogniser on all sessions of a folder.

    RUN gets config.json (features, settings, labels), metrics.json (what it was trained on) and model.npz (the trees,
    as arrays: reading it executes nothing).  A folder in which there is a model is refused.
    """
    import time

    from learn.recognize.dataset import read_exports
    from learn.recognize.model import Settings, refuse_taken, save
    from learn.recognize.model import train as trained

    refuse_taken(run)
    started = time.monotonic()
    with out.progress() as progress:
        sessions = read_exports(source, progress)
        recognizer = trained(sessions, Settings(n_trees=trees, seed=seed), progress)
        save(recognizer, run)
    metrics: dict[str, Any] = {
        "sessions": len(sessions),
        "windows": sum(len(session.labels) for session in sessions),
        "labels": len(recognizer.vocabulary),
        "training_s": round(time.monotonic() - started, 1),
    }
    _write_json(metrics, run / "metrics.json")
    text = (
        f"trained on {count(metrics['windows'], 'window')} of {count(len(sessions), 'session')}; wrote {run}"
    )
    out.result({"run": str(run), **metrics}, text)


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
    """Say how often a trained recogniser is right about the sessions of a folder.

    Shares of windows are printed whose whole label is right (tuple), and each slot of it: of windows alone, which see
    20 frames, and with context, which see their session.  RUN/predictions.parquet gets a row for each window with its
    true and its predicted slots and how probable these are; RUN/evaluation.json the figures.  They say something only
    about sessions that the recogniser was not trained on.
    """
    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import PREDICTIONS, predicted, scores, write_predictions
    from learn.recognize.model import load

    recognizer = load(run)
    with out.progress() as progress:
        sessions = read_exports(source, progress)
        found = predicted(sessions, recognizer.recognize([session.points for session in sessions]))
    write_predictions(found, run / PREDICTIONS)
    result = scores(found)
    _write_json(result, run / "evaluation.json")
    out.result({"run": str(run), **result}, _table(result))


@verb(
    "crossval",
    examples=(
        "ecat learn recognize crossval exports --run runs/folds",
        "ecat learn recognize crossval exports --run runs/blocks --folds blocks --seeds 3",
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
@TREES
def crossval(out: Output, *, source: Path, run: Path, kind: Any, seeds: int, trees: int) -> None:
    """Say how good the recogniser is on sessions it has not seen, by five folds that are always the same.

    Each fifth of the sessions is recognised by what was trained on the other four; nothing is fitted to a session that
    is tested.  RUN gets crossval.json (with baselines, and without the sessions whose labels look inverted),
    predictions.parquet and a picture of the confusions.
    """
    from learn.recognize.dataset import read_exports
    from learn.recognize.evaluation import PREDICTIONS, cross_validate, write_predictions
    from learn.recognize.model import Settings

    with out.progress() as progress:
        sessions = read_exports(source, progress)
        result, found = cross_validate(
            sessions, kind, seeds=range(seeds), settings=Settings(n_trees=trees), progress=progress
        )
    write_predictions(found, run / PREDICTIONS)
    _draw(found, run)
    _write_json(result, run / "crossval.json")
    lines = [_table(result["runs"]["0"])]
    lines += [f"{name:<24}{100 * one['tuple']:6.1f}  (baseline)" for name, one in result["baselines"].items()]
    lines += [
        f"{way}: {100 * result['mean'][way]:.1f} +- {100 * result['spread'][way]:.1f} over {count(seeds, 'seed')}"
        for way in result["mean"]
    ]
    out.result({"run": str(run), **result}, "\n".join(lines))


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
    """Deal the sessions of a folder out to five folds, at random and in blocks.

    The CSV has the columns file, session, random, blocks.  The folds that crossval uses were made like this once and
    come with ecat; sessions that are not among them are dealt out by a hash of their file and name.
    """
    from learn.recognize.dataset import read_exports
    from learn.recognize.folds import make_folds, write_folds

    with out.progress() as progress:
        sessions = read_exports(source, progress)
    write_folds(make_folds([session.key for session in sessions]), dest)
    text = f"wrote the folds of {count(len(sessions), 'session')} to {dest}"
    out.result({"path": str(dest), "sessions": len(sessions)}, text)


recognize = Group(
    "recognize",
    [train, evaluate, crossval, folds],
    """Recognise who does what to which box, window by window.""",
    examples=("ecat learn recognize train exports --run runs/first",),
)


def _draw(found: Predicted, run: Path) -> None:
    from learn.recognize.evaluation import WAYS, draw_confusions

    for way in WAYS:
        draw_confusions(found, way, run / f"confusion_{way}.png")


def _write_json(data: dict[str, Any], dest: Path) -> None:
    from ecat.store import staged_file

    with staged_file(dest, replaces=b"{") as staging:
        staging.write_text(json.dumps(data, indent=1) + "\n", "utf-8")


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
