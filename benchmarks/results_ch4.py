"""Recognition of actions: the thesis (chapter 4), the same models trained again, and ours, side by side.

    python benchmarks/results_ch4.py DIR --run RUN [--seeds 3] [--models ...] [--jobs 2]

DIR holds learning exports.  Every model is trained on the folds that come with ecat, fold by fold, as many at once as
there are processors; what is finished is kept in RUN and not computed again, so that it can be interrupted.  A report
is printed as Markdown: what is to be reached and what was, then every model.  RUN gets report.md, report.json, and a
picture of the confusions of each model.

Ours are trained with every seed, on random folds, on folds of neighbouring sessions, and with a quarter of the
sessions; the parts of the mixture, trees and network, are asked by themselves too, as training them alone gives the
same.  The others are trained on random folds with the first seed.

``thesis`` among the protocols is that of the thesis' program, as far as it can be rebuilt: of every file 60 % of the
sessions to learn from and 40 % to test, drawn once (here by a seed; it had none), features fitted to all sessions, also
those that are tested, states carried from one batch to the next, and half the weight for pairs of slots when testing.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ecat.batch.engines import Workers, usual_jobs
from learn.recognize.crossval import Split, in_order, kept_or, made_of, splits_of, summary
from learn.recognize.dataset import SLOTS, LabelledSession, read_exports
from learn.recognize.evaluation import (
    WAYS,
    Predicted,
    baselines,
    draw_confusions,
    predicted,
    score,
    scores,
    some_of,
)
from learn.recognize.folds import N_FOLDS
from learn.recognize.neural.training import Settings
from learn.recognize.runs import MODELS, Options, train

THESIS: dict[str, float] = {
    "marginals": 6,
    "quant-lstm": 39,
    "quant-lstm-crf": 48,
    "qual-lstm-crf": 60,
}
"""Shares of windows, in per cent, that the thesis reports; for its baseline, each slot is drawn by itself."""
THESIS_SLOTS = {"qual-lstm-crf": (93, 90, 80, 83, 82)}
OURS = ("mixture", "trees", "neural")
"""The first is made of the others."""
NETWORKS = tuple(name for name in MODELS if name not in (*OURS, "hmm", "lds"))
TRAINED_ON = 0.6
CARRIED = ("quant-lstm", "quant-lstm-crf", "qual-lstm-crf", "sparse-lstm-crf")
PROTOCOLS = {
    "random": "random folds",
    "blocks": "folds of neighbouring sessions",
    "quarter": "random folds, a quarter of the sessions",
    "thesis": "the thesis' own",
}
FIGURES = (
    ("windows alone", "mixture", "random", "windows", (91, 93)),
    ("with the session", "mixture", "random", "context", (94, 96)),
    ("folds of neighbouring sessions, windows alone", "mixture", "blocks", "windows", (87, None)),
    ("... with the session", "mixture", "blocks", "context", (91, None)),
    ("trained with a quarter of the sessions, windows alone", "mixture", "quarter", "windows", (80, None)),
    ("network on raw points, windows alone", "neural", "random", "windows", (88, None)),
)
"""What is to be reached, in per cent of windows: as labelled, and without the ten sessions that look inverted."""


@dataclass(frozen=True)
class Job:
    """Models that one training on one split of the sessions gives."""

    models: tuple[str, ...]
    protocol: str
    seed: int
    fold: int

    @property
    def what(self) -> str:
        """Its name for people."""
        return f"{self.models[0]}, {PROTOCOLS[self.protocol]}, seed {self.seed}, fold {self.fold + 1}"

    def file(self, model: str) -> str:
        """Where what a model said is kept."""
        return f"{model}-{self.protocol}-{self.seed}-{self.fold}.npz"

    def split(self, sessions: Sequence[LabelledSession]) -> Split:
        """The sessions that it learns from, and those that are tested."""
        if self.protocol == "thesis":
            return thesis_split(sessions, self.seed)
        known, tested = splits_of(sessions, "blocks" if self.protocol == "blocks" else "random")[self.fold]
        share = 0.25 * N_FOLDS / (N_FOLDS - 1) if self.protocol == "quarter" else 1.0
        return some_of(known, share, seed=self.seed), tested


@dataclass(frozen=True)
class Task:
    """A job, and all that a process of its own has to know to do it."""

    job: Job
    source: Path
    folder: Path
    given: argparse.Namespace


def thesis_split(sessions: Sequence[LabelledSession], seed: int) -> Split:
    """Of every file 60 % of its sessions, shuffled, and the rest."""
    generator = np.random.default_rng(seed)
    known: set[tuple[str, str]] = set()
    for file in sorted({one.file for one in sessions}):
        keys = [one.key for one in sessions if one.file == file]
        order = generator.permutation(len(keys)).tolist()
        known.update(keys[place] for place in order[: int(TRAINED_ON * len(keys))])
    return [one for one in sessions if one.key in known], [one for one in sessions if one.key not in known]


def jobs_of(given: argparse.Namespace) -> list[Job]:
    """All that is to be done: seed by seed, and fold by fold, so that all models have a figure early."""
    ours = tuple(name for name in OURS if name in given.models)
    together = [ours] if "mixture" in ours else [(name,) for name in ours]
    found: list[Job] = []
    for seed in range(given.seeds):
        for protocol in ("random", "blocks", "quarter"):
            found += [Job(models, protocol, seed, fold) for fold in range(N_FOLDS) for models in together]
        if seed == 0:
            others = [name for name in given.models if name not in OURS]
            found += [Job((name,), "random", seed, fold) for fold in range(N_FOLDS) for name in others]
            found += [Job((name,), "thesis", seed, 0) for name in others if name in NETWORKS]
    return found


def options_of(name: str, seed: int, given: argparse.Namespace) -> Options:
    """Sizes are said for the thesis' networks only; ours are trained as they are."""
    if name not in NETWORKS:
        return Options(seed=seed)
    layers = None if name == "mlp" else given.layers
    return Options(seed=seed, epochs=given.epochs, hidden=given.hidden, layers=layers, rate=given.rate)


@cache
def sessions_of(source: Path) -> list[LabelledSession]:
    """Every process reads them once."""
    return read_exports(source)


def said(task: Task) -> dict[str, Predicted]:
    """What each model says: kept, or else asked of what is trained for all of them when the first is asked."""
    job, sessions = task.job, sessions_of(task.source)
    split = job.split(sessions)
    trained: list[Any] = []

    def ask(name: str) -> Predicted:
        if not trained:
            trained.append(_trained(job, split, sessions, task.given))
        part = trained[0] if name == job.models[0] else getattr(trained[0], name)
        return predicted(split[1], part.recognize([one.points for one in split[1]]))

    def kept(name: str) -> Predicted:
        what = made_of(name, options_of(name, job.seed, task.given)) + job.protocol
        return kept_or(lambda *_: ask(name), split, task.folder / job.file(name), what)

    return {name: kept(name) for name in job.models}


def _trained(job: Job, split: Split, sessions: Sequence[LabelledSession], given: argparse.Namespace) -> Any:
    name = job.models[0]
    options = options_of(name, job.seed, given)
    if job.protocol != "thesis":
        return train(name, split[0], options)[0]
    from learn.recognize.neural import recognizer as neural

    settings = replace(options.of_network(name), carries=name in CARRIED, crf_weight=0.5, validation=0.0)
    return neural.train(split[0], settings, fit_to=sessions).recognizer


def do(task: Task) -> tuple[Task, float, float]:
    """See that what the models of a task say is kept; the share of windows that the first gets right, and seconds."""
    started = time.monotonic()
    first = said(task)[task.job.models[0]]
    return task, score(first.true, first.labels["windows"])["tuple"], time.monotonic() - started


def run(tasks: Sequence[Task], n_jobs: int) -> None:
    """Do what is not done yet, and say how long the rest will take."""
    spent: dict[tuple[tuple[str, ...], str], list[float]] = {}
    left = list(tasks)
    done = 0

    def told(result: tuple[Task, float, float]) -> None:
        nonlocal done
        task, right, took = result
        done += 1
        left.remove(task)
        if took > 1:
            spent.setdefault((task.job.models, task.job.protocol), []).append(took)
        usual = float(np.mean([one for times in spent.values() for one in times])) if spent else 0.0
        wait = sum(
            float(np.mean(spent.get((other.job.models, other.job.protocol), [usual]))) for other in left
        )
        print(
            f"{done}/{len(tasks)} {task.job.what}: {100 * right:.1f} % in {took:.0f} s; "
            f"about {wait / n_jobs / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )

    with Workers("processes", n_jobs, ["learn.recognize.runs"]) as workers:
        for _ in workers.run(do, tasks, died=_died, keep=told):
            pass


def _died(task: Task) -> tuple[Task, float, float]:
    raise SystemExit(f"a process ended while it did: {task.job.what}; is there enough memory? Try --jobs 1")


def collected(tasks: Sequence[Task], folder: Path) -> list[dict[str, Any]]:
    """Scores of each model under each protocol, and a picture of what its first seed took for what."""
    groups: dict[tuple[str, str], dict[int, list[Predicted]]] = {}
    for task in tasks:
        for name, words in said(task).items():
            seeds = groups.setdefault((name, task.job.protocol), {})
            seeds.setdefault(task.job.seed, []).append(words)
    rows: list[dict[str, Any]] = []
    for (name, protocol), seeds in groups.items():
        whole = {
            seed: parts[0] if protocol == "thesis" else in_order(parts, sessions_of(tasks[0].source))
            for seed, parts in seeds.items()
        }
        for way in WAYS:
            draw_confusions(next(iter(whole.values())), way, folder / f"{name}-{protocol}-{way}.png")
        scored = summary(list(whole), [scores(one) for one in whole.values()])
        rows.append({"model": name, "protocol": protocol, **scored})
    return rows


def report(rows: Sequence[dict[str, Any]], known: dict[str, Any], given: argparse.Namespace) -> str:
    """The tables, as Markdown."""
    titles = ["model", "protocol", "thesis", "windows alone", *SLOTS, "with the session"]
    lines = [f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}"]
    lines += [_row(name, PROTOCOLS["random"], [one], "-") for name, one in known.items()]
    for row in rows:
        runs = [one["windows"] for one in row["runs"].values()]
        context = _mean_of(row, "context", trusted=False)
        lines.append(_row(row["model"], PROTOCOLS[row["protocol"]], runs, context, row["spread"]["windows"]))
    for name, slots in THESIS_SLOTS.items():
        lines.append(f"| {name} | as reported | {THESIS[name]:.0f} | | {' | '.join(map(str, slots))} | |")
    return "\n".join([*_figures(rows), *lines, *_trusted(rows), "", *_notes(given)]) + "\n"


def _figures(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What is to be reached, and what was."""
    titles = ["what", "reach", "reached", "without the ten: reach", "reached"]
    lines = [f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}"]
    for what, model, protocol, way, (reach, without) in FIGURES:
        for row in rows:
            if (row["model"], row["protocol"]) == (model, protocol):
                parts = [f"{reach} %", _mean_of(row, way, trusted=False)]
                parts += ["" if without is None else f"{without} %", _mean_of(row, way, trusted=True)]
                lines.append(f"| {what} | {' | '.join(parts)} |")
    return [*lines, ""] if len(lines) > 2 else []


def _mean_of(row: dict[str, Any], way: str, *, trusted: bool) -> str:
    runs = list(row["runs"].values())
    if trusted:
        runs = [one["without_suspicious"] for one in runs if "without_suspicious" in one]
    if not runs:
        return ""
    shares = 100 * np.array([one[way]["tuple"] for one in runs])
    return f"{shares.mean():.2f}" + (f" ± {shares.std(ddof=1):.2f}" if len(shares) > 1 else "")


def _trusted(rows: Sequence[dict[str, Any]]) -> list[str]:
    lines = ["", "Without the ten sessions whose labels look inverted:", ""]
    lines += ["| model | protocol | windows alone | with the session |", "|---|---|---|---|"]
    for row in rows:
        shares = [_mean_of(row, way, trusted=True) for way in WAYS]
        if all(shares):
            lines.append(f"| {row['model']} | {PROTOCOLS[row['protocol']]} | {' | '.join(shares)} |")
    return lines


def _notes(given: argparse.Namespace) -> list[str]:
    usual = Settings("")
    size = f"{given.layers or usual.layers} layer(s) of {given.hidden or usual.hidden}"
    how = f"at most {given.epochs or usual.epochs} epochs at a rate of {given.rate or usual.rate}"
    return [
        f"Per cent of windows; of ours the mean of {given.seeds} seed(s) ± standard deviation, of others the first.",
        f"The thesis' networks have {size}, {how};",
        "the thesis tried up to 2 layers of 400 and 200 epochs, rates of 0.05 to 0.5, and reports the best.",
        "On folds, states are not carried from batch to batch, windows are shuffled, a tenth of the training sessions",
        "says when to stop, pairs of slots keep their weight, and nothing is fitted to a session that is tested.",
        "The thesis' own protocol leaks: its features are fitted to the tested sessions too, and there is no third",
        "part on which settings were chosen. Its last windows that fill no batch were not tested; here they are.",
    ]


def _row(name: str, protocol: str, runs: Sequence[dict[str, Any]], context: str, spread: float = 0.0) -> str:
    thesis = f"{THESIS[name]:.0f}" if name in THESIS else "-"
    right = f"{100 * float(np.mean([one['tuple'] for one in runs])):.1f}"
    right += f" ± {100 * spread:.1f}" if len(runs) > 1 else ""
    slots = [f"{100 * np.mean([one['slots'][slot] for one in runs]):.1f}" for slot in runs[0]["slots"]]
    return f"| {name} | {protocol} | {thesis} | {right} | {' | '.join(slots)} | {context} |"


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("--run", type=Path, default=Path("build/results-ch4"))
    parser.add_argument("--seeds", type=int, default=3, help="of ours")
    parser.add_argument("--models", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--jobs", type=int, default=usual_jobs(sys.maxsize), help="trainings at once")
    parser.add_argument("--hidden", type=int, help="units of the thesis' networks, 200 if not given")
    parser.add_argument("--layers", type=int, help="layers of the thesis' LSTMs, 1 if not given")
    parser.add_argument("--epochs", type=int, help="of the thesis' networks, 100 if not given")
    parser.add_argument("--rate", type=float, help="at which the thesis' networks learn, 0.2 if not given")
    parser.add_argument("--no-times", dest="times", action="store_false", help="do not measure speed")
    return parser.parse_args()


def times(source: Path) -> str:
    """How long training takes, and recognising, measured by itself when nothing else is trained."""
    program = [sys.executable, str(Path(__file__).with_name("recognize.py")), str(source)]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True)
    return f"\nSpeed (targets: 10 minutes of training, 2,000 windows/s):\n\n```\n{done.stdout}```\n"


def main() -> None:
    """Train, recognise, report."""
    given = arguments()
    given.run.mkdir(parents=True, exist_ok=True)
    tasks = [Task(job, given.source, given.run, given) for job in jobs_of(given)]
    run(tasks, given.jobs)
    rows = collected(tasks, given.run)
    known = baselines(splits_of(sessions_of(given.source), "random"))
    text = report(rows, known, given) + (times(given.source) if given.times else "")
    (given.run / "report.md").write_text(text, "utf-8")
    data = {"rows": rows, "baselines": known, "options": asdict(options_of("qual-lstm-crf", 0, given))}
    (given.run / "report.json").write_text(json.dumps(data, indent=1) + "\n", "utf-8")
    print(text)


if __name__ == "__main__":
    main()
